"""How a bifurcation curve passes the kinks of a map that is only piecewise smooth.

Where a cycle touches the border between two pieces without crossing it, the multipliers have a corner as
functions of the parameters, and so has the curve; where it turns by more than a right angle, no step ends
ahead.  Time steps leave some of that wherever an orbit is not smooth in time: more of them are tried first.
The map regularised over a half width w is smooth there, and elsewhere its curve is nearly that of the exact
map.  The width is a homotopy parameter: a point u_0 moves to u_w in the plane across the curve,

    phi_w(s, T, lambda) - s = 0,    phase(s) = 0,    g_w(s, T, lambda) = 0,    <t, u_w - u_0> = 0

the curve goes on with w until its steps are long again, and the end of such a step moves back to w = 0.
Where its steps are still short, the point stays on the curve of w, and its distance from the exact curve is
stored.  If the exact point beside it is not found either, the distance e(w) = c w^p is estimated from

    e(w) - e(w/2) = (1 - 2^-p) e(w)

Twice that difference lies within a factor of two of e(w) for every p >= 0.42: p = 1 at a corner, 1/2 where
the multipliers have a root there, and more beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from pipelines.bifurcations.continuation import Rejected, adapted_length, leaves_ranges, returned
from pipelines.bifurcations.critical.correction import CurveConstraint
from pipelines.bifurcations.critical.corrector import correct_critical
from pipelines.bifurcations.critical.critical_cycles import BorderingVectors
from pipelines.bifurcations.curve import CurveOptions, CurveState, SpecialPoint
from pipelines.bifurcations.curves.codimension_two import crossed, resonant_end
from pipelines.bifurcations.curves.first_point import columns_of, curve_metric
from pipelines.bifurcations.curves.segment import CurveEnd, CurveStep, curve_end, with_normal_form
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveProblem
from pipelines.orbits.floquet import orthonormal
from pipelines.orbits.shooting import reference_of
from pipelines.orbits.system import Matrix
from pipelines.orbits.time_steps import most_steps

Attempt = Callable[[CurveProblem, CurveState], CurveStep | Rejected]
Advance = Callable[[CurveState, CurveStep], CurveState]

_SHORTEST, _LONGEST = 4.0, 1000.0  # a step is short below 4 shortest ones or a 1000th of the longest one
_FIRST = 100.0  # or, where the first step is far shorter than the longest one, below a part of that
_BEND = 1.0 / 16.0  # of the shortest step: on a smoother map
_TRIED = 4.0  # times that length: first step on a smoother map
_RECOVERED = 8.0  # likewise: the kink lies behind, the exact map is tried again
_FINER = 4.0  # times as many time steps, before a smoother map
_ALIKE = 0.9  # cosine between the critical vectors of one curve before and after a change of the width
_RETREAT = 4.0  # ratio of the distances by which a smoother curve may begin further back
_MOST_STEPS = 30  # back to the last point
_NEAR = 0.5  # of the step: a point that moves further may come to another curve


def attempt_past_kinks(
    problem: CurveProblem,
    state: CurveState,
    options: CurveOptions,
    attempt: Attempt,
    advance: Advance,
    in_vain: set[int],
) -> CurveStep | Rejected:
    """One step on the map of the state; where that is too short beside a kink, with more time steps.

    If these do not help, on a smoother map: the widths are tried in their order, beginning with the first one
    above that of the state.  ``in_vain``: indices of the points from which none leads on, where none is tried
    again, because a shorter step changes nothing in that search; it is added to.
    """
    own = problem.with_width(state.clipping_width)
    step = attempt(own, state)
    if isinstance(step, Rejected) and _stops_at_kink(problem, state, options, step):
        finer = _with_more_time_steps(problem, state, options)
        past = step if finer is None else attempt(own, finer)
        if isinstance(past, Rejected) and state.index not in in_vain:
            smoother = _on_smoother_map(problem, state, options, attempt, advance)
            if smoother is None:
                in_vain.add(state.index)
            past = smoother or step
        step = past
    if isinstance(step, Rejected) or step.begin.clipping_width == 0.0:
        return step
    return _beside_exact_map(problem, step, options)


def short_step(options: CurveOptions) -> float:
    """The length below which steps are short: some of the shortest one, or a part of the longest.

    Around a narrow tongue the first step is short too, and tells what is short there.
    """
    part = min(options.maximum_step / _LONGEST, options.step / _FIRST)
    return min(options.maximum_step, max(_SHORTEST * options.minimum_step, part))


def shortest_step(options: CurveOptions, state: CurveState) -> float:
    """The shortest step from a state: shorter on a smoother map, whose curve has a bend for a corner."""
    return options.minimum_step * (1.0 if state.clipping_width == 0.0 else _BEND)


def next_length(step: CurveStep, options: CurveOptions) -> float:
    """The length of the next step."""
    shortest = replace(options, minimum_step=shortest_step(options, step.begin))
    return adapted_length(step.begin.step, step.point.newton_iterations, shortest)


def _stops_at_kink(problem: CurveProblem, state: CurveState, options: CurveOptions, step: Rejected) -> bool:
    """Whether the next step would be short while the cycle is near to grazing, or none is left."""
    if problem.kinks is None:
        return False
    if 0.5 * state.step < shortest_step(options, state):
        return True
    short = short_step(options)
    if not step.factor * state.step < short <= state.step:
        return False
    own = problem.with_width(state.clipping_width)
    parameters = own.parameters_at(state.position)
    orbit = own.period_map.evaluate(state.state, parameters, state.period, state.steps).orbit
    return problem.kinks.distance(orbit, parameters) <= problem.kinks.widths[-1]


def _with_more_time_steps(
    problem: CurveProblem, state: CurveState, options: CurveOptions
) -> CurveState | None:
    """The state with more time steps, moved to their curve, of unknown error; None if there are no more.

    Without that a step shorter than the distance of both curves would end beside its own.
    """
    steps = most_steps(problem.period_map, _FINER * state.steps)
    if steps <= state.steps:
        return None
    finer = replace(state, steps=steps, step_error=math.nan, coarser_error=math.nan)
    return _state_with_width(problem, finer, options, state.clipping_width, 0.0)


def _on_smoother_map(
    problem: CurveProblem, state: CurveState, options: CurveOptions, attempt: Attempt, advance: Advance
) -> CurveStep | None:
    """The first step that leads past the state with a larger width; None if there is none.

    A sharp corner is rounded off by the width: near its tip the smoother curve begins further back.
    """
    assert problem.kinks is not None
    for width in problem.kinks.widths:
        if width <= state.clipping_width:
            continue
        for back in _retreats(options):
            begin = _state_with_width(problem, state, options, width, back)
            step = None if begin is None else _step_ahead(problem, begin, options, back, attempt, advance)
            if step is not None:
                return replace(step, begin=replace(step.begin, index=state.index))
    return None


def _retreats(options: CurveOptions) -> Iterator[float]:
    """How far before the last point a smoother curve may begin."""
    yield 0.0
    back = short_step(options)
    while back <= options.maximum_step:
        yield back
        back *= _RETREAT


def _step_ahead(
    problem: CurveProblem,
    begin: CurveState,
    options: CurveOptions,
    back: float,
    attempt: Attempt,
    advance: Advance,
) -> CurveStep | None:
    """The step along the curve of ``begin`` that comes to more than ``back`` behind it; None if none does."""
    own, short = problem.with_width(begin.clipping_width), short_step(options)
    passed = begin.arclength + back
    state = replace(begin, step=min(options.maximum_step, _TRIED * short + back))
    found: tuple[SpecialPoint, ...] = ()
    for _ in range(_MOST_STEPS):
        step = attempt(own, state)
        if isinstance(step, Rejected):
            state = replace(state, step=step.factor * state.step)
            if state.step < short:
                return None
            continue
        found += step.found
        if state.arclength + step.length > passed:
            return replace(step, found=found)
        if resonant_end(problem.kind, step.point.cos_theta) is not None:
            return None
        state = replace(advance(state, step), clipping_width=begin.clipping_width)
    return None


def _state_with_width(
    problem: CurveProblem, state: CurveState, options: CurveOptions, width: float, back: float
) -> CurveState | None:
    """The state moved to the curve of another width, and ``back`` along it.

    None where it comes to another curve or to none.
    """
    end = _moved(problem, state, options, width, back)
    if end is None or not _is_same_curve(problem, state, end, options, back):
        return None
    kept = {
        "step_error": state.step_error,
        "coarser_error": state.coarser_error,
        "tests": np.where(np.isnan(end.tests), state.tests, end.tests),
    }
    straight = {"bend_state": np.zeros_like(end.position.state), "bend_parameters": np.zeros(2)}
    return replace(
        state,
        clipping_width=width,
        arclength=state.arclength - back,
        bend_period=0.0,
        **columns_of(problem, end) | kept | straight,
    )


def _beside_exact_map(problem: CurveProblem, step: CurveStep, options: CurveOptions) -> CurveStep:
    """The step with its end on the curve of the exact map, else with the effect of the width there."""
    at_end = replace(step.begin, step=next_length(step, options), **columns_of(problem, step.end))
    exact = _exact_end(problem, at_end, options)
    if exact is None or not _may_go_back(problem, step.begin, at_end, options):
        return _with_effect(problem, step, at_end, exact, options)
    end = with_normal_form(exact, curve_metric(problem, options, step.begin.start), options.normal_form)
    names = ("newton_iterations", "step_error", "coarser_error", "unlocated")
    effort = {name: getattr(step.point, name) for name in names}
    return replace(step, end=replace(end, point=replace(end.point, **effort)))


def _may_go_back(problem: CurveProblem, begin: CurveState, at_end: CurveState, options: CurveOptions) -> bool:
    """Whether a step ends far enough behind a kink; the last point of a curve stays where it ends."""
    if at_end.step < min(_RECOVERED * short_step(options), options.maximum_step):
        return False
    leaves = leaves_ranges(at_end.parameters, at_end.tangent_parameters, options.ranges)
    resonant = resonant_end(problem.kind, at_end.cos_theta) is not None
    closed = returned(begin, at_end.position, curve_metric(problem, options, begin.start))
    return not (leaves or resonant or closed)


def _with_effect(
    problem: CurveProblem, step: CurveStep, at_end: CurveState, exact: CurveEnd | None, options: CurveOptions
) -> CurveStep:
    """The step with the width in its point, and the distance of its end from the curve of the exact map.

    Measured where the ``exact`` point beside it is known, else estimated; NaN where neither is possible.
    """
    width, beside, factor = step.begin.clipping_width, exact, 1.0
    if beside is None:
        beside, factor = _moved(problem, at_end, options, 0.5 * width), 2.0
    effect = math.nan if beside is None else factor * _distance(at_end, beside, options)
    point = replace(step.point, clipping_width=width, width_effect=effect)
    return replace(step, end=replace(step.end, point=point))


def _exact_end(problem: CurveProblem, state: CurveState, options: CurveOptions) -> CurveEnd | None:
    """The point of the exact map beside a state, if it lies on the same curve and that runs the same way."""
    end = _moved(problem, state, options, 0.0)
    if end is None or not _is_same_curve(problem, state, end, options):
        return None
    along = curve_metric(problem, options, state.start).inner(end.tangent, state.tangent)
    return end if along >= options.minimum_cosine else None


def _distance(state: CurveState, end: CurveEnd, options: CurveOptions) -> float:
    """Distance of a point from the curve of a state, at right angles in the plane of scaled parameters."""
    shift, along = (
        vector / np.array(options.parameter_scales)
        for vector in (end.position.parameters - state.parameters, state.tangent_parameters)
    )
    length = float(np.linalg.norm(along))
    across = abs(float(shift[0] * along[1] - shift[1] * along[0]))
    return across / length if length > 0.0 else float(np.linalg.norm(shift))


def _moved(
    problem: CurveProblem, state: CurveState, options: CurveOptions, width: float, back: float = 0.0
) -> CurveEnd | None:
    """The point of another width in the plane across the curve ``back`` before a state; None without one."""
    own = problem.with_width(width)
    metric = curve_metric(own, options, state.start)
    row, across = metric.row(state.tangent), metric.row(state.normal)
    guess = state.position.plus(state.tangent, -back)
    constraint = CurveConstraint(row, row.dot(guess), across, state.gradient, metric)
    reference = reference_of(own.cycle_problem(state.position), own.unknowns(state.position), state.steps)
    try:
        found = correct_critical(own, guess, constraint, state.basis, state.bordering, state.steps, reference)
        if found.point is None:
            return None
        return curve_end(found, found.point, constraint, state.tangent, options.normal_form, state.bordering)
    except np.linalg.LinAlgError:
        return None


def _is_same_curve(
    problem: CurveProblem, state: CurveState, end: CurveEnd, options: CurveOptions, back: float = 0.0
) -> bool:
    """Whether a point of another width is near, has similar critical vectors and no special point before."""
    metric = curve_metric(problem, options, state.start)
    apart = metric.norm(end.position.minus(state.position.plus(state.tangent, -back)))
    near = apart <= _NEAR * max(state.step, short_step(options), back)
    own, other = (_critical_plane(problem, each) for each in (state, end.bordering))
    alike = float(np.linalg.svd(own.T @ other, compute_uv=False)[-1]) >= _ALIKE
    return near and alike and not crossed(state.tests, end.tests)


def _critical_plane(problem: CurveProblem, held: CurveState | BorderingVectors) -> Matrix:
    """An orthonormal basis of the critical vectors, with the part of the period."""
    if problem.kind is EventKind.NEIMARK_SACKER:
        return orthonormal(np.column_stack([held.right, held.left]))
    return orthonormal(np.append(held.right, held.right_period)[:, None])
