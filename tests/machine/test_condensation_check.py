"""The comparison of full and condensed rotor that the choice of masters rests on."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.condensation_check import compare_condensation, compare_modes, modal_assurance
from pipelines.machine.rotor_modes import LinearBearing, oscillating_modes
from pipelines.machine.shaft import assemble_rotor

# A gas bearing's order of magnitude, with cross coupling.
STIFFNESS = np.array([[1.2e6, 4e5], [-3e5, 1.6e6]])
DAMPING = np.array([[150.0, 10.0], [10.0, 120.0]])
SPEEDS = np.linspace(200.0, 3000.0, 15)
UNBALANCE = {0: 2e-7, 14: -2e-7j}


def bearings(first: int = 2, second: int = 12) -> list[LinearBearing]:
    growing = (0.5 + SPEEDS / 3000.0)[:, None, None]
    return [
        LinearBearing(first, STIFFNESS * growing, DAMPING / growing),
        LinearBearing(second, STIFFNESS, DAMPING),
    ]


def test_seven_masters_stand_for_the_reconstructed_rotor(slender_rotor):
    """Up to 3000 rad/s, 1.5 times the largest speed of the paper's charts in units of 1 / t0 = 1938 rad/s."""
    result = compare_condensation(
        assemble_rotor(slender_rotor),
        slender_rotor.masters,
        bearings(),
        SPEEDS,
        unbalance=UNBALANCE,
        modal_index=14,
        modes=6,
    )
    modal = result.modal
    assert result.modal_speed == 3000.0
    assert np.all(np.diff(modal.full_frequency) >= 0)
    # measured: 6e-4 in the frequencies, 2e-3 in the decrements
    np.testing.assert_allclose(modal.condensed_frequency, modal.full_frequency, rtol=1e-3)
    np.testing.assert_allclose(modal.condensed_decrement, modal.full_decrement, rtol=5e-3)
    assert modal.mac.shape == (6, 6)
    assert np.all(np.diag(modal.mac) > 0.999)
    assert result.unbalance_full.shape == result.unbalance_condensed.shape == (15, 15, 2)
    # at a resonance with damping ratio 0.05 a frequency error of 6e-4 is one of 6e-4 / 0.05 in the response
    largest = np.max(np.abs(result.unbalance_full))
    assert np.max(np.abs(result.unbalance_condensed - result.unbalance_full)) < 0.02 * largest


def test_fewer_masters_are_seen_to_be_worse(slender_rotor):
    matrices = assemble_rotor(slender_rotor)
    at_last = [item.at(14) for item in bearings()]
    errors = []
    for masters in ((2, 12), (0, 2, 7, 12, 14), slender_rotor.masters):
        modal = compare_modes(matrices, masters, 3000.0, at_last, 4)
        errors.append(np.max(np.abs(modal.condensed_frequency / modal.full_frequency - 1)))
    assert errors[0] > 5 * errors[1] > 5 * errors[2]


def test_overdamped_modes_are_not_compared(slender_rotor):
    """Stiffness-proportional damping overdamps modes above 2 / b; turning, they wander slowly."""
    matrices = assemble_rotor(slender_rotor)
    at_last = [item.at(14) for item in bearings()]
    lowest = oscillating_modes(matrices, 3000.0, at_last)
    assert lowest.damped_frequencies[0] < 20.0
    assert lowest.damping_ratios[0] > 0.999
    kept = lowest.lightly_damped(0.5, 4)
    np.testing.assert_array_equal(kept.eigenvalues, lowest.eigenvalues[lowest.damping_ratios < 0.5][:4])
    modal = compare_modes(matrices, slender_rotor.masters, 3000.0, at_last, 4)
    np.testing.assert_array_equal(modal.full_frequency, kept.damped_frequencies)


def test_partners_are_found_when_modes_change_their_order(slender_rotor):
    """Two bending modes in planes of nearly equal stiffness, whose order the condensation can turn round."""
    matrices = assemble_rotor(slender_rotor.model_copy(update={"rayleigh_stiffness": 0.0}))
    plain = [LinearBearing(node, np.diag([1e6, 1.001e6]), np.zeros((2, 2))) for node in (2, 12)]
    modal = compare_modes(matrices, slender_rotor.masters, 0.0, plain, 4)
    assert np.all(np.diag(modal.mac) > 0.999)
    assert np.max(np.abs(modal.mac - np.diag(np.diag(modal.mac)))) < 0.05


def test_modal_assurance_of_equal_and_of_orthogonal_shapes():
    shapes = np.array([[1.0, 1.0j, 0.0], [1.0, -1.0j, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(modal_assurance(shapes, (2 - 3j) * shapes), np.eye(3), atol=1e-15)
    mixed = np.array([[1.0, 0.0, 0.0]], dtype=complex)
    np.testing.assert_allclose(modal_assurance(shapes, mixed), [[0.5], [0.5], [0.0]])


def test_a_bearing_must_stand_on_a_master(slender_rotor):
    with pytest.raises(ValueError, match="node 3 is not a master node"):
        compare_condensation(
            assemble_rotor(slender_rotor),
            slender_rotor.masters,
            bearings(first=3),
            SPEEDS,
            unbalance=UNBALANCE,
            modal_index=0,
        )
