"""Set up a transient from a case: its request, its drive, its time steps, its place in the store."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.layout import LARGEST_ROWS
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store, case_group
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector, with_stand_ins
from pipelines.machine.extremes import FILM, LOW_PRESSURE, OBSERVED, machine_extremes
from pipelines.machine.rates import BEARINGS
from pipelines.machine.unbalance import UnbalanceMass, unbalance_acceleration, unbalance_masses
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.time_runs.drive import Drive, Switching, make_drive
from pipelines.orbits.time_runs.transient import DrivenSystem, Plan, choose_steps, trial_end
from pipelines.stages.parameter_columns import parameter_attributes
from pipelines.stages.transients.start import CannotRunError, StartState, start_state

MOST_BLOCKS = 100_000
_SAME_DISPLACEMENT = 1e-12
# Relative: a speed copied with few digits, or a cycle that is disturbed a little on purpose.
_SAME_SPEED = 1e-3
MOST_RUNS = 1000  # t000 to t999
_MEASURED_STEPS = 32


@dataclass(frozen=True)
class Run:
    """A transient to be computed.

    ``attributes`` are those of its group and hold all that a later process needs to go on without its start:
    ``start`` is None for a run that is in the store already and has a checkpoint.
    """

    group: str
    attributes: Mapping[str, Any]
    machine: Machine
    driven: DrivenSystem
    parameters: Array
    drive: Drive
    plan: Plan
    limits: Array
    masses: tuple[UnbalanceMass, ...]
    start: StartState | None


def prepare_run(named: NamedCase, store: Store | None) -> Run:
    """The transient that a case requests, new or to be resumed.

    Raises CannotRunError before anything is computed.
    """
    case, machine = named.case, build_machine(named.case)
    request = request_of(case)
    group, stored, started = _place(named, store)
    masses = unbalance_masses(case)
    driven = driven_machine(machine, masses)
    start = None
    if stored is None or not started:
        start = _start(named, machine, store)
    if stored is None:
        assert start is not None
        attributes = _new_attributes(case, machine, driven, start, request)
    else:
        attributes = {name: stored[name] for name in _ATTRIBUTES}
    parameters = with_stand_ins(attributes["parameters"])
    drive = drive_of(case, parameters, attributes["angle"], attributes["ring_phase"])
    plan = _plan(case, drive, attributes)
    return Run(group, attributes, machine, driven, parameters, drive, plan, _limits(case), masses, start)


def request_of(case: Case) -> dict[str, Any]:
    """What distinguishes runs: the tables [transient] and [unbalance]."""
    unbalance = None if case.unbalance is None else case.unbalance.model_dump(mode="json")
    return {"transient": case.transient.model_dump(mode="json"), "unbalance": unbalance}


def _place(named: NamedCase, store: Store | None) -> tuple[str, Mapping[str, Any] | None, bool]:
    """The group of the case's request and its attributes, or the first free one; whether it has begun."""
    for number in range(MOST_RUNS):
        group = case_group(named.case_id, f"transient/t{number:03d}")
        if store is None or not store.has_group(group):
            return group, None, False
        found = read_group(store, group, ())
        if found.attributes["request"] == request_of(named.case):
            return group, found.attributes, found.n_events > 0
    raise CannotRunError(
        f"the store holds {MOST_RUNS} transient runs of the case {named.case_id}",
        "name another store with -o",
    )


def driven_machine(machine: Machine, masses: tuple[UnbalanceMass, ...]) -> DrivenSystem:
    """The machine for the transient loop; samples hold the displacements of the masters."""
    first, count = machine.rotor_start, machine.rotor_freedoms
    return DrivenSystem(
        machine_system(machine),
        push=unbalance_acceleration(machine, masses),
        push_row=first + count,
        recorded=slice(first, first + count),
        observe=machine_extremes,
        observed=OBSERVED,
    )


