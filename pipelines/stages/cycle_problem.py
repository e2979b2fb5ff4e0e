"""From a case to the continuation problem of its cycles, and to the first cycle of a branch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.arclength import (
    BranchPoint,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
    continue_branch,
)
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.case.models import PARAMETERS, Case
from pipelines.machine import film
from pipelines.machine.assembly import Machine, parameter_vector
from pipelines.orbits.equilibrium import Equilibrium, machine_equilibrium
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.linear import Instability, at_speed, linear_point
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import steppers
from pipelines.stages.linearize import hopf_between, leading_growth

Array = NDArray[np.float64]

ORBIT_SAMPLES = 64
INITIAL_COLUMNS = 24
HOPF_SCAN_POINTS = 25


@dataclass(frozen=True)
class NoStart:
    """Why a branch could not be started, with advice."""

    reason: str
    advice: str


@dataclass(frozen=True)
class FirstCycle:
    """A guess of the first cycle and the direction in which the branch leaves it (0: as the user asked)."""

    start: BranchStart
    direction: int = 0


def cycle_problem(machine: Machine, case: Case) -> CycleProblem:
    """The cycles of a case along the parameter that is continued, at the value where the branch starts."""
    table, numerics = case.continue_cycles, case.numerics
    parameters = parameter_vector(case)
    if table.start is not None:
        parameters[PARAMETERS.index(table.parameter)] = table.start
    period_map = PeriodMap(
        machine_system(machine, forced=not is_self_excited(case)),
        stepper=steppers()[numerics.stepper],
        formulation=Formulation(table.formulation),
        samples=ORBIT_SAMPLES,
        steps_per_period=numerics.steps_per_period,
    )
    basis = BasisOptions(
        multiplier_cut=numerics.multiplier_cut,
        initial_columns=min(INITIAL_COLUMNS, numerics.max_columns),
        maximum_columns=numerics.max_columns,
    )
    options = ShootingOptions(
        tolerance=numerics.newton_tolerance, iterations=numerics.newton_iterations, basis=basis
    )
    return CycleProblem(period_map, parameters, table.parameter, options)


def is_self_excited(case: Case) -> bool:
    """Whether the cycles are those of the passive machine, whose period is its own."""
    table = case.continue_cycles
    return (
        table.formulation == "autonomous"
        and case.excitation.displacement == 0.0
        and table.parameter != "displacement"
    )


def continuation_options(case: Case, direction: int) -> ContinuationOptions:
    """Options of the arclength continuation; foil stiffnesses count relative to the first one."""
    table = case.continue_cycles
    start = parameter_vector(case)[film.FOIL_STIFFNESS] if table.start is None else table.start
    return ContinuationOptions(
        range=table.range,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scale=float(start) if table.parameter == "foil_stiffness" else 1.0,
        detection=DetectionOptions(event_tolerance=0.01 * case.numerics.event_tolerance),
    )


def first_cycle(machine: Machine, case: Case, problem: CycleProblem) -> FirstCycle | NoStart:
    """The equilibrium in the mean ring for forced cycles, a small cycle beside the Hopf point for self-
    excited ones.
    """
    if is_self_excited(case):
        return _self_excited_start(machine, case, problem)
    equilibrium = machine_equilibrium(machine, problem.parameters)
    if not equilibrium.converged:
        return NoStart("there is no equilibrium to start from", equilibrium.reason)
    return FirstCycle(_forced_start(problem, equilibrium.state))


def _forced_start(problem: CycleProblem, state: Array) -> BranchStart:
    period = 2.0 * np.pi / problem.parameters[film.EXCITATION_FREQUENCY]
    value = float(problem.parameters[problem.index])
    return BranchStart(problem.period_map.extend(state), value, period)


def ramped_cycle(machine: Machine, case: Case, problem: CycleProblem) -> FirstCycle | NoStart:
    """The forced cycle reached by raising the ring's displacement from zero, for starts too far from the
    equilibrium.
    """
    wanted = float(problem.parameters[film.DISPLACEMENT])
    at_rest = problem.parameters.copy()
    at_rest[film.DISPLACEMENT] = 0.0
    equilibrium = machine_equilibrium(machine, at_rest)
    if not equilibrium.converged:
        return NoStart("there is no equilibrium to start from", equilibrium.reason)
    ramp = replace(problem, parameters=at_rest, parameter="displacement")
    options = ContinuationOptions(
        range=(0.0, wanted), step=0.2 * wanted, maximum_step=wanted, minimum_step=1e-4 * wanted,
        detection=DetectionOptions(kinds=()),
    )  # fmt: skip
    result = continue_branch(ramp, _forced_start(ramp, equilibrium.state), options, _forget)
    if result.stop is not BranchStop.RANGE or result.state is None or result.state.parameter < wanted:
        reached = 0.0 if result.state is None else result.state.parameter
        return NoStart(
            f"no cycle was found: raising the ring's displacement stopped at {reached:.3g} of {wanted:.3g}",
            "start at a lower speed, at another excitation frequency, or with a smaller displacement",
        )
    value = float(problem.parameters[problem.index])
    return FirstCycle(BranchStart(result.state.state, value, result.state.period))


def _forget(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
    """Record nothing: only the end of the branch matters."""


def _self_excited_start(machine: Machine, case: Case, problem: CycleProblem) -> FirstCycle | NoStart:
    """The small whirl beside the Hopf point; carried along the speed when another parameter is continued."""
    along_speed = replace(problem, parameter="speed")
    low, high = case.continue_cycles.range if problem.parameter == "speed" else case.linearize.speed_range
    hopf = first_hopf(machine, problem.parameters, low, high)
    if hopf is None:
        return NoStart(
            f"the equilibrium is stable between the speeds {low:g} and {high:g}: no self-excited whirl",
            "widen the range of speeds; agfb linearize shows the growth rates",
        )
    state, amplitude = hopf.equilibrium.state, case.continue_cycles.amplitude
    correction = start_at_hopf(along_speed, state, hopf.eigenvector, hopf.frequency, hopf.speed, amplitude)
    if correction.cycle is None:
        return NoStart(
            f"the whirl beside the Hopf point was not found: {correction.stop.advice}", "lower amplitude"
        )
    found = correction.cycle.unknowns
    direction = 1 if found.parameter > hopf.speed else -1
    start = BranchStart(found.state, found.parameter, found.period)
    if problem.parameter == "speed":
        return FirstCycle(start, direction)
    return _carried_to_speed(along_speed, start, direction, float(problem.parameters[film.SPEED]), problem)


def _carried_to_speed(
    along_speed: CycleProblem, start: BranchStart, direction: int, speed: float, problem: CycleProblem
) -> FirstCycle | NoStart:
    """The self-excited cycle at the case's own speed, by continuation from the Hopf point."""
    side = "below" if direction < 0 else "above"
    interval = (start.parameter, speed) if direction > 0 else (speed, start.parameter)
    if interval[0] >= interval[1]:
        return NoStart(
            f"near its Hopf point the whirl exists {side} speed {start.parameter:.6g}, not at {speed:.6g}",
            "set operation.speed there",
        )
    options = ContinuationOptions(range=interval, direction=direction, detection=DetectionOptions(kinds=()))
    result = continue_branch(along_speed, start, options, _forget)
    if result.stop is not BranchStop.RANGE or result.state is None:
        return NoStart(
            f"the whirl was lost on the way to speed {speed:.6g}: {result.stop.advice}", result.message
        )
    value = float(problem.parameters[problem.index])
    return FirstCycle(BranchStart(result.state.state, value, result.state.period))


def first_hopf(machine: Machine, parameters: Array, low: float, high: float) -> Instability | None:
    """The lowest speed between ``low`` and ``high`` at which the equilibrium loses stability."""
    last_speed, last_growth, guess = np.nan, np.nan, None
    for speed in np.linspace(low, high, HOPF_SCAN_POINTS):
        point = linear_point(machine, at_speed(parameters, float(speed)), 4, guess)
        if isinstance(point, Equilibrium):
            last_growth = np.nan
            continue
        growth = float(leading_growth(point.eigenpairs.values[None, :])[0])
        if last_growth < 0.0 <= growth and guess is not None:
            return hopf_between(machine, parameters, last_speed, float(speed), guess)
        last_speed, last_growth, guess = float(speed), growth, point.equilibrium.state
    return None
