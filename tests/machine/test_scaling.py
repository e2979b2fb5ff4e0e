"""Units: one machine described in two ways behaves the same in SI; similar machines are one machine."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.case.models import Case
from pipelines.machine.assembly import Machine, build_machine, film_settings, parameter_vector
from pipelines.machine.bearing import film_state, pack_bearing
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from tests.machines import BEARING, DISC, OTHER_BEARING, case, symmetric_rotor

RPM = 24_000.0
FREQUENCY_HZ = 300.0


def described(first: dict, second: dict) -> Case:
    """The symmetric rotor at a speed in rpm on two bearings, given from node 0 upwards."""
    return case(
        (12, 2),
        bearings=(first, second),
        operation={"speed_rpm": RPM},
        excitation={"frequency": None, "frequency_hz": FREQUENCY_HZ, "displacement": 0.2},
    )


@pytest.fixture(scope="module")
def both_ways() -> list[tuple[Machine, NDArray[np.float64]]]:
    """The machine and the same machine turned end for end, so that the other bearing sets the scales."""
    cases = [described(BEARING, OTHER_BEARING), described(OTHER_BEARING, BEARING)]
    return [(build_machine(one), parameter_vector(one)) for one in cases]


def reversed_masters(machine: Machine, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """x, y of the masters in the opposite order."""
    return values.reshape(-1, 2)[::-1].ravel()


def turned(
    from_machine: Machine, to_machine: Machine, state: NDArray[np.float64], rate: bool = False
) -> NDArray[np.float64]:
    """A state (or, with ``rate``, its d/dtau) of one machine in the units and order of the other."""
    a, b = from_machine.scales, to_machine.scales
    length, time = a.displacement / b.displacement, b.time / a.time
    n, start = from_machine.rotor_freedoms, from_machine.rotor_start
    parts = [state[from_machine.film_unknowns(1)], state[from_machine.film_unknowns(0)]]
    position = length * reversed_masters(from_machine, state[start : start + n])
    velocity = length * time * reversed_masters(from_machine, state[start + n :])
    return np.concatenate([*parts, position, velocity]) * (time if rate else 1.0)


def test_end_for_end_rates_agree(both_ways: list[tuple[Machine, NDArray[np.float64]]]) -> None:
    """At a random state and phase, every entry of ds/dt: time, clearance, force and stiffness ratios."""
    (machine, parameters), (other, other_parameters) = both_ways
    generator = np.random.default_rng(4)
    state = 0.1 * generator.standard_normal(machine.size)
    for index in range(2):
        unknowns = machine.film_unknowns(index)
        state[unknowns][: 2 * machine.bearings[index].settings.nodes] += 1.0
    rates = turned(machine, other, machine.rates(0.9, state, parameters), rate=True)
    again = other.rates(0.9, turned(machine, other, state), other_parameters)
    np.testing.assert_allclose(again, rates, rtol=1e-10, atol=1e-10 * np.abs(rates).max())
    # and back: the map is its own inverse
    np.testing.assert_allclose(turned(other, machine, turned(machine, other, state)), state, rtol=1e-14)


def test_end_for_end_equilibria_agree(both_ways: list[tuple[Machine, NDArray[np.float64]]]) -> None:
    (machine, parameters), (other, other_parameters) = both_ways
    first, second = machine_equilibrium(machine, parameters), machine_equilibrium(other, other_parameters)
    assert first.converged
    assert second.converged
    metres = machine.scales.displacement * machine.masters(first.state)
    other_metres = other.scales.displacement * other.masters(second.state)
    np.testing.assert_allclose(
        reversed_masters(machine, other_metres), metres, rtol=0.0, atol=1e-7 * BEARING["clearance"]
    )
    np.testing.assert_allclose(
        machine.minimum_film(0.0, first.state, parameters),
        other.minimum_film(0.0, second.state, other_parameters)[::-1],
        rtol=1e-7,
    )


def test_end_for_end_eigenvalues_agree(both_ways: list[tuple[Machine, NDArray[np.float64]]]) -> None:
    """In 1/s, with multiplicity: the whole spectrum of the whole Jacobian."""
    spectra = []
    for machine, parameters in both_ways:
        state = machine_equilibrium(machine, parameters).state
        values = np.linalg.eigvals(machine.jacobian(0.0, state, parameters).toarray()) / machine.scales.time
        spectra.append(np.sort_complex(values[values.imag >= 0.0]))
    np.testing.assert_allclose(spectra[0], spectra[1], rtol=1e-6)


def test_second_bearing_in_its_own_scales(both_ways: list[tuple[Machine, NDArray[np.float64]]]) -> None:
    """Film rates in 1/s and forces in N of a bearing: as second of a machine, and alone with its own t_b."""
    machine, parameters = both_ways[0]
    own = machine.scales.bearings[1]
    alone_case = described(OTHER_BEARING, OTHER_BEARING)
    alone, alone_parameters = pack_bearing(film_settings(alone_case, 0)), parameter_vector(alone_case)
    generator = np.random.default_rng(7)
    unknowns = 0.1 * generator.standard_normal(alone.settings.unknowns)
    unknowns[: 2 * alone.settings.nodes] += 1.0
    journal = np.array([0.2, -0.3, 0.05, 0.04])  # in c_b and c_b / t0 of the machine
    second = film_state(machine.bearings[1], unknowns, journal, 0.9, parameters)
    journal_alone = journal * [1.0, 1.0, own.time_ratio, own.time_ratio]
    first = film_state(alone, unknowns, journal_alone, 0.9, alone_parameters)
    np.testing.assert_allclose(
        second.rates / machine.scales.time, first.rates / own.time, rtol=1e-10, atol=1e-6
    )
    np.testing.assert_allclose(second.force, first.force, rtol=1e-13)
    assert own.force == pytest.approx(101325.0 * OTHER_BEARING["radius"] * OTHER_BEARING["length"])


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_stronger_gas_and_rotor_are_one_machine(factor: float) -> None:
    """Viscosity, ambient pressure, modulus, density, discs times a factor: times stay, forces scale."""
    steel = {"young_modulus": factor * 206e9, "poisson_ratio": 0.3, "density": factor * 7850.0}
    disc = {key: factor * value for key, value in DISC.items()}
    rotor = symmetric_rotor(materials={"steel": steel}, discs=[{"node": 0, **disc}, {"node": 14, **disc}])
    gas = {"viscosity": factor * 1.85e-5, "ambient_pressure": factor * 101325.0}
    assert_same_dimensionless(case((12, 2)), case((12, 2), gas=gas, rotor=rotor))


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_slower_gas_and_heavier_rotor_are_one_machine(factor: float) -> None:
    """Viscosity times a factor makes t0 longer by it: masses times its square, gravity divided by that."""
    steel = {"young_modulus": 206e9, "poisson_ratio": 0.3, "density": factor**2 * 7850.0}
    disc = {key: factor**2 * value for key, value in DISC.items()}
    rotor = symmetric_rotor(
        materials={"steel": steel},
        discs=[{"node": 0, **disc}, {"node": 14, **disc}],
        rayleigh_stiffness=factor * 2.43e-5,
        gravity=9.81 / factor**2,
    )
    gas = {"viscosity": factor * 1.85e-5, "ambient_pressure": 101325.0}
    assert_same_dimensionless(case((12, 2)), case((12, 2), gas=gas, rotor=rotor))


def assert_same_dimensionless(first: Case, second: Case) -> None:
    """Both cases have the same dimensionless right-hand side."""
    one, other = build_machine(first), build_machine(second)
    state = 1.0 + 0.1 * np.random.default_rng(1).standard_normal(one.size)
    state[one.rotor_start :] -= 1.0
    rates = one.rates(0.3, state, parameter_vector(first))
    np.testing.assert_allclose(other.rates(0.3, state, parameter_vector(second)), rates, rtol=1e-7, atol=1e-7)
    assert np.abs(one.rates(0.3, 0.99 * state, parameter_vector(first)) - rates).max() > 1e-2


def test_ring_load_moves_both_rings_equally_in_metres() -> None:
    """A load on two equal rings displaces both by the same length, whatever their bearings' clearances."""
    ring = {
        "inner_radius": 0.02,
        "thickness": 0.002,
        "width": 0.015,
        "young_modulus": 206e9,
        "poisson_ratio": 0.3,
    }
    excitation = {"displacement": None, "load": 20.0, "ring": ring, "frequency": 0.7}
    loaded = case((12, 2), bearings=(BEARING, OTHER_BEARING), excitation=excitation)
    machine, parameters = build_machine(loaded), parameter_vector(loaded)
    top = [
        parameters[2] * bearing.settings.ring_amplitude * scales.clearance_ratio
        for bearing, scales in zip(machine.bearings, machine.scales.bearings, strict=True)
    ]
    assert top[0] == pytest.approx(top[1], rel=1e-12)
