"""Period doublings around a tongue that other time steps move by a part of its width, in closed form.

The map z -> M z with det M = 1 + q and tr M = -(1 + det M) + F has the multiplier -1 where

    F = p^2 + (q/L)^2 - W^2 = 0,

on an ellipse with R2 at both of its ends, p = -W and p = W.  With n time steps it lies at p - c (16/n)^5: c is
far below what their error may change in the multipliers, which lie up to 2 W apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveStop, around_tongue
from pipelines.bifurcations.curves.kinks import short_step
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

    def evaluate(self, state, parameters, period, steps, *rest: Any, **more: Any) -> PeriodImage:  # type: ignore[no-untyped-def, override]
        moved = parameters - MOVED * (16.0 / steps) ** 5 * np.eye(len(parameters))[0]
        image = super().evaluate(state, moved, period, steps, *rest, **more)
        return replace(image, start=image.start._replace(parameters=parameters))


def tongue() -> CurveProblem:
    def function(s, p):  # type: ignore[no-untyped-def]
        determinant = 1.0 + p[1]
        trace = p[0] ** 2 + (p[1] / LENGTH) ** 2 - HALF_WIDTH**2 - 1.0 - determinant
        return s[1], trace * s[1] - determinant * s[0]

    own = map_problem(explicit_map(2, ("p", "q"), function), FLIP, (0.0, 0.0), ("p", "q"))
    unused = own.period_map.system
    system = replace(unused, compiled=True, shifted=unused.tangent)  # as an implicit stepper asks for
    moved = MovedMap(system, samples=1, stepper=ESDIRK5, function=function)
    return replace(own, period_map=moved, options=replace(own.options, step_tolerance=3e-4))


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


def test_with_fewer_time_steps_no_short_step_leads_on() -> None:
    options = replace(around_tongue(OPTIONS, 2.0 * HALF_WIDTH), fewer_time_steps=True)
    run = trace(tongue(), start([0.0, 0.0], (-HALF_WIDTH, 0.0)), options)
    assert run.result.stop is CurveStop.MINIMUM_STEP
    assert len(run.points) == 1


def test_what_is_a_short_step_follows_the_width_of_the_tongue() -> None:
    """A tenth of it is none: a smoother map would move the tongue by more than that."""
    width = 1e-4
    assert short_step(OPTIONS) > width
    assert short_step(around_tongue(OPTIONS, width)) < 0.01 * width
    assert short_step(around_tongue(OPTIONS, 1.0)) == short_step(OPTIONS)
