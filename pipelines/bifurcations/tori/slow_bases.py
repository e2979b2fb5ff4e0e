"""Bases of the slow subspaces along an invariant curve.

The basis V_j (N, k) at every angle moves with the map: V_j <- orth (D V)_j, where D carries fields around the
curve.  The shift in D interpolates over the angles, so the columns that span the slow fields must be smooth
functions of the angle.  The k columns together need not be: the last of them belong to multipliers that no
gap separates from the neglected ones, and their directions are arbitrary at every angle.  Therefore the
columns are kept in two blocks.  The ``leading`` ones end at a gap of the multipliers, are orthonormalised
first, and within their span are turned as near to the old ones as possible, so that they stay smooth; the
others follow in what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.tori.fourier import Array, applied, resampled, shift_matrix
from pipelines.orbits.floquet import BasisOptions, deterministic_block, orthonormal, wanted_columns
from pipelines.orbits.system import Matrix, Vector

_SPARE_COLUMNS = 6  # by which the leading block may be wider than it must, to end in a gap
_GAP = 1.3  # ratio of neighbouring moduli that counts as one
_SETTLED = 1e-10  # error of the leading block after the sweeps that arrange it
_MOST_SWEEPS = 80


@dataclass(frozen=True)
class SlowBases:
    """``columns`` (M, N, k), orthonormal at every angle; the first ``leading`` are smooth over the angles."""

    columns: Array
    leading: int

    @property
    def whole(self) -> bool:
        """Whether the bases span the whole space: then they are identities and stay so."""
        return self.columns.shape[1] == self.columns.shape[2]

    def following(self, columns: Array, rotation: float) -> SlowBases:
        """V_j <- orth (D V)_j for the images ``columns`` (M, N, k) of the old basis."""
        if self.whole:
            return self
        shift = shift_matrix(len(columns), -rotation)[0]
        return replace(self, columns=aligned_frames(applied(shift, columns), self.columns, self.leading))

    def resampled(self, count: int) -> SlowBases:
        """The bases at another number of angles."""
        if self.whole:
            return constant_bases(self.columns[0], count)
        moved = resampled(self.columns, count)
        return replace(self, columns=aligned_frames(moved, moved, self.leading))

    def grown(self, moduli: Vector, options: BasisOptions) -> SlowBases:
        """The bases with fixed new directions, if the moduli of the multipliers require more columns."""
        count, size, width = self.columns.shape
        wanted = wanted_columns(moduli, size, options)
        if self.whole or wanted <= width:
            return self
        new = constant_bases(deterministic_block(size, wanted - width, first=width), count)
        together = np.concatenate([self.columns, new.columns], axis=2)
        return replace(self, columns=aligned_frames(together, together, self.leading))


def constant_bases(basis: Matrix, count: int) -> SlowBases:
    """The same basis (N, k) at every angle."""
    columns = np.ascontiguousarray(np.broadcast_to(basis, (count, *basis.shape)))
    return SlowBases(columns, basis.shape[1])


def aligned_frames(blocks: Array, old: Array, leading: int) -> Array:
    """Nested orthonormal bases of the spans of ``blocks`` (M, N, k), turned to be nearest to ``old``.

    The first columns span the leading blocks.  Both parts are turned.
    """
    nested, _ = np.linalg.qr(blocks)
    parts = [
        _turned(nested[:, :, part], old[:, :, part])
        for part in (slice(0, leading), slice(leading, blocks.shape[2]))
    ]
    return np.ascontiguousarray(np.concatenate(parts, axis=2))


def _turned(frames: Array, old: Array) -> Array:
    """Q A C' with the singular value decomposition Q'V_old = A B C'."""
    left, _, right = np.linalg.svd(np.swapaxes(frames, 1, 2) @ old)
    return np.asarray(frames @ (left @ right))


def leading_columns(moduli: Vector, cut: float) -> int:
    """How many columns belong to multipliers above the cut, extended to the widest gap.

    All of them where there is no gap.  ``moduli`` by falling size.
    """
    slow = max(1, int(np.sum(moduli > cut)))
    ratios = moduli[slow - 1 : -1] / np.maximum(moduli[slow:], np.finfo(float).tiny)
    ratios = ratios[:_SPARE_COLUMNS]
    if len(ratios) == 0 or np.max(ratios) < _GAP:
        return len(moduli)
    return slow + int(np.argmax(ratios))


def leading_coordinates(bases: Array, columns: Array, rotation: float, leading: int, moduli: Vector) -> Array:
    """Smooth orthonormal frames of the p slowest directions, as coordinates (M, k, p) in the bases V.

    p = ``leading``.  Subspace iteration uses the images M V = ``columns``: no passes are needed.

    It starts from the constant frame of the mean map, near which the others can be turned smoothly.
    """
    count, _, width = bases.shape
    if leading == width:
        return np.ascontiguousarray(np.broadcast_to(np.eye(width), (count, width, width)))
    ratio = float(moduli[leading - 1] / max(moduli[leading], np.finfo(float).tiny))
    sweeps = min(_MOST_SWEEPS, math.ceil(math.log(_SETTLED) / -math.log(max(ratio, _GAP))) + 3)
    shift, transposed = shift_matrix(count, -rotation)[0], np.ascontiguousarray(np.swapaxes(bases, 1, 2))
    constant = np.ascontiguousarray(bases[0][:, :leading])
    for _ in range(sweeps):
        constant = orthonormal((columns @ (transposed @ constant)).mean(axis=0))
    frames = np.broadcast_to(constant, (count, *constant.shape))
    coordinates, _ = np.linalg.qr(transposed @ frames)
    coordinates = _turned(coordinates, transposed @ frames)
    for _ in range(sweeps):
        frames = bases @ coordinates
        moved, _ = np.linalg.qr(transposed @ applied(shift, columns @ coordinates))
        coordinates = _turned(moved, transposed @ frames)
    return np.ascontiguousarray(coordinates)


def rearranged(bases: Array, columns: Array, coordinates: Array) -> tuple[SlowBases, Array]:
    """V and M V rotated at every angle so that frames with the given coordinates come first."""
    complete, _ = np.linalg.qr(coordinates, mode="complete")
    leading = coordinates.shape[2]
    turn = np.concatenate([coordinates, complete[:, :, leading:]], axis=2)
    return SlowBases(np.ascontiguousarray(bases @ turn), leading), np.ascontiguousarray(columns @ turn)
