"""A rotor of ROSS on exported coefficients against the full eigenproblem of agfb, and how far they agree.

ROSS takes K and C at the real whirl frequency of a mode; its exponent is complex. What is neglected is of
first order in the damping ratio (`pipelines.orbits.equilibria.bearing_coefficients`).
"""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.rotor_modes import LinearBearing, oscillating_modes
from pipelines.orbits.equilibria.bearing_coefficients import machine_coefficients
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed, dynamic_stiffness
from pipelines.orbits.equilibria.modes import modes_at
from tests.helpers.ross_foil_rotor import HIGHEST, REFERENCE, case, write_coefficients

NAMES = tuple(f"{letter}{entry}" for letter in "kc" for entry in ("xx", "xy", "yx", "yy"))
LIGHTLY_DAMPED = 0.01


def bearings_of(paths: list[Path]) -> list[dict[str, Any]]:
    return [next(iter(tomllib.loads(path.read_text()).values())) for path in paths]


def ross_eigenvalues() -> dict[float, list[complex]]:
    table: dict[float, list[complex]] = {}
    with (REFERENCE / "ross_foil_bearing_eigenvalues.csv").open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            value = complex(float(row["real"]), float(row["imaginary"]))
            table.setdefault(float(row["speed"]), []).append(value)
    return table


FROM_ROSS = ross_eigenvalues()


def test_the_export_is_what_ross_was_given(tmp_path: Path) -> None:
    frozen = bearings_of([REFERENCE / f"ross_foil_bearing_{number}.toml" for number in (1, 2)])
    for now, before in zip(bearings_of(write_coefficients(tmp_path)), frozen, strict=True):
        assert now.keys() == before.keys() == {"n", "tag", "speed", "frequency", *NAMES}
        assert (now["n"], now["tag"]) == (before["n"], before["tag"])
        shape = (len(now["speed"]), len(now["frequency"]))
        for name in ("speed", "frequency", *NAMES):
            assert np.shape(now[name]) == {"speed": shape[:1], "frequency": shape[1:]}.get(name, shape)
            scale = np.max(np.abs(before[name]))
            np.testing.assert_allclose(now[name], before[name], rtol=1e-6, atol=1e-8 * scale)


@pytest.mark.parametrize("speed", FROM_ROSS)
def test_eigenvalues_of_agfb_agree_with_ross(speed: float) -> None:
    machine, parameters = build_machine(case().case), parameter_vector(case().case)
    time = machine.scales.time
    at = at_speed(parameters, speed * time)
    found = modes_at(machine, at, machine_equilibrium(machine, at).state, HIGHEST * time)
    own = found.eigenvalues / time
    lightly = 0
    for expected in FROM_ROSS[speed]:
        mine = own[np.argmin(np.abs(own - expected))]
        error, ratio = abs(mine - expected) / abs(mine), abs(mine.real) / abs(mine)
        if ratio < LIGHTLY_DAMPED:
            lightly += 1
            assert error < 1e-3
        assert error < 1e-4 + 0.15 * ratio
    assert lightly == 3, "the two bending modes and the whirl that loses its stability"
    kept = (own.imag < HIGHEST) & (found.damping_ratios < 0.3)
    assert np.count_nonzero(kept) == len(FROM_ROSS[speed]), "ROSS has every mode"


def test_what_is_neglected_is_of_first_order_in_the_damping() -> None:
    """K + lambda C - Z(lambda) over sigma tends to i K' - omega C' (central differences in omega)."""
    machine = build_machine(case().case)
    at = at_speed(parameter_vector(case().case), FROM_ROSS_SPEED * machine.scales.time)
    state = machine_equilibrium(machine, at).state
    film, journal = state[machine.film_unknowns(0)], machine.journal(state, 0)[:2]
    omega, step = 0.4, 1e-4
    around = np.array([omega - step, omega, omega + step])
    stiffness, damping = (each[:, 0] for each in machine_coefficients(machine, at, state, around))
    slope = [(each[2] - each[0]) / (2.0 * step) for each in (stiffness, damping)]
    expected = 1j * slope[0] - omega * slope[1]

    def neglected(sigma: float) -> np.ndarray:
        exponent = sigma + 1j * omega
        exact = dynamic_stiffness(machine.bearings[0], film, journal, at, np.array([exponent]))[0]
        return (stiffness[1] + exponent * damping[1] - exact) / sigma

    errors = [np.max(np.abs(neglected(sigma) - expected)) for sigma in (-2e-2, -1e-2, -5e-3)]
    assert errors[2] < 0.02 * np.max(np.abs(expected))
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


FROM_ROSS_SPEED = next(iter(FROM_ROSS))


def test_a_rotor_assembled_here_has_the_eigenvalues_of_ross() -> None:
    """The full rotor on the coefficients at the whirl frequency of each of ROSS's modes."""
    machine, named = build_machine(case().case), case()
    parameters, scales = parameter_vector(named.case), machine.scales
    for speed, values in FROM_ROSS.items():
        at = at_speed(parameters, speed * scales.time)
        state = machine_equilibrium(machine, at).state
        for expected in values:
            whirl = np.array([expected.imag * scales.time])
            stiffness, damping = machine_coefficients(machine, at, state, whirl)
            bearings = []
            for index, table in enumerate(named.case.bearings):
                own = scales.bearings[index]
                unit = own.force / (own.clearance_ratio * scales.displacement)
                k, c = stiffness[0, index] * unit, damping[0, index] * unit * scales.time
                bearings.append(LinearBearing(table.node, k, c))
            mine = oscillating_modes(machine.rotor, speed, bearings).eigenvalues
            # ROSS's coefficients are interpolated between frequencies 125 rad/s apart
            assert np.min(np.abs(mine - expected)) < 2e-4 * abs(expected)
