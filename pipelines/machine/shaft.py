"""The full finite-element rotor: Timoshenko beam elements, rigid discs, linear supports (Eq. 10).

    M q'' + (C + Omega G) q' + K q = F + F_gravity

Each node has four degrees of freedom, ordered ``x, y, alpha, beta``: two displacements and the rotations
about x and y. With z along the shaft the cross sections' slopes are ``beta`` in the x-z plane and ``-alpha``
in the y-z plane, so that a shaft which does not shear has x' = beta and y' = -alpha. The shaft turns from x
towards y. Everything is SI.

Elements are cylinders or cones; the diameters of a cone are linear in z. Its shape functions are those of the
cylinder of its middle section, and the matrices integrate the true sections (Genta and Gugliotta, J. Sound
Vib. 120 (1988) 175).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipelines.case.models import Element, Material, Rotor, Support
    from pipelines.case.rotor import DiscInertia

FloatArray = NDArray[np.float64]

NODE_FREEDOMS = 4  # x, y, alpha, beta

# Products of two cubics with an area, and of two slopes with a second moment of area, have degree 8 in a
# cone: five Gauss points integrate every element matrix exactly.
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(5)
_FRACTIONS = 0.5 * (1.0 + _GAUSS_POINTS)  # of an element's length


@dataclass(frozen=True)
class ElementMatrices:
    """Mass, gyroscopic (to be multiplied by the rotating speed in rad/s) and stiffness matrix of one part.

    ``geometric`` is the stiffness by the axial force, which comes beside the elastic one.
    """

    mass: FloatArray
    gyroscopic: FloatArray
    stiffness: FloatArray
    geometric: FloatArray


@dataclass(frozen=True)
class RotorMatrices:
    """The assembled rotor in SI units; every matrix has shape (4 nodes, 4 nodes).

    ``gyroscopic`` is to be multiplied by the rotating speed [rad/s]. ``gravity_load`` [N], shape (4 nodes,),
    points along -y. ``node_position`` [m], shape (nodes,), starts at 0.
    """

    mass: FloatArray
    damping: FloatArray
    gyroscopic: FloatArray
    stiffness: FloatArray
    gravity_load: FloatArray
    node_position: FloatArray

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.node_position.size


def cowper_shear_coefficient(poisson_ratio: float, diameter_ratio: float) -> float:
    """Shear coefficient of a circular section with m = inner/outer diameter (Cowper 1966).

    kappa = 6 (1 + nu) (1 + m^2)^2 / [(7 + 6 nu)(1 + m^2)^2 + (20 + 12 nu) m^2]

    It is 1/2 for a thin tube with nu = 0.
    """
    hollow = (1.0 + diameter_ratio**2) ** 2
    denominator = (7.0 + 6.0 * poisson_ratio) * hollow + (20.0 + 12.0 * poisson_ratio) * diameter_ratio**2
    return 6.0 * (1.0 + poisson_ratio) * hollow / denominator


def _shape_functions(
    fraction: FloatArray, length: float, shear: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shape functions of deflection, slope of the cross section and d slope/dz, each of shape (4, points).

    They are taken at z = ``fraction * length`` and multiply (deflection, slope) at the left end, then at the
    right end. They are the exact static solution of an unloaded Timoshenko beam with the shear parameter
    Phi = ``shear``, so that displacements of the nodes are exact in statics.
    """
    s = fraction
    deflection = np.array(
        [
            1.0 - 3.0 * s**2 + 2.0 * s**3 + shear * (1.0 - s),
            length * (s - 2.0 * s**2 + s**3 + 0.5 * shear * (s - s**2)),
            3.0 * s**2 - 2.0 * s**3 + shear * s,
            length * (s**3 - s**2 - 0.5 * shear * (s - s**2)),
        ]
    )
    slope = np.array(
        [
            6.0 * (s**2 - s) / length,
            1.0 - 4.0 * s + 3.0 * s**2 + shear * (1.0 - s),
            6.0 * (s - s**2) / length,
            3.0 * s**2 - 2.0 * s + shear * s,
        ]
    )
    curvature = np.array(
        [
            6.0 * (2.0 * s - 1.0) / length**2,
            (6.0 * s - 4.0 - shear) / length,
            6.0 * (1.0 - 2.0 * s) / length**2,
            (6.0 * s - 2.0 + shear) / length,
        ]
    )
    return deflection / (1.0 + shear), slope / (1.0 + shear), curvature / (1.0 + shear)


