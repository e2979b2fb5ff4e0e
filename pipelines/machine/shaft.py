"""The full finite-element rotor: two-node Timoshenko beam elements, rigid discs, linear supports (Eq. 10).

    M q'' + (C + Omega G) q' + K q = F + F_gravity

Each node has four degrees of freedom, ordered ``x, y, alpha, beta``: two displacements and the rotations
about x and y. With z along the shaft the cross sections' slopes are ``beta`` in the x-z plane and ``-alpha``
in the y-z plane, so that a shaft which does not shear has x' = beta and y' = -alpha. The shaft turns from x
towards y. Everything is SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipelines.case.models import Disc, Material, Rotor, Support

FloatArray = NDArray[np.float64]

NODE_FREEDOMS = 4  # x, y, alpha, beta

# Products of two cubics have degree 6: four Gauss points integrate every element matrix exactly.
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class ElementMatrices:
    """Mass, gyroscopic (to be multiplied by the rotating speed in rad/s) and stiffness matrix of one part."""

    mass: FloatArray
    gyroscopic: FloatArray
    stiffness: FloatArray


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


def element_matrices(
    length: float, outer_diameter: float, inner_diameter: float, material: Material
) -> ElementMatrices:
    """Matrices (8, 8) of a circular Timoshenko element: consistent mass, rotary inertia, gyroscopic effect.

    Its shear parameter is Phi = 12 E I / (kappa G A L^2). Lengths in m; freedoms x, y, alpha, beta of the
    left, then of the right node.
    """
    poisson_ratio = material.resolved_poisson_ratio
    shear_modulus = material.young_modulus / (2.0 * (1.0 + poisson_ratio))
    area = 0.25 * np.pi * (outer_diameter**2 - inner_diameter**2)
    second_moment = np.pi / 64.0 * (outer_diameter**4 - inner_diameter**4)
    shear_coefficient = cowper_shear_coefficient(poisson_ratio, inner_diameter / outer_diameter)
    shear_stiffness = shear_coefficient * shear_modulus * area
    bending_stiffness = material.young_modulus * second_moment
    shear = 12.0 * bending_stiffness / (shear_stiffness * length**2)

    weights = 0.5 * length * _GAUSS_WEIGHTS
    deflection, slope, curvature = _shape_functions(0.5 * (1.0 + _GAUSS_POINTS), length, shear)
    deflection_x, deflection_y = _planes(deflection)
    slope_x, slope_y = _planes(slope)
    curvature_x, curvature_y = _planes(curvature)
    shear_x, shear_y = _planes(_shear_angle(length, shear))

    def integral(left: FloatArray, right: FloatArray) -> FloatArray:
        return (left * weights) @ right.T

    # M = int rho A (x x + y y) + rho I (beta beta + alpha alpha) dz
    line_mass = material.density * area
    line_inertia = material.density * second_moment
    mass = line_mass * (integral(deflection_x, deflection_x) + integral(deflection_y, deflection_y))
    mass += line_inertia * (integral(slope_x, slope_x) + integral(slope_y, slope_y))
    # G = int 2 rho I (alpha beta - beta alpha) dz, with alpha = -slope_y and beta = slope_x
    gyroscopic = 2.0 * line_inertia * (integral(slope_x, slope_y) - integral(slope_y, slope_x))
    # K = int E I (beta' beta' + alpha' alpha') + kappa G A (gamma_x gamma_x + gamma_y gamma_y) dz
    stiffness = bending_stiffness * (integral(curvature_x, curvature_x) + integral(curvature_y, curvature_y))
    stiffness += shear_stiffness * length * (np.outer(shear_x, shear_x) + np.outer(shear_y, shear_y))
    return ElementMatrices(mass, gyroscopic, stiffness)


def disc_matrices(disc: Disc) -> ElementMatrices:
    """Matrices (4, 4) of a rigid disc: mass, diametral inertia, gyroscopic moment Omega I_p."""
    mass = np.diag([disc.mass, disc.mass, disc.diametral_inertia, disc.diametral_inertia])
    gyroscopic = np.zeros((NODE_FREEDOMS, NODE_FREEDOMS))
    gyroscopic[2, 3], gyroscopic[3, 2] = disc.polar_inertia, -disc.polar_inertia
    return ElementMatrices(mass, gyroscopic, np.zeros_like(gyroscopic))


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

    Rayleigh damping ``C = a M + b K`` is that of the rotor itself (elements and discs); the supports add
    their own stiffness and damping afterwards. The weight of an element is shared equally by its two nodes.
    """
    position = np.array(rotor.node_positions())
    size = NODE_FREEDOMS * position.size
    mass, gyroscopic, stiffness = (np.zeros((size, size)) for _ in range(3))
    node_mass = np.zeros(position.size)

    for node, element in enumerate(rotor.single_elements()):
        material = rotor.materials[element.material]
        part = element_matrices(element.length, element.outer_diameter, element.inner_diameter, material)
        both = _node_slice(node, 2)
        mass[both, both] += part.mass
        gyroscopic[both, both] += part.gyroscopic
        stiffness[both, both] += part.stiffness
        area = 0.25 * np.pi * (element.outer_diameter**2 - element.inner_diameter**2)
        node_mass[node : node + 2] += 0.5 * material.density * area * element.length
    for disc in rotor.discs:
        part = disc_matrices(disc)
        at_node = _node_slice(disc.node)
        mass[at_node, at_node] += part.mass
        gyroscopic[at_node, at_node] += part.gyroscopic
        node_mass[disc.node] += disc.mass

    damping = rotor.rayleigh_mass * mass + rotor.rayleigh_stiffness * stiffness
    for support in rotor.supports:
        _add_support(support, damping, stiffness)
    gravity_load = np.zeros(size)
    gravity_load[1::NODE_FREEDOMS] = -rotor.gravity * node_mass
    return RotorMatrices(mass, damping, gyroscopic, stiffness, gravity_load, position)
