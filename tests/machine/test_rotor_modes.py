"""Modes, undamped critical speeds and unbalance response against closed forms and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.case.models import Disc, Element, Material, Rotor, Support
from pipelines.machine.condensation import condense
from pipelines.machine.rotor_modes import (
    LinearBearing,
    oscillating_modes,
    translations,
    unbalance_response,
    whirl_directions,
)
from pipelines.machine.shaft import assemble_rotor
from tests.helpers.undamped import undamped_critical_speeds


def bearing(node: int, stiffness: float, damping: float = 0.0, ratio: float = 1.0) -> LinearBearing:
    return LinearBearing(node, np.diag([stiffness, ratio * stiffness]), np.diag([damping, ratio * damping]))


def test_a_free_rotor_at_rest_has_rayleigh_damping_ratios(slender_rotor):
    """zeta = (a / w + b w) / 2 with w the undamped frequency; four rigid motions do not oscillate."""
    rotor = slender_rotor.model_copy(update={"rayleigh_mass": 30.0, "rayleigh_stiffness": 2e-7})
    modes = oscillating_modes(assemble_rotor(rotor), 0.0)
    undamped = oscillating_modes(
        assemble_rotor(rotor.model_copy(update={"rayleigh_mass": 0.0, "rayleigh_stiffness": 0.0})), 0.0
    )
    assert undamped.eigenvalues.size == 4 * 15 - 4
    frequency = undamped.damped_frequencies[:8]
    np.testing.assert_allclose(modes.natural_frequencies[:8], frequency, rtol=1e-9)
    ratio = 0.5 * (30.0 / frequency + 2e-7 * frequency)
    np.testing.assert_allclose(modes.damping_ratios[:8], ratio, rtol=1e-7)
    np.testing.assert_allclose(
        modes.logarithmic_decrements[:8], 2 * np.pi * ratio / np.sqrt(1 - ratio**2), rtol=1e-7
    )


def test_modes_satisfy_their_equation_on_both_rotors(slender_rotor):
    full = assemble_rotor(slender_rotor)
    bearings = [bearing(2, 1e6, 200.0, 0.6), bearing(12, 2e6, 100.0, 1.5)]
    for rotor in (full, condense(full, slender_rotor.masters)):
        modes = oscillating_modes(rotor, 3000.0, bearings)
        first = modes.shapes[:6].T
        stiffness, damping = rotor.stiffness.copy(), rotor.damping + 3000.0 * rotor.gyroscopic
        for item, position in zip(bearings, (8, 48) if rotor is full else (2, 10), strict=True):
            stiffness[position : position + 2, position : position + 2] += item.stiffness
            damping[position : position + 2, position : position + 2] += item.damping
        values = modes.eigenvalues[:6]
        terms = rotor.mass @ first * values**2, damping @ first * values, stiffness @ first
        residual = np.linalg.norm(sum(terms), axis=0)
        scale = np.linalg.norm(np.abs(stiffness) @ np.abs(first), axis=0)
        assert np.max(residual / scale) < 1e-10


def test_the_gyroscopic_effect_lifts_forward_and_lowers_backward_whirl(slender_rotor):
    rotor = assemble_rotor(slender_rotor.model_copy(update={"rayleigh_stiffness": 0.0}))
    bearings = [bearing(2, 1e7), bearing(12, 1e7)]
    at_rest = oscillating_modes(rotor, 0.0, bearings).damped_frequencies[:6]
    modes = oscillating_modes(rotor, 4000.0, bearings)
    whirl = whirl_directions(translations(rotor, modes.shapes[:6]))
    np.testing.assert_array_equal(whirl, [-1, 1, -1, 1, -1, 1])
    assert np.all((modes.damped_frequencies[:6] - at_rest) * whirl > 0)
    # turning the rotor the other way exchanges the names
    reversed_modes = oscillating_modes(rotor, -4000.0, bearings)
    np.testing.assert_array_equal(whirl_directions(translations(rotor, reversed_modes.shapes[:6])), -whirl)


def test_planar_modes_have_no_direction(slender_rotor):
    rotor = assemble_rotor(slender_rotor)
    modes = oscillating_modes(rotor, 0.0, [bearing(2, 1e6, 0.0, 0.5), bearing(12, 1e6, 0.0, 0.5)])
    np.testing.assert_array_equal(whirl_directions(translations(rotor, modes.shapes[:4])), 0)


def test_undamped_critical_speeds_are_the_crossings_of_the_campbell_diagram(slender_rotor):
    matrices = assemble_rotor(slender_rotor.model_copy(update={"rayleigh_stiffness": 0.0}))
    bearings = [bearing(2, 5e6, ratio=0.7), bearing(12, 8e6, ratio=0.8)]
    criticals = undamped_critical_speeds(matrices, bearings)
    for speed, whirl in zip(criticals.speeds[:6], criticals.whirl[:6], strict=True):
        modes = oscillating_modes(matrices, speed, bearings)
        nearest = np.argmin(np.abs(modes.eigenvalues - 1j * speed))
        assert abs(modes.eigenvalues[nearest] - 1j * speed) < 1e-9 * speed
        assert whirl_directions(translations(matrices, modes.shapes[[nearest]]))[0] == whirl
    assert set(criticals.whirl[:4]) == {-1, 1}


def test_a_disc_heavier_about_its_axis_has_no_forward_tilting_critical_speed():
    """Disc on a light stiff shaft, I_p > I_d: tilting, W^2 = k / (I_d - I_p) forward has no solution."""
    light = {"steel": Material(young_modulus=206e9, density=1e-6, poisson_ratio=0.3)}
    rotor = Rotor(
        materials=light,
        elements=(Element(length=0.1, outer_diameter=0.05, count=2),),
        discs=(Disc(node=1, mass=2.0, diametral_inertia=0.01, polar_inertia=0.018),),
        supports=(
            Support(node=0, stiffness_xx=1e4, stiffness_yy=1e4),
            Support(node=2, stiffness_xx=1e4, stiffness_yy=1e4),
        ),
        masters=(0, 2),
    )
    criticals = undamped_critical_speeds(assemble_rotor(rotor))
    low = criticals.speeds < 1e4  # above: the shaft's own modes
    translation, tilting = np.sqrt(2e4 / 2.0), np.sqrt(2 * 1e4 * 0.1**2 / (0.01 + 0.018))
    # the shaft is 1e3 times stiffer than the supports
    np.testing.assert_allclose(criticals.speeds[low], [tilting, translation, translation], rtol=2e-3)
    assert criticals.whirl[low][0] == -1


def test_criticals_refuse_what_has_none(slender_rotor):
    matrices = assemble_rotor(slender_rotor)
    with pytest.raises(ValueError, match="held by its bearings"):
        undamped_critical_speeds(matrices)
    crossed = LinearBearing(2, np.array([[1e6, 5e5], [-5e5, 1e6]]), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="symmetric stiffness"):
        undamped_critical_speeds(matrices, [crossed, bearing(12, 1e6)])


def test_unbalance_response_of_a_rigid_rotor():
    """X = u W^2 / (2 k - m W^2 + 2 i c W), y a quarter turn behind x."""
    hard = {"steel": Material(young_modulus=1e16, density=7850.0, poisson_ratio=0.3)}
    rotor = Rotor(
        materials=hard, elements=(Element(length=0.1, outer_diameter=0.05, count=2),), masters=(0, 2)
    )
    speeds = np.linspace(10.0, 400.0, 7)
    matrices = assemble_rotor(rotor)
    bearings = [bearing(0, 1e4, 20.0), bearing(2, 1e4, 20.0)]
    expected = 1e-5 * speeds**2 / (2e4 - rotor.mass * speeds**2 + 40j * speeds)
    for subject in (matrices, condense(matrices, (0, 2))):
        response = unbalance_response(subject, speeds, {1: 1e-5}, bearings)
        assert response.shape == (7, 3, 2)
        # bending stiffness over bearing stiffness is 4e8, condition number 1e10
        np.testing.assert_allclose(response[:, :, 0], np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)
        np.testing.assert_allclose(response[:, :, 1], -1j * response[:, :, 0], rtol=1e-5)


def test_bearings_with_a_list_of_speeds_are_taken_speed_by_speed(slender_rotor):
    matrices = assemble_rotor(slender_rotor)
    speeds = np.array([500.0, 900.0])
    stiffness = np.array([np.diag([1e6, 2e6]), np.diag([3e6, 4e6])])
    listed = LinearBearing(2, stiffness, np.zeros((2, 2)))
    other = bearing(12, 2e6, 30.0)
    together = unbalance_response(matrices, speeds, {0: 1e-6}, [listed, other])
    for index, speed in enumerate(speeds):
        there = LinearBearing(2, stiffness[index], np.zeros((2, 2)))
        alone = unbalance_response(matrices, np.array([speed]), {0: 1e-6}, [there, other])
        np.testing.assert_allclose(together[index], alone[0], rtol=1e-12)


def test_the_angle_of_an_unbalance_turns_the_response(slender_rotor):
    matrices = assemble_rotor(slender_rotor)
    bearings = [bearing(2, 1e6, 30.0), bearing(12, 2e6, 30.0)]
    speeds = np.array([700.0])
    reference = unbalance_response(matrices, speeds, {0: 1e-6}, bearings)
    turned = unbalance_response(matrices, speeds, {0: 1e-6 * np.exp(0.4j)}, bearings)
    np.testing.assert_allclose(turned, reference * np.exp(0.4j), rtol=1e-10)


def test_nodes_off_the_shaft_are_refused(slender_rotor):
    matrices = assemble_rotor(slender_rotor)
    with pytest.raises(ValueError, match="node 15 is not on the shaft"):
        oscillating_modes(matrices, 0.0, [bearing(15, 1e6)])
    with pytest.raises(ValueError, match="unbalance at node 99"):
        unbalance_response(matrices, np.array([1.0]), {99: 1e-6})
