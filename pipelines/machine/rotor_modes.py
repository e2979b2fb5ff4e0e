"""Linear vibrations of the rotor on linear bearings: modes and unbalance response.

Works on the full and on the condensed rotor alike: both are M q'' + (C + Omega G) q' + K q = F.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from pipelines.machine.condensation import CondensedRotor
from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# An orbit counts as a straight line if its area is below this part of the area of a circle of its size.
PLANAR_ORBIT = 1e-6


@dataclass(frozen=True)
class LinearBearing:
    """Stiffness [N/m] and damping [N s/m] of a bearing at a node: force = -(stiffness x + damping x').

    Both have shape (2, 2), or (speeds, 2, 2) when they belong to a list of speeds; rows force, columns
    displacement.
    """

    node: int
    stiffness: FloatArray
    damping: FloatArray

    def at(self, index: int) -> LinearBearing:
        """The bearing at one entry of the list of speeds; constant coefficients hold at all of them."""
        pick = [matrix[index] if matrix.ndim == 3 else matrix for matrix in (self.stiffness, self.damping)]
        return LinearBearing(self.node, *pick)


@dataclass(frozen=True)
class Modes:
    """Oscillating modes by rising |Im lambda|, with ``shapes`` (modes, freedoms of the rotor)."""

    eigenvalues: ComplexArray
    shapes: ComplexArray

    @property
    def natural_frequencies(self) -> FloatArray:
        """|lambda| [rad/s]."""
        return np.abs(self.eigenvalues)

    @property
    def damped_frequencies(self) -> FloatArray:
        """Im lambda [rad/s]."""
        return self.eigenvalues.imag

    @property
    def damping_ratios(self) -> FloatArray:
        """-Re lambda / |lambda|."""
        return -self.eigenvalues.real / np.abs(self.eigenvalues)

    @property
    def logarithmic_decrements(self) -> FloatArray:
        """-2 pi Re lambda / Im lambda: logarithm of the ratio of consecutive maxima."""
        return -2.0 * np.pi * self.eigenvalues.real / self.eigenvalues.imag

    def lightly_damped(self, max_damping_ratio: float, count: int) -> Modes:
        """The lowest ``count`` modes whose damping ratio is below the bound; fewer if there are fewer."""
        kept = np.flatnonzero(self.damping_ratios < max_damping_ratio)[:count]
        return Modes(self.eigenvalues[kept], self.shapes[kept])


def bearing_freedoms(rotor: RotorMatrices | CondensedRotor, node: int) -> slice:
    """Freedoms x and y of a node; raises ValueError if the rotor does not have them."""
    if isinstance(rotor, CondensedRotor):
        first = rotor.position(node)
    elif 0 <= node < rotor.nodes:
        first = NODE_FREEDOMS * node
    else:
        raise ValueError(f"node {node} is not on the shaft, whose nodes are 0 to {rotor.nodes - 1}")
    return slice(first, first + 2)


def with_bearings(
    rotor: RotorMatrices | CondensedRotor, bearings: Sequence[LinearBearing]
) -> tuple[FloatArray, FloatArray]:
    """Damping and stiffness matrix of the rotor with the bearings added."""
    damping, stiffness = rotor.damping.copy(), rotor.stiffness.copy()
    for bearing in bearings:
        x_y = bearing_freedoms(rotor, bearing.node)
        damping[x_y, x_y] += bearing.damping
        stiffness[x_y, x_y] += bearing.stiffness
    return damping, stiffness


def oscillating_modes(
    rotor: RotorMatrices | CondensedRotor, speed: float, bearings: Sequence[LinearBearing] = ()
) -> Modes:
    """All modes with Im lambda > 0 at a rotating speed [rad/s], without rigid-body and overdamped motions.

    [q ]'   [    0             I          ] [q ]
    [q'] =  [-M^-1 K   -M^-1 (C + Omega G)] [q']
    """
    damping, stiffness = with_bearings(rotor, bearings)
    # Divide by the masses symmetrically (M = L L') to balance translations against rotations.
    lower = linalg.cholesky(rotor.mass, lower=True)

    def reduced(matrix: FloatArray) -> FloatArray:
        half = linalg.solve_triangular(lower, matrix, lower=True)
        result: FloatArray = linalg.solve_triangular(lower, half.T, lower=True).T
        return result

    size = rotor.mass.shape[0]
    companion = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-reduced(stiffness), -reduced(damping + speed * rotor.gyroscopic)],
        ]
    )
    eigenvalues, vectors = linalg.eig(companion)
    # A rigid-body motion is a double zero, which rounding splits by the square root of its size.
    floor = np.sqrt(np.finfo(float).eps) * np.max(np.abs(eigenvalues))
    oscillating = np.flatnonzero(eigenvalues.imag > floor)
    oscillating = oscillating[np.argsort(eigenvalues.imag[oscillating], kind="stable")]
    shapes = linalg.solve_triangular(lower.T, vectors[:size, oscillating], lower=False).T
    return Modes(eigenvalues[oscillating], shapes)


def translations(rotor: RotorMatrices | CondensedRotor, shapes: ComplexArray) -> ComplexArray:
    """Displacements x, y of all nodes, (shapes, nodes, 2), from shapes of the rotor (shapes, freedoms)."""
    full = shapes @ rotor.transformation.T if isinstance(rotor, CondensedRotor) else shapes
    return full.reshape(full.shape[0], full.shape[1] // NODE_FREEDOMS, NODE_FREEDOMS)[:, :, :2]


def whirl_directions(displacements: ComplexArray) -> NDArray[np.int8]:
    """Whirl of shapes (shapes, nodes, 2): +1 forward (from x to y), -1 backward, 0 planar.

    The motion is Re(shape exp(lambda t)) with Im lambda > 0.
    The sign is that of the area which the nodes' ellipses enclose together, Im(x y*) summed; it is compared
    with the area of circles of the same size.
    """
    x, y = displacements[..., 0], displacements[..., 1]
    area = np.sum(np.imag(x * np.conj(y)), axis=-1)
    circle = 0.5 * np.sum(np.abs(x) ** 2 + np.abs(y) ** 2, axis=-1)
    return np.where(np.abs(area) > PLANAR_ORBIT * circle, np.sign(area), 0.0).astype(np.int8)


def _full_size(rotor: RotorMatrices | CondensedRotor) -> int:
    return int((rotor.transformation if isinstance(rotor, CondensedRotor) else rotor.mass).shape[0])


def unbalance_response(
    rotor: RotorMatrices | CondensedRotor,
    speeds: FloatArray,
    unbalance: Mapping[int, complex],
    bearings: Sequence[LinearBearing] = (),
) -> ComplexArray:
    """Response X of all nodes [m], shape (speeds, nodes, 2), the motion being Re(X exp(i Omega t)).

    ``unbalance`` [kg m] per node of the full rotor: its argument is the angular position. ``speeds`` [rad/s].
    Raises ValueError for an unbalance that is not on the shaft.

        (K - Omega^2 M + i Omega (C + Omega G)) X = Omega^2 sum_n u_n (1, -i) at node n
    """
    pattern = np.zeros(_full_size(rotor), dtype=np.complex128)
    for node, amount in unbalance.items():
        if not 0 <= node < pattern.size // NODE_FREEDOMS:
            raise ValueError(f"unbalance at node {node}, which is not on the shaft")
        pattern[NODE_FREEDOMS * node : NODE_FREEDOMS * node + 2] += [amount, -1j * amount]
    load = rotor.transformation.T @ pattern if isinstance(rotor, CondensedRotor) else pattern

    response = np.empty((len(speeds), load.size), dtype=np.complex128)
    for index, speed in enumerate(speeds):
        damping, stiffness = with_bearings(rotor, [bearing.at(index) for bearing in bearings])
        impedance = stiffness - speed**2 * rotor.mass + 1j * speed * (damping + speed * rotor.gyroscopic)
        response[index] = linalg.solve(impedance, speed**2 * load)
    return translations(rotor, response)
