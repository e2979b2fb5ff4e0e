"""Axial operators of the gas film: half a film, symmetric about its middle, ambient at its side.

An operator acts on values at ``count`` stations between the side (excluded, pressure 1) and the middle
(included) and gives the second derivative and the mean over the film.  Stations are ordered from the side to
the middle; z = Z / L_b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AxialOperator:
    """Second axial derivative and axial mean of a function u known at the stations and at the side.

    d^2 u / dz^2 = ``second_derivative @ u + side * u_side``,  mean u = ``weights @ u + side_weight * u_side``
    """

    stations: Array
    second_derivative: Array
    side: Array
    weights: Array
    side_weight: float


def chebyshev_operator(count: int) -> AxialOperator:
    """Chebyshev collocation with even polynomials of degree 2 ``count`` on the whole film.

    Its accuracy is spectral.
    """
    degree = 2 * count
    index = np.arange(degree + 1)
    points = np.cos(np.pi * index / degree)  # on [-1, 1], side first
    # D_ij = c_i / c_j (-1)^(i+j) / (x_i - x_j), rows summing to zero
    signs = np.where((index == 0) | (index == degree), 2.0, 1.0) * (-1.0) ** index
    difference = points[:, None] - points[None, :] + np.eye(degree + 1)
    derivative = np.outer(signs, 1.0 / signs) / difference
    derivative -= np.diag(derivative.sum(axis=1))
    second = 4.0 * (derivative @ derivative)  # z = (1 - x) / 2
    folded = _fold(second[1 : count + 1], count)
    weights = _fold(_clenshaw_curtis(degree)[None, :], count)[0]
    return AxialOperator(
        stations=0.5 * (1.0 - points[1 : count + 1]),
        second_derivative=np.ascontiguousarray(folded[:, 1:]),
        side=np.ascontiguousarray(folded[:, 0]),
        weights=weights[1:],
        side_weight=float(weights[0]),
    )


def _fold(rows: Array, count: int) -> Array:
    """Turn rows that act on the whole film into rows that act on half of a symmetric film."""
    folded = rows[:, : count + 1].copy()
    folded[:, :count] += rows[:, :count:-1]
    return folded


def _clenshaw_curtis(degree: int) -> Array:
    """Quadrature weights at cos(j pi / degree) for the mean over [-1, 1]; ``degree`` even."""
    angle = np.pi * np.arange(degree + 1) / degree
    weights = np.ones(degree + 1)
    for k in range(1, degree // 2 + 1):
        factor = 1.0 if k == degree // 2 else 2.0
        weights -= factor * np.cos(2.0 * k * angle) / (4.0 * k * k - 1.0)
    weights[[0, -1]] *= 0.5
    return weights / degree


def uniform_operator(count: int) -> AxialOperator:
    """The paper's uniform grid: central second differences and the trapezoidal mean (second order)."""
    spacing = 0.5 / count
    second = np.diag(np.full(count, -2.0)) + np.diag(np.ones(count - 1), 1) + np.diag(np.ones(count - 1), -1)
    if count > 1:
        second[-1, -2] = 2.0  # the station beyond the middle mirrors the one before it
    side = np.zeros(count)
    side[0] = 1.0 if count > 1 else 2.0
    weights = np.full(count, 1.0 / count)
    weights[-1] *= 0.5
    return AxialOperator(
        stations=spacing * np.arange(1, count + 1, dtype=np.float64),
        second_derivative=second / spacing**2,
        side=side / spacing**2,
        weights=weights,
        side_weight=0.5 / count,
    )
