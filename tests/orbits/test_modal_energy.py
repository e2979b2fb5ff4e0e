"""Energies of the modes of the reconstructed rotor."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine
from pipelines.orbits.time_runs.modal_energy import modal_energy, rotor_modes, sampled_velocity
from tests.helpers.tiny import tiny_case


@pytest.fixture(scope="module")
def rotor():
    machine = build_machine(tiny_case().case)
    scales = machine.scales
    return machine.condensed.scaled(scales.time, scales.displacement, scales.force)


def test_the_sum_over_the_modes_is_the_energy(rotor):
    modes = rotor_modes(rotor.mass, rotor.stiffness)
    random = np.random.default_rng(1)
    displacement, velocity = random.normal(size=(2, 20, len(rotor.mass)))
    found = modal_energy(modes, displacement, velocity)
    kinetic = 0.5 * np.einsum("ti,ij,tj->t", velocity, rotor.mass, velocity)
    strain = 0.5 * np.einsum("ti,ij,tj->t", displacement, rotor.stiffness, displacement)
    np.testing.assert_allclose(found.kinetic.sum(axis=1), kinetic, rtol=1e-12)
    np.testing.assert_allclose(found.strain.sum(axis=1), strain, rtol=1e-9)


def test_both_planes_of_a_mode_count_together(rotor):
    """A free round rotor on seven masters: four rigid-body motions and five pairs of bending modes."""
    modes = rotor_modes(rotor.mass, rotor.stiffness)
    np.testing.assert_array_equal(modes.multiplicity, [4, 2, 2, 2, 2, 2])
    assert modes.frequency[0] == 0.0
    assert np.all(np.diff(modes.frequency) > 0.0)


def test_a_rigid_motion_has_no_strain_and_a_mode_its_own_energy(rotor):
    modes = rotor_modes(rotor.mass, rotor.stiffness)
    sideways = np.tile([1.0, 0.0], (1, len(rotor.mass) // 2))
    rigid = modal_energy(modes, sideways, sideways)
    mass = float(sideways[0] @ rotor.mass @ sideways[0])
    assert rigid.kinetic[0, 0] == pytest.approx(0.5 * mass, rel=1e-9)
    assert np.abs(rigid.kinetic[0, 1:]).max() < 1e-9 * mass
    assert rigid.strain[0, 0] == 0.0
    # the second shape of the first bending pair, turning at its natural frequency: constant energy
    shape = np.linalg.solve(rotor.mass, modes.weights[5])
    phase = np.linspace(0.0, 6.0, 50)[:, None]
    frequency = modes.frequency[1]
    bending = modal_energy(modes, np.cos(phase) * shape, -frequency * np.sin(phase) * shape)
    np.testing.assert_allclose((bending.kinetic + bending.strain)[:, 1], 0.5 * frequency**2, rtol=1e-9)


def test_velocities_of_sixth_order():
    errors = []
    for interval in (0.2, 0.1):
        time = np.arange(0.0, 20.0, interval)[:, None]
        velocity = sampled_velocity(np.sin(time), interval)
        errors.append(np.abs(velocity - np.cos(time))[3:-3].max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.1)
    with pytest.raises(ValueError, match="7 samples"):
        sampled_velocity(np.zeros((6, 2)), 0.1)
