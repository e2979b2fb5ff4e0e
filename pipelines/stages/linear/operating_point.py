"""The machine at its operating speed: written by `agfb linearize` beside the equilibria along the speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import write_group
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, case_group
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.orbits.equilibria.bearing_coefficients import machine_coefficients
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest, machine_equilibrium
from pipelines.orbits.equilibria.modes import LARGEST_DAMPING_RATIO, logarithmic_decrements, modes_at
from pipelines.orbits.equilibria.static_deflection import bearing_reactions, static_deflection
from pipelines.stages.linear.along_speed import direction_flags, reference_parameters
from pipelines.stages.results import Scalar

GROUP = "operating_point"
HIGHEST = 3.0  # of the rotating speed: modes up to this frequency, or to the end of criticals.speed_range


def write_operating_point(store: Store, named: NamedCase, machine: Machine) -> None:
    """Write the group unless it is there; without an equilibrium it says why and has no arrays."""
    group = case_group(named.case_id, GROUP)
    request = {"ring": named.case.linearize.ring, "frequency": _top(named.case)}
    if store.has_group(group) and read_group(store, group, ()).attributes.get("request") == request:
        return
    parameters = reference_parameters(named.case, named.case.linearize.ring)
    speed = float(parameters[film.SPEED])
    equilibrium = machine_equilibrium(machine, parameters)
    attributes = {
        "request": request,
        "speed": speed,
        "speed_rpm": machine.scales.speed_rpm(speed),
        "equilibrium": equilibrium.converged,
        "reason": "" if equilibrium.converged else equilibrium.reason,
    }
    arrays: dict[str, Any] = {}
    if equilibrium.converged:
        arrays = _statics(machine, named.case, parameters, equilibrium.state)
        arrays |= _coefficients(machine, parameters, equilibrium.state)
        arrays |= _modes(machine, named.case, parameters, equilibrium.state)
    write_group(store, group, GROUP, arrays, attributes)


def _top(case: Case) -> float:
    """The highest frequency of a stored mode."""
    return max(HIGHEST * float(case.parameters[film.SPEED]), case.criticals.speed_range[1])


def _statics(machine: Machine, case: Case, parameters: Array, state: Array) -> dict[str, Any]:
    bearings = range(len(machine.bearings))
    journal = np.array([machine.journal(state, index)[:2] for index in bearings])
    reaction = bearing_reactions(machine, parameters, state)
    clearance = np.array([table.clearance for table in case.bearings])
    # from the direction of the load, -reaction, to the journal, in the direction of rotation
    angle = np.angle((journal[:, 0] + 1j * journal[:, 1]) / -(reaction[:, 0] + 1j * reaction[:, 1]))
    return {
        "deflection": static_deflection(machine, state),
        "bearing_node": np.array([table.node for table in case.bearings], dtype=np.int32),
        "reaction": reaction,
        "journal": journal,
        "eccentricity": np.hypot(*journal.T),
        "attitude_angle": angle,
        "minimum_film": machine.minimum_film(MEAN_PHASE, state, at_rest(parameters)) * clearance,
    }


def _coefficients(machine: Machine, parameters: Array, state: Array) -> dict[str, Any]:
    """Stiffness [N/m] and damping [N s/m] for whirl at the rotating speed."""
    scales, synchronous = machine.scales, parameters[film.SPEED : film.SPEED + 1]
    stiffness, damping = machine_coefficients(machine, parameters, state, synchronous)
    unit = np.array([scales.bearing_stiffness(index) for index in range(len(machine.bearings))])
    return {
        "stiffness": stiffness[0] * unit[:, None, None],
        "damping": damping[0] * (unit * scales.time)[:, None, None],
    }


def _modes(machine: Machine, case: Case, parameters: Array, state: Array) -> dict[str, Any]:
    """The oscillating modes up to the highest frequency, without strongly damped ones of film and foil."""
    top = _top(case)
    modes = modes_at(machine, parameters, state, top)
    kept = (modes.eigenvalues.imag <= top) & (modes.damping_ratios < LARGEST_DAMPING_RATIO)
    eigenvalues = modes.eigenvalues[kept]
    return {
        "eigenvalue": eigenvalues,
        "frequency_hertz": eigenvalues.imag * machine.scales.hertz_per_unit,
        "frequency_rpm": eigenvalues.imag * machine.scales.speed_rpm_per_unit,
        "logarithmic_decrement": logarithmic_decrements(eigenvalues),
        "damping_ratio": modes.damping_ratios[kept],
        "direction": direction_flags(modes.directions[kept]),
        "mode_shape": modes.shapes[kept],
    }


def tables(group: Group) -> dict[str, list[dict[str, Scalar]]]:
    """What the terminal shows of the group: the bearings, K and C for synchronous whirl, and the modes."""
    if not group.attributes["equilibrium"]:
        return {}
    bearings = [_bearing(group, index) for index in range(len(group["bearing_node"]))]
    modes = [_mode(group, index) for index in range(len(group["eigenvalue"]))]
    return {"bearings_at_operating_speed": bearings, "modes_at_operating_speed": modes}


def _bearing(group: Group, index: int) -> dict[str, Scalar]:
    named = {
        "load N": np.hypot(*group["reaction"][index]),
        "eccentricity": group["eccentricity"][index],
        "attitude deg": np.rad2deg(group["attitude_angle"][index]),
        "film um": 1e6 * group["minimum_film"][index],
    }
    for letter, array, unit in (("K", "stiffness", "N/m"), ("C", "damping", "N s/m")):
        for entry, row, column in (("xx", 0, 0), ("xy", 0, 1), ("yx", 1, 0), ("yy", 1, 1)):
            named[f"{letter}{entry} {unit}"] = group[array][index, row, column]
    return {"bearing": index + 1, "node": int(group["bearing_node"][index])} | _plain(named)


def _mode(group: Group, index: int) -> dict[str, Scalar]:
    numbers = {
        "rpm": group["frequency_rpm"][index],
        "Hz": group["frequency_hertz"][index],
        "decrement": group["logarithmic_decrement"][index],
        "damping ratio": group["damping_ratio"][index],
    }
    unstable = " unstable" if numbers["decrement"] < 0.0 else ""
    direction = str(group.labels("direction")[index])
    return {"mode": index + 1} | _plain(numbers) | {"direction": direction + unstable}


def _plain(numbers: Mapping[str, Any]) -> dict[str, Scalar]:
    return {name: float(number) for name, number in numbers.items()}
