"""Branches of cycles that cross: from a branch point to the other branch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations import location
from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.switching import crossing_branch, doubled_branch
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.autonomous_flows import crossing_cycles, forced_pitchfork, lorenz, roessler
from tests.bifurcations.explicit_maps import CLOCK, explicit_map

SHIFT = 0.4


def branch(
    problem: CycleProblem, begin: BranchStart, options: ContinuationOptions
) -> tuple[list[BranchPoint], list[Event]]:
    points: list[BranchPoint] = []
    events: list[Event] = []

    def record(point, state, found):  # type: ignore[no-untyped-def]
        points.append(point)
        events.extend(found)

    assert continue_branch(problem, begin, options, record).stop is BranchStop.RANGE
    return points, events


def unknown_period(power: int, within: float = 1e-8) -> tuple[CycleProblem, Event]:
    """The branch u = 0 and the point where the other one crosses it."""
    period_map = PeriodMap(crossing_cycles(power), DOPRI8, Formulation.AUTONOMOUS, samples=32)
    problem = CycleProblem(replace(period_map, minimum_steps=64), np.array([0.0, SHIFT]), "lambda")
    begin = BranchStart(np.array([1.0, 0.0, 0.0]), -0.21, 2 * math.pi)
    _, events = branch(problem, begin, ContinuationOptions((-0.21, 0.1), maximum_step=0.1))
    (event,) = events
    assert event.kind is EventKind.BRANCH_POINT
    assert abs(event.parameters[0]) < within
    return problem, event


@pytest.fixture(scope="module")
def pitchfork() -> tuple[CycleProblem, Event]:
    return unknown_period(2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_pitchfork(pitchfork: tuple[CycleProblem, Event], side: float) -> None:
    """u^2 = lambda and T = 2 pi/(1 + c u), from the branch point to the end of the range."""
    problem, event = pitchfork
    new = crossing_branch(problem, event, side * 0.1)
    assert new is not None
    assert new.direction == 1
    assert new.start.state[2] == pytest.approx(side * 0.1, rel=0.02)
    points, events = branch(new.problem, new.start, ContinuationOptions((-0.1, 0.2), maximum_step=0.1))
    assert events == []
    for point in points:
        at = point.cycle.unknowns
        assert at.state[2] == pytest.approx(side * math.sqrt(at.parameter), abs=1e-8)
        assert at.period == pytest.approx(2 * math.pi / (1 + SHIFT * at.state[2]), abs=1e-8)


@pytest.mark.slow
# with a scale ten times smaller steps are so short that two lengths of them are enough
@pytest.mark.parametrize(
    ("scale", "longest"),
    [
        *((scale, longest) for scale in (1.0, 100.0) for longest in (0.2, 0.1, 0.05, 0.025)),
        (0.1, 0.2),
        (0.1, 0.1),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_branch_passes_the_pitchfork_that_it_was_born_at(
    pitchfork: tuple[CycleProblem, Event], side: float, scale: float, longest: float
) -> None:
    """Down one half of u^2 = lambda and up the other: one branch point, no fold."""
    problem, _ = pitchfork
    first = side * 0.4
    begin = BranchStart(np.array([1.0, 0.0, first]), 0.16, 2 * math.pi / (1 + SHIFT * first))
    options = ContinuationOptions((-0.1, 0.17), direction=-1, maximum_step=longest, parameter_scale=scale)
    points, events = branch(problem, begin, options)
    assert [event.kind for event in events] == [EventKind.BRANCH_POINT]
    assert events[0].parameters[0] == pytest.approx(0.0, abs=1e-8)
    assert points[-1].cycle.unknowns.state[2] == pytest.approx(-side * math.sqrt(0.17), abs=1e-8)
    assert not any(point.unexplained for point in points)


@pytest.mark.parametrize("side", [1, -1])
def test_transcritical_point(side: int) -> None:
    """u = lambda on both sides."""
    problem, event = unknown_period(1)
    new = crossing_branch(problem, event, side * 0.05)
    assert new is not None
    assert new.direction == side
    options = ContinuationOptions((-0.2, 0.2), direction=new.direction, maximum_step=0.1)
    points, _ = branch(new.problem, new.start, options)
    assert points[-1].cycle.unknowns.parameter == pytest.approx(side * 0.2)
    for point in points:
        at = point.cycle.unknowns
        assert at.state[2] == pytest.approx(at.parameter, abs=1e-8)
        assert at.period == pytest.approx(2 * math.pi / (1 + SHIFT * at.parameter), abs=1e-8)


@pytest.mark.parametrize("formulation", list(Formulation))
def test_pitchfork_of_forced_cycles(formulation: Formulation) -> None:
    period_map = PeriodMap(forced_pitchfork(), DOPRI8, formulation, samples=32, minimum_steps=64)
    problem = CycleProblem(period_map, np.array([1.5, 0.0]), "lambda")
    at_rest = np.array([0.0, 1.0 / (1.0 + 1.5**2)])
    begin = BranchStart(period_map.extend(at_rest), -0.1, 2 * math.pi / 1.5)
    _, (event,) = branch(problem, begin, ContinuationOptions((-0.1, 0.1), maximum_step=0.05))
    new = crossing_branch(problem, event, 0.1)
    assert new is not None
    # y answers with the same displacement, so that both entries are the largest
    assert abs(new.start.state[0]) == pytest.approx(0.1, rel=0.02)
    assert new.start.state[0] ** 2 == pytest.approx(new.start.parameter, abs=1e-9)
    assert new.start.period == pytest.approx(2 * math.pi / 1.5)


def test_symmetry_breaking_and_period_doubling_of_lorenz() -> None:
    """The symmetric cycle of large rho loses its symmetry at 312.97353, what is born there doubles its period
    at 229.40671.
    """
    period_map = PeriodMap(lorenz(), DOPRI8, Formulation.AUTONOMOUS)
    problem = CycleProblem(period_map, np.array([330.0]), "rho", ShootingOptions(1e-9))
    begin = BranchStart(np.array([0.0, 39.3475133, 279.259268]), 330.0, 0.400256257)
    down = ContinuationOptions((220.0, 340.0), direction=-1, maximum_step=4.0)
    _, events = branch(problem, begin, down)
    event = events[0]
    assert event.kind is EventKind.BRANCH_POINT
    assert event.parameters[0] == pytest.approx(312.97353, abs=1e-5)
    found = []
    for amplitude in (1.0, -1.0):
        new = crossing_branch(problem, event, amplitude)
        assert new is not None
        assert new.direction == -1
        points, events = branch(new.problem, new.start, down)
        assert points[0].unstable == 0
        (doubling,) = events
        assert doubling.kind is EventKind.PERIOD_DOUBLING
        assert doubling.parameters[0] == pytest.approx(229.40671, abs=1e-5)
        found.append(np.sort(np.abs(np.ptp(points[-1].cycle.image.orbit, axis=0))))
    # one is the mirror image of the other
    assert np.allclose(*found, rtol=1e-3)


def test_cascade_of_roessler() -> None:
    """a = b = 0.2: the cycle doubles its period at c = 2.8324450, 3.8373582, 4.1242147 and 4.1869970."""
    problem = CycleProblem(
        PeriodMap(roessler(), DOPRI8, Formulation.AUTONOMOUS), np.array([0.2, 0.2, 2.5]), "c"
    )
    begin = BranchStart(np.array([3.5, -2.5, 0.1]), 2.5, 5.75)
    found = []
    for amplitude in (0.1, 0.03, 0.01, None):
        options = ContinuationOptions((2.4, 4.3), maximum_step=0.3)
        _, events = branch(problem, begin, options)
        event = events[0]
        assert event.kind is EventKind.PERIOD_DOUBLING
        found.append(event.parameters[2])
        if amplitude is not None:
            doubled = doubled_branch(problem, event, amplitude)
            assert doubled is not None
            assert doubled.direction == 1
            problem, begin = doubled.problem, doubled.start
    assert found == pytest.approx([2.8324450, 3.8373582, 4.1242147, 4.1869970], abs=1e-7)


def test_what_cannot_be_switched(pitchfork: tuple[CycleProblem, Event]) -> None:
    problem, event = pitchfork
    with pytest.raises(ValueError, match="branch point"):
        crossing_branch(problem, replace(event, kind=EventKind.FOLD), 0.1)
    with pytest.raises(ValueError, match="amplitude"):
        crossing_branch(problem, event, 0.0)
    with pytest.raises(ValueError, match="direction"):
        crossing_branch(problem, replace(event, direction=None), 0.1)
    hasty = replace(problem, options=replace(problem.options, iterations=1))
    assert crossing_branch(hasty, event, 0.5) is None


@pytest.mark.parametrize("width", [0.1, 0.03, 0.01])
@pytest.mark.parametrize("scale", [0.1, 1.0])
def test_where_a_small_branch_was_born(width: float, scale: float) -> None:
    """x^2 + l^2 = width^2 closes round two pitchforks of x = 0, of multiplier 1 + width^2 - l^2."""
    bubble = explicit_map(
        2, ("l",), lambda s, p: ((1.0 + width**2 - p[0] ** 2) * s[0] - s[0] ** 3, 0.3 * s[1] + 0.5 * s[0])
    )
    problem = CycleProblem(bubble, np.array([0.0, CLOCK]), "l", ShootingOptions(1e-12))
    begin = BranchStart(np.array([0.6, 0.43]) * width, -0.8 * width)
    events: list[Event] = []
    options = ContinuationOptions((-0.5, 0.5), step=0.01, parameter_scale=scale)
    result = continue_branch(problem, begin, options, lambda point, state, found: events.extend(found))
    assert result.stop is BranchStop.CLOSED
    assert [event.kind for event in events] == [EventKind.BRANCH_POINT] * 2
    # to 1e-8 in the multiplier, whose slope is 2 width
    places = sorted(event.parameters[0] for event in events)
    assert places == pytest.approx([-width, width], rel=0, abs=0.5e-8 / width)


@pytest.mark.parametrize("power", [1, 2])
def test_a_branch_point_between_cycles_beside_it(power: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the branch point itself the corrector may fail: there it has no unique solution."""

    def fails(*arguments: object) -> float:
        raise location._NotConvergedError

    monkeypatch.setattr(location, "_root", fails)
    problem, event = unknown_period(power, within=1e-6)  # of the corrector's error over mu - 1
    assert event.residual < 1e-6
    assert event.state == pytest.approx([1.0, 0.0, 0.0], abs=1e-7)
    assert event.period == pytest.approx(2.0 * math.pi, abs=1e-7)
    new = crossing_branch(problem, event, 0.1)
    assert new is not None
    assert new.start.state[2] == pytest.approx(0.1, rel=0.02)
