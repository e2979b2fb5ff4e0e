"""One line of a survey: the cycles at its cells, each with its leading multipliers, as a row of the store."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.case.survey_settings import Axis, survey_axes
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import Machine
from pipelines.machine.extremes import FILM, LOW_PRESSURE, OBSERVED, machine_extremes
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.equilibria.equilibrium import (
    MEAN_PHASE,
    at_rest,
    equilibrium_along,
    machine_equilibrium,
)
from pipelines.orbits.forced_cycle import ForcedCycle, ForcedCycleOptions, Method, forced_cycle
from pipelines.orbits.harmonic_balance import RestingSystem
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, NewtonStop, ShootingOptions
from pipelines.orbits.steppers import steppers

SAMPLES = 32  # of an orbit, at which the film is looked at
NEWTON_SHARE = 0.01  # of the tolerated miss: what Newton's method leaves
MULTIPLIER_SHARE = 0.2  # of the tolerated error: what the subspace iteration leaves
CHECKED_MODULUS = 0.3
REAL = 1e-6  # imaginary part, relative to the modulus, below which a multiplier is taken as real

_SPEC = KINDS["survey"]
_NUMBERS = ("growth_rate", "multiplier", "minimum_film", "miss", "step_error")
_FLAGS = ("status", "bifurcation", "method")


@dataclass(frozen=True)
class SurveyProblem:
    """All that the lines of a case's survey have in common.

    ``along`` and ``across``: the parameter along the lines and the other one, with ``abscissae`` (cells,)
    and ``ordinates`` (lines,); ``cycles`` at the case's own parameters.
    """

    machine: Machine
    case: Case
    along: Axis
    across: Axis
    cycles: CycleProblem
    options: ForcedCycleOptions

    @property
    def abscissae(self) -> Array:
        return np.linspace(self.along.low, self.along.high, self.along.points)

    @property
    def ordinates(self) -> Array:
        return np.linspace(self.across.low, self.across.high, self.across.points)

    def parameters(self, line: int, cell: int) -> Array:
        """The parameter vector of a cell."""
        values = np.array(self.cycles.parameters)
        values[PARAMETERS.index(self.along.parameter)] = self.abscissae[cell]
        values[PARAMETERS.index(self.across.parameter)] = self.ordinates[line]
        return values


def survey_problem(machine: Machine, case: Case, parameters: Array) -> SurveyProblem:
    """The survey of a case; ``parameters``: those of the case."""
    along, across = survey_axes(case.survey, case.track_curves)
    table, numerics = case.survey, case.numerics
    period_map = PeriodMap(
        machine_system(machine),
        stepper=steppers()[numerics.stepper],
        samples=SAMPLES,
        steps_per_period=numerics.steps_per_period,
    )
    shooting = ShootingOptions(
        tolerance=NEWTON_SHARE * table.tolerance,
        iterations=numerics.newton_iterations,
        picard_tolerance=0.01,
        multiplier_tolerance=MULTIPLIER_SHARE * table.multiplier_tolerance,
        checked_modulus=CHECKED_MODULUS,
        step_tolerance=table.multiplier_tolerance,
    )
    options = ForcedCycleOptions(table.harmonics, table.phases, table.tolerance)
    cycles = CycleProblem(period_map, parameters, across.parameter, shooting)
    return SurveyProblem(machine, case, along, across, cycles, options)


def compute_line(problem: SurveyProblem, line: int) -> dict[str, Any]:
    """The row of a line: it depends on the problem and the number of the line alone.

    Cells are visited in both directions: where no cycle is found at first, the one found beside it later is
    followed.
    """
    resting = _resting_systems(problem, line)
    found: list[ForcedCycle | NewtonStop | None] = [None] * problem.along.points
    for cells in (range(problem.along.points), reversed(range(problem.along.points))):
        beside: ForcedCycle | None = None
        first = all(one is None for one in found)
        for cell in cells:
            system = resting[cell]
            if system is not None and (first or (isinstance(found[cell], NewtonStop) and beside is not None)):
                cycles = replace(problem.cycles, parameters=problem.parameters(line, cell))
                found[cell] = forced_cycle(cycles, system, problem.options, beside)
            one = found[cell]
            beside = one if isinstance(one, ForcedCycle) else None
    return _row(problem, line, [_cell(problem, line, cell, one) for cell, one in enumerate(found)])


def _resting_systems(problem: SurveyProblem, line: int) -> list[RestingSystem | None]:
    """The machine at rest at every cell, None without equilibrium.

    One for all if only the excitation frequency changes.
    """
    if problem.along.parameter == "excitation_frequency":
        return [_resting_system(problem, line, 0)] * problem.along.points
    return [_resting_system(problem, line, cell) for cell in range(problem.along.points)]


def _resting_system(problem: SurveyProblem, line: int, cell: int) -> RestingSystem | None:
    machine, still = problem.machine, at_rest(problem.parameters(line, cell))
    if problem.across.parameter == "speed":
        equilibrium = equilibrium_along(machine, still, problem.ordinates, line)
    else:
        equilibrium = machine_equilibrium(machine, still)
    if not equilibrium.converged:
        return None
    return RestingSystem.of(
        equilibrium.state, machine.jacobian(MEAN_PHASE, equilibrium.state, still).toarray()
    )


def _cell(
    problem: SurveyProblem, line: int, cell: int, found: ForcedCycle | NewtonStop | None
) -> dict[str, Any]:
    """The entries of a cell by array; the flags as their meanings."""
    if not isinstance(found, ForcedCycle):
        return {"status": "no_equilibrium" if found is None else "no_cycle"}
    cycle, parameters = found.cycle, problem.parameters(line, cell)
    multipliers = cycle.spectrum.multipliers
    leading = complex(multipliers[0])
    film_left, pressure = _extremes(problem.machine, cycle.image.orbit, parameters)
    status = "found"
    if pressure <= 0.0:
        status = "below_vacuum"
    elif film_left < problem.case.continue_cycles.minimum_film:
        status = "thin_film"
    return {
        "status": status,
        "growth_rate": math.log(abs(leading)) / cycle.unknowns.period,
        "multiplier": leading if leading.imag >= 0.0 else leading.conjugate(),
        "bifurcation": bifurcation_of(leading),
        "unstable_count": int(np.sum(np.abs(multipliers) > 1.0)),
        "minimum_film": film_left,
        "method": "newton" if found.method is Method.NEWTON else "harmonic_balance",
        "miss": cycle.residual,
        "steps_per_period": cycle.steps,
        "step_error": found.step_error if math.isfinite(found.step_error) else math.nan,
    }


def bifurcation_of(multiplier: complex) -> str:
    """The bifurcation at which a multiplier passes the unit circle."""
    if abs(multiplier.imag) > REAL * abs(multiplier):
        return "neimark_sacker"
    return "fold" if multiplier.real > 0.0 else "period_doubling"


def _extremes(machine: Machine, orbit: Array, parameters: Array) -> tuple[float, float]:
    """Smallest film thickness and pressure along an orbit (samples, N), of both bearings."""
    out, work = np.empty(OBSERVED), np.empty(machine.work_size)
    smallest = np.full((OBSERVED // BEARINGS, BEARINGS), np.inf)
    for sample, state in enumerate(orbit):
        phase = 2.0 * math.pi * sample / len(orbit)
        machine_extremes(phase, state, parameters, machine.constants, machine.layout, work, out)
        smallest = np.minimum(smallest, out.reshape(smallest.shape))
    return float(smallest[FILM].min()), float(smallest[LOW_PRESSURE].min())


def _row(problem: SurveyProblem, line: int, cells: list[Mapping[str, Any]]) -> dict[str, Any]:
    """The arrays of a line from the entries of its cells."""
    row: dict[str, Any] = {"across": problem.ordinates[line]}
    for name in _NUMBERS:
        row[name] = np.array([cell.get(name, np.nan) for cell in cells])
    for name in _FLAGS:
        spec = _SPEC.array(name)
        row[name] = np.array([spec.flag(cell[name]) if name in cell else -1 for cell in cells], dtype=np.int8)
    for name in ("unstable_count", "steps_per_period"):
        row[name] = np.array([cell.get(name, -1) for cell in cells], dtype=np.int32)
    return row
