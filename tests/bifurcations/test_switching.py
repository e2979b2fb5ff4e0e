"""Doubled cycles, curves from events, and points that are already on a curve."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.curve import CurveOptions, CurveStop
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.switching import curve_from_event, doubled_branch, doubled_map
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.time_steps import stable_steps
from tests.bifurcations.curve_runs import trace
from tests.bifurcations.explicit_maps import CLOCK, henon
from tests.systems import tondl

B = 0.3


def branch(
    problem: CycleProblem, begin: BranchStart, options: ContinuationOptions
) -> tuple[list[BranchPoint], list[Event]]:
    points: list[BranchPoint] = []
    events: list[Event] = []

    def record(point, state, found):  # type: ignore[no-untyped-def]
        points.append(point)
        events.extend(found)

    result = continue_branch(problem, begin, options, record)
    assert result.stop is BranchStop.RANGE
    return points, events


@pytest.fixture(scope="module")
def henon_flip() -> tuple[CycleProblem, Event]:
    problem = CycleProblem(henon(), np.array([0.1, B, CLOCK]), "a", ShootingOptions(tolerance=1e-12))
    x = (-(1 - B) + math.sqrt((1 - B) ** 2 + 0.4)) / 0.2
    _, events = branch(problem, BranchStart(np.array([x, B * x]), 0.1), ContinuationOptions((0.05, 0.6)))
    (event,) = events
    assert event.parameters[0] == pytest.approx(0.75 * (1 - B) ** 2, abs=1e-9)
    return problem, event


def test_period_doubling_cascade(henon_flip: tuple[CycleProblem, Event]) -> None:
    """2T, 4T and 8T: the flips of the Henon map at b = 0.3; the second is (1 - b)^2 + (1 + b)^2/4."""
    problem, event = henon_flip
    found = []
    for amplitude in (0.05, 0.02, 0.005):
        doubled = doubled_branch(problem, event, amplitude)
        assert doubled is not None
        assert doubled.direction == 1
        assert doubled.problem.period_map.period_multiple == 2 * problem.period_map.period_multiple
        options = ContinuationOptions((0.05, 1.06), maximum_step=0.02)
        points, events = branch(doubled.problem, doubled.start, options)
        assert points[0].unstable == 0
        problem, event = doubled.problem, events[0]
        assert event.kind is EventKind.PERIOD_DOUBLING
        found.append(event.parameters[0])
    assert found[0] == pytest.approx((1 - B) ** 2 + (1 + B) ** 2 / 4.0, abs=1e-9)
    # Henon's cascade; quotients tend to Feigenbaum's number
    assert found[1:] == pytest.approx([1.0258554, 1.0511257], abs=1e-6)


def test_curve_of_doubled_flips(henon_flip: tuple[CycleProblem, Event]) -> None:
    doubled = doubled_branch(*henon_flip, 0.05)
    assert doubled is not None
    _, events = branch(doubled.problem, doubled.start, ContinuationOptions((0.05, 1.0)))
    curves, begin = curve_from_event(doubled.problem, events[0], ("a", "b"))
    run = trace(curves, begin, CurveOptions(((0.0, 3.0), (-0.5, 0.6)), direction=-1, maximum_step=0.1))
    a, b = run.parameters.T
    assert np.max(np.abs(a - (1 - b) ** 2 - (1 + b) ** 2 / 4.0)) < 1e-8
    curve = KnownCurve.of(run.states)
    assert curve.holds(begin)
    middle = run.states[len(run.states) // 2]
    there = replace(begin, state=middle.state, parameters=tuple(middle.parameters))
    assert curve.holds(there)
    # between the recorded points it is on their cubic
    assert KnownCurve.of([state for state in run.states if state is not middle]).holds(there)
    beside = (there.parameters[0] + 0.01, there.parameters[1])
    assert not curve.holds(replace(there, parameters=beside))
    assert not curve.holds(replace(there, state=there.state + 0.5))
    tangent = middle.tangent_parameters
    assert curve.runs_along(there, tangent)
    assert curve.runs_along(there, -3.0 * tangent)
    assert not curve.runs_along(there, np.array([tangent[1], -tangent[0]]))


def test_curve_ends_where_another_was_traced(henon_flip: tuple[CycleProblem, Event]) -> None:
    doubled = doubled_branch(*henon_flip, 0.05)
    assert doubled is not None
    _, events = branch(doubled.problem, doubled.start, ContinuationOptions((0.05, 1.0)))
    curves, begin = curve_from_event(doubled.problem, events[0], ("a", "b"))
    options = CurveOptions(((0.0, 3.0), (-0.5, 0.6)), maximum_step=0.1)
    known = trace(curves, begin, options)
    recorded: list[int] = []
    result = continue_curve(
        curves,
        begin,
        options,
        lambda point, state, specials: recorded.append(state.index),
        traced={"pd/c000": KnownCurve.of(known.states)},
    )
    assert (result.stop, result.message) == (CurveStop.TRACED, "it runs along pd/c000")
    assert recorded == [0]


@pytest.mark.parametrize("formulation", list(Formulation))
def test_doubled_cycles_of_a_flow(formulation: Formulation) -> None:
    """The doubled cycles grow like the square root of the distance."""
    period_map = PeriodMap(tondl(), DOPRI8, formulation)
    problem = CycleProblem(period_map, np.array([0.0, 2.4]), "c1", ShootingOptions(tolerance=1e-11))
    state = period_map.extend(np.array([0.323, 0.0477, 0.062, -0.1016]))
    begin = BranchStart(state, 0.06, 2 * math.pi / 2.4)
    _, events = branch(problem, begin, ContinuationOptions((0.06, 0.08)))
    distances = []
    for amplitude in (0.02, 0.04):
        doubled = doubled_branch(problem, events[0], amplitude)
        assert doubled is not None
        distances.append(doubled.start.parameter - events[0].parameters[0])
        period = doubled.start.period
        assert period == pytest.approx(4.0 * math.pi / 2.4, abs=1e-9)
    assert distances[1] / distances[0] == pytest.approx(4.0, rel=0.02)


def test_what_cannot_be_switched(henon_flip: tuple[CycleProblem, Event]) -> None:
    problem, event = henon_flip
    with pytest.raises(ValueError, match="period doubling"):
        doubled_branch(problem, replace(event, kind=EventKind.FOLD), 0.1)
    with pytest.raises(ValueError, match="amplitude"):
        doubled_branch(problem, event, 0.0)
    hasty = replace(problem, options=replace(problem.options, iterations=1))
    assert doubled_branch(hasty, event, 0.5) is None
    with pytest.raises(ValueError, match="branch points"):
        curve_from_event(problem, replace(event, kind=EventKind.BRANCH_POINT), ("a", "b"))


def test_doubled_map_keeps_the_time_step() -> None:
    single = PeriodMap(tondl(), DOPRI8, steps_per_period=64)
    twice = doubled_map(single)
    assert (twice.period_multiple, twice.samples, twice.steps_per_period) == (2, 128, 128)
    assert stable_steps(doubled_map(replace(single, steps_per_period=None)), 0.0, 1.0) == 256
