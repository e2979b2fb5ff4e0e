"""What starts at a bifurcation: curves in two parameters, branches of cycles, other curves.

At a period doubling with eigenvector v, M v = -v, the cycles of twice the period are

    s = s_0 + A v + O(A^2),      lambda = lambda_0 + O(A^2)

so the parameter turns at the bifurcation.  The first of them is corrected with the amplitude fixed instead of
the parameter, <v, s - s_0> = A, which the cycle of the simple period cannot satisfy.

At a branch point the linearised equations of u = (s, T, lambda) have two null vectors, and the branch on
which it was found has its tangent t in their plane.  With n in the plane across t, the other branch is

    u = u_0 + A (n + c t) + O(A^2),      <n, u - u_0> = A,      <n, t> = 0

where c = 0 at a pitchfork: there n has no part in lambda, and the parameter turns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.branch import BranchStart
from pipelines.bifurcations.curve import CurveStart, SpecialPoint
from pipelines.bifurcations.curves.codimension_two import SecondBifurcation, second_bifurcation
from pipelines.bifurcations.cycles.segment import BranchMetric, metric_of
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import (
    Cycle,
    CycleProblem,
    NewtonStop,
    Unknowns,
    correct,
    first_basis,
    null_directions,
    reference_of,
)
from pipelines.orbits.system import Vector, size_of
from pipelines.orbits.time_steps import first_steps
from pipelines.orbits.vectors import Constraint

_NEAR = 0.5  # distance of the first cycle of another branch from its prediction, in units of the step
_FARTHER = 1.5  # times the amplitude at which the sense of a new branch is found


def curve_from_event(
    problem: CycleProblem,
    event: Event,
    names: tuple[str, str],
    formulation: CurveFormulation = CurveFormulation.BORDERED,
    smooth_maps: tuple[PeriodMap, ...] = (),
) -> tuple[CurveProblem, CurveStart]:
    """The curve in the plane of two parameters through a bifurcation found on a branch of cycles.

    ``smooth_maps`` as in CurveProblem.

    Raises ValueError for a branch point: see ``crossing_branch``.
    """
    curves = CurveProblem(
        problem.period_map, event.kind, event.parameters, names, problem.options, formulation, smooth_maps
    )
    first, second = (float(event.parameters[index]) for index in curves.indices)
    return curves, CurveStart(event.state, (first, second), event.period, event.angle)


def joined_curve(problem: CurveProblem, special: SpecialPoint) -> tuple[CurveProblem, CurveStart] | None:
    """The other curve through a special point of a curve of ``problem``.

    None where there is none (see `second_bifurcation`).

    A Neimark-Sacker curve leaves R1 and R2 in one direction; every other curve goes on in both.
    """
    second = second_bifurcation(problem.kind, special, problem.period_map.autonomous)
    return None if second is None else curve_of_second(problem, special, second)


def curve_of_second(
    problem: CurveProblem, special: SpecialPoint, second: SecondBifurcation
) -> tuple[CurveProblem, CurveStart]:
    """The curve of the second bifurcation at a special point of a curve of ``problem``."""
    first, last = (float(special.parameters[index]) for index in problem.indices)
    joined = replace(problem, kind=second.kind, formulation=CurveFormulation.BORDERED)
    return joined, CurveStart(special.state, (first, last), special.period, second.angle, special.width)


@dataclass(frozen=True)
class NewBranch:
    """The start of a branch of other cycles, for ``continue_branch(problem, start, ...)``.

    ``problem``: with twice the period per cycle at a period doubling, the same at a branch
    point; ``direction``: the sense of the parameter in which the branch leaves the bifurcation.
    """

    problem: CycleProblem
    start: BranchStart
    direction: int


def doubled_branch(problem: CycleProblem, event: Event, amplitude: float) -> NewBranch | None:
    """The branch of cycles of twice the period at a period doubling of ``problem``.

    ``amplitude`` (> 0): largest entry of the first step away from the simple cycle.  None when no doubled
    cycle of that amplitude was found: try another one.  Raises ValueError for an event of another kind or an
    amplitude that is not positive.
    """
    if event.kind is not EventKind.PERIOD_DOUBLING:
        raise ValueError(f"doubled cycles start at a period doubling, not at a {event.kind.name}")
    if not amplitude > 0.0:
        raise ValueError(f"amplitude is {amplitude}; it must be positive")
    cycle = _cycle_of(problem, event)
    if cycle is None:
        return None
    vector = _flip_vector(cycle)
    doubled = replace(problem, period_map=doubled_map(problem.period_map))
    parameter = float(event.parameters[problem.index])
    at_flip = doubled.consistent(Unknowns(event.state, 2.0 * event.period, parameter))
    row = Unknowns(vector / float(vector @ vector), 0.0, 0.0)
    return _branch_along(doubled, at_flip, Unknowns(vector, 0.0, 0.0), row, amplitude)


def crossing_branch(problem: CycleProblem, event: Event, amplitude: float) -> NewBranch | None:
    """The other branch of cycles through a branch point of ``problem``.

    ``amplitude``: largest entry of the first step away from the branch point; the other half of the branch
    starts with its negative, which in a symmetric system is the mirror image.  None when no cycle of that
    amplitude was found on it: try another one.  Raises ValueError for an event of another kind, one read from
    a store (it has lost its direction) and an amplitude of zero.
    """
    if event.kind is not EventKind.BRANCH_POINT:
        raise ValueError(f"branches cross at a branch point, not at a {event.kind.name}")
    if event.direction is None:
        raise ValueError("the event does not know the direction of its branch: locate it again")
    if amplitude == 0.0:
        raise ValueError("amplitude is 0; it must be positive or negative")
    cycle = _cycle_of(problem, event)
    if cycle is None:
        return None
    metric = metric_of(problem, 1.0, cycle.unknowns.period / size_of(cycle.unknowns.state))
    across = _across(problem, cycle, event.direction, metric)
    row = metric.row(across).scaled(1.0 / metric.inner(across, across))
    return _branch_along(problem, cycle.unknowns, across, row, amplitude, event.direction)


def _branch_along(
    problem: CycleProblem,
    origin: Unknowns,
    direction: Unknowns,
    row: Unknowns,
    amplitude: float,
    known: Unknowns | None = None,
) -> NewBranch | None:
    """The cycles at row . (u - origin) = A, for two values of A.

    With other time steps the bifurcation itself moves, so a second amplitude is needed to find the
    sense.  ``known``: tangent of the known branch.
    """
    steps = first_steps(problem, origin)
    if isinstance(steps, NewtonStop):
        return None
    reference, basis = reference_of(problem, origin, steps), first_basis(problem, origin, steps)
    found: list[Unknowns] = []
    for size in (amplitude, _FARTHER * amplitude):
        constraint = Constraint(row, row.dot(origin) + size)
        correction = correct(problem, origin.plus(direction, size), constraint, basis, steps, reference)
        if correction.cycle is None:
            return None
        found.append(correction.cycle.unknowns)
        if known is not None and not _near(found[-1].minus(origin), direction.scaled(size), known):
            return None
    first, second = found
    start = BranchStart(first.state, first.parameter, first.period)
    return NewBranch(problem, start, 1 if second.parameter >= first.parameter else -1)


def _near(moved: Unknowns, predicted: Unknowns, known: Unknowns) -> bool:
    """Whether a cycle lies where the other branch starts, A (n + c t) with any c, not on a third branch."""
    rest, along = moved.state - predicted.state, known.state
    if np.any(along):
        rest = rest - along * float(along @ rest) / float(along @ along)
    return bool(np.linalg.norm(rest) <= _NEAR * np.linalg.norm(predicted.state))


def doubled_map(period_map: PeriodMap) -> PeriodMap:
    """The map over two periods: twice the periods of the forcing, twice the samples and the steps."""
    steps = None if period_map.steps_per_period is None else 2 * period_map.steps_per_period
    doubled = replace(period_map, samples=2 * period_map.samples, steps_per_period=steps)
    if period_map.system.forcing is None:
        return replace(doubled, minimum_steps=2 * period_map.minimum_steps)
    return replace(doubled, period_multiple=2 * period_map.period_multiple)


def with_multiplied_period(problem: CycleProblem, period_multiple: int) -> CycleProblem:
    """The same problem for cycles that close after so many (1, 2, 4, ...) times the simple period."""
    period_map = problem.period_map
    for _ in range(period_multiple.bit_length() - 1):
        period_map = doubled_map(period_map)
    return replace(problem, period_map=period_map)


def _cycle_of(problem: CycleProblem, event: Event) -> Cycle | None:
    """The cycle of an event, corrected with its time steps."""
    at_event = replace(problem, parameters=event.parameters)
    at = Unknowns(event.state, event.period, float(event.parameters[problem.index]))
    reference, basis = reference_of(at_event, at, event.steps), first_basis(at_event, at, event.steps)
    constraint = at_event.fixed_parameter(at.parameter)
    return correct(at_event, at, constraint, basis, event.steps, reference).cycle


def _flip_vector(cycle: Cycle) -> Vector:
    """The eigenvector of -1, scaled to the largest entry one."""
    nearest = int(np.argmin(np.abs(cycle.spectrum.multipliers + 1.0)))
    complex_vector = cycle.spectrum.vectors[:, nearest]
    vector = (complex_vector / complex_vector[np.argmax(np.abs(complex_vector))]).real
    return np.asarray(vector, dtype=np.float64)


def _across(problem: CycleProblem, cycle: Cycle, along: Unknowns, metric: BranchMetric) -> Unknowns:
    """The null direction of a branch point at right angles to the branch, scaled to the largest entry one."""
    reference = reference_of(problem, cycle.unknowns, cycle.steps)
    first, second = null_directions(problem, cycle, reference)
    across = first.scaled(metric.inner(along, second)).plus(second, -metric.inner(along, first))
    return across.scaled(1.0 / float(across.state[np.argmax(np.abs(across.state))]))
