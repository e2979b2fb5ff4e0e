"""Axial operators of the half film: exact polynomials, weights, order."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.axial import AxialOperator, chebyshev_operator, uniform_operator


def shape(z: np.ndarray) -> np.ndarray:
    """A profile symmetric about the middle z = 1/2, 1 at the side z = 0: cos(2 (1 - 2z)) / cos 2."""
    return np.cos(2.0 * (1.0 - 2.0 * z)) / np.cos(2.0)


def errors(operator: AxialOperator) -> tuple[float, float]:
    """Errors of the second derivative (-16 u) and of the mean (tan 2 / 2) for ``shape``."""
    u = shape(operator.stations)
    curvature = operator.second_derivative @ u + operator.side
    mean = operator.weights @ u + operator.side_weight
    return float(np.abs(curvature + 16.0 * u).max()), abs(float(mean) - np.tan(2.0) / 2.0)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_chebyshev_is_exact_for_even_polynomials(count: int) -> None:
    """x^(2k), x = 1 - 2z, k <= count: second derivative 8k (2k - 1) x^(2k-2), mean 1 / (2k + 1)."""
    operator = chebyshev_operator(count)
    x = 1.0 - 2.0 * operator.stations
    for k in range(count + 1):
        curvature = operator.second_derivative @ x ** (2 * k) + operator.side
        expected = 8.0 * k * (2 * k - 1) * x ** max(2 * k - 2, 0)
        np.testing.assert_allclose(curvature, expected, rtol=0.0, atol=1e-11 * (1 + 8 * count**4))
        mean = operator.weights @ x ** (2 * k) + operator.side_weight
        assert mean == pytest.approx(1.0 / (2 * k + 1), abs=1e-14)


@pytest.mark.parametrize("operator", [chebyshev_operator, uniform_operator])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_weights(operator: type, count: int) -> None:
    """A constant is its own mean and has no curvature; weights are positive; the middle comes last."""
    built = operator(count)
    assert built.weights.sum() + built.side_weight == pytest.approx(1.0, abs=1e-14)
    assert (built.weights > 0.0).all()
    assert built.side_weight > 0.0
    np.testing.assert_allclose(
        built.second_derivative.sum(axis=1) + built.side,
        0.0,
        atol=1e-11 * np.abs(built.second_derivative).max(),
    )
    assert (np.diff(built.stations) > 0.0).all()
    assert built.stations[-1] == pytest.approx(0.5, abs=1e-15)


def test_uniform_is_of_second_order() -> None:
    coarse, fine = (errors(uniform_operator(count)) for count in (16, 32))
    for before, after in zip(coarse, fine, strict=True):
        assert np.log2(before / after) == pytest.approx(2.0, abs=0.05)


def test_chebyshev_is_spectral() -> None:
    """Errors of an entire function fall by a growing factor per station."""
    found = np.array([errors(chebyshev_operator(count)) for count in (2, 3, 4, 5, 6)])
    factors = found[:-1] / found[1:]
    assert (factors > 8.0).all()
    assert found[-1, 0] < 1e-4
    assert found[-1, 1] < 1e-7
