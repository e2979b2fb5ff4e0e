"""Initial condition of a transient: an equilibrium, a stored cycle, a checkpoint of another run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.case.transient_settings import EQUILIBRIUM
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.store import Store, case_group, local_name
from pipelines.machine import film
from pipelines.machine.assembly import Machine, parameter_vector, with_stand_ins
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.stages.parameter_columns import stored_parameters


class CannotRunError(Exception):
    """A run cannot start; ``advice`` says what to change. Both name the key."""

    def __init__(self, reason: str, advice: str) -> None:
        super().__init__(reason)
        self.reason, self.advice = reason, advice


@dataclass(frozen=True)
class StartState:
    """The initial state of a transient.

    ``state`` (N,) with its four ``parameters``; their displacement is that of the excitation when it is
    on, ``displacement`` that of the rings in this state. Angles in rad.
    """

    state: Array
    parameters: Array
    displacement: float
    angle: float
    ring_phase: float


def start_state(
    named: NamedCase, machine: Machine, store: Store | None, speed: float | None, displacement: float
) -> StartState:
    """The initial state that the case requests. Raises CannotRunError.

    ``speed`` (None: the case's own) and ``displacement`` are those of an equilibrium.
    """
    table = named.case.transient
    if table.start == EQUILIBRIUM:
        return _equilibrium(named, machine, speed, displacement)
    start = _stored(named, store, table.start)
    if start.state.shape != (machine.size,):
        raise CannotRunError(
            f"transient.start = {table.start}: its states have {start.state.size} components, those of this "
            f"case {machine.size}: it was computed on another grid or for another rotor",
            "start from a group that was computed with the same numerics and rotor.masters",
        )
    return start


def _equilibrium(named: NamedCase, machine: Machine, speed: float | None, displacement: float) -> StartState:
    parameters = parameter_vector(named.case)
    if speed is not None:
        parameters[film.SPEED] = speed
    own = parameters.copy()
    own[film.DISPLACEMENT] = displacement
    found = machine_equilibrium(machine, own)
    if not found.converged:
        raise CannotRunError(
            f"transient.start = {EQUILIBRIUM}: there is none at speed {own[film.SPEED]:g}: {found.reason}",
            "start at another speed (transient.speeds, operation.speed), or from a stored state",
        )
    return StartState(found.state, parameters, displacement, named.case.transient.angle, 0.0)


def _stored(named: NamedCase, store: Store | None, name: str) -> StartState:
    """A row of a branch or a checkpoint of a transient of the same case."""
    group = case_group(named.case_id, name)
    if store is None or not store.has_group(group):
        known = [] if store is None else list_groups(store, named.case_id)
        own = [local_name(path) for path in known if "/cycles/" in path or "/transient/" in path]
        there = f"there are {', '.join(own)}" if own else "there is no branch and no run yet"
        raise CannotRunError(
            f"transient.start = {name}: the store has no such group for the case {named.case_id}; {there}",
            "compute it first (`agfb continue` with the same store), or name another start",
        )
    return _cycle(named, store, group) if name.startswith("cycles") else _checkpoint(named, store, group)


def _cycle(named: NamedCase, store: Store, group: str) -> StartState:
    rows = read_group(store, group, ("state", *PARAMETERS))
    row = _row(named, rows.n_points, "points")
    state, ring_phase = rows["state"][row], 0.0
    parameters = stored_parameters(rows.arrays, row)
    if rows.attributes["formulation"] == "autonomous" and parameters[film.DISPLACEMENT] != 0.0:
        ring_phase = math.atan2(state[-2], state[-1])  # the oscillator of Eq. 17 is (sin, cos) of the phase
        state = state[:-2]
    angle = named.case.transient.angle
    state = np.ascontiguousarray(state)
    return StartState(state, parameters, float(parameters[film.DISPLACEMENT]), angle, ring_phase)


def _checkpoint(named: NamedCase, store: Store, group: str) -> StartState:
    names = ("state", "speed", "angle", "ring_phase", "ring_displacement")
    found = read_group(store, group, [f"checkpoint_{name}" for name in names])
    row = _row(named, found.n_events, "checkpoints")
    state, speed, angle, ring_phase, displacement = (found[f"checkpoint_{name}"][row] for name in names)
    parameters = with_stand_ins(found.attributes["parameters"])
    parameters[film.SPEED] = speed
    return StartState(np.ascontiguousarray(state), parameters, displacement, angle, ring_phase)


def _row(named: NamedCase, count: int, what: str) -> int:
    table = named.case.transient
    row = count - 1 if table.start_row is None else table.start_row
    if not 0 <= row < count:
        raise CannotRunError(
            f"transient.start_row: {table.start} has {count} {what}, counted from 0; {row} is not one",
            "name another row, or leave start_row out for the last one",
        )
    return row
