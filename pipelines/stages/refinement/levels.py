"""The family of grids for recomputing bifurcation points, and one point on all of them.

Level 0 is the stored grid with twice the time steps, levels 1 and 2 are finer around the bearing.  With
Chebyshev collocation, whose error along the axis is spectral and so of no order, these keep the axial
unknowns, and level 3 tells the axial part: the stored intervals with two more axial unknowns, because errors
with an odd and an even number of them differ.  The paper's uniform axial grid is refined along with the
other direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.curve import CurveStart
from pipelines.bifurcations.curves.fixed_parameter import FixedParameterPoint, locate_at_fixed_parameter
from pipelines.bifurcations.plane import CurveProblem, metric_of
from pipelines.bifurcations.switching import with_multiplied_period
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.machine.assembly import Machine, build_machine
from pipelines.machine.regrid import regrid
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.refinement.extrapolation import Extrapolation, extrapolate
from pipelines.stages.refinement.points import StoredPoint

FORMAL_ORDERS = {"fourth_order": 4, "central": 2, "backward": 1}  # around the bearing
UNIFORM_ORDER = 2  # of the paper's axial grid
MORE_AXIAL = 2
MIXED = 0.5  # part of the axial error that another grid around the bearing may change; up to 0.33 was seen
SAME_PAIR = 0.15  # rad, by which the angle of a Neimark-Sacker point may change from one grid to another

REFINED, BOUND, NOT_CONVERGED, OTHER_BIFURCATION, GRID_TOO_LARGE, UNSUPPORTED = range(6)


@dataclass(frozen=True)
class Grid:
    """Circumferential intervals and axial unknowns."""

    circumferential: int
    axial: int


def grid_family(case: Case) -> tuple[Grid, ...]:
    """The grids of all levels."""
    numerics = case.numerics
    stored = Grid(numerics.circumferential, numerics.axial)
    uniform = numerics.axial_scheme == "uniform"
    grids = [stored]
    for factor in case.refine.factors:
        around = max(round(factor * stored.circumferential), grids[-1].circumferential + 1)
        grids.append(Grid(around, round(factor * stored.axial) if uniform else stored.axial))
    return tuple(grids if uniform else [*grids, Grid(stored.circumferential, stored.axial + MORE_AXIAL)])


def formal_order(case: Case) -> int:
    """The order of the error in the spacing of the grids of a family."""
    around = FORMAL_ORDERS[case.numerics.scheme]
    return min(around, UNIFORM_ORDER) if case.numerics.axial_scheme == "uniform" else around


@dataclass(frozen=True)
class Level:
    """The machine and its cycles on one grid; both None if the grid is too large to compute."""

    grid: Grid
    machine: Machine | None
    problem: CycleProblem | None


def build_level(case: Case, grid: Grid) -> Level:
    """The machine and its cycles on another grid."""
    finer = case_on(case, grid)
    if finer is None:
        return Level(grid, None, None)
    machine = build_machine(finer)
    return Level(grid, machine, cycle_problem(machine, finer))


def case_on(case: Case, grid: Grid) -> Case | None:
    """The case on another grid, with the tighter tolerance of time steps.

    None for a grid that no configuration may have.
    """
    numerics, plain = case.numerics, case.model_dump(mode="json")
    steps = numerics.steps_per_period
    plain["numerics"] |= {
        "circumferential": grid.circumferential,
        "axial": grid.axial,
        "multiplier_tolerance": case.refine.tolerance_factor * numerics.multiplier_tolerance,
        "steps_per_period": None if steps is None else 2 * steps,
    }
    try:
        return Case.model_validate(plain)
    except ValueError:
        return None


@dataclass(frozen=True)
class Refinement:
    """A stored point on all grids.

    ``values``, ``angles`` and ``steps`` (levels,), NaN or -1 where missing; ``status`` as in the flag of
    the group; ``failed_level``: -1 when none failed; ``reason``: in words.
    """

    values: Array
    angles: Array
    steps: NDArray[np.int32]
    status: int
    failed_level: int
    reason: str = ""


def refine_point(source: Machine, levels: Sequence[Level], point: StoredPoint) -> Refinement:
    """Recompute a point stored for the machine ``source``; every failure is a result."""
    values, angles = np.full(len(levels), np.nan), np.full(len(levels), np.nan)
    steps = np.full(len(levels), -1, dtype=np.int32)
    near, last = source, point
    for index, level in enumerate(levels):
        if level.grid.circumferential == levels[0].grid.circumferential:
            near, last = source, point  # the axial level begins at the stored point again
        found = _on_level(near, last, level, 2 * point.steps if index == 0 else None)
        if isinstance(found, _Failure):
            return Refinement(values, angles, steps, found.status, index, found.reason)
        if point.angle is not None and abs(found.angle - point.angle) > SAME_PAIR:
            reason = f"the angle changes from {point.angle:.4g} to {found.angle:.4g}"
            return Refinement(values, angles, steps, OTHER_BIFURCATION, index, reason)
        values[index], angles[index], steps[index] = found.parameters[1], found.angle, found.steps
        assert level.machine is not None
        near, last = level.machine, _moved(point, found)
    return Refinement(values, angles, steps, REFINED, -1)


def _moved(point: StoredPoint, found: FixedParameterPoint) -> StoredPoint:
    """The stored point with values from a grid: the guess on the next grid."""
    parameters = point.parameters.copy()
    parameters[PARAMETERS.index(point.free)] = found.parameters[1]
    angle = None if point.angle is None else found.angle
    return replace(point, parameters=parameters, state=found.state, period=found.period, angle=angle)


@dataclass(frozen=True)
class _Failure:
    status: int
    reason: str


def _on_level(
    near: Machine, point: StoredPoint, level: Level, steps: int | None
) -> FixedParameterPoint | _Failure:
    """The point on one grid, searched from the machine ``near`` on which its state is known."""
    if level.machine is None or level.problem is None:
        return _Failure(GRID_TOO_LARGE, f"{level.grid.circumferential} x {level.grid.axial} is too large")
    names = (point.held, point.free)
    held, free = (float(point.parameters[PARAMETERS.index(name)]) for name in names)
    try:
        period_map = with_multiplied_period(level.problem, point.turns).period_map
        problem = CurveProblem(period_map, point.kind, point.parameters, names, level.problem.options)
        state = regrid(near, level.machine, point.state)
    except ValueError as error:
        return _Failure(UNSUPPORTED, str(error))
    scales = tuple(abs(v) if n == "foil_stiffness" else 1.0 for n, v in zip(names, (held, free), strict=True))
    start = CurveStart(state, (held, free), point.period, point.angle)
    found = locate_at_fixed_parameter(problem, start, 0, metric_of(problem, (scales[0], scales[1])), steps)
    return found if isinstance(found, FixedParameterPoint) else _Failure(NOT_CONVERGED, found.advice)


@dataclass(frozen=True)
class ErrorEstimate:
    """Order, limit, error of the stored value and its axial and temporal part; NaN where unknown."""

    order: float
    richardson: float
    richardson_error: float
    error: float
    axial_error: float
    step_error: float
    status: int


def estimate(
    stored: float, grids: Sequence[Grid], refinement: Refinement, formal_order: int
) -> ErrorEstimate:
    """The error estimate of the ``stored`` value from the values on all grids."""
    values = refinement.values
    step_error = abs(stored - float(values[0]))
    if refinement.status != REFINED:
        return ErrorEstimate(*5 * (np.nan,), step_error, refinement.status)
    spacings = 1.0 / np.array([grid.circumferential for grid in grids[:3]], dtype=float)
    limit: Extrapolation = extrapolate(spacings, values[:3], formal_order)
    # errors of both directions add, but for the part by which the axial one depends on the other grid
    axial = float(values[3] - values[0]) if len(values) > 3 else 0.0
    axial_error = abs(axial) if len(values) > 3 else np.nan
    value, uncertainty = limit.value + axial, limit.error + MIXED * abs(axial)
    if limit.clean:
        error, status = abs(stored - value), REFINED
    else:
        error, status = float(np.max(np.abs(values - stored))), BOUND
    return ErrorEstimate(limit.order, value, uncertainty, error, axial_error, step_error, status)
