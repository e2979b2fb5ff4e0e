"""The unbalance on the condensed rotor, and the machine's right-hand side with it."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.extremes import (
    FILM,
    HIGH_FOIL,
    HIGH_PRESSURE,
    LOW_FOIL,
    LOW_PRESSURE,
    machine_extremes,
)
from pipelines.machine.rates import BEARINGS
from pipelines.machine.unbalance import UnbalanceMass, unbalance_acceleration
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.time_runs.unbalanced_map import UNBALANCED_PARAMETERS, unbalanced_system
from tests.machines import BEARING, OTHER_BEARING, case, symmetric_rotor

MASSES = (UnbalanceMass(2, 3e-6, 0.4), UnbalanceMass(9, 1e-6, -1.0))  # node 9 is condensed out


SLOPES = ({"node": 0, "slopes": True}, 2, {"node": 7, "slopes": True}, 12, 14)


@pytest.fixture(scope="module", params=[(0, 2, 4, 7, 10, 12, 14), SLOPES], ids=["translations", "slopes"])
def machine(request):
    rotor = symmetric_rotor(masters=request.param)
    return build_machine(case((16, 1), bearings=(BEARING, OTHER_BEARING), rotor=rotor))


def test_a_mass_on_any_node_accelerates_the_masters_as_its_virtual_work_says(machine):
    """M a = T' F in SI units, F = U Omega^2 (cos, sin)(phi + alpha), then made dimensionless."""
    speed, angle, scales = 700.0, 1.1, machine.scales
    force = np.zeros(machine.condensed.transformation.shape[0])
    for mass in MASSES:
        turned = angle + mass.phase
        force[4 * mass.node : 4 * mass.node + 2] += (
            mass.moment * speed**2 * np.array([np.cos(turned), np.sin(turned)])
        )
    expected = np.linalg.solve(machine.condensed.mass, machine.condensed.transformation.T @ force)
    along, across = unbalance_acceleration(machine, MASSES) * (speed * scales.time) ** 2
    found = (along * np.cos(angle) + across * np.sin(angle)) * scales.displacement / scales.time**2
    found[machine.condensed.freedoms % 4 >= 2] /= BEARING["length"]  # slopes are in units of c/L
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_the_right_hand_side_gains_the_force_alone(machine):
    system, base = unbalanced_system(machine, MASSES), parameter_vector(case((16, 1)))
    parameters = np.zeros(len(UNBALANCED_PARAMETERS))
    parameters[:4], parameters[5:] = base, (1.5, 0.3)
    state = machine_equilibrium(machine, base).state
    phase = 0.8
    gained = system.rates_at(phase, state, parameters) - machine.rates(phase, state, base)
    angle = 0.3 + phase * base[0] / base[1]
    along, across = unbalance_acceleration(machine, MASSES)
    expected = np.zeros(machine.size)
    rows = slice(machine.rotor_start + machine.rotor_freedoms, machine.size)
    expected[rows] = 1.5 * base[0] ** 2 * (along * np.cos(angle) + across * np.sin(angle))
    np.testing.assert_allclose(gained, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max() + 1e-14)


def test_a_mass_beside_the_shaft_is_refused(machine):
    with pytest.raises(ValueError, match="nodes are 0 to 14"):
        unbalance_acceleration(machine, [UnbalanceMass(15, 1e-6)])


def test_the_observed_extremes_are_those_of_the_films(machine):
    parameters = parameter_vector(case((16, 1)))
    state = machine_equilibrium(machine, parameters).state
    phase, out, work = 0.8, np.empty(5 * BEARINGS), np.empty(machine.work_size)
    machine_extremes(phase, state, parameters, machine.constants, machine.layout, work, out)
    found = out.reshape(5, BEARINGS)
    np.testing.assert_allclose(found[FILM], machine.minimum_film(phase, state, parameters), rtol=1e-13)
    for bearing in range(BEARINGS):
        own = state[machine.film_unknowns(bearing)]
        foil = own[-machine.bearings[bearing].settings.nodes :]
        pressure = machine.pressures(state, bearing)
        assert found[LOW_PRESSURE, bearing] == pressure.min()
        assert found[HIGH_PRESSURE, bearing] == -pressure.max()
        assert found[LOW_FOIL, bearing] == foil.min()
        assert found[HIGH_FOIL, bearing] == -foil.max()


def test_the_film_follows_a_ring_whose_displacement_grows(machine):
    """At a growing displacement dq_r/dtau is the total derivative along the ring's motion."""
    from pipelines.machine.ring import ring_axes_at

    rate, frequency, h = 0.07, 0.7, 1e-5

    def axes(t: float) -> np.ndarray:
        return np.array(ring_axes_at.py_func(frequency * t, 0.2 + rate * t, frequency, 0.9, 1.5, 0.3, rate))

    time = 1.3
    difference = (axes(time + h)[:2] - axes(time - h)[:2]) / (2.0 * h)
    np.testing.assert_allclose(axes(time)[2:], difference, atol=1e-10)

    parameters = np.array([1.0, frequency, 0.2, 10.0, rate])
    state = machine_equilibrium(machine, parameters[:4]).state
    moved = machine.rates(0.8, state, parameters) - machine.rates(0.8, state, parameters[:4])
    for bearing in range(BEARINGS):
        own = moved[machine.film_unknowns(bearing)]
        foil = own[-machine.bearings[bearing].settings.nodes :]
        assert np.abs(foil).max() > 0.1 * rate  # the foil is carried along, and squeezes the film
        pressures = own[: -machine.bearings[bearing].settings.nodes].reshape(-1, foil.size)
        film = machine.film(bearing, 0.8, state, parameters).thickness[1:-1]
        squeezed = -machine.pressures(state, bearing).reshape(-1, foil.size) / film * foil
        np.testing.assert_allclose(pressures, squeezed, rtol=0.0, atol=1e-12)
