"""The response to unbalance: the equations of motion, the orbit of the full machine, and a single mass."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.unbalance import UnbalanceMass, unbalance_acceleration
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.equilibria.synchronous_response import peaks, synchronous_response
from tests.helpers.unbalanced_map import unbalanced_map
from tests.machines import case, symmetric_rotor

SPEED = 0.7  # that of the excitation: the unbalanced motion then has its period
MASSES = (UnbalanceMass(2, 3e-9), UnbalanceMass(9, 1e-9, 1.0))
SPEEDS = np.array([0.3, SPEED, 1.0])


@pytest.fixture(scope="module")
def passive() -> tuple[Machine, np.ndarray]:
    """Rings at rest, speed and excitation frequency equal."""
    description = case((16, 1), displacement=0.0, speed=SPEED)
    return build_machine(description), parameter_vector(description)


def test_it_is_the_orbit_of_the_full_machine_under_a_small_unbalance(passive):
    """A fixed point of the nonlinear map over a turn: the difference is of second order in the unbalance."""
    machine, parameters = passive
    found = synchronous_response(machine, parameters, MASSES, (2, 5, 9), SPEEDS)
    linear = found.displacement[found.speeds.tolist().index(SPEED)].sum(axis=0)
    rows = machine.scaled.transformation
    start, size = machine.rotor_start, machine.rotor_freedoms
    errors = []
    for factor in (20.0, 40.0):
        masses = [UnbalanceMass(mass.node, factor * mass.moment, mass.phase) for mass in MASSES]
        turning = unbalanced_map(machine, masses, parameters, 40)
        rest = state = machine_equilibrium(machine, at_speed(parameters, SPEED)).state
        for _ in range(5):
            image = turning.evaluate(state, 0.0, np.eye(machine.size))
            state = state + np.linalg.solve(np.eye(machine.size) - image.columns, image.state - state)
        assert np.abs(turning.evaluate(state, 0.0).state - state).max() < 1e-12
        moved = rows @ (state - rest)[start : start + size]
        at_zero = np.array([moved[4 * node : 4 * node + 2] for node in (2, 5, 9)])
        errors.append(np.abs(at_zero - factor * linear.real).max())
        assert errors[-1] < 0.05 * np.abs(factor * linear.real).max()
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.3)


def test_planes_superpose_and_turn_with_their_phase(passive):
    machine, parameters = passive
    whole = synchronous_response(machine, parameters, MASSES, (2, 9), SPEEDS)
    at = [0, -1]
    single = synchronous_response(machine, parameters, (UnbalanceMass(9, 2e-9),), (2, 9), SPEEDS)
    turned = 0.5 * np.exp(1j) * single.displacement[at, 0]
    np.testing.assert_allclose(whole.displacement[at, 1], turned, rtol=1e-10)
    doubled = [UnbalanceMass(mass.node, 2.0 * mass.moment, mass.phase) for mass in MASSES]
    twice = synchronous_response(machine, parameters, doubled, (2, 9), SPEEDS)
    np.testing.assert_allclose(twice.gap, 2.0 * whole.gap, rtol=1e-10)
    assert unbalance_acceleration(machine, MASSES).shape == (2, machine.rotor_freedoms)


def test_speeds_are_inserted_where_the_response_is_curved(passive):
    """Between its speeds no chord is off by more than 2 % of the largest amplitude."""
    machine, parameters = passive
    found = synchronous_response(machine, parameters, MASSES, (2,), np.linspace(0.2, 0.8, 7))
    assert len(found.speeds) > 7
    assert np.all(np.diff(found.speeds) > 0.0)
    middles = 0.5 * (found.speeds[1:] + found.speeds[:-1])
    fine = synchronous_response(machine, parameters, MASSES, (2,), np.unique([*found.speeds, *middles]))
    total, exact = (each.displacement.sum(axis=1)[:, 0] for each in (found, fine))
    for axis in (0, 1):
        guess = np.interp(fine.speeds, found.speeds, total[:, axis].real)
        assert np.abs(guess - exact[:, axis].real).max() < 0.02 * np.abs(exact).max()


def test_a_probe_beside_the_shaft_is_refused(passive):
    with pytest.raises(ValueError, match="probe at node 99: the shaft's nodes are 0 to 14"):
        synchronous_response(*passive, MASSES, (99,), SPEEDS)


def test_a_speed_without_equilibrium_is_told(passive):
    description = case((16, 1), displacement=0.0, speed=SPEED, rotor=symmetric_rotor(gravity=500.0))
    found = synchronous_response(build_machine(description), passive[1], MASSES, (2,), np.array([0.02, 0.03]))
    assert found.speeds.size == 0
    assert found.displacement.shape == (0, 2, 1, 2)
    assert sorted(found.missing) == [0.02, 0.03]


@pytest.mark.parametrize("damping", [0.02, 0.1, 0.2])
def test_the_peak_of_a_single_mass(damping):
    """x = W^2 / (1 - W^2 + 2 i zeta W): top and half-power speeds in closed form, error of fourth order."""
    top = 1.0 / np.sqrt(1.0 - 2.0 * damping**2)
    height = 1.0 / (2.0 * damping * np.sqrt(1.0 - damping**2))

    def response(speed):
        return speed**2 / (1.0 - speed**2 + 2j * damping * speed)

    # |x| = h: W^4 (1 - 1/h^2) - W^2 (2 - 4 zeta^2) + 1 = 0
    level = 0.7071 * height
    low, high = np.sort(np.sqrt(np.roots([1.0 - level**-2, -(2.0 - 4.0 * damping**2), 1.0])))
    errors = []
    for points in (80, 160):
        speeds = np.linspace(0.4, 2.5, round(points * 0.1 / damping) + 1)
        (found,) = peaks(speeds, response(speeds))
        exact = (top, height, low, high)
        errors.append(
            np.abs(np.array([found.speed, found.amplitude, found.low, found.high]) / exact - 1.0).max()
        )
        assert found.amplification == pytest.approx(top / (high - low), rel=0.02)
        assert found.phase == pytest.approx(float(np.angle(response(top))), abs=0.02)
    assert errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) > 2.8


def test_a_peak_without_half_power_has_no_amplification():
    speeds = np.linspace(0.4, 1.1, 100)
    (found,) = peaks(speeds, speeds**2 / (1.0 - speeds**2 + 0.2j * speeds))
    assert np.isnan(found.high)
    assert np.isnan(found.amplification)
    assert np.isfinite(found.low)
    assert list(peaks(speeds[:3], speeds[:3] + 0j)) == []
