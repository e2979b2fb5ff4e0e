"""Floquet multipliers from the slow invariant subspace, and the basis that spans it.

With V orthonormal (N, p) and M V known, the multipliers are the eigenvalues of V'MV; a pair (mu, y) is
trusted by its residual ||M V y - mu V y||, ||y|| = 1.  One step of subspace iteration is V <- orth(M V): the
angle between V and the eigenvector of mu shrinks by abs(mu_neglected / mu).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pipelines.orbits.period_map import OrbitStart, PeriodMap
from pipelines.orbits.system import Matrix, Vector

Complex = NDArray[np.complex128]

_SWEEPS = 3  # of subspace iteration with one number of columns
_CLUSTER_COLUMNS = 8  # so many multipliers within one ratio are a cluster, not isolated modes
_CLUSTER_RATIO = 1.5
_CLUSTER_MODULUS = 0.3  # above it a cluster must be resolved: Picard sweeps would converge too slowly


@dataclass(frozen=True)
class BasisOptions:
    """Size of the slow subspace.

    ``multiplier_cut``: keep every isolated multiplier above this modulus; ``buffer``: columns kept beyond
    them, which speed up the subspace iteration; ``initial_columns``: size of the first basis;
    ``maximum_columns``: cap.
    """

    multiplier_cut: float = 1e-3
    buffer: int = 4
    initial_columns: int = 24
    maximum_columns: int = 64

    def __post_init__(self) -> None:
        if not 0.0 < self.multiplier_cut < 1.0:
            raise ValueError(f"multiplier_cut is {self.multiplier_cut}; it must lie between 0 and 1")
        if self.buffer < 1 or self.initial_columns < 1 or self.maximum_columns < self.initial_columns:
            raise ValueError(
                f"buffer {self.buffer}, initial_columns {self.initial_columns}, maximum_columns "
                f"{self.maximum_columns}; needed: buffer >= 1 and 1 <= initial_columns <= maximum_columns"
            )


@dataclass(frozen=True)
class FloquetSpectrum:
    """Multipliers (p,) by falling modulus, their residuals (p,) and eigenvectors (N, p) of unit norm."""

    multipliers: Complex
    residuals: Vector
    vectors: Complex


def floquet_spectrum(basis: Matrix, image: Matrix) -> FloquetSpectrum:
    """Eigenvalues of V'MV with the residuals ||M V y - mu V y||; ``image`` is M V."""
    multipliers, coefficients = np.linalg.eig(basis.T @ image)
    order = np.argsort(-np.abs(multipliers), kind="stable")
    multipliers = multipliers[order].astype(complex)
    coefficients = coefficients[:, order].astype(complex)
    vectors = basis @ coefficients
    residuals = np.linalg.norm(image @ coefficients - vectors * multipliers, axis=0)
    return FloquetSpectrum(multipliers, residuals, vectors)


def orthonormal(block: Matrix) -> Matrix:
    """Orthonormal basis of the columns, with signs that make R's diagonal positive.

    Equal input gives equal bits.
    """
    q, r = np.linalg.qr(block)
    return np.ascontiguousarray(q * np.where(np.diag(r) < 0.0, -1.0, 1.0))


def deterministic_block(size: int, columns: int, first: int = 0) -> Matrix:
    """Columns without structure that are equal on every machine.

    Fractional parts of a two-dimensional Weyl sequence.
    """
    row = np.arange(1, size + 1)[:, None]
    column = np.arange(first + 1, first + columns + 1)[None, :]
    return (row * math.sqrt(2.0) + column * math.sqrt(3.0) + row * column * math.sqrt(5.0)) % 1.0 - 0.5


def starting_basis(period_map: PeriodMap, start: OrbitStart, options: BasisOptions) -> Matrix:
    """A slow basis without an earlier one, by subspace iteration on a fixed block.

    The block is enlarged until the smallest multiplier is below the cut.  The identity, and so the plain
    Newton method, when the system is no larger than the initial block.
    """
    size = period_map.size
    if size <= options.initial_columns:
        return np.eye(size)
    basis = orthonormal(deterministic_block(size, options.initial_columns))
    image = period_map.evaluate(*start, basis, keep_factors=True)
    for sweep in itertools.count(1):
        if not np.all(np.isfinite(image.columns)):
            break
        basis, previous = orthonormal(image.columns), basis
        if sweep % _SWEEPS == 0:
            moduli = np.abs(np.linalg.eigvals(previous.T @ image.columns))
            wanted = wanted_columns(moduli, size, options)
            if wanted <= basis.shape[1]:
                break
            basis = enlarge(basis, min(size, options.maximum_columns, max(wanted, basis.shape[1] + 8)))
        image = period_map.with_columns(image, basis)
    return basis


def wanted_columns(moduli: Vector, size: int, options: BasisOptions) -> int:
    """Number of columns that the slow basis should have, from the moduli of its multipliers.

    All above the cut plus the buffer.  When the smallest ones form a cluster (foil modes gather at exp(-T
    k_f/c_f)) only the isolated ones above it count: the cluster is left to the Picard sweeps.
    """
    moduli = np.sort(moduli)[::-1]
    smallest = moduli[-1]
    clustered = int(np.sum(moduli <= _CLUSTER_RATIO * smallest))
    slow = int(np.sum(moduli > options.multiplier_cut))
    if clustered >= _CLUSTER_COLUMNS and smallest < _CLUSTER_MODULUS:
        slow = min(slow, len(moduli) - clustered)
    return min(slow + options.buffer, options.maximum_columns, size)


def enlarge(basis: Matrix, columns: int) -> Matrix:
    """The basis with fixed new directions, orthogonal to the old ones, up to ``columns`` columns."""
    new = deterministic_block(basis.shape[0], columns - basis.shape[1], first=basis.shape[1])
    return orthonormal(np.hstack([basis, new]))


def adapted_basis(basis: Matrix, image: Matrix, options: BasisOptions) -> Matrix:
    """orth(M V) with as many columns as the multipliers require.

    It shrinks onto the dominant Schur vectors, but only when more than the buffer would go, so that the size
    does not flicker from point to point.
    """
    size, columns = basis.shape
    following = orthonormal(image)
    if columns == size:
        return np.eye(size)
    projected = basis.T @ image
    moduli = np.sort(np.abs(np.linalg.eigvals(projected)))[::-1]
    wanted = wanted_columns(moduli, size, options)
    if wanted > columns:
        return enlarge(following, wanted)
    if wanted >= columns - options.buffer:
        return following
    # The threshold lies in the gap below the last wanted multiplier, so that a complex pair is never divided.
    threshold = moduli[wanted - 1] * (1.0 - 1e-12)
    _, vectors, kept = scipy.linalg.schur(projected, sort=lambda re, im=0.0: math.hypot(re, im) >= threshold)
    return orthonormal(image @ vectors[:, :kept])


def nontrivial(multipliers: Complex, autonomous: bool) -> Complex:
    """The multipliers without the trivial one (the nearest to 1) of an autonomous cycle."""
    if not autonomous:
        return multipliers
    return np.delete(multipliers, int(np.argmin(np.abs(multipliers - 1.0))))
