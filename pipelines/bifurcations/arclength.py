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
    Limit,
    Record,
)
from pipelines.bifurcations.detection import (
    DetectionOptions,
    Event,
    EventKind,
    LocationStop,
    evaluate_tests,
    explains,
    kinds_between,
    locate,
    unstable_count,
)
from pipelines.bifurcations.dips import dips_inside, may_be_crossed
from pipelines.bifurcations.segment import Metric, Segment, metric_of
from pipelines.bifurcations.walking import STEP_GROWTH, adapted_length, is_start, passes_start, period_scale
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import (
    Constraint,
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
from pipelines.orbits.time_steps import StepDemand, first_steps, following_steps, step_demand

_NO_DEMAND = StepDemand(0, math.nan)  # of a correction without a cycle
_TWICE = "a multiplier crosses the unit circle and returns within the step"
_UNEXPLAINED = "the number of unstable multipliers changes without an event to explain it"


def continue_branch(
    problem: CycleProblem,
    start: BranchStart | BranchState,
    options: ContinuationOptions,
    record: Record,
    limit: Limit | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BranchResult:
    """Trace a branch of cycles from a guess, or go on from a recorded state.

    ``record(point, state, events)`` is called once per accepted point, with the events between the previous
    point and this one; ``state`` is all that is needed to restart after it.  ``limit(point)`` returns a
    sentence when the point must not be accepted (journal touches the foil), which ends the branch before it.
    ``should_stop()`` is asked after each recorded point.  The last point lies exactly on the end of the
    range, and that of a closed branch on its first point.  Raises ValueError when the start lies outside the
    range; every other failure is a BranchResult.
    """
    if isinstance(start, BranchState):
        state = start
    else:
        opened = _open_branch(problem, start, options)
        if isinstance(opened, BranchResult):
            return opened
        point, state = opened
        if limit is not None and (message := limit(point)) is not None:
            return BranchResult(BranchStop.LIMIT, None, message)
        record(point, state, ())
    metric = _metric_from(problem, options, state.start)
    while (stop := _stop_reason(state, options, metric)) is None:
        if should_stop is not None and should_stop():
            return BranchResult(BranchStop.INTERRUPTED, state)
        step = _attempt(problem, state, options, metric)
        if isinstance(step, _Rejected):
            if 0.5 * state.step < options.minimum_step:
                return BranchResult(BranchStop.MINIMUM_STEP, state, step.message)
            state = replace(state, step=0.5 * state.step)
            continue
        if limit is not None and (message := limit(step.point)) is not None:
            return BranchResult(BranchStop.LIMIT, state, message)
        state = _advance(problem, state, step, options)
        record(step.point, state, step.events)
    return BranchResult(stop, state)


@dataclass(frozen=True)
class _Step:
    """An accepted step: the point, the piece of branch that leads to it and the events on it."""

    point: BranchPoint
    segment: Segment
    events: tuple[Event, ...]


@dataclass(frozen=True)
class _Rejected:
    message: str


def _open_branch(
    problem: CycleProblem, start: BranchStart, options: ContinuationOptions
) -> tuple[BranchPoint, BranchState] | BranchResult:
    """Correct the guess at its fixed parameter and orient the branch."""
    if not options.range[0] <= start.parameter <= options.range[1]:
        raise ValueError(
            f"the start {problem.parameter} = {start.parameter} lies outside the range {options.range}"
        )
    guess = problem.consistent(Unknowns(np.array(start.state, dtype=float), start.period, start.parameter))
    steps = first_steps(problem, guess)
    if isinstance(steps, NewtonStop):
        return BranchResult(BranchStop.START_FAILED, None, steps.advice)
    reference = reference_of(problem, guess, steps)
    basis = first_basis(problem, guess, steps)
    correction = correct(problem, guess, problem.fixed_parameter(start.parameter), basis, steps, reference)
    demand = _NO_DEMAND if correction.cycle is None else step_demand(problem, correction.cycle)
    while correction.cycle is not None and demand.steps > steps:
        guess, steps = correction.cycle.unknowns, demand.steps
        reference = reference_of(problem, guess, steps)
        correction = correct(
            problem, guess, problem.fixed_parameter(start.parameter), correction.cycle.basis, steps, reference
        )
        demand = _NO_DEMAND if correction.cycle is None else step_demand(problem, correction.cycle)
    cycle = correction.cycle
    if cycle is None:
        return BranchResult(BranchStop.START_FAILED, None, correction.advice)
    row = Unknowns(np.zeros(problem.period_map.size), 0.0, float(options.direction))
    tangent = tangent_at(problem, cycle, row, reference)
    if tangent is None:
        return BranchResult(BranchStop.START_FAILED, None, "the parameter turns at the first point")
    at = cycle.unknowns
    tangent = tangent.scaled(1.0 / _metric_from(problem, options, at).norm(tangent))
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
        steps=steps,
        step_error=demand.error,
        basis=following_basis(problem, cycle),
        multipliers=cycle.spectrum.multipliers,
        previous_multipliers=np.zeros(0, dtype=complex),
        previous_arclength=0.0,
        start_state=at.state,
        start_period=at.period,
        start_parameter=at.parameter,
    )
    return _point(problem, correction, cycle, demand, _Found()), state


def _metric_from(problem: CycleProblem, options: ContinuationOptions, first: Unknowns) -> Metric:
    """The metric of a branch with this first cycle."""
    period = period_scale(first.state, first.period, options.maximum_step)
    return metric_of(problem, options.parameter_scale, period)


def _stop_reason(state: BranchState, options: ContinuationOptions, metric: Metric) -> BranchStop | None:
    """Why nothing follows a state; told by the state alone, so that a restart from it ends at once."""
    if _returned(state, state.unknowns, metric):
        return BranchStop.CLOSED
    low, high = options.range
    outward_high = state.parameter >= high and state.tangent_parameter > 0.0
    outward_low = state.parameter <= low and state.tangent_parameter < 0.0
    if outward_high or outward_low:
        return BranchStop.RANGE
    return BranchStop.MAXIMUM_POINTS if state.index + 1 >= options.max_points else None


def _attempt(
    problem: CycleProblem, state: BranchState, options: ContinuationOptions, metric: Metric
) -> _Step | _Rejected:
    """One step: predict, correct, test, locate.  Rejected means that the step is too long."""
    steps = following_steps(problem, state.steps, state.step_error)
    reference = reference_of(problem, state.unknowns, steps)
    correction, demand = _predict_and_correct(problem, state, options, metric, steps, reference)
    segment = _segment(problem, state, options, metric, correction, reference)
    if isinstance(segment, _Rejected):
        return segment
    if _passes_start(state, segment):
        landing = _land_on_start(segment, state, correction)
        if landing.cycle is not None and _returned(state, landing.cycle.unknowns, metric):
            correction = landing
            segment = _segment(problem, state, options, metric, landing, reference)
            if isinstance(segment, _Rejected):
                return segment
    shortest = _is_shortest(state, options)
    found = _events(segment, options.detection, accept_anyway=shortest)
    if isinstance(found, _Rejected):
        return found
    if dips_inside(segment, state.previous_multipliers, state.arclength - state.previous_arclength):
        if not shortest:
            return _Rejected(_TWICE)
        found = replace(found, unexplained=True)
    return _Step(_point(problem, correction, segment.end, demand, found), segment, found.located)


def _is_shortest(state: BranchState, options: ContinuationOptions) -> bool:
    return 0.5 * state.step < options.minimum_step


def _segment(
    problem: CycleProblem,
    state: BranchState,
    options: ContinuationOptions,
    metric: Metric,
    correction: Correction,
    reference: PhaseReference | None,
) -> Segment | _Rejected:
    """The piece of branch from a state to a corrected cycle, unless it is too long to be one piece."""
    cycle = correction.cycle
    if cycle is None:
        return _Rejected(correction.advice)
    chord = cycle.unknowns.minus(state.unknowns)
    if metric.norm(chord) == 0.0:
        return _Rejected("the corrector returned to the previous point")
    tangent = tangent_at(problem, cycle, metric.row(chord), reference)
    if tangent is None:
        return _Rejected("the tangent is singular")
    tangent = tangent.scaled(1.0 / metric.norm(tangent))
    segment = Segment(
        problem,
        metric,
        state.unknowns,
        state.tangent,
        state.multipliers,
        cycle,
        tangent,
        state.basis,
        reference,
    )
    crossed = may_be_crossed(segment, state.previous_multipliers, state.arclength - state.previous_arclength)
    rule = StepRule(options.minimum_cosine, crossed=crossed)
    message = refusal(metric, state.tangent, chord, tangent, rule, segment.missed_at)
    return segment if message is None else _Rejected(message)


def _predict_and_correct(
    problem: CycleProblem,
    state: BranchState,
    options: ContinuationOptions,
    metric: Metric,
    steps: int,
    reference: PhaseReference | None,
) -> tuple[Correction, StepDemand]:
    """Tangent predictor and arclength corrector; past the end of the range the parameter is fixed to it
    instead.  Repeated with more time steps when the cycle asks for them.
    """
    row = metric.row(state.tangent)
    guess = state.unknowns.plus(state.tangent, state.step)
    constraint = Constraint(row, row.dot(state.unknowns) + state.step)
    bound = _bound_passed(guess.parameter, options.range)
    if bound is None:
        correction = correct(problem, guess, constraint, state.basis, steps, reference)
        if correction.cycle is None:
            return correction, _NO_DEMAND
        guess = correction.cycle.unknowns
        bound = _bound_passed(guess.parameter, options.range)
    if bound is not None:
        share = (bound - state.parameter) / (guess.parameter - state.parameter)
        guess = state.unknowns.plus(guess.minus(state.unknowns), share)
        constraint = problem.fixed_parameter(bound)
        correction = correct(problem, guess, constraint, state.basis, steps, reference)
    if correction.cycle is None:
        return correction, _NO_DEMAND
    demand = step_demand(problem, correction.cycle)
    if demand.steps <= steps:
        return correction, demand
    guess, grown = correction.cycle.unknowns, problem.period_map.rounded_steps(STEP_GROWTH * demand.steps)
    again = correct(problem, guess, constraint, correction.cycle.basis, grown, reference)
    demand = _NO_DEMAND if again.cycle is None else step_demand(problem, again.cycle)
    return _one_history(correction, again), demand


def _one_history(first: Correction, second: Correction) -> Correction:
    """The second correction with the history of both: the step length must follow the whole effort, not that
    of the last touch.
    """
    return replace(
        second,
        residual_norms=first.residual_norms + second.residual_norms,
        update_norms=first.update_norms + second.update_norms,
    )


def _bound_passed(parameter: float, interval: tuple[float, float]) -> float | None:
    if parameter > interval[1]:
        return interval[1]
    return interval[0] if parameter < interval[0] else None


@dataclass(frozen=True)
class _Found:
    """Events of a segment: located, in order along it; detected only; and whether some must be missing."""

    located: tuple[Event, ...] = ()
    unlocated: tuple[EventKind, ...] = ()
    unexplained: bool = False


def _events(segment: Segment, options: DetectionOptions, accept_anyway: bool) -> _Found | _Rejected:
    """Detect and locate the events of a segment.  Rejected means that it must be shorter to tell them
    apart.
    """
    autonomous = segment.problem.period_map.autonomous
    before = evaluate_tests(segment.start_multipliers, autonomous)
    after = evaluate_tests(segment.end.spectrum.multipliers, autonomous)
    kinds = tuple(kind for kind in kinds_between(segment, before, after) if kind in options.kinds)
    complete = len(options.kinds) == len(EventKind)
    if complete and not accept_anyway and not explains(before, after, kinds):
        return _Rejected(_UNEXPLAINED)
    events: list[Event] = []
    unlocated: list[EventKind] = []
    for kind in kinds:
        outcome, event = locate(segment, kind, options)
        if event is not None:
            events.append(event)
        elif outcome is not LocationStop.NEUTRAL_SADDLE:
            if not accept_anyway:
                return _Rejected(outcome.value)
            unlocated.append(kind)
    confirmed = (*(event.kind for event in events), *unlocated)
    unexplained = complete and not explains(before, after, confirmed, confirmed=True)
    if unexplained and not accept_anyway:
        return _Rejected(_UNEXPLAINED)
    return _Found(tuple(sorted(events, key=lambda event: event.fraction)), tuple(unlocated), unexplained)


def _point(
    problem: CycleProblem, correction: Correction, cycle: Cycle, demand: StepDemand, found: _Found
) -> BranchPoint:
    return BranchPoint(
        cycle,
        unstable_count(cycle.spectrum.multipliers, problem.period_map.autonomous),
        correction.residual_norms,
        correction.update_norms,
        demand.error,
        found.unlocated,
        found.unexplained,
    )


def _passes_start(state: BranchState, segment: Segment) -> bool:
    """Whether the segment passes through, or stops just before, the first point of the branch, which it has
    left before.
    """
    offset = state.start.minus(segment.start)
    fraction = segment.metric.inner(offset, segment.chord) / segment.length**2
    return passes_start(
        state.arclength,
        segment.length,
        fraction,
        lambda at: segment.metric.norm(state.start.minus(segment.guess(at))),
    )


def _land_on_start(segment: Segment, state: BranchState, correction: Correction) -> Correction:
    """The cycle in the plane through the first point across the segment, with the history of the one that
    led there.
    """
    row = segment.metric.row(segment.chord)
    constraint = Constraint(row, row.dot(state.start))
    landing = correct(
        segment.problem, state.start, constraint, segment.basis, segment.end.steps, segment.reference
    )
    return _one_history(correction, landing)


def _returned(state: BranchState, at: Unknowns, metric: Metric) -> bool:
    """Whether ``at`` is the first point again."""
    return is_start(state.arclength, state.step, metric.norm(at.minus(state.start)))


def _advance(
    problem: CycleProblem, state: BranchState, step: _Step, options: ContinuationOptions
) -> BranchState:
    """The state after an accepted step; the step length follows the Newton count."""
    cycle, tangent = step.segment.end, step.segment.end_tangent
    length = adapted_length(
        state.step,
        step.point.iterations,
        options.target_iterations,
        options.minimum_step,
        options.maximum_step,
    )
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
        basis=following_basis(problem, cycle),
        multipliers=cycle.spectrum.multipliers,
        previous_multipliers=state.multipliers,
        previous_arclength=state.arclength,
    )
