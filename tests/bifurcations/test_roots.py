"""Zeros are found to the width asked for, with few values, also of functions that are not smooth."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from pipelines.bifurcations.roots import Node, zero


def search(function: Callable[[float], float], slope: Callable[[float], float] | None, width: float):  # type: ignore[no-untyped-def]
    asked: list[float] = []

    def counted(place: float) -> float:
        asked.append(place)
        return function(place)

    ends = [Node(end, function(end), None if slope is None else slope(end)) for end in (0.0, 1.0)]
    return zero(counted, *ends, width), len(asked)


def test_a_cubic_with_known_slopes_needs_one_value() -> None:
    place, asked = search(lambda t: (t - 0.3) * (t * t + 1), lambda t: 3 * t * t - 0.6 * t + 1, 1e-12)
    assert place == pytest.approx(0.3, abs=1e-12)
    assert asked == 1


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_smooth_function_needs_few_values(scale: float) -> None:
    place, asked = search(lambda t: scale * (math.exp(t) - 1.7), lambda t: scale * math.exp(t), 1e-6)
    assert place == pytest.approx(math.log(1.7), abs=1e-6)
    assert asked <= 3
    place, asked = search(lambda t: scale * (math.exp(t) - 1.7), None, 1e-6)
    assert place == pytest.approx(math.log(1.7), abs=1e-6)
    assert asked <= 5


@pytest.mark.parametrize(
    "function",
    [
        lambda t: -1.0 if t < 0.37 else 0.2,
        lambda t: t - 0.37 if t < 0.37 else 1e3 * (t - 0.37),
        lambda t: math.copysign(abs(t - 0.37) ** 0.2, t - 0.37),
        lambda t: (t - 0.37) ** 9,
        lambda t: math.atan(1e4 * (t - 0.37)),
    ],
    ids=["jump", "kink", "root", "flat", "steep"],
)
def test_functions_that_no_polynomial_follows(function: Callable[[float], float]) -> None:
    place, asked = search(function, None, 1e-6)
    flat = 0.02 if abs(function(0.371)) < 1e-20 else 2e-6
    assert place == pytest.approx(0.37, abs=flat)
    assert asked < 60


def test_a_value_that_is_small_enough_ends_the_search() -> None:
    asked: list[float] = []

    def noisy(place: float) -> float:
        asked.append(place)
        return (place - 0.4) * (1.0 + 0.2 * place) + 1e-9 * math.sin(1e12 * place)

    place = zero(noisy, Node(0.0, -0.4), Node(1.0, 0.72), 1e-14, enough=1e-8)
    assert place == pytest.approx(0.4, abs=2e-8)
    assert len(asked) <= 4


@pytest.mark.parametrize(("values", "expected"), [((0.0, 1.0), 0.0), ((1.0, 0.0), 1.0)])
def test_an_end_that_is_zero_is_the_zero(values: tuple[float, float], expected: float) -> None:
    def never(place: float) -> float:
        raise AssertionError(place)

    assert zero(never, Node(0.0, values[0]), Node(1.0, values[1]), 1e-6) == expected
