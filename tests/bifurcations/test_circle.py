"""Trigonometric interpolation on odd numbers of angles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.bifurcations.tori.fourier import (
    amplitudes,
    angles,
    applied,
    derivative,
    interpolated,
    nearest_fraction,
    resampled,
    shift_matrix,
    tail,
)


def polynomial(at: np.ndarray) -> np.ndarray:
    """Wave numbers up to 5, two components."""
    return np.stack([1.0 + np.cos(3 * at) - 0.4 * np.sin(5 * at), np.sin(at) + 0.2 * np.cos(5 * at)], axis=1)


@pytest.mark.parametrize("count", [11, 13, 31])
def test_exact_for_polynomials(count: int) -> None:
    """Eleven angles hold wave numbers up to five; shift, resampling and interpolation leave rounding only."""
    at, values = angles(count), polynomial(angles(count))
    shifted = applied(shift_matrix(count, 0.83)[0], values)
    assert np.max(np.abs(shifted - polynomial(at + 0.83))) < 1e-13
    assert np.max(np.abs(interpolated(values, at + 0.3) - polynomial(at + 0.3))) < 1e-13
    assert np.max(np.abs(resampled(values, 57) - polynomial(angles(57)))) < 1e-13
    assert np.max(np.abs(resampled(resampled(values, 57), count) - values)) < 1e-13
    slope = -3 * np.sin(3 * at) - 2.0 * np.cos(5 * at)
    assert np.max(np.abs(derivative(values)[:, 0] - slope)) < 1e-12


def test_shifts_form_a_group() -> None:
    """Orthogonal, S(a) S(b) = S(a + b), and dS/da is the difference quotient to second order."""
    first, slope = shift_matrix(15, 0.4)
    second, _ = shift_matrix(15, 1.1)
    assert np.max(np.abs(first @ first.T - np.eye(15))) < 1e-14
    assert np.max(np.abs(first @ second - shift_matrix(15, 1.5)[0])) < 1e-14
    errors = [
        np.max(np.abs((shift_matrix(15, 0.4 + h)[0] - shift_matrix(15, 0.4 - h)[0]) / (2 * h) - slope))
        for h in (1e-2, 5e-3)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("count", [2, 14, 1])
def test_even_numbers_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="odd number"):
        angles(count)


@pytest.mark.parametrize("ratio", [0.3, 0.6])
def test_tail_of_a_geometric_series(ratio: float) -> None:
    """The function 1/(1 - r exp(i theta)) lacks r^(K + 1) and more beyond K: the estimate is that within the
    fall over a quarter of the wave numbers, and never below.
    """
    at = angles(41)
    series = 1.0 / (1.0 - ratio * np.exp(1j * at))
    found = amplitudes(np.stack([series.real, series.imag], axis=1))
    missing = ratio**21 / (1.0 - ratio)
    assert missing * (1.0 - ratio) < tail(found) < missing * ratio**-5


def test_nearest_fraction() -> None:
    assert nearest_fraction(2.0 * math.pi * 1.2503, 12)[:2] == (5, 4)
    p, q, distance = nearest_fraction(2.0 * math.pi * 0.3331, 12)
    assert (p, q) == (1, 3)
    assert distance == pytest.approx(1.0 / 3.0 - 0.3331, rel=1e-6)
