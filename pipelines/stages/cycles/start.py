"""The first cycle of a branch: forced cycles from an equilibrium, self-excited cycles from a Hopf point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import (
    BranchPoint,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
)
from pipelines.bifurcations.continuation import Limit
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.orbits.equilibria.equilibrium import Equilibrium, machine_equilibrium
from pipelines.orbits.equilibria.linear import Instability, at_speed, linear_point
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.steppers import ImplicitStepper
from pipelines.orbits.time_steps import MOST_STEPS, spectral_radius, stable_steps
from pipelines.stages.cycles.problem import is_self_excited
from pipelines.stages.linear.linearize import hopf_between, leading_growth

HOPF_SCAN_POINTS = 25


@dataclass(frozen=True)
class NoStart:
    """Why a branch could not be started, with advice."""

    reason: str
    advice: str


@dataclass(frozen=True)
class FirstCycle:
    """A guess of the first cycle and the direction in which the branch leaves it (0: as requested)."""

    start: BranchStart
    direction: int = 0


@dataclass(frozen=True)
class Guard:
    """What may end the search of a first cycle early: a physical limit, or the user."""

    limit: Limit[BranchPoint]
    should_stop: Callable[[], bool]


def first_cycles(
    machine: Machine, case: Case, problem: CycleProblem, watch: Guard
) -> Iterator[FirstCycle | NoStart]:
    """Guesses of the first cycle, the cheapest first; tried in this order until one converges."""
    if is_self_excited(case):
        yield _small_whirl(machine, case, problem, watch)
        return
    resting = resting_start(machine, problem)
    yield resting
    if isinstance(resting, FirstCycle) and problem.parameters[film.DISPLACEMENT] > 0.0:
        yield _ramped_start(machine, case, problem, watch)


def resting_start(machine: Machine, problem: CycleProblem) -> FirstCycle | NoStart:
    """The equilibrium with the mean ring as a guess of the forced cycle."""
    equilibrium = machine_equilibrium(machine, problem.parameters)
    if not equilibrium.converged:
        return NoStart("there is no equilibrium to start from", equilibrium.reason)
    start = _forced_start(problem, equilibrium.state)
    return _too_stiff(problem, start) or FirstCycle(start)


def _forced_start(problem: CycleProblem, state: Array) -> BranchStart:
    period = 2.0 * np.pi / problem.parameters[film.EXCITATION_FREQUENCY]
    value = float(problem.parameters[problem.index])
    return BranchStart(problem.period_map.extend(state), value, period)


def _too_stiff(problem: CycleProblem, start: BranchStart) -> NoStart | None:
    """The reason not to start with an explicit stepper, or None: stability may need too many steps."""
    period_map = problem.period_map
    if period_map.steps_per_period is not None or isinstance(period_map.stepper, ImplicitStepper):
        return None
    resting = np.tile(start.state, (period_map.samples, 1))
    radius = spectral_radius(period_map, resting, problem.parameters)
    steps = stable_steps(period_map, radius, start.period)
    if steps <= MOST_STEPS:
        return None
    return NoStart(
        f"the machine is too stiff: stability needs {steps} steps per period (fastest rate {radius:.3g})",
        "a foil relaxes at the rate 1/loss_factor, a film at a rate that grows like the fourth power of "
        "numerics.axial: raise loss_factor, lower numerics.axial, or use the implicit numerics.stepper; "
        "numerics.steps_per_period forces a number of steps",
    )


def _ramped_start(machine: Machine, case: Case, problem: CycleProblem, watch: Guard) -> FirstCycle | NoStart:
    """The forced cycle reached by raising the ring's displacement from zero, far from the equilibrium."""
    wanted = float(problem.parameters[film.DISPLACEMENT])
    still = problem.parameters.copy()
    still[film.DISPLACEMENT] = 0.0
    equilibrium = machine_equilibrium(machine, still)
    if not equilibrium.converged:
        return NoStart("there is no equilibrium to start from", equilibrium.reason)
    ramp = replace(problem, parameters=still, parameter="displacement")
    found = _carried(ramp, _forced_start(ramp, equilibrium.state), wanted, 0.2 * wanted, watch)
    if isinstance(found, NoStart):
        fixed = "" if case.numerics.steps_per_period is None else "leave out numerics.steps_per_period, "
        advice = (
            f"{fixed}start at a lower speed, at another excitation frequency, or with a smaller displacement"
        )
        return NoStart(f"no cycle was found: {found.reason}", advice)
    return FirstCycle(replace(found, parameter=float(problem.parameters[problem.index])))


