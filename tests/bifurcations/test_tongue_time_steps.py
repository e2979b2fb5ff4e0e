"""Period doublings around a tongue that other time steps move by a part of its width, in closed form.

The map z -> M z with det M = 1 + q and tr M = -(1 + det M) + F has the multiplier -1 where

    F = p^2 + (q/L)^2 - W^2 = 0,

on an ellipse with R2 at both of its ends, p = -W and p = W.  With n time steps it lies at p - c (16/n)^5:
c is far below what their error may change in the multipliers, which lie up to 2 W apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveStop, around_tongue
from pipelines.bifurcations.curves.kinks import _with_more_time_steps, short_step
from pipelines.bifurcations.plane import CurveProblem
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.steppers import ESDIRK5
from tests.bifurcations.curve_runs import FLIP, map_problem, start, trace
from tests.bifurcations.explicit_maps import ExplicitMap, explicit_map

HALF_WIDTH, LENGTH, MOVED = 5e-5, 10.0, 1e-5
RANGES = ((-1.0, 1.0), (-1.0, 1.0))
OPTIONS = CurveOptions(RANGES, minimum_step=5e-4, normal_form=None)


@dataclass(frozen=True)
class MovedMap(ExplicitMap):
    """A map of which n time steps move the first parameter by c (16/n)^5."""

    moved: float = MOVED

    def evaluate(self, state, parameters, period, steps, *rest: Any, **more: Any) -> PeriodImage:  # type: ignore[no-untyped-def, override]
        moved = parameters - self.moved * (16.0 / steps) ** 5 * np.eye(len(parameters))[0]
        image = super().evaluate(state, moved, period, steps, *rest, **more)
        return replace(image, start=image.start._replace(parameters=parameters))


def tongue(moved: float = MOVED) -> CurveProblem:
    def function(s, p):  # type: ignore[no-untyped-def]
        determinant = 1.0 + p[1]
        trace = p[0] ** 2 + (p[1] / LENGTH) ** 2 - HALF_WIDTH**2 - 1.0 - determinant
        return s[1], trace * s[1] - determinant * s[0]

    own = map_problem(explicit_map(2, ("p", "q"), function), FLIP, (0.0, 0.0), ("p", "q"))
    unused = own.period_map.system
    system = replace(unused, compiled=True, shifted=unused.tangent)  # as an implicit stepper asks for
    period_map = MovedMap(system, samples=1, stepper=ESDIRK5, function=function, moved=moved)
    return replace(own, period_map=period_map, options=replace(own.options, step_tolerance=3e-4))


@pytest.mark.parametrize("direction", [1, -1])
def test_a_narrow_tongue_keeps_its_time_steps_and_closes(direction: int) -> None:
    options = replace(around_tongue(OPTIONS, 2.0 * HALF_WIDTH), direction=direction)
    run = trace(tongue(), start([0.0, 0.0], (-HALF_WIDTH, 0.0)), options)
    assert run.result.stop is CurveStop.CLOSED
    (steps,) = {state.steps for state in run.states}
    p, q = run.parameters.T
    across = (p - MOVED * (16.0 / steps) ** 5) / HALF_WIDTH
    error = 2.0 * tongue().options.multiplier_tolerance / HALF_WIDTH**2  # of F
    np.testing.assert_allclose(across**2 + (q / LENGTH / HALF_WIDTH) ** 2, 1.0, rtol=0, atol=error)


def test_with_fewer_time_steps_the_curve_does_not_close() -> None:
    options = replace(around_tongue(OPTIONS, 2.0 * HALF_WIDTH), fewer_time_steps=True, max_points=100)
    run = trace(tongue(), start([0.0, 0.0], (-HALF_WIDTH, 0.0)), options)
    assert run.result.stop is not CurveStop.CLOSED


def test_more_time_steps_begin_on_their_own_curve() -> None:
    """Four times as many, beside a kink: with 32 the curve lies beside it by 6 % of half the width."""
    moved, options = 1e-4, around_tongue(OPTIONS, 2.0 * HALF_WIDTH)
    run = trace(tongue(moved), start([0.0, 0.0], (-HALF_WIDTH, 0.0)), replace(options, max_points=6))
    finer = _with_more_time_steps(tongue(moved), run.states[-1], options)
    assert finer is not None
    assert (run.states[-1].steps, finer.steps) == (32, 128)
    before, after = (
        abs(p**2 + (q / LENGTH) ** 2 - HALF_WIDTH**2) / HALF_WIDTH**2
        for p, q in (run.states[-1].parameters, finer.parameters)
    )
    assert after < 0.01 < 0.03 < before


def test_what_is_a_short_step_follows_the_width_of_the_tongue() -> None:
    """A tenth of it is none: a smoother map would move the tongue by more than that."""
    width = 1e-4
    assert short_step(OPTIONS) > width
    assert short_step(around_tongue(OPTIONS, width)) < 0.01 * width
    assert short_step(around_tongue(OPTIONS, 1.0)) == short_step(OPTIONS)
