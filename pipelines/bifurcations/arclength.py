"""Pseudo-arclength continuation of cycles: predict, correct, test, locate, store, adapt.

In the space u = (s, T, lambda) a point follows u_0 with unit tangent t at distance h when

    phi(s, T, lambda) - s = 0,    phase(s) = 0,    <t, u - u_0> = h
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.acceptance import StepRule, refusal
from pipelines.bifurcations.branch import (
    BranchPoint,
    BranchResult,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
)
from pipelines.bifurcations.continuation import (
    STEP_GROWTH,
    Limit,
    Record,
    Rejected,
    Tracer,
    adapted_length,
    bound_passed,
    extrapolated,
    follow,
    leaves_ranges,
    one_history,
    period_scale,
    returned,
    steps_of,
    told_error,
)
from pipelines.bifurcations.cycles.double_crossings import dips_inside, may_be_crossed
from pipelines.bifurcations.cycles.segment import BranchMetric, Segment, metric_of
from pipelines.bifurcations.detection import (
    DetectionOptions,
    Event,
    EventKind,
    evaluate_tests,
    explains,
    kinds_between,
    unstable_count,
)
from pipelines.bifurcations.location import LocationStop, locate
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import (
    Correction,
    Cycle,
    CycleProblem,
    NewtonStop,
    Unknowns,
    correct,
    first_basis,
    following_basis,
    reference_of,
    tangent_at,
)
from pipelines.orbits.time_steps import RequiredSteps, first_steps, next_steps, required_steps
from pipelines.orbits.vectors import Constraint

_NO_STEPS = RequiredSteps(0, math.nan)  # of a correction without a cycle
_TWICE = "a multiplier crosses the unit circle and returns within the step"
_UNEXPLAINED = "the number of unstable multipliers changes without an event to explain it"


def continue_branch(
    problem: CycleProblem,
    start: BranchStart | BranchState,
    options: ContinuationOptions,
    record: Record[BranchPoint, BranchState, Event],
    limit: Limit[BranchPoint] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BranchResult:
    """Trace a branch of cycles from a guess, or resume it from a recorded state.

    ``record(point, state, events)`` is called once per accepted point, with the events between the previous
    point and this one; ``state`` is all that is needed to restart after it.  ``limit(point)`` returns a
    sentence when the point must not be accepted (journal touches the foil), which ends the branch before it.
    ``should_stop()`` is asked after each recorded point.  The last point lies exactly on the end of the
    range, and that of a closed branch on its first point.  Raises ValueError when the start lies outside the
    range; every other failure is a BranchResult.
    """
    return follow(_Branch(problem, options), start, record, limit, should_stop)


@dataclass(frozen=True)
class _Step:
    """An accepted step: its point, the piece of branch that leads to it, and the events on that piece."""

    point: BranchPoint
    segment: Segment
    found: tuple[Event, ...]


@dataclass(frozen=True)
class _Branch(Tracer[BranchState, _Step]):
    """A branch of cycles as the driver sees it."""

    problem: CycleProblem
    options: ContinuationOptions
    stops = BranchStop

    def open(self, start: BranchStart) -> tuple[BranchPoint, BranchState] | Rejected:
        """Correct the guess at its fixed parameter and orient the branch."""
        problem, options = self.problem, self.options
        if not options.range[0] <= start.parameter <= options.range[1]:
            raise ValueError(
                f"the start {problem.parameter} = {start.parameter} lies outside the range {options.range}"
            )
        first = _first_cycle(problem, start)
        if isinstance(first, Rejected):
            return first
        correction, cycle, required, reference = first
        row = Unknowns(np.zeros(problem.period_map.size), 0.0, float(options.direction))
        tangent = tangent_at(problem, cycle, row, reference)
        if tangent is None:
            return Rejected("the parameter turns at the first point")
        at = cycle.unknowns
        tangent = self._metric(at).unit(tangent)
        state = BranchState(
            index=0,
            state=at.state,
            period=at.period,
            parameter=at.parameter,
            tangent_state=tangent.state,
            tangent_period=tangent.period,
            tangent_parameter=tangent.parameter,
            step=options.step,
            arclength=0.0,
            steps=cycle.steps,
            step_error=required.error,
            coarser_error=required.coarser,
            basis=following_basis(problem, cycle),
            multipliers=cycle.spectrum.multipliers,
            previous_state=at.state,
            previous_period=at.period,
            previous_parameter=at.parameter,
            previous_tangent_state=tangent.state,
            previous_tangent_period=tangent.period,
            previous_tangent_parameter=tangent.parameter,
            previous_multipliers=np.zeros(0, dtype=complex),
            previous_arclength=0.0,
            start_state=at.state,
            start_period=at.period,
            start_parameter=at.parameter,
        )
        return _point(problem, correction, cycle, required, _Found()), state

    def stop_reason(self, state: BranchState) -> BranchStop | None:
        """Why the branch ends at a state; None if it continues."""
        if returned(state, state.unknowns, self._metric(state.start)):
            return BranchStop.CLOSED
        if leaves_ranges((state.parameter,), (state.tangent_parameter,), (self.options.range,)):
            return BranchStop.RANGE
        return BranchStop.MAXIMUM_POINTS if state.index + 1 >= self.options.max_points else None

    def attempt(self, state: BranchState) -> _Step | Rejected:
        """One step: predict, correct, test, locate."""
        steps = next_steps(self.problem, steps_of(state))
        reference = reference_of(self.problem, state.unknowns, steps)
        correction, required = self._predict_and_correct(state, steps, reference)
        segment = self._segment(state, correction, reference)
        if isinstance(segment, Rejected):
            return segment
        if segment.passes(state.start, state.arclength):
            landing = _land_on_start(segment, state, correction)
            if landing.cycle is not None and returned(state, landing.cycle.unknowns, segment.metric):
                correction = landing
                segment = self._segment(state, landing, reference)
                if isinstance(segment, Rejected):
                    return segment
        shortest = self.is_shortest(state)
        found = _events(segment, self.options.detection, accept_anyway=shortest)
        if isinstance(found, Rejected):
            return found
        if dips_inside(segment, state.previous_multipliers, state.arclength - state.previous_arclength):
            if not shortest:
                return Rejected(_TWICE)
            found = replace(found, unexplained=True)
        return _Step(_point(self.problem, correction, segment.end, required, found), segment, found.located)

    def advance(self, state: BranchState, step: _Step) -> BranchState:
        """The state after an accepted step; the step length follows the Newton count."""
        cycle, tangent = step.segment.end, step.segment.end_tangent
        length = adapted_length(state.step, step.point.iterations, self.options)
        return replace(
            state,
            index=state.index + 1,
            state=cycle.unknowns.state,
            period=cycle.unknowns.period,
            parameter=cycle.unknowns.parameter,
            tangent_state=tangent.state,
            tangent_period=tangent.period,
            tangent_parameter=tangent.parameter,
            step=length,
            arclength=state.arclength + step.segment.length,
            steps=cycle.steps,
            step_error=step.point.step_error,
            coarser_error=step.point.coarser_error,
            basis=following_basis(self.problem, cycle),
            multipliers=cycle.spectrum.multipliers,
            previous_state=state.state,
            previous_period=state.period,
            previous_parameter=state.parameter,
            previous_tangent_state=state.tangent_state,
            previous_tangent_period=state.tangent_period,
            previous_tangent_parameter=state.tangent_parameter,
            previous_multipliers=state.multipliers,
            previous_arclength=state.arclength,
        )

    def _metric(self, first: Unknowns) -> BranchMetric:
        """The metric of a branch with this first cycle."""
        period = period_scale(first.state, first.period, self.options.maximum_step)
        return metric_of(self.problem, self.options.parameter_scale, period)

    def _segment(
        self, state: BranchState, correction: Correction, reference: PhaseReference | None
    ) -> Segment | Rejected:
        """The piece of branch from a state to a corrected cycle, or the reason why the step is too long."""
        cycle, metric = correction.cycle, self._metric(state.start)
        if cycle is None:
            return Rejected(correction.advice)
        chord = cycle.unknowns.minus(state.unknowns)
        if metric.norm(chord) == 0.0:
            return Rejected("the corrector returned to the previous point")
        tangent = tangent_at(self.problem, cycle, metric.row(chord), reference)
        if tangent is None:
            return Rejected("the tangent is singular")
        tangent = metric.unit(tangent)
        segment = Segment(
            self.problem,
            metric,
            state.unknowns,
            state.tangent,
            state.multipliers,
            cycle,
            tangent,
            state.basis,
            reference,
        )
        before = state.arclength - state.previous_arclength
        crossed = may_be_crossed(segment, state.previous_multipliers, before)
        rule = StepRule(self.options.minimum_cosine, crossed=crossed)
        message = refusal(metric, state.tangent, chord, tangent, rule, segment.missed_at)
        return segment if message is None else Rejected(message)

    def _predict_and_correct(
        self, state: BranchState, steps: int, reference: PhaseReference | None
    ) -> tuple[Correction, RequiredSteps]:
        """Correct the prediction on the arclength row.

        Beyond the end of the range the parameter is fixed to that end instead.  Repeated with more
        time steps when the cycle asks for them.
        """
        problem, ranges = self.problem, (self.options.range,)
        row = self._metric(state.start).row(state.tangent)
        # each point has a phase condition of its own if the period is unknown: no cubic through two of them
        free = problem.period_map.autonomous
        length = 0.0 if free else state.arclength - state.previous_arclength
        guess = extrapolated(state.previous, (state.unknowns, state.tangent), length, state.step)
        constraint = Constraint(row, row.dot(state.unknowns) + state.step)
        passed = bound_passed((guess.parameter,), ranges)
        if passed is None:
            correction = correct(problem, guess, constraint, state.basis, steps, reference)
            if correction.cycle is None:
                return correction, _NO_STEPS
            guess = correction.cycle.unknowns
            passed = bound_passed((guess.parameter,), ranges)
        if passed is not None:
            bound = passed[1]
            share = (bound - state.parameter) / (guess.parameter - state.parameter)
            guess = state.unknowns.plus(guess.minus(state.unknowns), share)
            constraint = problem.fixed_parameter(bound)
            correction = correct(problem, guess, constraint, state.basis, steps, reference)
        if correction.cycle is None:
            return correction, _NO_STEPS
        required = required_steps(problem, correction.cycle, told_error(state))
        if required.steps <= steps:
            return correction, required
        steps = problem.period_map.rounded_steps(STEP_GROWTH * required.steps)
        guess, basis = correction.cycle.unknowns, correction.cycle.basis
        again = correct(problem, guess, constraint, basis, steps, reference)
        required = _NO_STEPS if again.cycle is None else required_steps(problem, again.cycle)
        return one_history(correction, again), required


def _first_cycle(
    problem: CycleProblem, start: BranchStart
) -> tuple[Correction, Cycle, RequiredSteps, PhaseReference | None] | Rejected:
    """The cycle at the parameter of a guess, with as many time steps as it asks for."""
    guess = problem.consistent(Unknowns(np.array(start.state, dtype=float), start.period, start.parameter))
    steps = first_steps(problem, guess)
    if isinstance(steps, NewtonStop):
        return Rejected(steps.advice)
    basis, constraint = first_basis(problem, guess, steps), problem.fixed_parameter(start.parameter)
    while True:
        reference = reference_of(problem, guess, steps)
        correction = correct(problem, guess, constraint, basis, steps, reference)
        if correction.cycle is None:
            return Rejected(correction.advice)
        required = required_steps(problem, correction.cycle)
        if required.steps <= steps:
            return correction, correction.cycle, required, reference
        guess, basis, steps = correction.cycle.unknowns, correction.cycle.basis, required.steps


@dataclass(frozen=True)
class _Found:
    """Events of a segment: located ones in order, those only detected, and whether some must be missing."""

    located: tuple[Event, ...] = ()
    unlocated: tuple[EventKind, ...] = ()
    unexplained: bool = False


def _events(segment: Segment, options: DetectionOptions, accept_anyway: bool) -> _Found | Rejected:
    """Detect and locate the events of a segment.

    Rejected means that the segment must be shorter to distinguish them.
    """
    autonomous = segment.problem.period_map.autonomous
    before = evaluate_tests(segment.start_multipliers, autonomous)
    after = evaluate_tests(segment.end.spectrum.multipliers, autonomous)
    kinds = tuple(kind for kind in kinds_between(segment, before, after) if kind in options.kinds)
    complete = len(options.kinds) == len(EventKind)
    if complete and not accept_anyway and not explains(before, after, kinds):
        return Rejected(_UNEXPLAINED)
    events: list[Event] = []
    unlocated: list[EventKind] = []
    for kind in kinds:
        outcome, event = locate(segment, kind, options)
        if event is not None:
            events.append(event)
        elif outcome is not LocationStop.NEUTRAL_SADDLE:
            if not accept_anyway:
                return Rejected(outcome.value)
            unlocated.append(kind)
    confirmed = (*(event.kind for event in events), *unlocated)
    unexplained = complete and not explains(before, after, confirmed, confirmed=True)
    if unexplained and not accept_anyway:
        return Rejected(_UNEXPLAINED)
    return _Found(tuple(sorted(events, key=lambda event: event.fraction)), tuple(unlocated), unexplained)


def _point(
    problem: CycleProblem, correction: Correction, cycle: Cycle, required: RequiredSteps, found: _Found
) -> BranchPoint:
    return BranchPoint(
        cycle,
        unstable_count(cycle.spectrum.multipliers, problem.period_map.autonomous),
        correction.residual_norms,
        correction.update_norms,
        required.error,
        required.coarser,
        found.unlocated,
        found.unexplained,
    )


def _land_on_start(segment: Segment, state: BranchState, correction: Correction) -> Correction:
    """The cycle in the plane through the first point across the segment.

    Its history includes the history of the correction that led there.
    """
    row = segment.metric.row(segment.chord)
    constraint = Constraint(row, row.dot(state.start))
    landing = correct(
        segment.problem, state.start, constraint, segment.basis, segment.end.steps, segment.reference
    )
    return one_history(correction, landing)
