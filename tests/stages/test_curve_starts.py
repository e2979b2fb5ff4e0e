"""Bifurcations of multiplied cycles, which are compared with stored curves at each excitation period."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveStart
from pipelines.bifurcations.plane import CurveProblem
from pipelines.bifurcations.switching import with_multiplied_period
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.steppers import RK4
from pipelines.stages.curves.starts import _samplings
from tests.bifurcations.curve_runs import NS
from tests.systems import tondl

STATE, PARAMETERS = np.array([0.3, 0.1, -0.2, 0.15]), np.array([0.03, 1.45])


@pytest.mark.parametrize("steps", [None, 100, 128])
def test_multiplied_cycles_are_sampled_whatever_the_number_of_steps(steps: int | None) -> None:
    simple = PeriodMap(tondl(), RK4, steps_per_period=steps)
    double = with_multiplied_period(CycleProblem(simple, PARAMETERS, "eta"), 2).period_map
    problem = CurveProblem(double, NS, PARAMETERS, ("c1", "eta"))
    guess = CurveStart(STATE, (0.03, 1.45), double.period(PARAMETERS))
    first, second = _samplings(SimpleNamespace(guess=guess, turns=2, problem=problem))  # type: ignore[arg-type]
    assert first is guess
    after = simple.evaluate(STATE, PARAMETERS, simple.period(PARAMETERS), 512).state
    np.testing.assert_allclose(second.state, after, rtol=0.0, atol=1e-7)
