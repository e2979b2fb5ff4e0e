"""Steppers: order conditions from the tableau, observed order, stability interval."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import numpy as np
import pytest

from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.steppers import RK4, Stepper, steppers
from tests.systems import duffing

Tree = tuple  # a rooted tree is the sorted tuple of its subtrees

ALL = list(steppers().values())


@cache
def trees(order: int) -> tuple[Tree, ...]:
    """All rooted trees with ``order`` vertices."""
    return tuple(sorted(set(_forests(order - 1, order - 1))))


@cache
def _forests(vertices: int, largest: int) -> tuple[Tree, ...]:
    if vertices == 0:
        return ((),)
    found = set()
    for size in range(1, min(vertices, largest) + 1):
        for tree in trees(size):
            for rest in _forests(vertices - size, largest):
                found.add(tuple(sorted((tree, *rest))))
    return tuple(found)


def order_of(tree: Tree) -> int:
    return 1 + sum(map(order_of, tree))


def density(tree: Tree) -> int:
    return order_of(tree) * math.prod(map(density, tree))


def weights(tree: Tree, stepper: Stepper) -> np.ndarray:
    """Elementary weights of the stages."""
    product = np.ones(stepper.stages)
    for child in tree:
        product = product * (stepper.a @ weights(child, stepper))
    return product


def test_numbers_of_rooted_trees() -> None:
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]
    assert len(Counter(trees(6))) == 20


@pytest.mark.parametrize("stepper", ALL, ids=lambda s: s.name)
def test_order_conditions(stepper: Stepper) -> None:
    """b . Phi(t) = 1/gamma(t) for every tree up to the order, and not for all trees of the next."""

    def defect(order: int) -> float:
        return max(abs(stepper.b @ weights(tree, stepper) - 1.0 / density(tree)) for tree in trees(order))

    # 1e-13: sums of a dozen 16-digit coefficients of size up to 40
    assert max(defect(order) for order in range(1, stepper.order + 1)) < 1e-13
    assert defect(stepper.order + 1) > 1e-6


@pytest.mark.parametrize("stepper", ALL, ids=lambda s: s.name)
def test_observed_order(stepper: Stepper) -> None:
    """Halving the step divides the error of orbit and tangent by 2^order."""
    parameters, state = np.array([1.0, 0.4]), np.array([0.5, -0.2])
    period_map = PeriodMap(duffing(), stepper, samples=4)
    coarse = {4: 64, 6: 40, 8: 20}[stepper.order]
    images = [
        period_map.evaluate(state, parameters, 2.0 * math.pi, n, np.eye(2))
        for n in (coarse, 2 * coarse, 1024)
    ]
    for part in ("state", "columns"):
        errors = [np.max(np.abs(getattr(image, part) - getattr(images[2], part))) for image in images[:2]]
        assert abs(math.log2(errors[0] / errors[1]) - stepper.order) < 0.6, (part, errors)
        assert errors[1] > 2e-13  # well above the rounding of 40 steps, so that the rate means something


def test_stability_intervals() -> None:
    """Classical value: RK4 2.785 on the real axis."""
    assert RK4.real_stability_interval == pytest.approx(2.7852935634, abs=1e-4)
    for stepper in ALL:
        z = -stepper.real_stability_interval
        inside = np.polynomial.polynomial.polyval(np.linspace(z, 0.0, 500), stepper.stability_polynomial)
        assert np.all(np.abs(inside) <= 1.0 + 1e-12)
        assert abs(np.polynomial.polynomial.polyval(1.01 * z, stepper.stability_polynomial)) > 1.0


def test_stability_polynomial_is_the_step_of_the_loop() -> None:
    for stepper in ALL:
        z = -0.7
        exponential = sum(z**k / math.factorial(k) for k in range(stepper.order + 1))
        value = np.polynomial.polynomial.polyval(z, stepper.stability_polynomial)
        assert abs(value - exponential) < abs(z) ** (stepper.order + 1)
        assert np.allclose(
            stepper.stability_polynomial[: stepper.order + 1],
            [1.0 / math.factorial(k) for k in range(stepper.order + 1)],
            rtol=1e-11,
        )


def test_malformed_tableaux_are_refused() -> None:
    with pytest.raises(ValueError, match="lower triangular"):
        Stepper("implicit", 1, np.array([[1.0]]), np.array([1.0]), np.array([1.0]))
    with pytest.raises(ValueError, match="sum to c"):
        Stepper("skew", 1, np.array([[0.0]]), np.array([1.0]), np.array([0.5]))
    with pytest.raises(ValueError, match="sum to"):
        Stepper("light", 1, np.array([[0.0]]), np.array([0.9]), np.array([0.0]))
