"""Curves past the corners of a map that is only piecewise smooth, against their closed form."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipelines.bifurcations.continuation import Rejected
from pipelines.bifurcations.curve import CurveOptions, CurveState, CurveStop
from pipelines.bifurcations.curves import kinks
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.plane import CurveProblem
from tests.bifurcations.curve_runs import FLIP, NS, Run, map_problem, start, trace
from tests.bifurcations.grazing_film import NU, film_kinks, film_map, regularised_share, share
from tests.bifurcations.test_regularised import NowhereMap

SHARP = 3.0  # turns the curve by 124 degrees
WIDTHS = (0.005, 0.01, 0.02, 0.04)
OPTIONS = CurveOptions(((-2.5, 0.5), (-1.0, 3.0)), normal_form=None, max_points=200)
COARSE = replace(OPTIONS, minimum_step=1e-3)  # stays on the smoother maps for several points


def problem(slope: float, widths: tuple[float, ...] = WIDTHS) -> CurveProblem:
    exact = map_problem(film_map(slope), NS, (0.0, 0.0), ("p", "b"))
    return replace(exact, kinks=film_kinks(slope, widths) if widths else None)


@cache
def run_of(slope: float, widths: tuple[float, ...] = WIDTHS, options: CurveOptions = OPTIONS) -> Run:
    return trace(problem(slope, widths), start([-1.3, 0.0, 0.0], (-2.3, 0.0), NU), options)


def misses(run: Run, slope: float) -> np.ndarray:
    """b - k g(p + b) at every point."""
    p, b = run.parameters.T
    return b - 2.0 * math.pi * slope * share(p + b)


def test_the_regularised_share_tends_to_the_exact_one() -> None:
    """Linearly in the width at the corner, and exactly beyond the width on the flat side."""
    at_corner = [regularised_share(-2.0, width) for width in (0.04, 0.02)]
    assert at_corner[0] / at_corner[1] == pytest.approx(2.0, abs=0.01)
    assert regularised_share(-2.05, 0.04) == 0.0
    far = [abs(regularised_share(-1.0, width) - float(share(-1.0))) for width in (0.8, 0.4)]
    assert math.log2(far[0] / far[1]) == pytest.approx(4.0, abs=0.5)
    assert float(share(-1e-12)) == pytest.approx(0.5, abs=5e-4)


def test_without_regularised_maps_the_curve_ends_at_its_corner() -> None:
    run = run_of(SHARP, ())
    assert run.result.stop is CurveStop.MINIMUM_STEP
    assert run.parameters[-1] == pytest.approx([-2.0, 0.0], abs=1e-5)


def test_the_curve_passes_its_corner_and_lands_on_the_exact_curve() -> None:
    run = run_of(SHARP)
    assert run.result.stop is CurveStop.RANGE
    assert [point.clipping_width for point in run.points] == [state.clipping_width for state in run.states]
    exact = np.array([point.clipping_width for point in run.points]) == 0.0
    behind = run.parameters[:, 1] > 1e-3
    assert np.count_nonzero(exact & behind) > 10
    assert np.max(np.abs(misses(run, SHARP)[exact])) < 1e-11
    assert run.parameters[-1, 0] == -2.5
    assert all(point.width_effect == 0.0 for point in np.array(run.points)[exact])


def test_period_doublings_and_normal_forms() -> None:
    """z -> -(1 + ...) z (1 - z^2) has the coefficient 1, on the exact and on the smoother maps."""
    flips = map_problem(film_map(SHARP, flip=True), FLIP, (0.0, 0.0), ("p", "b"))
    flips = replace(flips, kinks=film_kinks(SHARP, WIDTHS, flip=True))
    options = replace(COARSE, normal_form=NormalFormOptions())
    run = trace(flips, start([-1.3, 0.0], (-2.3, 0.0)), options)
    assert run.result.stop is CurveStop.RANGE
    exact = np.array([point.clipping_width for point in run.points]) == 0.0
    assert 0 < np.count_nonzero(~exact) < 10
    assert np.max(np.abs(misses(run, SHARP)[exact])) < 1e-11
    forms = [point.normal_form for point in run.points]
    assert [form.coefficient.real for form in forms if form is not None] == pytest.approx(
        [1.0] * len(run.points), abs=1e-3
    )


def test_a_corner_that_a_step_can_pass_needs_no_width() -> None:
    run = run_of(0.3, WIDTHS, replace(OPTIONS, ranges=((-2.5, -1.0), (-1.0, 3.0))))
    assert run.result.stop is CurveStop.RANGE
    assert all(point.clipping_width == 0.0 for point in run.points)
    assert np.max(np.abs(misses(run, 0.3))) < 1e-11


def test_the_effect_of_the_width_is_measured() -> None:
    run = run_of(SHARP, WIDTHS, COARSE)
    assert run.result.stop is CurveStop.RANGE
    smooth = [point for point in run.points if point.clipping_width > 0.0]
    assert len(smooth) >= 3
    true = np.array([distance(point.parameters) for point in smooth])
    estimated = np.array([point.width_effect for point in smooth])
    assert true.max() > 1e-4
    assert estimated == pytest.approx(true, rel=0.15)
    exact = np.array([point.clipping_width for point in run.points]) == 0.0
    assert np.max(np.abs(misses(run, SHARP)[exact])) < 1e-11


def test_where_no_exact_point_is_found_the_effect_is_estimated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a factor of two where it is largest; elsewhere at most it is too large."""
    monkeypatch.setattr(kinks, "_exact_end", lambda *_: None)
    run = trace(problem(SHARP), start([-1.3, 0.0, 0.0], (-2.3, 0.0), NU), replace(COARSE, max_points=20))
    smooth = [point for point in run.points if point.clipping_width > 0.0]
    assert len(smooth) > 5
    true = np.array([distance(point.parameters) for point in smooth])
    estimated = np.array([point.width_effect for point in smooth])
    largest = int(np.argmax(true))
    assert true[largest] > 1e-4
    assert 0.5 * true[largest] <= estimated[largest] <= 2.0 * true[largest]
    assert np.all(estimated >= 0.5 * true - 1e-5)  # as sharp as `distance`


