"""Mass, centre of gravity and bearing loads against the law of the lever and a clamped beam."""

from __future__ import annotations

from typing import Any

import pytest

from pipelines.case.rotor import Rotor
from pipelines.stages.reports.rotor_at_rest import rotor_at_rest

GRAVITY = 9.80665
STEEL = {"young_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0}
LENGTH = 0.05


def rotor(**more: Any) -> Rotor:
    """Eight solid elements of 50 mm."""
    plain = {
        "materials": {"steel": STEEL},
        "elements": [{"count": 8, "length": LENGTH, "outer_diameter": 0.03}],
        "masters": [0, 2, 6],
        "gravity": GRAVITY,
    }
    return Rotor.model_validate(plain | more)


def disc(node: int, mass: float) -> dict[str, Any]:
    return {"node": node, "mass": mass, "diametral_inertia": 1e-4, "polar_inertia": 2e-4}


def test_two_bearings_carry_what_the_lever_says() -> None:
    built = rotor(discs=[disc(8, 1.5), disc(3, 0.4)])
    rest = rotor_at_rest(built, [1, 5])
    shaft = built.mass - 1.9
    centre = (shaft * 4 + 1.5 * 8 + 0.4 * 3) * LENGTH / built.mass
    assert rest.mass == pytest.approx(built.mass, rel=1e-12)
    assert rest.centre == pytest.approx(centre, rel=1e-12)
    right = built.mass * GRAVITY * (centre - LENGTH) / (4 * LENGTH)
    assert rest.loads == pytest.approx((built.mass * GRAVITY - right, right), rel=1e-6)
    assert rest.loads[0] < 0.0, "the overhung disc lifts the first journal"


def test_the_centre_of_a_cone() -> None:
    """A cone from diameter d to 2 d: its centre is at 17/28 of its length."""
    cone = {"count": 8, "length": LENGTH, "outer_diameter": 0.02, "outer_diameter_right": 0.04}
    built = rotor(elements=[cone])
    rest = rotor_at_rest(built, [0, 8])
    assert rest.centre == pytest.approx(17.0 / 28.0 * 8 * LENGTH, rel=1e-9)
    assert rest.loads[1] == pytest.approx(17.0 / 28.0 * built.mass * GRAVITY, rel=1e-6)


def test_a_stiff_support_takes_its_share() -> None:
    """A uniform beam on three rigid supports: the outer ones carry 3/16 of the weight each.

    The shaft is thin, so that it does not shear. Its weight acts at the nodes: second order.
    """
    errors = []
    for count in (8, 16, 32):
        thin = [{"count": count, "length": 0.4 / count, "outer_diameter": 0.002}]
        support = {"node": count // 2, "stiffness_xx": 1e10, "stiffness_yy": 1e10}
        built = rotor(elements=thin, supports=[support], masters=[0, count])
        rest = rotor_at_rest(built, [0, count])
        share = rest.loads[0] / (built.mass * GRAVITY)
        assert rest.loads[1] == pytest.approx(rest.loads[0], rel=1e-6)
        errors.append(abs(share / (3.0 / 16.0) - 1.0))
    assert errors[-1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.02)


def test_without_gravity_nothing_is_carried() -> None:
    assert rotor_at_rest(rotor(gravity=0.0), [0, 8]).loads == (0.0, 0.0)
