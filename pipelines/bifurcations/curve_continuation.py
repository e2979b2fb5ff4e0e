"""Period-doubling, Neimark-Sacker and fold curves: predict, correct, test, locate, record, adapt.

On the surface of cycles over two parameters (``pipelines.bifurcations.plane``) a point follows u_0 with unit
tangent t at distance h when, with the test function g of ``pipelines.bifurcations.critical.critical_cycles``,

    phi(s, T, lambda) - s = 0,    phase(s) = 0,    g(s, T, lambda) = 0,    <t, u - u_0> = h
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pipelines.bifurcations.acceptance import StepRule, refusal
from pipelines.bifurcations.continuation import (
    STEP_GROWTH,
    Limit,
    Record,
    Rejected,
    Tracer,
    bound_passed,
    follow,
    leaves_ranges,
    one_history,
    returned,
    steps_of,
    told_error,
)
from pipelines.bifurcations.critical.correction import CurveConstraint, CurveCorrection
from pipelines.bifurcations.critical.corrector import correct_critical
from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveResult,
    CurveStart,
    CurveState,
    CurveStop,
    SpecialKind,
    SpecialPoint,
)
from pipelines.bifurcations.curves.codimension_two import (
    crossed,
    resonant_end,
    unstable_others,
    without_rounding,
)
from pipelines.bifurcations.curves.double_passages import dip_through
from pipelines.bifurcations.curves.first_point import (
    columns_of,
    curve_metric,
    required_steps_of,
    start_curve,
    with_errors,
)
from pipelines.bifurcations.curves.kinks import attempt_past_kinks, next_length, short_step, shortest_step
from pipelines.bifurcations.curves.segment import (
    Bracket,
    CurveEnd,
    CurveSegment,
    CurveStep,
    SegmentPoints,
    curve_end,
    locate_special,
    with_normal_form,
)
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.curves.tongues import both_sides, dips, ends_inside
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.plane import CurveProblem, PlaneMetric, Position
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import NewtonStop, reference_of
from pipelines.orbits.system import Vector
from pipelines.orbits.time_steps import RequiredSteps, next_steps

# The error that time steps leave is noisy beside kinks: a point is corrected again only where it is clearly
# too large, else the next one has more steps.
_REPEATED = 3.0
_MISSED = 0.25  # share of the defect of a step by which the cubic may miss the curve, also beside a kink
_STUCK = 0.25  # of a step in which the test function does not get smaller
_RECENT = 10  # points that a curve may be near to because it has just left them
_BEFORE = 0.45  # of the distance to an unresolved tongue: no step of 1 to 2 times that ends in it afterwards
_IN_A_TONGUE = "the step ends inside a tongue that the error of the multipliers hides"
_STARTED = 5e-3  # share of its change in a step within which a test at the first point is zero there


def continue_curve(
    problem: CurveProblem,
    start: CurveStart | CurveState,
    options: CurveOptions,
    record: Record[CurvePoint, CurveState, SpecialPoint],
    limit: Limit[CurvePoint] | None = None,
    should_stop: Callable[[], bool] | None = None,
    traced: Mapping[str, KnownCurve] | None = None,
    own: KnownCurve | None = None,
) -> CurveResult:
    """Trace a bifurcation curve from a guess, or resume it from a recorded state.

    ``record(point, state, specials)`` is called once per accepted point, with the special points between the
    previous point and this one; ``state`` is all that is needed to restart after it.  ``limit(point)``
    returns a sentence when the point must not be accepted, which ends the curve before it.  ``should_stop()``
    is asked after each recorded point.  The curve ends where it runs along one of the ``traced`` ones of the
    same kind and period, or along itself: beside a kink of the equations it may change to another curve and
    come into a loop that its first point is not on.  ``own``: the points recorded before a restart.  The last
    point lies exactly on the end of a range, on R1 or R2 of a Neimark-Sacker curve, or on the first point of
    a closed curve.  Raises ValueError when the start lies outside the ranges; every other failure is a
    CurveResult.
    """
    tracer = _Curve(problem, options, traced or {}, own)
    if isinstance(start, CurveState) and own is None:
        tracer.remember(start)

    def remembered(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        tracer.remember(state)
        record(point, state, specials)

    return follow(tracer, start, remembered, limit, should_stop)


class _Curve(Tracer[CurveState, CurveStep]):
    """A bifurcation curve as the driver sees it; it keeps its points to detect when it meets itself."""

    stops = CurveStop

    def __init__(
        self,
        problem: CurveProblem,
        options: CurveOptions,
        traced: Mapping[str, KnownCurve],
        own: KnownCurve | None,
    ) -> None:
        self.problem = problem
        self.options = options
        self._traced = traced
        self._own = own
        self._in_vain: set[int] = set()

    def remember(self, state: CurveState) -> None:
        """Add a recorded point to those that the curve may meet again."""
        self._own = KnownCurve.of([state]) if self._own is None else self._own.with_point(state)

    def open(self, start: CurveStart) -> tuple[CurvePoint, CurveState] | Rejected:
        """Correct the guess at right angles to the curve and orient the curve."""
        try:
            return start_curve(self.problem, start, self.options)
        except np.linalg.LinAlgError:
            return Rejected("a matrix of the first point is singular")

    def stop_reason(self, state: CurveState) -> CurveStop | None:
        """Why the curve ends at a state; None if it continues."""
        if returned(state, state.position, curve_metric(self.problem, self.options, state.start)):
            return CurveStop.CLOSED
        if state.index > 0 and (end := resonant_end(self.problem.kind, state.cos_theta)) is not None:
            return CurveStop.RESONANCE_1 if end is SpecialKind.R1 else CurveStop.RESONANCE_2
        if leaves_ranges(state.parameters, state.tangent_parameters, self.options.ranges):
            return CurveStop.RANGE
        return CurveStop.MAXIMUM_POINTS if state.index + 1 >= self.options.max_points else None

    def attempt(self, state: CurveState) -> CurveStep | Rejected:
        """One step: predict, correct, test, locate; past a kink of the equations on regularised maps."""
        return attempt_past_kinks(
            self.problem, state, self.options, self._attempt, self.advance, self._in_vain
        )

    def shortest_step(self, state: CurveState) -> float:
        """The shortest step from a state; shorter on smoother maps."""
        return shortest_step(self.options, state)

    def ends_before(self, state: CurveState, step: CurveStep) -> tuple[CurveStop, str] | None:
        """Whether the curve runs along a known one or along itself, or bounds no stable cycles."""
        unstable = unstable_others(
            self.problem.kind,
            step.point.cycle.spectrum.multipliers,
            step.point.cos_theta,
            self.problem.period_map.autonomous,
        )
        if self.options.boundary and unstable > 0 and (state.index == 0 or not step.found):
            return CurveStop.LEAVES_BOUNDARY, "the cycles on both sides are unstable"
        name = _along(state, step.end, unstable, self._traced, self.options)
        metric = curve_metric(self.problem, self.options, state.start)
        if name is None and self._own is not None and not returned(state, step.end.position, metric):
            itself = {"itself": self._own.without_last(_RECENT)}
            # without the count, which is known only of the points before a restart
            name = _along(state, step.end, None, itself, self.options, same_sense=True)
        return None if name is None else (CurveStop.TRACED, f"it runs along {name}")

    def advance(self, state: CurveState, step: CurveStep) -> CurveState:
        """The state after an accepted step; the step length follows the count of the corrector."""
        state = step.begin
        bend = step.end.tangent.minus(state.tangent).scaled(1.0 / step.length)
        return replace(
            state,
            bend_state=bend.state,
            bend_period=bend.period,
            bend_parameters=bend.parameters,
            index=state.index + 1,
            step=next_length(step, self.options),
            arclength=state.arclength + step.length,
            previous_tests=state.tests,
            previous_arclength=state.arclength,
            clipping_width=step.point.clipping_width,
            **columns_of(self.problem, step.end),
        )

    def _attempt(self, problem: CurveProblem, state: CurveState) -> CurveStep | Rejected:
        steps = next_steps(problem.cycle_problem(state.position), steps_of(state))
        # other time steps move the curve, perhaps by more than a short step
        if not self.options.fewer_time_steps or state.step < short_step(self.options):
            steps = max(steps, state.steps)
        try:
            return self._step(problem, state, steps)
        except np.linalg.LinAlgError:
            return Rejected("a matrix of the step is singular")

    def _step(self, problem: CurveProblem, state: CurveState, steps: int) -> CurveStep | Rejected:
        options = self.options
        metric = curve_metric(problem, options, state.start)
        cycles, unknowns = problem.cycle_problem(state.position), problem.unknowns(state.position)
        reference = reference_of(cycles, unknowns, steps)
        segment = _predict_and_correct(problem, state, options, metric, steps, reference)
        if isinstance(segment, Rejected):
            return segment
        if segment.passes(state.start, state.arclength):
            landing = _land_on_start(segment, state, options)
            if landing is not None and returned(state, landing.position, metric):
                segment = replace(segment, end=landing)
        # the test function of equations that are only piecewise smooth has kinks and corners; curves of one
        # kind cross in symmetric systems only
        rule = StepRule(options.minimum_cosine, _MISSED)
        if self.is_shortest(state):
            rule = replace(rule, minimum_cosine=None, largest_defect=math.inf)
        message = refusal(metric, state.tangent, segment.chord, segment.end.tangent, rule, segment.missed_at)
        if message is not None:
            return Rejected(message)
        segment = replace(segment, end=with_normal_form(segment.end, metric, options.normal_form))
        return _with_specials(segment, state, options, accept_anyway=self.is_shortest(state))


def _along(
    state: CurveState,
    end: CurveEnd,
    unstable: int | None,
    traced: Mapping[str, KnownCurve],
    options: CurveOptions,
    same_sense: bool = False,
) -> str | None:
    """The name of the traced curve on which an accepted point and the point before it lie.

    ``unstable``: number of its other multipliers outside the unit circle, None where that is not compared.

    A single point may lie where two curves cross at a small angle.  A curve meets itself in the
    ``same_sense``; the other side of a narrow loop is no part of it.
    """
    begin = _place(state.position, math.acos(min(1.0, max(-1.0, state.cos_theta))))
    places = (
        (_place(end.position, end.point.angle, unstable), end.tangent.parameters),
        (begin, state.tangent_parameters),
    )
    for name, curve in traced.items():
        if _runs_along(places, curve, options.parameter_scales, same_sense):
            return name
    return None


def _runs_along(
    places: Iterable[tuple[CurveStart, Vector]],
    curve: KnownCurve,
    scales: tuple[float, float],
    same_sense: bool = False,
) -> bool:
    return all(curve.runs_along(place, tangent, scales, same_sense) for place, tangent in places)


def would_end_on(recorded: KnownCurve, traced: Iterable[KnownCurve], scales: tuple[float, float]) -> bool:
    """Whether a curve that was recorded without knowledge of other ones has a step along one of them.

    With these among its ``traced`` curves, `continue_curve` would have ended before that step.
    """
    parts = zip(recorded.states, recorded.parameters, recorded.angles, recorded.tangents, strict=True)
    places = [
        (CurveStart(state, (float(first), float(second)), angle=float(angle)), tangent)
        for state, (first, second), angle, tangent in parts
    ]
    steps = [
        ((replace(end, unstable=None if math.isnan(count) else int(count)), tangent), begin)
        for (begin, (end, tangent)), count in zip(pairwise(places), recorded.unstable[1:], strict=True)
    ]
    return any(_runs_along(step, curve, scales) for curve in traced for step in steps)


def _place(position: Position, angle: float, unstable: int | None = None) -> CurveStart:
    first, second = position.parameters
    return CurveStart(position.state, (float(first), float(second)), angle=angle, unstable=unstable)


def _predict_and_correct(
    problem: CurveProblem,
    state: CurveState,
    options: CurveOptions,
    metric: PlaneMetric,
    steps: int,
    reference: PhaseReference | None,
) -> CurveSegment | Rejected:
    """Correct the second-order prediction on the arclength row.

    Beyond the end of a range that parameter is fixed to the end instead.
    """
    across = metric.row(state.normal)
    row = metric.row(state.tangent)
    constraint = CurveConstraint(row, row.dot(state.position) + state.step, across, state.gradient, metric)
    guess = state.position.plus(state.tangent, state.step).plus(state.bend, 0.5 * state.step**2)
    basis, bordering = state.basis, state.bordering
    found: CurveCorrection | None = None
    for _ in range(3):
        bound = bound_passed(guess.parameters, options.ranges)
        if bound is not None:
            which, value = bound
            share = (value - state.parameters[which]) / (guess.parameters[which] - state.parameters[which])
            guess = state.position.plus(guess.minus(state.position), float(share))
            constraint = replace(constraint, row=problem.row_of_parameter(which), value=value)
        elif found is not None:
            break
        found = correct_critical(problem, guess, constraint, basis, bordering, steps, reference)
        if found.point is None:
            return Rejected(found.advice, factor=_STUCK if found.stop is NewtonStop.STUCK else 0.5)
        guess = found.point.position
    if found is None or found.point is None or bound_passed(guess.parameters, options.ranges) is not None:
        return Rejected("the corrector leaves the ranges of the parameters")
    required, newton_iterations = (
        required_steps_of(problem, found.point, told_error(state)),
        found.iterations,
    )
    enough = required.error <= _REPEATED * problem.options.step_tolerance
    if not enough and required.steps > steps:
        steps = problem.period_map.rounded_steps(STEP_GROWTH * required.steps)
        again = correct_critical(problem, guess, constraint, found.point.basis, bordering, steps, reference)
        if again.point is None:
            return Rejected(again.advice)
        required = required_steps_of(problem, again.point)
        found = one_history(found, again, ("residual_norms", "test_values"))
    return _segment(problem, state, options, constraint, found, reference, (newton_iterations, required))


def _segment(
    problem: CurveProblem,
    state: CurveState,
    options: CurveOptions,
    constraint: CurveConstraint,
    found: CurveCorrection,
    reference: PhaseReference | None,
    iterations_and_required: tuple[int, RequiredSteps],
) -> CurveSegment | Rejected:
    if found.point is None:
        return Rejected(found.advice)
    if constraint.metric.norm(found.point.position.minus(state.position)) == 0.0:
        return Rejected("the corrector returned to the previous point")
    end = curve_end(found, found.point, constraint, state.tangent, options.normal_form, state.bordering)
    if end is None:
        return Rejected("the tangent is singular")
    newton_iterations, required = iterations_and_required
    end = with_errors(end, required)
    end = replace(end, point=replace(end.point, newton_iterations=newton_iterations))
    return CurveSegment(
        problem,
        constraint.metric,
        state.position,
        state.tangent,
        end,
        state.basis,
        state.bordering,
        constraint.across,
        state.gradient,
        found.point.steps,
        reference,
    )


def _with_specials(
    segment: CurveSegment, state: CurveState, options: CurveOptions, accept_anyway: bool
) -> CurveStep | Rejected:
    """Detect and locate the special points of a segment, which is cut where a Neimark-Sacker curve ends."""
    points = SegmentPoints(segment)
    tongues, specials = dips(points, (state.cos_theta, state.cos_theta_slope))
    for tongue in specials:
        if ends_inside(points, tongue) and not accept_anyway:
            return Rejected(_IN_A_TONGUE, factor=_BEFORE * tongue.fraction)
    unlocated: list[SpecialKind] = []
    ends: list[tuple[Bracket, SpecialPoint, CurveEnd]] = []
    for bracket in _brackets(points, state, options) + tongues:
        special = bracket.special
        located = locate_special(points, bracket, options.event_tolerance, options.normal_form)
        if located is None:
            if not accept_anyway:
                return Rejected("a special point inside the step did not converge")
            unlocated.append(special)
            continue
        point, there = located
        if point is not None and resonant_end(segment.problem.kind, there.point.cos_theta) is special:
            ends.append((bracket, point, there))
        elif point is not None:
            specials.append(point)
    end = segment.end
    if ends:
        bracket, point, end = min(ends, key=lambda each: each[1].fraction)
        sides = both_sides(points, bracket, point, options.event_tolerance)
        if sides is None and not accept_anyway:
            return Rejected(_IN_A_TONGUE, factor=_BEFORE * point.fraction)
        specials = [each for each in specials if each.fraction <= point.fraction]
        specials += (point,) if sides is None else sides
    kept = tuple(sorted(specials, key=lambda point: point.fraction))
    end = replace(end, point=replace(end.point, unlocated=tuple(unlocated)))
    return CurveStep(state, end, segment.metric.norm(end.position.minus(segment.start)), kept)


def _brackets(points: SegmentPoints, state: CurveState, options: CurveOptions) -> list[Bracket]:
    """Where the special points of a segment lie.

    A curve that starts on one may find it again with other time steps, on either side of its first point: the
    step that comes back there has it, the one that leaves does not.
    """
    segment = points.segment
    before, after = without_rounding(state.tests), without_rounding(segment.end.tests)
    nothing = _STARTED * np.abs(after - before)
    if state.index == 0:
        before = np.where(np.abs(before) < nothing, 0.0, before)
    if returned(state, segment.end.position, segment.metric):
        after = np.where(np.abs(after) < nothing, 0.0, after)
    twice = _passed_twice(points, state, before, after, options.normal_form)
    seen = {bracket.special for bracket in twice}
    once = [
        Bracket(
            special,
            (0.0, 1.0),
            (float(before[special - 1]), float(after[special - 1])),
            slopes=_resonance_slopes(segment, special, state),
        )
        for special in crossed(before, after)
        if special not in seen
    ]
    return twice + once


def _resonance_slopes(
    segment: CurveSegment, special: SpecialKind, state: CurveState
) -> tuple[float, float] | None:
    """Derivatives by the fraction of the test of a resonance at both ends; None for other special points."""
    if segment.problem.kind is not EventKind.NEIMARK_SACKER or special > SpecialKind.R4:
        return None
    sign, chord = -1.0 if special is SpecialKind.R1 else 1.0, segment.chord
    # an arclength ds along t is a fraction <t, chord> ds / <chord, chord>
    before, after = (
        sign * slope * segment.length**2 / segment.metric.inner(tangent, chord)
        for slope, tangent in (
            (state.cos_theta_slope, segment.start_tangent),
            (segment.end.cos_theta_slope, segment.end.tangent),
        )
    )
    return before, after


def _passed_twice(
    points: SegmentPoints, state: CurveState, before: Vector, after: Vector, form: NormalFormOptions | None
) -> list[Bracket]:
    """The brackets of special points passed twice, except the ends of a Neimark-Sacker curve."""
    if state.index == 0:
        return []
    length = state.arclength - state.previous_arclength
    brackets: list[Bracket] = []
    for special, *values in zip(SpecialKind, state.previous_tests, before, after, strict=True):
        is_end = special in (SpecialKind.R1, SpecialKind.R2)
        if not (is_end and points.segment.problem.kind is EventKind.NEIMARK_SACKER):
            last, start, end = map(float, values)
            brackets += dip_through(points, special, (last, start, end), length, form)
    return brackets


def _land_on_start(segment: CurveSegment, state: CurveState, options: CurveOptions) -> CurveEnd | None:
    """The point in the plane through the first point across the segment."""
    row = segment.metric.row(segment.chord)
    constraint = CurveConstraint(row, row.dot(state.start), segment.across, segment.gradient, segment.metric)
    found = segment.correct_on(state.start, constraint, segment.anchors[0])
    if found.point is None:
        return None
    return curve_end(found, found.point, constraint, segment.chord, options.normal_form, segment.bordering)
