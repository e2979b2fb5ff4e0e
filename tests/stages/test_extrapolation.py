"""Observed order and extrapolation from three grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.stages.refinement.extrapolation import extrapolate, observed_order


@pytest.mark.parametrize("grids", [(24, 36, 54), (40, 60, 90), (24, 35, 50)])
@pytest.mark.parametrize("order", [0.7, 1.0, 2.0, 4.5])
def test_the_order_of_one_power_is_found(grids: tuple[int, int, int], order: float) -> None:
    h = 1.0 / np.array(grids)
    assert observed_order(h, 1.2 - 3.0 * h**order) == pytest.approx(order, abs=1e-6)


@pytest.mark.parametrize("formal", [1, 2])
@pytest.mark.parametrize("second", [0.0, 40.0])
def test_two_terms_are_taken_off_exactly(formal: int, second: float) -> None:
    """The uncertainty is what the second term makes of the finest two grids: nothing where there is none."""
    h = 1.0 / np.array([24, 36, 55])
    found = extrapolate(h, 1.2 + 3.0 * h**formal + second * h ** (2 * formal), formal)
    assert found.clean
    assert found.value == pytest.approx(1.2, abs=1e-12)
    q = float(formal)
    expected = abs(second) * h[1] ** q * h[2] ** q
    assert found.error == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    "values", [(1.0, 1.1, 1.05), (1.0, 1.1, 1.2), (1.0, 1.0, 1.1), (1.0, 1.1, 1.1), (1.0, 1.1, 1.100001)]
)
def test_no_order_is_told_where_there_is_none(values: tuple[float, float, float]) -> None:
    """Not monotone, growing, standing still, or falling faster than any scheme does."""
    found = extrapolate(1.0 / np.array([24, 36, 54]), np.array(values), 2)
    assert not found.clean
    assert math.isnan(found.order) or found.order > 6.0


def test_misuse() -> None:
    with pytest.raises(ValueError, match="falling spacings"):
        extrapolate(np.array([1.0, 2.0, 3.0]), np.zeros(3), 2)
    with pytest.raises(ValueError, match="three values"):
        extrapolate(np.array([3.0, 2.0]), np.zeros(2), 2)
