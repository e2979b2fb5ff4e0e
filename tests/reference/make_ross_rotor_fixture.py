"""Write rotors saved by ROSS and the eigenvalues of one: ross_rotor.toml, ross_parts.toml, a table.

ROSS (https://github.com/petrobras/ross, Apache-2.0) is never a dependency here: see make_ross_fixture.py for
an environment of its own, in which this script is run,

    /tmp/ross/bin/python tests/reference/make_ross_rotor_fixture.py

``configs/models/ross_rotor.toml`` is what `Rotor.save` writes for a rotor of everything that `agfb import
ross` carries over: cones, hollow parts, two materials, an axial force, discs, a point mass and bearings with
constant coefficients. ``ross_rotor_eigenvalues.csv`` holds its eigenvalues [rad/s] at several speeds, from
the lateral part of the matrices that ROSS assembles: ROSS's own list mixes in axial and torsional modes.
``ross_parts.toml`` is a rotor with parts and options that cannot be carried over; a gear is missing, because
ROSS 2.3.0 cannot save one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import ross
from scipy import linalg

FOLDER = Path(__file__).parent
MODEL = FOLDER.parents[1] / "configs" / "models" / "ross_rotor.toml"  # a page imports it too
SPEEDS = (0.0, 1000.0, 3000.0, 6000.0)  # rad/s
MODES = 10
NODE_FREEDOMS = 6  # x, y, z, alpha, beta, theta
LATERAL = (0, 1, 3, 4)

STEEL = ross.Material(name="Steel", rho=7810.0, E=211e9, G_s=81.2e9)
TITANIUM = ross.Material(name="Ti6Al4V", rho=4430.0, E=113.8e9, Poisson=0.342)

# length, outer diameters left and right, inner diameters left and right [m], material, axial force [N]
SHAFT = (
    (0.020, 0.012, 0.020, 0.000, 0.000, TITANIUM, 0.0),
    (0.030, 0.020, 0.020, 0.006, 0.006, TITANIUM, 800.0),
    (0.030, 0.024, 0.024, 0.006, 0.006, STEEL, 800.0),
    (0.025, 0.024, 0.034, 0.006, 0.014, STEEL, 800.0),
    (0.040, 0.034, 0.034, 0.014, 0.014, STEEL, 800.0),
    (0.040, 0.034, 0.034, 0.014, 0.014, STEEL, 800.0),
    (0.025, 0.034, 0.022, 0.014, 0.000, STEEL, -300.0),
    (0.030, 0.022, 0.022, 0.000, 0.000, STEEL, -300.0),
    (0.020, 0.018, 0.018, 0.000, 0.000, STEEL, 0.0),
)


def shaft() -> list[ross.ShaftElement]:
    return [
        ross.ShaftElement(L=length, odl=odl, odr=odr, idl=idl, idr=idr, material=material, axial_force=force)
        for length, odl, odr, idl, idr, material, force in SHAFT
    ]


def rotor() -> ross.Rotor:
    discs = [
        ross.DiskElement(n=0, m=0.12, Id=4.0e-5, Ip=6.5e-5, tag="compressor"),
        ross.DiskElement.from_geometry(n=4, material=STEEL, width=0.008, i_d=0.034, o_d=0.060, tag="collar"),
        ross.DiskElement(n=9, m=0.10, Id=3.2e-5, Ip=5.0e-5, tag="turbine"),
    ]
    bearings = [
        ross.BearingElement(n=2, kxx=3e6, kyy=4e6, kxy=5e5, kyx=-6e5, cxx=200.0, cyy=300.0, tag="left"),
        ross.BearingElement(n=7, kxx=2e6, kyy=5e6, cxx=150.0, tag="right"),
    ]
    masses = [ross.PointMass(n=7, m=0.03, tag="sensor")]
    return ross.Rotor(shaft(), discs, bearings, masses, rated_w=6000.0)


def rotor_of_other_parts() -> ross.Rotor:
    elements = shaft()
    elements[1].alpha, elements[1].beta, elements[2].torque = 1.0, 1e-6, 20.0
    elements[4] = ross.ShaftElement(
        L=0.04, idl=0.014, odl=0.034, material=STEEL, shear_effects=False, rotary_inertia=False
    )
    elements[5] = ross.ShaftElement(
        L=0.04, idl=0.014, odl=0.034, material=STEEL, shear_method_calc="hutchinson", gyroscopic=False
    )
    elements.append(ross.CouplingElement(m_l=0.2, m_r=0.2, Ip_l=1e-4, Ip_r=1e-4, kr_z=1e5, tag="coupling"))
    for node, element in enumerate(elements):
        element.n = node  # ROSS would count the sleeve
    sleeve = ross.ShaftElement(n=7, L=0.03, idl=0.022, odl=0.026, material=TITANIUM, tag="sleeve")
    speeds = [100.0, 1000.0, 3000.0]
    bearings = [
        ross.BearingElement(
            n=2, kxx=[1e6, 2e6, 3e6], kyy=[1e6, 3e6, 5e6], cxx=[50.0, 70.0, 90.0], frequency=speeds, tag="oil"
        ),
        ross.BearingElement(n=7, kxx=2e6, cxx=150.0, cxy=20.0, mxx=0.1, kzz=1e5, n_link=11, tag="linked"),
        ross.BearingElement(n=11, kxx=5e7, cxx=0.0, tag="pedestal"),
        ross.SealElement(n=4, kxx=1e4, cxx=10.0, kxy=2e3, kyx=-2e3, tag="labyrinth"),
    ]
    masses = [ross.PointMass(n=2, mx=0.1, my=0.2, tag="half"), ross.PointMass(n=11, m=5.0, tag="block")]
    return ross.Rotor(
        [*elements[:8], sleeve, *elements[8:]],
        [ross.DiskElement(n=0, m=0.1, Id=1e-5, Ip=1.5e-5, tag="wheel")],
        bearings,
        masses,
    )


def lateral_eigenvalues(model: ross.Rotor, speed: float) -> np.ndarray:
    """The lowest eigenvalues with Im > 0 of M q'' + (C + speed G) q' + K q = 0 of the lateral freedoms."""
    nodes = len(model.nodes)
    kept = np.ravel([[NODE_FREEDOMS * node + each for each in LATERAL] for node in range(nodes)])
    mass, damping, stiffness, gyroscopic = (
        matrix[np.ix_(kept, kept)] for matrix in (model.M(speed), model.C(speed), model.K(speed), model.G())
    )
    lower = linalg.cholesky(mass, lower=True)

    def reduced(matrix: np.ndarray) -> np.ndarray:
        half = linalg.solve_triangular(lower, matrix, lower=True)
        return linalg.solve_triangular(lower, half.T, lower=True).T

    size = kept.size
    companion = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-reduced(stiffness), -reduced(damping + speed * gyroscopic)],
        ]
    )
    eigenvalues = linalg.eigvals(companion)
    above = eigenvalues[eigenvalues.imag > 0]
    return above[np.argsort(above.imag)][:MODES]


def main() -> None:
    model = rotor()
    model.save(MODEL)
    rows = [
        "# ROSS " + ross.__version__ + ", make_ross_rotor_fixture.py; all numbers in rad/s",
        "speed,real,imaginary",
    ]
    for speed in SPEEDS:
        rows += [f"{speed!r},{z.real!r},{z.imag!r}" for z in map(complex, lateral_eigenvalues(model, speed))]
    (FOLDER / "ross_rotor_eigenvalues.csv").write_text("\n".join(rows) + "\n")
    rotor_of_other_parts().save(FOLDER / "ross_parts.toml")


if __name__ == "__main__":
    main()
