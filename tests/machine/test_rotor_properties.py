"""Mass, centre of gravity, inertia and bearing loads of rotors against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.case.models import Disc, Element, Material, Rotor
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
    assert found.bearing_loads == pytest.approx((0.5 * mass * 9.81, 0.5 * mass * 9.81), rel=1e-12)


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
    assert found.bearing_loads == pytest.approx((found.mass * 9.81 - second, second), rel=1e-12)


def test_supports_leave_the_loads_undetermined_and_a_vertical_rotor_has_none() -> None:
    assert rotor_properties(assemble_rotor(rotor()), (1, 7), supported=True).bearing_loads == ()
    assert rotor_properties(assemble_rotor(rotor(gravity=0.0)), (1, 7)).bearing_loads == (0.0, 0.0)
