"""Mass, centre of gravity, inertia and bearing loads of rotors against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.case.models import Disc, Element, Material, Rotor, Support
from pipelines.machine.rotor_properties import rotor_properties
from pipelines.machine.shaft import assemble_rotor

STEEL = {"steel": Material(young_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)}


def rotor(discs: tuple[Disc, ...] = (), gravity: float = 9.81) -> Rotor:
    element = Element(length=0.05, outer_diameter=0.04, inner_diameter=0.01, material="steel", count=8)
    return Rotor(materials=STEEL, elements=(element,), discs=discs, masters=(0, 4, 8), gravity=gravity)


def test_a_hollow_cylinder() -> None:
    found = rotor_properties(assemble_rotor(rotor()), (1, 7))
    mass = 7850.0 * np.pi / 4 * (0.04**2 - 0.01**2) * 0.4
    squares = 0.02**2 + 0.005**2
    assert found.mass == pytest.approx(mass, rel=1e-12)
    assert found.centre_of_gravity == pytest.approx(0.2, rel=1e-12)
    assert found.polar_inertia == pytest.approx(0.5 * mass * squares, rel=1e-12)
    assert found.diametral_inertia == pytest.approx(mass * (0.25 * squares + 0.4**2 / 12), rel=1e-12)
    assert found.bearing_loads == pytest.approx((0.5 * mass * 9.81, 0.5 * mass * 9.81), rel=1e-8)


def test_an_overhung_disc_moves_centre_and_loads() -> None:
    disc = Disc(node=8, mass=2.0, diametral_inertia=1e-3, polar_inertia=1.8e-3)
    bare = rotor_properties(assemble_rotor(rotor()), (1, 5))
    found = rotor_properties(assemble_rotor(rotor((disc,))), (1, 5))
    assert found.mass == pytest.approx(bare.mass + 2.0, rel=1e-12)
    centre = (bare.mass * 0.2 + 2.0 * 0.4) / found.mass
    assert found.centre_of_gravity == pytest.approx(centre, rel=1e-12)
    assert found.polar_inertia == pytest.approx(bare.polar_inertia + 1.8e-3, rel=1e-12)
    steiner = bare.mass * (centre - 0.2) ** 2 + 2.0 * (0.4 - centre) ** 2
    assert found.diametral_inertia == pytest.approx(bare.diametral_inertia + 1e-3 + steiner, rel=1e-12)
    second = found.mass * 9.81 * (centre - 0.05) / 0.2
    assert found.bearing_loads == pytest.approx((found.mass * 9.81 - second, second), rel=1e-8)


def test_a_vertical_rotor_has_no_loads() -> None:
    assert rotor_properties(assemble_rotor(rotor(gravity=0.0)), (1, 7)).bearing_loads == (0.0, 0.0)


def test_the_centre_of_a_cone() -> None:
    """A cone from diameter d to 2 d: its centre is at 17/28 of its length."""
    cone = Element(length=0.05, outer_diameter=0.02, outer_diameter_right=0.04, material="steel", count=8)
    built = Rotor(materials=STEEL, elements=(cone,), masters=(0, 8), gravity=9.81)
    found = rotor_properties(assemble_rotor(built), (0, 8))
    assert found.centre_of_gravity == pytest.approx(17.0 / 28.0 * 0.4, rel=1e-9)
    assert found.bearing_loads[1] == pytest.approx(17.0 / 28.0 * found.mass * 9.81, rel=1e-6)


def test_a_stiff_support_takes_its_share() -> None:
    """A uniform beam on three rigid supports: the outer ones carry 3/16 of the weight each.

    The shaft is thin, so that it does not shear. Its weight acts at the nodes: second order.
    """
    errors = []
    for count in (8, 16, 32):
        thin = Element(length=0.4 / count, outer_diameter=0.002, material="steel", count=count)
        support = Support(node=count // 2, stiffness_xx=1e10, stiffness_yy=1e10)
        built = Rotor(
            materials=STEEL, elements=(thin,), supports=(support,), masters=(0, count), gravity=9.81
        )
        found = rotor_properties(assemble_rotor(built), (0, count))
        share = found.bearing_loads[0] / (found.mass * 9.81)
        assert found.bearing_loads[1] == pytest.approx(found.bearing_loads[0], rel=1e-6)
        errors.append(abs(share / (3.0 / 16.0) - 1.0))
    assert errors[-1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.02)