def _limits(case: Case) -> Array:
    limits = np.full(OBSERVED, -np.inf)
    limits[FILM * BEARINGS : (FILM + 1) * BEARINGS] = case.transient.minimum_film
    limits[LOW_PRESSURE * BEARINGS : (LOW_PRESSURE + 1) * BEARINGS] = 0.0
    return limits


def _speed_table(case: Case, own: float | None) -> tuple[list[float], list[float]]:
    """Times and speeds; ``own`` is the speed if there is no table."""
    table = case.transient
    if not table.times:
        return [0.0], [] if own is None else [own]
    return list(table.times), list(table.speeds)


def _displacements(case: Case, own: float) -> tuple[float, float]:
    """The rings' displacement before and after switching."""
    mode = case.transient.excitation
    return (own if mode in ("on", "switch_off") else 0.0), (own if mode in ("on", "switch_on") else 0.0)


def drive_of(case: Case, parameters: Array, angle: float, ring_phase: float) -> Drive:
    """The drive of a case's run, at the speed of the start state's parameters."""
    table, frequency = case.transient, float(parameters[film.EXCITATION_FREQUENCY])
    before, after = _displacements(case, float(parameters[film.DISPLACEMENT]))
    ramp = 2.0 * math.pi / frequency if table.switch_ramp is None else table.switch_ramp
    switching = Switching(before, after, table.switch_time or 0.0, ramp)
    times, speeds = _speed_table(case, float(parameters[film.SPEED]))
    return make_drive(times, speeds, table.duration, switching, frequency, angle, ring_phase)


def _start(named: NamedCase, machine: Machine, store: Store | None) -> StartState:
    """The start state, whose rings must be in the position where the run begins."""
    case = named.case
    _, speeds = _speed_table(case, None)
    own = float(parameter_vector(case)[film.DISPLACEMENT])
    speed = speeds[0] if speeds else None
    start = start_state(named, machine, store, speed, _displacements(case, own)[0])
    begin, _ = _displacements(case, float(start.parameters[film.DISPLACEMENT]))
    if abs(start.displacement - begin) > _SAME_DISPLACEMENT:
        raise CannotRunError(
            f"transient.excitation = {case.transient.excitation}: the run begins with the ring displacement "
            f"{begin:g}, but the rings of its start state are at {start.displacement:g}: they would jump",
            "begin as the start state is (on or off), and switch with switch_on or switch_off",
        )
    own_speed = float(start.parameters[film.SPEED])
    if speed is not None and abs(speed - own_speed) > _SAME_SPEED * own_speed:
        rpm = machine.scales.speed_rpm
        raise CannotRunError(
            f"transient.speeds: the run begins with the speed {speed:.7g} ({rpm(speed):.7g} rpm), but the "
            f"rotor of its start state {case.transient.start} turns with {own_speed:.7g} "
            f"({rpm(own_speed):.7g} rpm): it would jump",
            f"begin the table with {own_speed:.10g} ({rpm(own_speed):.10g} rpm), or leave out times and "
            "speeds to stay at it",
        )
    return start


_ATTRIBUTES = (
    "request",
    "parameters",
    "angle",
    "ring_phase",
    "reference_period",
    "steps_per_period",
    "step_error",
)


def _new_attributes(
    case: Case, machine: Machine, driven: DrivenSystem, start: StartState, request: Mapping[str, Any]
) -> dict[str, Any]:
    table, parameters = case.transient, start.parameters
    drive = drive_of(case, parameters, start.angle, start.ring_phase)
    period = reference_period(drive, parameters)
    trial, state = _trial(case, machine, drive, parameters, start, period)
    turns = max(1, math.ceil(period * drive.largest_speed() / (2.0 * math.pi)))
    tolerances = table.tolerance, table.steps_per_period, turns
    choice = choose_steps(driven, trial, parameters, state, *tolerances)
    if not math.isfinite(choice.error):  # the unbalance drives the journal into the foil within a period
        balanced = replace(driven, push=np.zeros_like(driven.push))
        choice = choose_steps(balanced, trial, parameters, state, *tolerances)
    if not math.isfinite(choice.error):
        raise CannotRunError(
            "transient.start: the equations have no solution in the first reference period, even without "
            "unbalance",
            "start elsewhere or at another speed, or lower excitation.displacement",
        )
    return {
        "request": dict(request),
        "parameters": list(parameter_attributes(case, parameters).values()),
        "angle": float(start.angle),
        "ring_phase": float(start.ring_phase),
        "reference_period": period,
        "steps_per_period": choice.steps,
        "step_error": choice.error,
    }


