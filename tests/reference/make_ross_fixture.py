"""Write ross_elements.json: beam element and disc matrices computed by ROSS, frozen for the tests.

ROSS (https://github.com/petrobras/ross, Apache-2.0) is an independent rotordynamics library. It is never a
dependency here: install it into a virtual environment of its own and run this script there,

    python -m venv /tmp/ross
    /tmp/ross/bin/pip install ross-rotordynamics==2.3.0 "plotly<6"
    /tmp/ross/bin/python tests/reference/make_ross_fixture.py

The file keeps the lateral part of ROSS's matrices (its axial and torsional rows are dropped): degrees of
freedom x, y, alpha, beta per node. Numbers are written with repr precision, so the tests may ask for rounding
error.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import ross

LATERAL_ELEMENT = [0, 1, 3, 4, 6, 7, 9, 10]  # of x, y, z, alpha, beta, theta per node
LATERAL_DISC = [0, 1, 3, 4]

# name: young_modulus, density, and either poisson_ratio or shear_modulus
MATERIALS = {
    "steel_by_shear_modulus": {"young_modulus": 211e9, "density": 7810.0, "shear_modulus": 81.2e9},
    "steel_by_poisson_ratio": {"young_modulus": 206e9, "density": 7850.0, "poisson_ratio": 0.3},
    "titanium": {"young_modulus": 113.8e9, "density": 4430.0, "poisson_ratio": 0.342},
    "magnesium_by_shear_modulus": {"young_modulus": 45e9, "density": 1740.0, "shear_modulus": 17e9},
}

# name: length, outer diameter, inner diameter [m], material
ELEMENTS = {
    "solid": (0.25, 0.05, 0.0, "steel_by_shear_modulus"),
    "solid_by_poisson_ratio": (0.025714, 0.0176, 0.0, "steel_by_poisson_ratio"),
    "hollow": (0.1, 0.06, 0.03, "titanium"),
    "thin_walled": (0.08, 0.04, 0.038, "steel_by_poisson_ratio"),
    "slender": (1.0, 0.01, 0.0, "steel_by_poisson_ratio"),
    "stubby": (0.01, 0.08, 0.0, "steel_by_shear_modulus"),
    "stubby_hollow": (0.0051, 0.066, 0.0304, "magnesium_by_shear_modulus"),
}

# name: length, outer diameters left and right, inner diameters left and right [m], material, axial force [N]
CONES = {
    "solid": (0.05, 0.03, 0.05, 0.0, 0.0, "steel_by_shear_modulus", 0.0),
    "stubby": (0.01, 0.08, 0.02, 0.0, 0.0, "steel_by_poisson_ratio", 0.0),
    "bore_that_ends": (0.06, 0.04, 0.025, 0.02, 0.0, "titanium", 0.0),
    "thinning_wall": (0.08, 0.04, 0.04, 0.01, 0.038, "magnesium_by_shear_modulus", 0.0),
    "pulled": (0.05, 0.03, 0.05, 0.01, 0.02, "titanium", 2e7),
    "pressed_cylinder": (0.1, 0.03, 0.03, 0.0, 0.0, "steel_by_poisson_ratio", -1e6),
}

# name: mass [kg], diametral and polar inertia [kg m2]
DISCS = {"thin": (0.079, 2.85e-5, 5.70e-5), "long": (12.0, 0.4, 0.1)}


def ross_material(name: str) -> ross.Material:
    values = MATERIALS[name]
    extra = (
        {"G_s": values["shear_modulus"]}
        if "shear_modulus" in values
        else {"Poisson": values["poisson_ratio"]}
    )
    return ross.Material(name=name, rho=values["density"], E=values["young_modulus"], **extra)


def lateral(matrix: np.ndarray, kept: list[int]) -> list[list[float]]:
    return matrix[np.ix_(kept, kept)].tolist()


def element_record(name: str) -> dict[str, object]:
    length, outer, inner, material = ELEMENTS[name]
    element = ross.ShaftElement(L=length, idl=inner, odl=outer, material=ross_material(material), n=0)
    return {
        "name": name,
        "length": length,
        "outer_diameter": outer,
        "inner_diameter": inner,
        "material": MATERIALS[material],
        "mass": lateral(element.M(), LATERAL_ELEMENT),
        "gyroscopic": lateral(element.G(), LATERAL_ELEMENT),
        "stiffness": lateral(element.K(), LATERAL_ELEMENT),
    }


def cone_record(name: str) -> dict[str, object]:
    length, outer, outer_right, inner, inner_right, material, force = CONES[name]
    element = ross.ShaftElement(
        L=length,
        odl=outer,
        odr=outer_right,
        idl=inner,
        idr=inner_right,
        material=ross_material(material),
        axial_force=force,
        n=0,
    )
    return {
        "name": name,
        "element": {
            "length": length,
            "outer_diameter": outer,
            "outer_diameter_right": outer_right,
            "inner_diameter": inner,
            "inner_diameter_right": inner_right,
            "axial_force": force,
        },
        "material": MATERIALS[material],
        "centre_of_gravity": element.beam_cg / length,
        "mass_of_element": element.m,
        "mass": lateral(element.M(), LATERAL_ELEMENT),
        "gyroscopic": lateral(element.G(), LATERAL_ELEMENT),
        "stiffness": lateral(element.K(), LATERAL_ELEMENT),
    }


def disc_record(name: str) -> dict[str, object]:
    mass, diametral, polar = DISCS[name]
    disc = ross.DiskElement(n=0, m=mass, Id=diametral, Ip=polar)
    return {
        "name": name,
        "mass_value": mass,
        "diametral_inertia": diametral,
        "polar_inertia": polar,
        "mass": lateral(disc.M(), LATERAL_DISC),
        "gyroscopic": lateral(disc.G(), LATERAL_DISC),
    }


def main() -> None:
    fixture = {
        "made_by": f"ross-rotordynamics {version('ross-rotordynamics')}, make_ross_fixture.py",
        "elements": [element_record(name) for name in ELEMENTS],
        "cones": [cone_record(name) for name in CONES],
        "discs": [disc_record(name) for name in DISCS],
    }
    target = Path(__file__).with_name("ross_elements.json")
    target.write_text(json.dumps(fixture, indent=1) + "\n")


if __name__ == "__main__":
    main()
