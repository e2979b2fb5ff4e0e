"""A bifurcation point with one of two parameters held fixed.

On the surface of cycles of ``pipelines.bifurcations.critical.cycle_manifold`` with its orthonormal tangents
t_1, t_2 the line of the held parameter runs along t, and the test function g changes there by dg t:

    t = (t_2)_held t_1 - (t_1)_held t_2,      row . u = value of the held parameter

That line may be vertical in the free parameter, so that a fold is corrected like every other point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.continuation import STEP_GROWTH
from pipelines.bifurcations.critical.bordering import first_bordering, vectors_of
from pipelines.bifurcations.critical.correction import CriticalCycle, CurveConstraint
from pipelines.bifurcations.critical.corrector import correct_critical
from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    critical_derivatives,
    critical_pass,
)
from pipelines.bifurcations.critical.cycle_manifold import manifold_tangents
from pipelines.bifurcations.critical.testfunctions import critical_of
from pipelines.bifurcations.curve import CurveStart
from pipelines.bifurcations.curves.first_point import required_steps_of
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveProblem, MapAt, PlaneMetric, Position
from pipelines.orbits.shooting import NewtonStop, correct, first_basis, reference_of
from pipelines.orbits.system import Matrix
from pipelines.orbits.time_steps import first_steps


@dataclass(frozen=True)
class FixedParameterPoint:
    """A bifurcation point located with one parameter held.

    Both parameters (2,), ``state`` (N,), period, critical angle in [0, pi] and the time steps per
    period.
    """

    parameters: tuple[float, float]
    state: np.typing.NDArray[np.float64]
    period: float
    angle: float
    steps: int


@dataclass(frozen=True)
class NotLocated:
    """Why the corrector found no bifurcation point, with what to change."""

    advice: str


def locate_at_fixed_parameter(
    problem: CurveProblem, start: CurveStart, held: int, metric: PlaneMetric, steps: int | None = None
) -> FixedParameterPoint | NotLocated:
    """The bifurcation point near ``start`` whose parameter ``problem.names[held]`` is that of the start.

    ``steps``: per period; chosen by the problem's step tolerance when None.  Every failure is a result.
    """
    guess = problem.consistent(Position(np.array(start.state), start.period, np.array(start.parameters)))
    try:
        return _located(problem, guess, held, metric, start.angle, steps)
    except np.linalg.LinAlgError:
        return NotLocated("a matrix of the corrector is singular")


def _located(
    problem: CurveProblem,
    guess: Position,
    held: int,
    metric: PlaneMetric,
    angle: float | None,
    steps: int | None,
) -> FixedParameterPoint | NotLocated:
    cycles, unknowns = problem.cycle_problem(guess), problem.unknowns(guess)
    chosen = steps is None
    if steps is None:
        first = first_steps(cycles, unknowns)
        if isinstance(first, NewtonStop):
            return NotLocated(first.advice)
        steps = first
    found = _corrected(problem, guess, held, metric, first_basis(cycles, unknowns, steps), angle, steps)
    for _ in range(2):
        if isinstance(found, NotLocated) or not chosen:
            break
        needed = required_steps_of(problem, found).steps
        if needed <= steps:
            break
        steps = problem.period_map.rounded_steps(STEP_GROWTH * needed)
        found = _corrected(problem, found.position, held, metric, found.basis, angle, steps)
    if isinstance(found, NotLocated):
        return found
    at, cos_theta = found.position, min(1.0, max(-1.0, found.critical.cos_theta))
    held_at, free_at = (float(value) for value in at.parameters)
    return FixedParameterPoint((held_at, free_at), at.state, at.period, float(np.arccos(cos_theta)), steps)


def _corrected(
    problem: CurveProblem,
    guess: Position,
    held: int,
    metric: PlaneMetric,
    basis: Matrix,
    angle: float | None,
    steps: int,
) -> CriticalCycle | NotLocated:
    """The critical cycle with a given number of steps: a cycle first, then its criticality as well."""
    cycles, unknowns = problem.cycle_problem(guess), problem.unknowns(guess)
    reference = reference_of(cycles, unknowns, steps)
    if problem.kind is not EventKind.FOLD:  # at a fold no cycle need exist with both parameters held
        fixed = cycles.fixed_parameter(unknowns.parameter)
        corrected = correct(cycles, unknowns, fixed, basis, steps, reference)
        if corrected.cycle is None:
            return NotLocated(corrected.advice)
        at = corrected.cycle.unknowns
        basis, guess = corrected.cycle.basis, replace(guess, state=at.state, period=at.period)
    here = MapAt(problem, guess, steps, reference)
    bordering = first_bordering(here, basis, angle)
    constraint = None if bordering is None else _constraint(here, basis, bordering, held, metric)
    if bordering is None or constraint is None:
        return NotLocated(
            "the guess has no critical multipliers, or they do not move with the free parameter"
        )
    found = correct_critical(problem, guess, constraint, basis, bordering, steps, reference)
    return NotLocated(found.advice) if found.point is None else found.point


def _constraint(
    at: MapAt, basis: Matrix, bordering: BorderingVectors, held: int, metric: PlaneMetric
) -> CurveConstraint | None:
    """The row that holds the parameter, the remaining direction and the slopes of the test function."""
    passed = critical_pass(at, basis, vectors_of(bordering, at.problem.kind))
    critical = None if passed is None else critical_of(passed, bordering)
    if passed is None or critical is None:
        return None
    first, second = manifold_tangents(passed.linear, metric)
    slopes = critical_derivatives(passed.linear, critical, (first, second), metric).values
    along = first.scaled(second.parameters[held]).plus(second, -first.parameters[held])
    if metric.norm(along) == 0.0 or float(np.hypot(*slopes)) == 0.0:
        return None
    gradient = metric.row(first).scaled(float(slopes[0])).plus(metric.row(second), float(slopes[1]))
    row = at.problem.row_of_parameter(held)
    return CurveConstraint(row, row.dot(at.position), metric.row(along), gradient, metric, follows=False)
