"""Bifurcation points with one of two parameters held, on maps and flows whose bifurcations are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveStart
from pipelines.bifurcations.curves.fixed_parameter import (
    FixedParameterPoint,
    NotLocated,
    locate_at_fixed_parameter,
)
from pipelines.bifurcations.plane import CurveProblem, metric_of
from tests.bifurcations.curve_runs import FLIP, FOLD, NS, map_problem, start
from tests.bifurcations.explicit_maps import cusp_map, henon, rotation_map
from tests.bifurcations.test_curves import polar_problem


def pinned(
    problem: CurveProblem, begin: CurveStart, held: int, steps: int | None = None
) -> FixedParameterPoint:
    found = locate_at_fixed_parameter(problem, begin, held, metric_of(problem, (1.0, 1.0)), steps)
    assert isinstance(found, FixedParameterPoint), found
    assert found.parameters[held] == pytest.approx(begin.parameters[held], abs=1e-11)
    return found


@pytest.mark.parametrize("held", [0, 1])
def test_a_fold_is_found_where_its_line_is_vertical(held: int) -> None:
    """(m/2)^2 = (n/3)^3: on neither line is there a cycle on both sides of the point."""
    half = math.sqrt(0.1)
    exact = (-2.0 * half**3, 0.3)
    begin = start([1.1 * half, 1.3 * half], tuple(np.array(exact) + 0.02 * np.eye(2)[1 - held]))
    m, n = pinned(map_problem(cusp_map(), FOLD, (0, 0), ("m", "n")), begin, held).parameters
    assert (m, n) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("held", [0, 1])
def test_a_period_doubling(held: int) -> None:
    """The flip of the Henon map, a = 3/4 (1 - b)^2; nothing is left of the guess but the parameter held."""
    a, b = 0.75 * 0.7**2, 0.3
    x = (-(1 - b) + math.sqrt((1 - b) ** 2 + 4 * a)) / (2 * a)
    guess = (a, b - 0.03) if held == 0 else (a + 0.05, b)
    begin = start([x + 0.05, b * x - 0.02], guess)
    found = pinned(map_problem(henon(), FLIP, (0, 0), ("a", "b")), begin, held)
    assert found.parameters == pytest.approx((a, b), abs=1e-9)
    assert found.angle == pytest.approx(math.pi, abs=1e-12)


def test_a_pair_is_chosen_by_its_angle() -> None:
    """Modulus 1 + m: critical at m = 0 whatever the angle theta that is held."""
    problem = map_problem(rotation_map(), NS, (0, 1.2, 0.5, 0, 0.8), ("theta", "m"))
    found = pinned(problem, start(np.zeros(3), (1.3, -0.05), 1.3), 0)
    assert found.parameters[1] == pytest.approx(0.0, abs=1e-9)
    assert found.angle == pytest.approx(1.3, abs=1e-9)


@pytest.mark.parametrize("steps", [None, 96])
def test_cycles_of_unknown_period(steps: int | None) -> None:
    """Folds at n = 3 e^2, m = -2 e^3; Neimark-Sacker points at delta = 0 with the angle omega T."""
    e = 0.3
    exact = (-2 * e**3, 3 * e * e)
    begin = start([math.sqrt(1 + e) + 0.01, 0, 0, 0], (exact[0], exact[1] + 0.01), period=2 * math.pi / 1.1)
    fold = pinned(polar_problem(FOLD, ("m", "n"), (0, 0, -0.2, 0.35, 0.4)), begin, 0, steps)
    assert fold.parameters == pytest.approx(exact, abs=1e-8)
    assert fold.period == pytest.approx(2 * math.pi / (1 + 0.4 * e), abs=1e-6)
    assert steps in (None, fold.steps)
    e, n = -0.1, -0.5
    period = 2 * math.pi / (1 + 0.4 * e)
    problem = polar_problem(NS, ("n", "delta"), (e**3 - n * e, n, 0, 0.35, 0.4))
    begin = start([math.sqrt(1 + e), 0, 0, 0], (n, -0.01), 0.35 * period, period)
    point = pinned(problem, begin, 0, steps)
    assert point.parameters[1] == pytest.approx(0.0, abs=1e-8)
    assert point.angle == pytest.approx(0.35 * period, abs=1e-6)


def test_what_is_not_there_is_a_result() -> None:
    """The Henon map with b > 0 has real multipliers only, and no fixed point at all for large negative a."""
    metric = metric_of(map_problem(henon(), NS, (0, 0), ("a", "b")), (1.0, 1.0))
    pair = map_problem(henon(), NS, (0, 0), ("a", "b"))
    assert isinstance(locate_at_fixed_parameter(pair, start([0.6, 0.2], (0.3, 0.3)), 0, metric), NotLocated)
    flip = map_problem(henon(), FLIP, (0, 0), ("a", "b"))
    nowhere = locate_at_fixed_parameter(flip, start([0.6, 0.2], (-5.0, 0.3)), 0, metric)
    assert isinstance(nowhere, NotLocated)
    assert "start closer" in nowhere.advice
