"""The critical speed map against closed forms and against the modes of the gyroscopic rotor."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.case.models import Disc, Element, Material, Rotor
from pipelines.machine.critical_map import critical_map
from pipelines.machine.rotor_modes import LinearBearing, oscillating_modes, translations, whirl_directions
from pipelines.machine.rotor_properties import rotor_properties
from pipelines.machine.shaft import RotorMatrices, assemble_rotor


def rotor(modulus: float = 2.1e11, length: float = 0.05, polar: float = 2e-3) -> RotorMatrices:
    steel = {"steel": Material(young_modulus=modulus, poisson_ratio=0.3, density=7850.0)}
    element = Element(length=length, outer_diameter=0.03, material="steel", count=8)
    discs = (Disc(node=0, mass=1.0, diametral_inertia=0.6 * polar, polar_inertia=polar),)
    return assemble_rotor(Rotor(materials=steel, elements=(element,), discs=discs, masters=(0, 4, 8)))


@pytest.mark.parametrize("backward", [False, True])
def test_a_rigid_rotor_on_soft_supports(backward: bool) -> None:
    """det [[2k - m w, k d], [k d, k s - (I_d -+ I_p) w]] = 0 about the centre of gravity, w = Omega^2."""
    stiff, nodes, k = rotor(modulus=2.1e14), (1, 7), 1e5
    body = rotor_properties(stiff, nodes)
    arms = stiff.node_position[list(nodes)] - body.centre_of_gravity
    sign = -1.0 if backward else 1.0
    springs = k * np.array([[2.0, arms.sum()], [arms.sum(), (arms**2).sum()]])
    inertia = np.diag([body.mass, body.diametral_inertia - sign * body.polar_inertia])
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(inertia, springs)).real))
    found = critical_map(stiff, nodes, np.array([k]), 2, backward)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize(("backward", "direction"), [(False, 1), (True, -1)])
def test_a_mode_of_the_rotor_has_its_speed(backward: bool, direction: int) -> None:
    """At a speed of the map the rotor on the springs has a mode of this direction with Im lambda = Omega."""
    flexible, nodes = rotor(), (1, 7)
    for k in (1e5, 1e7, 1e9):
        speeds = critical_map(flexible, nodes, np.array([k]), 3, backward)[0]
        bearings = [LinearBearing(node, k * np.eye(2), np.zeros((2, 2))) for node in nodes]
        for speed in speeds[np.isfinite(speeds)]:
            modes = oscillating_modes(flexible, float(speed), bearings)
            nearest = int(np.argmin(np.abs(modes.damped_frequencies - speed)))
            assert modes.damped_frequencies[nearest] == pytest.approx(speed, rel=1e-6)
            shape = translations(flexible, modes.shapes[nearest : nearest + 1])
            assert whirl_directions(shape)[0] == direction


def test_speeds_rise_with_the_stiffness_up_to_those_of_pinned_bearings() -> None:
    flexible = rotor()
    found = critical_map(flexible, (1, 7), np.logspace(4, 13, 10), 3, backward=True)
    assert np.all(np.diff(found, axis=0) > 0.0)
    assert np.max(np.abs(found[-1] / found[-2] - 1.0)) < 1e-3
