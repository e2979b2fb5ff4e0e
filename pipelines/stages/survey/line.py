"""One line of a survey: the cycles at its cells, each with its leading multipliers, as a row of the store."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.case.survey_settings import Axis, survey_axes
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import Machine
from pipelines.orbits.equilibria.equilibrium import at_rest, equilibrium_along, machine_equilibrium
from pipelines.orbits.forced_cycle import ForcedCycle, ForcedCycleOptions, Method, forced_cycle
from pipelines.orbits.harmonic_balance import RestingSystem
from pipelines.orbits.shooting import CycleProblem, NewtonStop
from pipelines.stages.survey.cells import (
    bifurcation_of,
    film_status,
    forced_cycles,
    nearest_to_circle,
    resting_system,
)

_SPEC = KINDS["survey"]
_NUMBERS = ("growth_rate", "multiplier", "nearest_multiplier", "minimum_film", "miss", "step_error")
_FLAGS = ("status", "bifurcation", "method")

Found = ForcedCycle | NewtonStop | None
"""A cycle, why Newton's method found none, or None where there is no equilibrium."""


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
        return self.parameters_at(float(self.abscissae[cell]), float(self.ordinates[line]))

    def parameters_at(self, along: float, across: float) -> Array:
        """The parameter vector at any place of the plane."""
        values = np.array(self.cycles.parameters)
        values[PARAMETERS.index(self.along.parameter)] = along
        values[PARAMETERS.index(self.across.parameter)] = across
        return values


def survey_problem(machine: Machine, case: Case, parameters: Array) -> SurveyProblem:
    """The survey of a case; ``parameters``: those of the case."""
    along, across = survey_axes(case.survey, case.track_curves)
    table = case.survey
    cycles = forced_cycles(machine, case, parameters, table.tolerance, table.multiplier_tolerance)
    options = ForcedCycleOptions(table.harmonics, table.phases, table.tolerance)
    return SurveyProblem(machine, case, along, across, cycles, options)


def compute_line(problem: SurveyProblem, line: int) -> dict[str, Any]:
    """The row of a line: it depends on the problem and the number of the line alone."""
    resting = _resting_systems(problem, line)

    def cycle(cell: int, beside: ForcedCycle | None) -> Found:
        system = resting[cell]
        if system is None:
            return None
        cycles = replace(problem.cycles, parameters=problem.parameters(line, cell))
        return forced_cycle(cycles, system, problem.options, beside)

    found = cycles_of_line(problem.along.points, cycle)
    return _row(problem, line, [entries(problem, one) for one in found])


def cycles_of_line(cells: int, cycle: Callable[[int, ForcedCycle | None], Found]) -> list[Found]:
    """The cycles at the cells of a line; ``cycle(cell, beside)`` seeks one, None where nothing can be.

    Cells are visited in both directions: where no cycle is found at first, the one found beside it later is
    followed.
    """
    found: list[Found] = [None] * cells
    for first, order in ((True, range(cells)), (False, reversed(range(cells)))):
        beside: ForcedCycle | None = None
        for cell in order:
            if first or (isinstance(found[cell], NewtonStop) and beside is not None):
                found[cell] = cycle(cell, beside)
            one = found[cell]
            beside = one if isinstance(one, ForcedCycle) else None
    return found


def cycle_at(problem: SurveyProblem, along: float, across: float) -> Found:
    """The cycle at any place of the plane, found as those of the cells; None without equilibrium."""
    parameters = problem.parameters_at(along, across)
    equilibrium = machine_equilibrium(problem.machine, at_rest(parameters))
    if not equilibrium.converged:
        return None
    resting = resting_system(problem.machine, equilibrium, at_rest(parameters))
    return forced_cycle(replace(problem.cycles, parameters=parameters), resting, problem.options)


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
    return resting_system(machine, equilibrium, still) if equilibrium.converged else None


def entries(problem: SurveyProblem, found: Found) -> dict[str, Any]:
    """What a survey tells of a cycle, by array; the flags as their meanings."""
    if not isinstance(found, ForcedCycle):
        return {"status": "no_equilibrium" if found is None else "no_cycle"}
    cycle, multipliers = found.cycle, found.cycle.spectrum.multipliers
    leading = complex(multipliers[0])
    status, thinnest = film_status(problem.machine, cycle, problem.case.continue_cycles.minimum_film)
    return {
        "status": status,
        "growth_rate": math.log(abs(leading)) / cycle.unknowns.period,
        "multiplier": leading if leading.imag >= 0.0 else leading.conjugate(),
        "nearest_multiplier": nearest_to_circle(multipliers),
        "bifurcation": bifurcation_of(leading),
        "unstable_count": int(np.sum(np.abs(multipliers) > 1.0)),
        "minimum_film": thinnest,
        "method": "newton" if found.method is Method.NEWTON else "harmonic_balance",
        "miss": cycle.residual,
        "steps_per_period": cycle.steps,
        "step_error": found.step_error if math.isfinite(found.step_error) else math.nan,
    }


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