def distance(point: np.ndarray) -> float:
    """From the exact curve, both of whose parts are nearly straight beside the corner."""
    a = np.linspace(-2.0, -1.9, 20001)
    b = 2.0 * math.pi * SHARP * share(a)
    beyond = float(np.min(np.hypot(a - b - point[0], b - point[1])))
    return min(beyond, abs(float(point[1])))  # these points lie beside the part b = 0, or behind the corner


def test_restart_gives_the_same_bits() -> None:
    whole = run_of(SHARP, WIDTHS, COARSE)
    widths = [state.clipping_width for state in whole.states]
    for index in (widths.index(max(widths)) - 1, widths.index(max(widths))):
        state = CurveState.from_arrays(pickle.loads(pickle.dumps(whole.states[index].arrays())))
        rest = trace(problem(SHARP), state, COARSE)
        assert len(rest.points) == len(whole.points) - index - 1
        for old, new in zip(whole.states[index + 1 :], rest.states, strict=True):
            assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(
                old.arrays().values(), new.arrays().values(), strict=True
            ))  # fmt: skip


def test_a_bend_within_the_shortest_step_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the map of a width, which rounds the corner off over a part of the shortest step."""
    monkeypatch.setattr(kinks, "_exact_end", lambda *_: None)
    width, options = 0.005, replace(OPTIONS, minimum_step=5e-3)
    own, begin = problem(SHARP, (width,)), run_of(SHARP).states[0]
    smooth = kinks._state_with_width(own, begin, options, width, 0.0)
    assert smooth is not None
    run = trace(own, smooth, options)
    assert run.result.stop is CurveStop.RANGE
    p, b = run.parameters.T
    shares = np.array([regularised_share(a, width) for a in p + b])
    assert np.max(np.abs(b - 2.0 * math.pi * SHARP * shares)) < 1e-9
    assert np.linalg.norm(np.diff(run.parameters, axis=0), axis=1).min() < 0.1 * options.minimum_step


def test_smoother_maps_are_searched_once_from_a_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shorter step changes nothing in a search that failed."""
    searched: list[int] = []

    def none(problem: CurveProblem, state: CurveState, *_: Any) -> None:
        searched.append(state.index)

    monkeypatch.setattr(kinks, "_on_smoother_map", none)
    run = trace(problem(SHARP), start([-1.3, 0.0, 0.0], (-2.3, 0.0), NU), OPTIONS)
    assert run.result.stop is CurveStop.MINIMUM_STEP
    assert searched
    assert len(set(searched)) == len(searched)


def test_without_a_smooth_cycle_the_curve_ends_as_before() -> None:
    exact = film_map(SHARP)
    nowhere = NowhereMap(exact.system, samples=1, steps_per_period=1, function=exact.function)
    own = problem(SHARP)
    assert own.kinks is not None
    own = replace(own, kinks=replace(own.kinks, regularised=lambda width: nowhere))
    run = trace(own, start([-1.3, 0.0, 0.0], (-2.3, 0.0), NU), OPTIONS)
    assert run.result.stop is CurveStop.MINIMUM_STEP
    assert np.array_equal(run.parameters, run_of(SHARP, ()).parameters)


def test_more_time_steps_come_before_a_width() -> None:
    """Four times as many, but not more than 400."""
    own = problem(SHARP)
    own = replace(own, period_map=replace(own.period_map, steps_per_period=None))
    first = replace(run_of(SHARP).states[0], step=OPTIONS.minimum_step)
    passed: Any = SimpleNamespace(begin=first)
    asked = []

    def attempt(problem: CurveProblem, state: CurveState) -> Any:
        asked.append(state.steps)
        return Rejected("too short") if state.steps < 48 else passed

    def past(steps: int) -> Any:
        asked.clear()
        return kinks.attempt_past_kinks(
            own, replace(first, steps=steps), OPTIONS, attempt, lambda *_: first, set()
        )

    assert past(12) is passed
    assert asked == [12, 48]
    assert past(60) is passed
    assert asked == [60]
    assert past(11).message == "too short"
    assert asked[:2] == [11, 44]
    asked.clear()
    assert past(400) is passed
    assert asked == [400]
    most = [kinks._with_more_time_steps(own, replace(first, steps=steps), OPTIONS) for steps in (200, 400)]
    assert [state and state.steps for state in most] == [400, None]


def test_far_from_grazing_a_width_is_tried_when_no_step_is_left() -> None:
    own = problem(SHARP)
    assert own.kinks is not None
    own = replace(own, kinks=replace(own.kinks, distance=lambda *_: math.inf))
    begin, options = start([-1.3, 0.0, 0.0], (-2.3, 0.0), NU), replace(OPTIONS, minimum_step=1e-5)
    late, early = trace(own, begin, options), run_of(SHARP, WIDTHS, options)
    assert late.result.stop is early.result.stop is CurveStop.RANGE
    assert len(late.points) > len(early.points)


def test_widths_are_checked() -> None:
    for widths in ((0.02, 0.01), (0.0, 0.01), (0.01, 0.01)):
        with pytest.raises(ValueError, match="positive and increasing"):
            film_kinks(SHARP, widths)
    with pytest.raises(ValueError, match="no regularised maps"):
        problem(SHARP, ()).with_width(0.01)