def _shear_angle(length: float, shear: float) -> FloatArray:
    """Shear angle gamma = dw/dz - slope, constant along the element, as a row over the four freedoms."""
    return shear / (1.0 + shear) * np.array([-1.0 / length, -0.5, 1.0 / length, -0.5])


def _planes(row: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Spread rows over (deflection, slope, deflection, slope) to the eight freedoms, x-z and y-z plane."""
    in_x = np.zeros((8, *row.shape[1:]))
    in_y = np.zeros_like(in_x)
    in_x[[0, 3, 4, 7]] = row  # x, beta
    in_y[[1, 5]] = row[[0, 2]]  # y
    in_y[[2, 6]] = -row[[1, 3]]  # -alpha
    return in_x, in_y


@dataclass(frozen=True)
class _Sections:
    """Sections of an element at the Gauss points: area [m2] and second moment of area [m4], shape (5,).

    ``weights`` [m] integrate along the element.
    """

    area: FloatArray
    second_moment: FloatArray
    weights: FloatArray


def _sections(element: Element) -> _Sections:
    outer, inner = (
        left + (right - left) * _FRACTIONS
        for left, right in zip(
            (element.outer_diameter, element.inner_diameter), element.right_diameters, strict=True
        )
    )
    return _Sections(*_area_moments(outer, inner), 0.5 * element.length * _GAUSS_WEIGHTS)


def _area_moments(outer: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Area and second moment of area of ring sections."""
    return 0.25 * np.pi * (outer**2 - inner**2), np.pi / 64.0 * (outer**4 - inner**4)


def _shear_modulus_and_parameter(element: Element, material: Material) -> tuple[float, float]:
    """kappa G [Pa] and the shear parameter Phi = 12 E I / (kappa G A L^2), all of the middle section."""
    right_outer, right_inner = element.right_diameters
    outer, inner = 0.5 * (element.outer_diameter + right_outer), 0.5 * (element.inner_diameter + right_inner)
    area, second_moment = _area_moments(np.array(outer), np.array(inner))
    poisson_ratio = material.resolved_poisson_ratio
    effective = cowper_shear_coefficient(poisson_ratio, inner / outer)
    effective *= material.young_modulus / (2.0 * (1.0 + poisson_ratio))
    shear = 12.0 * material.young_modulus * second_moment / (effective * area * element.length**2)
    return effective, float(shear)


def element_matrices(element: Element, material: Material) -> ElementMatrices:
    """Matrices (8, 8) of one Timoshenko element: consistent mass, rotary inertia, gyroscopic effect.

    Freedoms x, y, alpha, beta of the left, then of the right node. The axial force N adds the stiffness
    int N w' w' dz with w' = slope + shear angle.
    """
    length, young_modulus, density = element.length, material.young_modulus, material.density
    effective_shear_modulus, shear = _shear_modulus_and_parameter(element, material)
    sections = _sections(element)
    deflection, slope, curvature = (_planes(row) for row in _shape_functions(_FRACTIONS, length, shear))
    shear_angle = _shear_angle(length, shear)[:, np.newaxis]
    constant_shear = _planes(np.repeat(shear_angle, _FRACTIONS.size, axis=1))
    tilt = [turned + sheared for turned, sheared in zip(slope, constant_shear, strict=True)]

    def integral(left: FloatArray, right: FloatArray, factor: FloatArray | float) -> FloatArray:
        return (left * (sections.weights * factor)) @ right.T

    def energy(rows: Sequence[FloatArray], factor: FloatArray | float) -> FloatArray:
        in_x, in_y = rows
        return integral(in_x, in_x, factor) + integral(in_y, in_y, factor)

    # M = int rho A (x x + y y) + rho I (beta beta + alpha alpha) dz
    line_inertia = density * sections.second_moment
    mass = energy(deflection, density * sections.area) + energy(slope, line_inertia)
    # G = int 2 rho I (alpha beta - beta alpha) dz, with alpha = -slope_y and beta = slope_x
    gyroscopic = integral(slope[0], slope[1], 2.0 * line_inertia)
    # K = int E I (beta' beta' + alpha' alpha') + kappa G A (gamma_x gamma_x + gamma_y gamma_y) dz
    stiffness = energy(curvature, young_modulus * sections.second_moment)
    stiffness += energy(constant_shear, effective_shear_modulus * sections.area)
    return ElementMatrices(mass, gyroscopic - gyroscopic.T, stiffness, energy(tilt, element.axial_force))


def weight_shares(element: Element) -> FloatArray:
    """The parts of an element's weight that its left and right node carry, as a beam on two supports."""
    sections = _sections(element)
    line_mass = sections.weights * sections.area
    right = (line_mass @ _FRACTIONS) / line_mass.sum()
    return np.array([1.0 - right, right])


def disc_matrices(disc: DiscInertia) -> ElementMatrices:
    """Matrices (4, 4) of a rigid disc: mass, diametral inertia, gyroscopic moment Omega I_p."""
    mass = np.diag([disc.mass, disc.mass, disc.diametral, disc.diametral])
    gyroscopic = np.zeros((NODE_FREEDOMS, NODE_FREEDOMS))
    gyroscopic[2, 3], gyroscopic[3, 2] = disc.polar, -disc.polar
    return ElementMatrices(mass, gyroscopic, np.zeros_like(gyroscopic), np.zeros_like(gyroscopic))


def _node_slice(node: int, nodes: int = 1) -> slice:
    return slice(NODE_FREEDOMS * node, NODE_FREEDOMS * (node + nodes))


def _add_support(support: Support, damping: FloatArray, stiffness: FloatArray) -> None:
    first = NODE_FREEDOMS * support.node
    x_y = slice(first, first + 2)
    stiffness[x_y, x_y] += [
        [support.stiffness_xx, support.stiffness_xy],
        [support.stiffness_yx, support.stiffness_yy],
    ]
    damping[x_y, x_y] += np.diag([support.damping_xx, support.damping_yy])


def assemble_rotor(rotor: Rotor) -> RotorMatrices:
    """Assemble Eq. 10 from the case's rotor: elements, discs, Rayleigh damping, supports and gravity.

    Rayleigh damping ``C = a M + b K`` is that of the rotor's material (elements and discs): neither the
    stiffness by axial forces nor the supports, which add their own damping, enter K there. The weight of an
    element is shared by its two nodes (``weight_shares``).
    """
    position = np.array(rotor.node_positions())
    size = NODE_FREEDOMS * position.size
    mass, gyroscopic, stiffness, geometric = (np.zeros((size, size)) for _ in range(4))
    node_mass = np.zeros(position.size)

    def add(part: ElementMatrices, place: slice) -> None:
        mass[place, place] += part.mass
        gyroscopic[place, place] += part.gyroscopic
        stiffness[place, place] += part.stiffness
        geometric[place, place] += part.geometric

    for node, element in enumerate(rotor.single_elements()):
        material = rotor.materials[element.material]
        add(element_matrices(element, material), _node_slice(node, 2))
        node_mass[node : node + 2] += material.density * element.volume * weight_shares(element)
    for disc, inertia in zip(rotor.discs, rotor.disc_inertias, strict=True):
        add(disc_matrices(inertia), _node_slice(disc.node))
        node_mass[disc.node] += inertia.mass

    damping = rotor.rayleigh_mass * mass + rotor.rayleigh_stiffness * stiffness
    stiffness += geometric
    for support in rotor.supports:
        _add_support(support, damping, stiffness)
    gravity_load = np.zeros(size)
    gravity_load[1::NODE_FREEDOMS] = -rotor.gravity * node_mass
    return RotorMatrices(mass, damping, gyroscopic, stiffness, gravity_load, position)
