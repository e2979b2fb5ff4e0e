"""Error of the condensed rotor: stored by `agfb criticals`, and a caution to all that is computed with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.scales import Scales
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store, case_group
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.condensation_error import (
    ALLOWED_ERROR,
    Masters,
    ModeErrors,
    better_masters,
    full_modes,
    mode_errors,
)
from pipelines.machine.rotor_modes import LinearBearing
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed, dynamic_stiffness


@dataclass(frozen=True)
class LinearBearings:
    """Films linearised at ``speeds`` (dimensionless), ``dimensional`` [rad/s].

    The coefficients of every bearing along them.
    """

    speeds: Array
    dimensional: Array
    bearings: tuple[LinearBearing, ...]


def linear_bearings(
    machine: Machine, case: Case, parameters: Array, equilibria: Mapping[float, Array]
) -> LinearBearings:
    """The films linearised at equilibria, given as states by rising dimensionless speed (at least one)."""
    speeds = np.array(list(equilibria))
    complex_stiffness = np.array(
        [
            _synchronous_coefficients(machine, state, at_speed(parameters, speed), speed)
            for speed, state in equilibria.items()
        ]
    )  # (speeds, bearings, 2, 2), in N/m
    dimensional = speeds / machine.scales.time  # rad/s
    bearings = tuple(
        LinearBearing(
            table.node,
            complex_stiffness[:, index].real,
            complex_stiffness[:, index].imag / dimensional[:, None, None],
        )
        for index, table in enumerate(case.bearings)
    )
    return LinearBearings(speeds, dimensional, bearings)


def _synchronous_coefficients(
    machine: Machine, state: Array, parameters: Array, speed: float
) -> list[NDArray[np.complex128]]:
    """K + i Omega C of every bearing [N/m] for whirl at the rotating speed."""
    result = []
    for index, bearing in enumerate(machine.bearings):
        unknowns, position = state[machine.film_unknowns(index)], machine.journal(state, index)[:2]
        dimensionless = dynamic_stiffness(bearing, unknowns, position, parameters, np.array([1j * speed]))[0]
        result.append(dimensionless * machine.scales.bearing_stiffness(index))
    return result


@dataclass(frozen=True)
class CheckedModes:
    """The stored check: arrays of the compared modes, the largest error, a sentence if it is too large."""

    arrays: dict[str, Any]
    error: float
    caution: str


def checked_modes(
    machine: Machine, case: Case, linear: LinearBearings, at_operation: int, critical: Sequence[float]
) -> CheckedModes:
    """Modes up to the upper end of ``criticals.speed_range``, condensed against full.

    At the operating speed, at the highest speed and at the ``critical`` speeds (at the nearest of the
    linearisation).
    """
    table = case.criticals
    nearest = [int(np.argmin(np.abs(linear.speeds - speed))) for speed in critical]
    highest = table.speed_range[1] / machine.scales.time
    references = [
        full_modes(
            machine.rotor,
            float(linear.dimensional[index]),
            [bearing.at(index) for bearing in linear.bearings],
            highest,
            table.max_damping_ratio,
        )
        for index in sorted({at_operation, len(linear.speeds) - 1, *nearest})
    ]
    masters = Masters(machine.condensed.masters, machine.condensed.slopes)
    errors = mode_errors(machine.rotor, masters, references)
    caution = ""
    if errors.worst > ALLOWED_ERROR:
        better = better_masters(machine.rotor, masters, references)
        caution = _caution(errors, machine.scales, masters, *better)
    arrays = {
        "checked_speed": errors.speed * machine.scales.time,
        "checked_full_frequency": errors.full * machine.scales.time,
        "checked_condensed_frequency": errors.condensed * machine.scales.time,
        "checked_error": errors.relative,
    }
    return CheckedModes(arrays, errors.worst, caution)


def condensation_caution(named: NamedCase, store: Store) -> str:
    """The caution for everything computed with the condensed rotor of a case.

    The caution of `criticals` if the store has them, else one from the operating and the highest speed.
    Empty without an equilibrium.
    """
    group = case_group(named.case_id, "criticals")
    if store.has_group(group):
        return str(read_group(store, group, ()).attributes.get("caution", ""))
    machine, parameters = build_machine(named.case), parameter_vector(named.case)
    operation, highest = float(parameters[film.SPEED]), named.case.criticals.speed_range[1]
    found = {
        speed: machine_equilibrium(machine, at_speed(parameters, speed))
        for speed in sorted({operation, highest})
    }
    states = {speed: equilibrium.state for speed, equilibrium in found.items() if equilibrium.converged}
    if not states:
        return ""
    linear = linear_bearings(machine, named.case, parameters, states)
    nearest = int(np.argmin(np.abs(linear.speeds - operation)))
    return checked_modes(machine, named.case, linear, nearest, ()).caution


def _caution(errors: ModeErrors, scales: Scales, masters: Masters, better: Masters, left: ModeErrors) -> str:
    """Which mode has which error, and the masters that reduce it."""
    worst = int(np.argmax(errors.relative))
    speed, full, condensed = (
        float(values[worst]) * scales.time for values in (errors.speed, errors.full, errors.condensed)
    )
    place = f"below the highest speed, at the rotating speed {speed:.4g}"
    if np.isfinite(condensed):
        hertz = f"{scales.hertz(condensed):.4g} instead of {scales.hertz(full):.4g} Hz"
        fault = f"the condensed rotor has a mode {100.0 * errors.worst:.3g} % off ({hertz}) {place}"
    else:
        fault = f"the condensed rotor lacks the mode of {scales.hertz(full):.4g} Hz {place}"
    if better == masters:
        return f"{fault}; no further master helps"
    left_over = f"{100.0 * left.worst:.2g} %"
    return f"{fault}; with rotor.masters = {written(better)} no mode is more than {left_over} off"


def written(masters: Masters) -> str:
    """Masters in the notation of a configuration file."""
    entries = (f"{{ node = {n}, slopes = true }}" if n in masters.slopes else str(n) for n in masters.nodes)
    return f"[{', '.join(entries)}]"