def _carried(
    problem: CycleProblem, start: BranchStart, target: float, step: float, watch: Guard
) -> BranchStart | NoStart:
    """The cycle at ``target`` of the problem's parameter, continued from ``start`` without turning back."""
    low, high = sorted((start.parameter, target))
    options = ContinuationOptions(
        range=(low, high), direction=1 if target > start.parameter else -1, step=step,
        minimum_step=1e-3 * step, maximum_step=5.0 * step, detection=DetectionOptions(kinds=()),
    )  # fmt: skip
    result = continue_branch(problem, start, options, _forget, watch.limit, watch.should_stop)
    state = result.state
    if result.stop is BranchStop.RANGE and state is not None and state.parameter == target:
        return BranchStart(state.state, target, state.period)
    reached = start.parameter if state is None else state.parameter
    why = result.message or (
        "the branch turns back" if result.stop is BranchStop.RANGE else result.stop.advice
    )
    return NoStart(f"{problem.parameter} came to {reached:.6g} on the way to {target:.6g}: {why}", "")


def _forget(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
    """Record nothing: only the end of the continuation matters."""


def _small_whirl(machine: Machine, case: Case, problem: CycleProblem, watch: Guard) -> FirstCycle | NoStart:
    """The small whirl beside the Hopf point; carried along the speed when another parameter is continued."""
    along_speed = replace(problem, parameter="speed")
    low, high = case.continue_cycles.range if problem.parameter == "speed" else case.linearize.speed_range
    hopf = first_hopf(machine, problem.parameters, low, high)
    if hopf is None:
        return _without_hopf(machine, problem.parameters, low, high)
    state, amplitude = hopf.equilibrium.state, case.continue_cycles.amplitude
    correction = start_at_hopf(along_speed, state, hopf.eigenvector, hopf.frequency, hopf.speed, amplitude)
    if correction.cycle is None:
        reason = f"the whirl beside the Hopf point at speed {hopf.speed:.6g} was not found"
        return NoStart(f"{reason}: {correction.advice}", "lower continue_cycles.amplitude")
    found = correction.cycle.unknowns
    start = BranchStart(found.state, found.parameter, found.period)
    side = 1 if found.parameter > hopf.speed else -1
    where = f"the whirl exists {'above' if side > 0 else 'below'} the Hopf point at speed {hopf.speed:.6g}"
    if problem.parameter == "speed":
        if low <= found.parameter <= high:
            return FirstCycle(start, side)
        return NoStart(f"{where}, outside the range", "widen continue_cycles.range or lower amplitude")
    speed = float(problem.parameters[film.SPEED])
    if (speed - found.parameter) * side <= 0.0:
        return NoStart(f"{where}, not at {speed:.6g}", "set operation.speed to the other side")
    carried = _carried(along_speed, start, speed, case.continue_cycles.step, watch)
    if isinstance(carried, NoStart):
        return replace(carried, advice="set operation.speed nearer to the Hopf point")
    return FirstCycle(replace(carried, parameter=float(problem.parameters[problem.index])))


def _without_hopf(machine: Machine, parameters: Array, low: float, high: float) -> NoStart:
    """Why no whirl begins between two speeds: no equilibrium at an end, or no change of stability."""
    for speed in (low, high):
        found = machine_equilibrium(machine, at_speed(parameters, speed))
        if not found.converged:
            reason = f"no loss of stability was found between the speeds {low:g} and {high:g}"
            return NoStart(f"{reason}: at speed {speed:g} there is no equilibrium", found.reason)
    return NoStart(
        f"the equilibrium does not lose its stability between the speeds {low:g} and {high:g}: "
        "no self-excited whirl begins there",
        "widen the range of speeds; agfb linearize shows the growth rates",
    )


def first_hopf(
    machine: Machine, parameters: Array, low: float, high: float, points: int = HOPF_SCAN_POINTS
) -> Instability | None:
    """The lowest speed between ``low`` and ``high`` at which the equilibrium loses stability.

    As seen from ``points`` equally spaced speeds.
    """
    last_speed, last_growth, guess = np.nan, np.nan, None
    for speed in np.linspace(low, high, points):
        point = linear_point(machine, at_speed(parameters, float(speed)), 4, guess)
        if isinstance(point, Equilibrium):
            last_growth = np.nan
            continue
        growth = float(leading_growth(point.eigenpairs.values[None, :])[0])
        if last_growth < 0.0 <= growth and guess is not None:
            return hopf_between(machine, parameters, last_speed, float(speed), guess)
        last_speed, last_growth, guess = float(speed), growth, point.equilibrium.state
    return None
