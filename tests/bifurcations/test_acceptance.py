"""A continuation never changes curve silently, and closes at every scale of its curve."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.acceptance import BENDS, LEAVES, StepRule, refusal
from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.curve import CurveOptions, CurveStart, CurveStop, SpecialKind
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.plane import CurveProblem, PlaneMetric, Position
from pipelines.bifurcations.switching import doubled_branch
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.vectors import Metric
from tests.bifurcations.curve_runs import FLIP, NS, trace
from tests.bifurcations.explicit_maps import CLOCK, explicit_map
from tests.systems import tondl

PLANE = ((-0.1, 0.25), (0.4, 4.6))
FLAT: PlaneMetric = Metric(0.0, np.ones(2))


def vector(x: float, y: float) -> Position:
    return Position(np.zeros(1), 0.0, np.array([x, y]))


def verdict(start_slope: float, chord: Position, end_slope: float, missed: float | None) -> str | None:
    ends = [vector(math.cos(slope), math.sin(slope)) for slope in (start_slope, end_slope)]
    return refusal(FLAT, ends[0], chord, ends[1], StepRule(0.8), lambda place: missed)


def test_arcs_are_accepted_and_steps_beside_the_curve_are_not() -> None:
    angle = 0.6
    arc = vector(math.sin(angle), 1.0 - math.cos(angle))
    assert verdict(0.0, arc, angle, None) is None, "no doubt, the middle is not asked for"
    assert verdict(0.0, arc, 0.7, None) == BENDS
    # from a line to a parallel one, 0.2 of the step away: what is between them is on neither
    beside = vector(1.0, 0.2)
    assert verdict(0.0, beside, 0.0, 0.05) == LEAVES
    assert verdict(0.0, beside, 0.0, None) == LEAVES
    assert verdict(0.0, beside, 0.0, 0.005) is None
    assert verdict(0.0, vector(1.0, 0.3), 0.0, 0.0) == LEAVES, "too far"


def curves(kind: EventKind) -> CurveProblem:
    options = ShootingOptions(1e-12, multiplier_tolerance=1e-10)
    return CurveProblem(PeriodMap(tondl(), DOPRI8), kind, np.zeros(2), ("c1", "eta"), options)


@pytest.mark.parametrize("longest", [0.2, 0.1, 0.05, 0.025])
@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_a_curve_beside_another_one(longest: float, scale: float) -> None:
    """With 0.05 a step once ended on another curve of Neimark-Sacker points, near (0.034, 0.59)."""
    state = np.array([0.34346801560218, 0.062681841346444, -0.049314392742447, 0.013628640273622])
    begin = CurveStart(state, (0.056083355519157, 0.72), angle=1.9054859747399)
    scales = (0.05 * scale, 0.5 * scale)
    options = CurveOptions(PLANE, maximum_step=longest, parameter_scales=scales, normal_form=None)
    run = trace(curves(NS), begin, options)
    assert run.result.stop is CurveStop.RESONANCE_1
    assert [special.kind for special in run.specials] == [SpecialKind.R4, SpecialKind.R1]
    assert np.allclose(run.points[-1].parameters, [0.06632612, 0.61223359], rtol=0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("scales", [(0.05, 0.5), (1.0, 1.0), (1e-4, 1e-3)])
def test_an_oval_closes_at_every_scale(scales: tuple[float, float], direction: int) -> None:
    """Period doublings on 4e-5 x 7e-6 from one R2 point through another: each side has a generalised flip."""
    begin = CurveStart(
        np.array([0.31955974, 0.05368591, -0.02798818, 0.00473829]), (0.020404344298, 0.486025635914)
    )
    run = trace(curves(FLIP), begin, CurveOptions(PLANE, direction=direction, parameter_scales=scales))
    assert run.result.stop is CurveStop.CLOSED
    flip, double = SpecialKind.GENERALISED_FLIP, SpecialKind.R2
    assert [special.kind for special in run.specials] == [flip, double, flip, double]
    assert np.allclose(np.ptp(run.parameters, axis=0), [3.65e-5, 6.6e-6], rtol=0.03)


@pytest.fixture(scope="module")
def simple_cycles() -> tuple[CycleProblem, list[Event]]:
    problem = CycleProblem(PeriodMap(tondl(), DOPRI8), np.array([0.0, 2.45]), "c1", ShootingOptions(1e-11))
    events: list[Event] = []
    options = ContinuationOptions((-0.1, 0.25), maximum_step=0.1, parameter_scale=0.1)
    begin = BranchStart(np.array([0.33, 0.05, 0.0, 0.0]), -0.1)
    continue_branch(problem, begin, options, lambda point, state, found: events.extend(found))
    return problem, events


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(("longest", "amplitude"), [(0.1, 0.02), (0.05, 0.02), (0.1, 0.05)])
def test_a_doubled_branch_passes_its_own_period_doublings(
    simple_cycles: tuple[CycleProblem, list[Event]], which: int, longest: float, amplitude: float
) -> None:
    """It goes through both into its mirror image, and closes."""
    problem, doublings = simple_cycles
    double = doubled_branch(problem, doublings[which], amplitude)
    assert double is not None
    points: list[BranchPoint] = []
    events: list[Event] = []

    def record(point, state, found):  # type: ignore[no-untyped-def]
        points.append(point)
        events.extend(found)

    options = ContinuationOptions((-0.45, 0.35), maximum_step=longest, parameter_scale=0.1, max_points=2000)
    options = replace(options, direction=double.direction)
    result = continue_branch(double.problem, double.start, options, record)
    assert result.stop is BranchStop.CLOSED
    assert not any(point.unexplained or point.unlocated for point in points)
    own, fold = EventKind.OWN_PERIOD_DOUBLING, EventKind.FOLD
    assert [event.kind for event in events] == [fold, own, fold, own]
    there, back = (float(doublings[index].parameters[0]) for index in (1 - which, which))
    expected = [0.2799662, there, 0.2799662, back]
    assert np.allclose([event.parameters[0] for event in events], expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("first", [-0.05, -0.0504, -0.0508, -0.0512, -0.0516, -0.052])
@pytest.mark.parametrize("longest", [0.2, 0.1])
def test_a_step_does_not_leave_along_a_branch_that_crosses(longest: float, first: float) -> None:
    """x -> x + (l x + x^3)/2: in this scale a step from x^2 = -l to x = 0, l > 0 is nearly straight, and both
    have one multiplier above 1.  The branch goes through x = 0 to the mirror image of its start.
    """
    explicit = explicit_map(
        2, ("l",), lambda s, p: (s[0] + 0.5 * (p[0] * s[0] + s[0] ** 3), 0.3 * s[1] + 0.5 * s[0])
    )
    problem = CycleProblem(explicit, np.array([first, CLOCK]), "l", ShootingOptions(1e-12))
    x = math.sqrt(-first)
    points: list[BranchPoint] = []
    events: list[Event] = []

    def record(point, state, found):  # type: ignore[no-untyped-def]
        points.append(point)
        events.extend(found)

    options = ContinuationOptions((-0.06, 0.05), maximum_step=longest, parameter_scale=0.01)
    begin = BranchStart(np.array([x, x / 1.4]), first)
    assert continue_branch(problem, begin, options, record).stop is BranchStop.RANGE
    assert [event.kind for event in events] == [EventKind.BRANCH_POINT]
    assert abs(events[0].parameters[0]) < 1e-8
    assert points[-1].cycle.unknowns.state[0] == pytest.approx(-math.sqrt(0.06), abs=1e-8)
    assert not any(point.unexplained for point in points)
