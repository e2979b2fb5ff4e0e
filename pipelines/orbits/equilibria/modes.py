"""Oscillating modes of the linearised machine at one speed, and their matching between speeds.

With the modes V of one speed and V' of another as columns, each set is expressed in the other one and its
conjugates,

    V' = V A + ...,      V = V' B + ...,      R_jk = A_jk B_kj

R (the relative gain array) does not depend on the scale of any column.  It tends to the identity as the
speeds meet, also where modes are far from orthogonal, and its rows add up to 1: a mode k with R_jk near 1 is
mode j.  Modes of one eigenvalue have no vectors of their own, only a space that they span: of such a group R
is summed up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linear_sum_assignment

from pipelines.case.arrays import Array, ComplexArray
from pipelines.machine.assembly import Machine
from pipelines.machine.rotor_modes import translations, whirl_directions
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest
from pipelines.orbits.equilibria.linear import eigenpairs_near

# Modes damped more than this are film and foil modes, of no interest to a rotor; those a little more damped
# are known too, so that one whose damping changes is not lost.
LARGEST_DAMPING_RATIO, LARGEST_KNOWN = 0.9, 0.99
# Eigenvalues that differ by less than this part are the same.
SAME = 1e-8
# |R_jk - 1| below which two modes are the same beyond doubt, and below which they are taken as the same.
CERTAIN, LIKELY = 0.3, 0.75
# Up to this size all eigenvalues of the dense matrix are computed: none can be missed.
DENSE_SIZE = 500
SHIFTS, MODES_PER_SHIFT, MOST_PER_SHIFT = 4, 10, 80
# Of a large machine the modes up to this many times the highest frequency are computed, so that none that
# passes it is lost, and up to this damping ratio.
BEYOND, SECTOR = 1.2, 0.63
SLOPE = SECTOR / np.sqrt(1.0 - SECTOR**2)  # -Re / Im of these


@dataclass(frozen=True)
class ModeSet:
    """Oscillating modes at one speed by rising frequency.

    Eigenvalues (modes,), unit eigenvectors (N, modes) of the whole state, displacements at all shaft
    nodes (modes, nodes, 2).  None with a frequency up to ``top`` is missing.
    """

    eigenvalues: ComplexArray
    vectors: ComplexArray
    shapes: ComplexArray
    top: float = np.inf

    @property
    def damping_ratios(self) -> Array:
        """-Re lambda / |lambda|, shape (modes,)."""
        return np.asarray(-self.eigenvalues.real / np.abs(self.eigenvalues))

    @property
    def directions(self) -> NDArray[np.int8]:
        """+1 forward, -1 backward, 0 planar, shape (modes,)."""
        return whirl_directions(self.shapes)


def logarithmic_decrements(eigenvalues: ComplexArray) -> Array:
    """-2 pi Re lambda / Im lambda: logarithm of the ratio of successive maxima; NaN without oscillation."""
    oscillating = np.abs(eigenvalues.imag) > 1e-9 * np.abs(eigenvalues)
    frequency = np.where(oscillating, np.abs(eigenvalues.imag), np.nan)
    return np.asarray(-2.0 * np.pi * eigenvalues.real / frequency)


def modes_at(machine: Machine, parameters: Array, state: Array, top: float) -> ModeSet:
    """Modes with a damping ratio below ``LARGEST_KNOWN``.

    Of a large machine those with Im lambda below about ``top``, damped up to about ``SECTOR``.
    """
    jacobian = machine.jacobian(MEAN_PHASE, state, at_rest(parameters))
    if jacobian.shape[0] <= DENSE_SIZE:
        values, vectors = np.linalg.eig(jacobian.toarray())
        top = np.inf
    else:
        values, vectors = _sparse_pairs(jacobian, BEYOND * top)
    kept = (values.imag > 1e-6) & (-values.real < LARGEST_KNOWN * np.abs(values))
    order = np.flatnonzero(kept)[np.argsort(values.imag[kept], kind="stable")]
    vectors = vectors[:, order] / np.linalg.norm(vectors[:, order], axis=0)
    return ModeSet(values[order], vectors, node_shapes(machine, vectors), top)


def _sparse_pairs(jacobian: sparse.csc_array, top: float) -> tuple[ComplexArray, ComplexArray]:
    """Eigenpairs about shifts along the imaginary axis, covering the lightly damped modes up to ``top``.

    So many of each shift that their discs cover the sector.
    """
    shifts = np.asarray(1j * top * (np.arange(SHIFTS) + 0.5) / SHIFTS, dtype=np.complex128)
    frequency, slope = np.meshgrid(np.linspace(0.05, 1.0, 20) * top, np.linspace(0.0, SLOPE, 7))
    sector = (frequency * (1j - slope)).ravel()
    count = MODES_PER_SHIFT
    while True:
        pairs = eigenpairs_near(jacobian, shifts, count)
        distance = np.sort(np.abs(pairs.values[:, None] - shifts), axis=0)
        reached = distance[min(count, len(distance)) - 1]
        covered = np.abs(sector[:, None] - shifts) <= reached
        if covered.any(axis=1).all() or count >= MOST_PER_SHIFT:
            return pairs.values, pairs.vectors
        count *= 2


def node_shapes(machine: Machine, vectors: ComplexArray) -> ComplexArray:
    """Displacements x, y at all shaft nodes (modes, nodes, 2) of eigenvectors (N, modes).

    The largest component is 1.
    """
    start = machine.rotor_start
    shapes = translations(machine.scaled, vectors[start : start + machine.rotor_freedoms].T)
    flat = shapes.reshape(vectors.shape[1], -1)
    largest = flat[np.arange(len(flat)), np.argmax(np.abs(flat), axis=1)]
    return np.asarray(shapes / largest[:, None, None])


@dataclass(frozen=True)
class Match:
    """The index in another set of every mode of a set, or -1, and whether the match is beyond doubt."""

    partner: tuple[int, ...]
    certain: tuple[bool, ...]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The modes matched in both sets."""
        return [(mode, partner) for mode, partner in enumerate(self.partner) if partner >= 0]


