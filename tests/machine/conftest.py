"""Rotors that several tests of the machine look at."""

from __future__ import annotations

import pytest

from pipelines.case.models import Disc, Element, Material, Rotor, Support

DISC = Disc(node=0, mass=0.079, diametral_inertia=2.85e-5, polar_inertia=5.70e-5)


@pytest.fixture
def slender_rotor() -> Rotor:
    """The reconstructed rotor: 360 mm x 17.6 mm of steel, 14 elements, discs at both ends, 7 masters."""
    return Rotor(
        elements=(Element(length=0.36 / 14, outer_diameter=0.0176, count=14),),
        discs=(DISC, DISC.model_copy(update={"node": 14})),
        masters=(0, 2, 4, 7, 10, 12, 14),
        rayleigh_stiffness=2.43e-5,
    )


@pytest.fixture
def stepped_rotor() -> Rotor:
    """Three materials, a hollow part, discs, and supports with every coefficient different."""
    return Rotor(
        materials={
            "steel": Material(young_modulus=206e9, density=7850.0, poisson_ratio=0.3),
            "hot steel": Material(young_modulus=160e9, density=7800.0, shear_modulus=61e9),
            "titanium": Material(young_modulus=113.8e9, density=4430.0, poisson_ratio=0.342),
        },
        elements=(
            Element(length=0.03, outer_diameter=0.02, count=3),
            Element(length=0.05, outer_diameter=0.03, inner_diameter=0.02, material="hot steel"),
            Element(length=0.02, outer_diameter=0.025, material="titanium", count=2),
        ),
        discs=(
            Disc(node=0, mass=0.4, diametral_inertia=3e-4, polar_inertia=5e-4),
            Disc(node=4, mass=0.2, diametral_inertia=1e-4, polar_inertia=1.5e-4),
        ),
        supports=(
            Support(
                node=1,
                stiffness_xx=1e6,
                stiffness_yy=2e6,
                stiffness_xy=3e5,
                stiffness_yx=-4e5,
                damping_xx=50.0,
                damping_yy=60.0,
            ),
            Support(node=5, stiffness_xx=5e6, stiffness_yy=6e6),
        ),
        masters=(0, 3, 6),
        rayleigh_mass=2.0,
        rayleigh_stiffness=1e-5,
        gravity=9.81,
    )