def reference_period(drive: Drive, parameters: Array) -> float:
    """The period of the rings, so that steps and samples repeat with it.

    If the rings rest, the period of the fastest rotation.
    """
    if drive.moves_rings():
        return 2.0 * math.pi / float(parameters[film.EXCITATION_FREQUENCY])
    return 2.0 * math.pi / drive.largest_speed()


def _trial(
    case: Case, machine: Machine, drive: Drive, parameters: Array, start: StartState, period: float
) -> tuple[Drive, Array]:
    """The reference period that needs most steps: at the highest speed with the rings in full motion.

    It starts from the equilibrium there, or from the start state of the run if there is none.
    """
    hardest = parameters.copy()
    hardest[film.SPEED] = drive.largest_speed()
    hardest[film.DISPLACEMENT] = max(_displacements(case, float(parameters[film.DISPLACEMENT])))
    found = machine_equilibrium(machine, hardest)
    if not found.converged:
        hardest[film.SPEED], hardest[film.DISPLACEMENT] = parameters[film.SPEED], start.displacement
    amplitude, frequency = float(hardest[film.DISPLACEMENT]), float(parameters[film.EXCITATION_FREQUENCY])
    steady = Switching(amplitude, amplitude)
    trial = make_drive(
        [0.0], [float(hardest[film.SPEED])], period, steady, frequency, start.angle, start.ring_phase
    )
    return trial, found.state if found.converged else start.state


def _plan(case: Case, drive: Drive, attributes: Mapping[str, Any]) -> Plan:
    table, period = case.transient, float(attributes["reference_period"])
    plan = Plan.of(
        drive,
        step=period / int(attributes["steps_per_period"]),
        interval=period / table.samples_per_period,
        block_samples=table.checkpoint_samples,
        most_blocks=MOST_BLOCKS,
    )
    if plan.samples > LARGEST_ROWS:
        raise CannotRunError(
            f"transient.samples_per_period: the run would store {plan.samples} samples; at most "
            f"{LARGEST_ROWS} fit in a group",
            f"set it to at most {0.99 * LARGEST_ROWS * period / drive.duration:.2g}, or shorten "
            "transient.duration",
        )
    return plan


@dataclass(frozen=True)
class Outlook:
    """Remaining time steps of a run, and their duration [s]."""

    steps: int
    seconds: float


def outlook_of(run: Run, done: int = 0) -> Outlook:
    """The outlook, measured on a few steps from the start or, for a run under way, from an equilibrium."""
    state = (
        run.start.state if run.start is not None else machine_equilibrium(run.machine, run.parameters).state
    )
    steps = min(_MEASURED_STEPS, run.plan.steps)
    period = float(run.attributes["reference_period"])
    length = period / int(run.attributes["steps_per_period"])
    own = float(run.parameters[film.DISPLACEMENT])
    frequency = float(run.parameters[film.EXCITATION_FREQUENCY])
    drive = make_drive([0.0], [run.drive.largest_speed()], steps * length, Switching(own, own), frequency)
    begin = time.perf_counter()
    trial_end(run.driven, drive, run.parameters, state, steps)
    seconds = (time.perf_counter() - begin) / steps
    left = run.plan.steps - done
    return Outlook(left, left * seconds)
