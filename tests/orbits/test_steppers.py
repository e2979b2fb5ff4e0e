"""Steppers: order conditions from the tableau, observed order, stability interval."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import numpy as np
import pytest

from pipelines.orbits.period_map import Formulation, Inhomogeneity, PeriodMap
from pipelines.orbits.steppers import ESDIRK5, RK4, ImplicitStepper, Stepper, steppers
from tests.systems import duffing, implicit

Tree = tuple  # a rooted tree is the sorted tuple of its subtrees

ALL = list(steppers().values())
EXPLICIT = [stepper for stepper in ALL if isinstance(stepper, Stepper)]


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


def weights(tree: Tree, stepper: Stepper | ImplicitStepper) -> np.ndarray:
    """Elementary weights of the stages."""
    product = np.ones(stepper.stages)
    for child in tree:
        product = product * (stepper.a @ weights(child, stepper))
    return product


def test_numbers_of_rooted_trees() -> None:
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]
    assert len(Counter(trees(6))) == 20


@pytest.mark.parametrize("stepper", ALL, ids=lambda s: s.name)
def test_order_conditions(stepper: Stepper | ImplicitStepper) -> None:
    """b . Phi(t) = 1/gamma(t) for every tree up to the order, and not for all trees of the next."""

    def defect(order: int) -> float:
        return max(abs(stepper.b @ weights(tree, stepper) - 1.0 / density(tree)) for tree in trees(order))

    # 1e-13: sums of a dozen 16-digit coefficients of size up to 40
    assert max(defect(order) for order in range(1, stepper.order + 1)) < 1e-13
    assert defect(stepper.order + 1) > 1e-6


@pytest.mark.parametrize("stepper", ALL, ids=lambda s: s.name)
def test_observed_order(stepper: Stepper | ImplicitStepper) -> None:
    """Halving the step divides the error of orbit and tangent by 2^order."""
    parameters, state = np.array([1.0, 0.4]), np.array([0.5, -0.2])
    period_map = PeriodMap(implicit(duffing()), stepper, samples=4)
    coarse = {4: 64, 5: 40, 6: 40, 8: 20}[stepper.order]
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
    for stepper in EXPLICIT:
        z = -stepper.real_stability_interval
        inside = np.polynomial.polynomial.polyval(np.linspace(z, 0.0, 500), stepper.stability_polynomial)
        assert np.all(np.abs(inside) <= 1.0 + 1e-12)
        assert abs(np.polynomial.polynomial.polyval(1.01 * z, stepper.stability_polynomial)) > 1.0


def test_stability_polynomial_is_the_step_of_the_loop() -> None:
    for stepper in EXPLICIT:
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


def test_implicit_stepper_is_l_stable() -> None:
    """|R| <= 1 on the imaginary axis, no pole on the left, R -> 0 far out; so R is bounded by one on the
    left.
    """
    axis = np.concatenate([np.linspace(0.0, 50.0, 2001), np.geomspace(50.0, 1e8, 200)])
    # 1e-12: the weights carry 13 digits, and at small y the modulus is one to order y^6
    assert max(abs(ESDIRK5.stability(1j * y)) for y in axis) <= 1.0 + 1e-12
    assert abs(ESDIRK5.stability(-1e10)) < 1e-8
    assert ESDIRK5.a[1, 1] > 0.0  # the only pole, 1 / gamma


def test_predictor_reproduces_linear_slopes() -> None:
    """Slopes that grow linearly in time are extrapolated exactly, from the step before and from this one."""
    times = np.concatenate([ESDIRK5.c - 1.0, ESDIRK5.c])
    np.testing.assert_allclose(
        ESDIRK5.predictor[1:] @ (2.0 + 3.0 * times), 2.0 + 3.0 * ESDIRK5.c[1:], rtol=1e-12
    )
    for i in range(1, ESDIRK5.stages):
        assert np.all(ESDIRK5.predictor[i, ESDIRK5.stages + i :] == 0.0)


def test_malformed_implicit_tableaux_are_refused() -> None:
    c = np.array([0.0, 1.0])
    for a, message in [
        ([[0.0, 0.0], [0.5, 0.5]], None),
        ([[0.5, 0.0], [0.5, 0.5]], "explicit first stage"),
        ([[0.0, 0.5], [0.5, 0.5]], "lower triangular"),
        ([[0.0, 0.0], [1.0, 0.0]], "positive number"),
        ([[0.0, 0.0], [0.4, 0.5]], "sum to c"),
    ]:
        if message is None:
            assert ImplicitStepper("trapezoidal", 2, np.array(a), c).order == 2
        else:
            with pytest.raises(ValueError, match=message):
                ImplicitStepper("malformed", 2, np.array(a), c)


def test_implicit_stepper_needs_shifted_equations() -> None:
    with pytest.raises(ValueError, match="use an explicit one"):
        PeriodMap(duffing(), ESDIRK5)


@pytest.mark.parametrize("formulation", list(Formulation))
def test_implicit_columns_are_derivatives_of_the_map(formulation: Formulation) -> None:
    """Tangent, parameter, period and phase columns against differences of the map itself, whose error at
    eps = 1e-5 is 1e-9.
    """
    period_map = PeriodMap(implicit(duffing()), ESDIRK5, formulation, samples=6)
    parameters, period, steps, eps = np.array([1.1, 0.4]), 2.0 * math.pi / 1.1, 40, 1e-5
    state = period_map.extend(np.array([0.5, -0.2]))
    if period_map.extended:
        state[-2:] = [0.3, 0.9]
    orbit = period_map.evaluate(state, parameters, period, steps).orbit
    reference = period_map.phase_reference(orbit, parameters, period)
    parts = (Inhomogeneity(0), Inhomogeneity(1), Inhomogeneity(period_rate=1.0))
    columns = np.eye(period_map.size)
    image = period_map.evaluate(state, parameters, period, steps, columns, parts, reference)

    def difference(ds: np.ndarray, dp: np.ndarray, dt: float) -> tuple[np.ndarray, float]:
        ends = [
            period_map.evaluate(
                state + sign * eps * ds, parameters + sign * eps * dp, period + sign * eps * dt, steps,
                reference=reference,
            )
            for sign in (1.0, -1.0)
        ]  # fmt: skip
        return (ends[0].state - ends[1].state) / (2 * eps), (ends[0].phase - ends[1].phase) / (2 * eps)

    nothing = np.zeros(2)
    for j, column in enumerate(columns):
        expected, phase = difference(column, nothing, 0.0)
        np.testing.assert_allclose(image.columns[:, j], expected, atol=1e-8)
        np.testing.assert_allclose(image.phase_columns[j], phase, atol=1e-8)
    for j, (dp, dt) in enumerate([(np.array([1.0, 0.0]), 0.0), (np.array([0.0, 1.0]), 0.0), (nothing, 1.0)]):
        expected, phase = difference(np.zeros(period_map.size), dp, dt)
        np.testing.assert_allclose(image.inhomogeneous[:, j], expected, atol=1e-8)
        np.testing.assert_allclose(image.phase_inhomogeneous[j], phase, atol=1e-8)


def test_implicit_orbit_between_the_steps() -> None:
    """Samples that no step meets: cubic Hermite interpolation, of fourth order."""
    parameters, state, period = np.array([1.0, 0.4]), np.array([0.5, -0.2]), 2.0 * math.pi
    exact = PeriodMap(duffing(), samples=7).evaluate(state, parameters, period, 7 * 512).orbit
    errors = [
        np.abs(
            PeriodMap(implicit(duffing()), ESDIRK5, samples=7).evaluate(state, parameters, period, n).orbit
            - exact
        )
        for n in (40, 80)
    ]
    assert abs(math.log2(errors[0].max() / errors[1].max()) - 4.0) < 0.6


def test_orbit_alone_is_the_orbit_with_columns() -> None:
    """With columns the matrices of Newton's method are renewed more often; the solved stages are the same."""
    period_map = PeriodMap(implicit(duffing()), ESDIRK5, samples=4)
    parameters, state, period = np.array([1.0, 0.4]), np.array([0.5, -0.2]), 2.0 * math.pi
    alone = period_map.evaluate(state, parameters, period, 20).state
    together = period_map.evaluate(state, parameters, period, 20, np.eye(2)).state
    np.testing.assert_allclose(alone, together, rtol=0.0, atol=1e-12)
