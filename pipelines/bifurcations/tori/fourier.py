"""Trigonometric interpolation on an odd number M of equally spaced angles theta_j = 2 pi j/M.

A function is known by its values x_j, shape (M, ...); its interpolant has the wave numbers -K..K with
M = 2 K + 1.  An even number would carry cos(M theta/2), which a shift does not map into itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipelines.orbits.system import Matrix, Vector

Array = NDArray[np.float64]

_QUARTER = 0.25  # of the wave numbers: groups this wide forgive single ones that a symmetry leaves out


def angles(count: int) -> Vector:
    """theta_j, shape (count,).  Raises ValueError for an even count or one below three."""
    if count < 3 or count % 2 == 0:
        raise ValueError(f"{count} angles; an odd number of at least 3 is needed")
    return 2.0 * math.pi * np.arange(count) / count


def shift_matrix(count: int, shift: float) -> tuple[Matrix, Matrix]:
    """S and dS/d shift, each (count, count): (S x)_j = x(theta_j + shift).

    S_ji = (1 + 2 sum_{m=1}^K cos m(theta_j + shift - theta_i)) / M is orthogonal and S(a) S(b) = S(a + b).
    """
    at = angles(count)
    numbers = np.arange(1, count // 2 + 1)
    gaps = numbers[:, None] * (at + shift)
    row = (1.0 + 2.0 * np.cos(gaps).sum(axis=0)) / count
    slope = (-2.0 * numbers[:, None] * np.sin(gaps)).sum(axis=0) / count
    offset = (np.arange(count)[:, None] - np.arange(count)[None, :]) % count
    return np.ascontiguousarray(row[offset]), np.ascontiguousarray(slope[offset])


def applied(matrix: Matrix, values: Array) -> Array:
    """A matrix (M, M) over the angles applied to values (M, ...)."""
    count = len(values)
    return np.asarray(matrix @ values.reshape(count, -1)).reshape(values.shape)


def derivative(values: Array) -> Array:
    """d/d theta of the interpolant at the angles, shape as ``values``."""
    return applied(shift_matrix(len(values), 0.0)[1], values)


def resampled(values: Array, count: int) -> Array:
    """The interpolant at another odd number of angles; wave numbers that do not fit are dropped."""
    old = len(values)
    if count == old:
        return values.copy()
    spectrum = np.fft.rfft(values, axis=0)
    kept = np.zeros((count // 2 + 1, *values.shape[1:]), dtype=complex)
    common = min(len(spectrum), len(kept))
    kept[:common] = spectrum[:common]
    return np.ascontiguousarray(np.fft.irfft(kept, n=count, axis=0) * (count / old))


def interpolated(values: Array, at: Vector) -> Array:
    """The interpolant at any angles (n,), shape (n, ...)."""
    count = len(values)
    gaps = np.asarray(at)[:, None] - angles(count)[None, :]
    weights = np.ones_like(gaps)
    for number in range(1, count // 2 + 1):
        weights += 2.0 * np.cos(number * gaps)
    return np.asarray(weights @ values.reshape(count, -1) / count).reshape(len(gaps), *values.shape[1:])


def amplitudes(values: Matrix) -> Vector:
    """Largest entry of the wave numbers 0..K of values (M, N), shape (K + 1,)."""
    spectrum = np.abs(np.fft.rfft(values, axis=0)) / len(values)
    spectrum[1:] *= 2.0
    return np.asarray(spectrum.max(axis=1))


def tail(found: Vector) -> float:
    """The part of an interpolant that its wave numbers miss, estimated from its ``amplitudes``.

    The largest one of the last quarter, less what the amplitudes fall from the third quarter to the
    last.
    """
    last = len(found) - 1
    third, fourth = math.ceil((1.0 - 2.0 * _QUARTER) * last), math.ceil((1.0 - _QUARTER) * last)
    before, end = float(found[third:fourth].max(initial=0.0)), float(found[fourth:].max())
    return end * end / before if before > end else end


def nearest_fraction(rotation: float, largest_denominator: int) -> tuple[int, int, float]:
    """The fraction of a turn that ``rotation`` [rad] is nearest to, as (p, q, distance).

    The distance is multiplied by q, so that small denominators are preferred.
    """
    turn = rotation / (2.0 * math.pi)
    distances = [
        (abs(q * turn - round(q * turn)), round(q * turn), q) for q in range(1, largest_denominator + 1)
    ]
    distance, p, q = min(distances)
    return p, q, distance / q
