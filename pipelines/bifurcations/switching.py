"""From a bifurcation to what starts there: curves in two parameters, doubled cycles, curves that meet.

At a period doubling with eigenvector v, M v = -v, the cycles of twice the period are

    s = s_0 + A v + O(A^2),      lambda = lambda_0 + O(A^2)

so the parameter turns at the bifurcation.  The first of them is corrected with the amplitude fixed instead of
the parameter, <v, s - s_0> = A, which the cycle of the simple period cannot satisfy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.branch import BranchStart
from pipelines.bifurcations.codimension_two import SecondBifurcation, second_bifurcation
from pipelines.bifurcations.curve import CurveStart, SpecialPoint
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.orbits.period_map import PeriodMap, PhaseReference
from pipelines.orbits.shooting import (
    Constraint,
    CycleProblem,
    NewtonStop,
    Unknowns,
    correct,
    first_basis,
    reference_of,
)
from pipelines.orbits.system import Vector
from pipelines.orbits.time_steps import first_steps

_FARTHER = 1.5  # times the amplitude at which the sense of a doubled branch is found


def curve_from_event(
    problem: CycleProblem,
    event: Event,
    names: tuple[str, str],
    formulation: CurveFormulation = CurveFormulation.BORDERED,
    smooth_maps: tuple[PeriodMap, ...] = (),
) -> tuple[CurveProblem, CurveStart]:
    """The curve in the plane of two parameters through a bifurcation found on a branch of cycles;
    ``smooth_maps`` as in CurveProblem.

    Raises ValueError for a branch point.
    """
    curves = CurveProblem(
        problem.period_map, event.kind, event.parameters, names, problem.options, formulation, smooth_maps
    )
    first, second = (float(event.parameters[index]) for index in curves.indices)
    return curves, CurveStart(event.state, (first, second), event.period, event.angle)


def joined_curve(problem: CurveProblem, special: SpecialPoint) -> tuple[CurveProblem, CurveStart] | None:
    """The other curve through a special point of a curve of ``problem``; None where there is none (see
    `second_bifurcation`).

    A Neimark-Sacker curve leaves R1 and R2 in one direction; every other curve goes on in both.
    """
    second = second_bifurcation(problem.kind, special, problem.period_map.autonomous)
    return None if second is None else curve_of_second(problem, special, second)


def curve_of_second(
    problem: CurveProblem, special: SpecialPoint, second: SecondBifurcation
) -> tuple[CurveProblem, CurveStart]:
    """The curve of what else becomes critical at a special point of a curve of ``problem``."""
    first, last = (float(special.parameters[index]) for index in problem.indices)
    joined = replace(problem, kind=second.kind, formulation=CurveFormulation.BORDERED)
    return joined, CurveStart(special.state, (first, last), special.period, second.angle)


@dataclass(frozen=True)
class DoubledBranch:
    """The start of a branch of doubled cycles: for ``continue_branch(problem, start, ...)``.

    ``problem``: the same system with twice the turns (or the period) per cycle; ``direction``: the sense of
    the parameter in which the branch leaves the bifurcation.
    """

    problem: CycleProblem
    start: BranchStart
    direction: int


def doubled_branch(problem: CycleProblem, event: Event, amplitude: float) -> DoubledBranch | None:
    """The branch of cycles of twice the period at a period doubling of ``problem``.

    ``amplitude`` (> 0): largest entry of the first step away from the simple cycle.  None when no doubled
    cycle of that amplitude was found: try another one.  Raises ValueError for an event of another kind or an
    amplitude that is not positive.
    """
    if event.kind is not EventKind.PERIOD_DOUBLING:
        raise ValueError(f"doubled cycles start at a period doubling, not at a {event.kind.name}")
    if not amplitude > 0.0:
        raise ValueError(f"amplitude is {amplitude}; it must be positive")
    parameter = float(event.parameters[problem.index])
    simple = Unknowns(event.state, event.period, parameter)
    vector = _flip_vector(problem, event, simple)
    if vector is None:
        return None
    doubled = replace(problem, period_map=doubled_map(problem.period_map))
    at_flip = doubled.consistent(Unknowns(event.state, 2.0 * event.period, parameter))
    steps = first_steps(doubled, at_flip)
    if isinstance(steps, NewtonStop):
        return None
    reference: PhaseReference | None = reference_of(doubled, at_flip, steps)
    row, basis = vector / float(vector @ vector), first_basis(doubled, at_flip, steps)
    found: list[Unknowns] = []
    for factor in (1.0, _FARTHER):
        size = factor * amplitude
        guess = Unknowns(event.state + size * vector, 2.0 * event.period, parameter)
        constraint = Constraint(Unknowns(row, 0.0, 0.0), float(row @ event.state) + size)
        correction = correct(doubled, guess, constraint, basis, steps, reference)
        if correction.cycle is None:
            return None
        found.append(correction.cycle.unknowns)
    # the bifurcation itself is not the same with other time steps, so that a second amplitude tells the sense
    first, second = found
    start = BranchStart(first.state, first.parameter, first.period)
    return DoubledBranch(doubled, start, 1 if second.parameter >= first.parameter else -1)


def doubled_map(period_map: PeriodMap) -> PeriodMap:
    """The map over two periods: twice the turns of the forcing, twice the samples and the steps."""
    turns = period_map.turns if period_map.system.forcing is None else 2 * period_map.turns
    steps = None if period_map.steps_per_period is None else 2 * period_map.steps_per_period
    minimum = period_map.minimum_steps * 2 if turns == period_map.turns else period_map.minimum_steps
    return replace(
        period_map,
        turns=turns,
        samples=2 * period_map.samples,
        steps_per_period=steps,
        minimum_steps=minimum,
    )


def _flip_vector(problem: CycleProblem, event: Event, simple: Unknowns) -> Vector | None:
    """The eigenvector of -1, its largest entry one."""
    at_event = replace(problem, parameters=event.parameters)
    reference = reference_of(at_event, simple, event.steps)
    basis = first_basis(at_event, simple, event.steps)
    constraint = at_event.fixed_parameter(simple.parameter)
    cycle = correct(at_event, simple, constraint, basis, event.steps, reference).cycle
    if cycle is None:
        return None
    nearest = int(np.argmin(np.abs(cycle.spectrum.multipliers + 1.0)))
    complex_vector = cycle.spectrum.vectors[:, nearest]
    vector = (complex_vector / complex_vector[np.argmax(np.abs(complex_vector))]).real
    return np.asarray(vector, dtype=np.float64)