def match_modes(first: ModeSet, second: ModeSet) -> Match:
    """The modes of ``first`` among those of ``second``, one to one."""
    gains = _relative_gains(first.vectors, second.vectors)
    same_before, same_after = _same(first.eigenvalues), _same(second.eigenvalues)
    gains = np.where(same_after.sum(axis=0) > 1, gains @ same_after, same_before @ gains)
    doubt = np.abs(gains - 1.0)
    partner, certain = [-1] * len(first.eigenvalues), [False] * len(first.eigenvalues)
    for row, column in zip(*linear_sum_assignment(np.minimum(doubt, 1.0)), strict=True):
        if doubt[row, column] < LIKELY:
            partner[row], certain[row] = int(column), bool(doubt[row, column] < CERTAIN)
    return Match(tuple(partner), tuple(certain))


def _same(eigenvalues: ComplexArray) -> Array:
    """1 for each two modes that have one eigenvalue, (modes, modes)."""
    apart = np.abs(eigenvalues[:, None] - eigenvalues)
    return np.asarray(apart <= SAME * np.abs(eigenvalues), dtype=np.float64)


def _relative_gains(first: ComplexArray, second: ComplexArray) -> ComplexArray:
    """The ratios R of the module's docstring."""
    return np.asarray(_expressed(second, first) * _expressed(first, second).T)


def _expressed(vectors: ComplexArray, basis: ComplexArray) -> ComplexArray:
    """Coefficients (basis, vectors) of vectors in a basis and its conjugates, by least squares."""
    whole = np.concatenate([basis, basis.conj()], axis=1)
    return np.asarray(np.linalg.lstsq(whole, vectors, rcond=1e-12)[0][: basis.shape[1]])
