"""Bifurcations of tori: their places against closed forms, and their names."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.events import UNDECIDED, TorusEventKind
from pipelines.bifurcations.tori.fourier import angles
from pipelines.bifurcations.tori.invariant_curve import Torus
from pipelines.bifurcations.tori.problem import FourierOptions, TorusProblem, TorusUnknowns
from pipelines.bifurcations.tori.segment import TorusSegment
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.torus import TorusOptions, TorusStart, TorusStop
from pipelines.orbits.shooting import ShootingOptions
from tests.bifurcations.explicit_maps import CLOCK
from tests.bifurcations.quasi_periodic import CIRCLE_TURN, folded_circle, losing_circle
from tests.bifurcations.torus_runs import trace_torus

WAVY = 0.6
FOLDED = 0.4, 0.5  # the parameters d and e of a family of circles


def losing_start(kind: str, p: float, k: float) -> tuple[TorusProblem, TorusStart]:
    circle = PeriodCircle(losing_circle(kind), np.array([p, k, CLOCK]), "p", 1)
    problem = TorusProblem(circle, ShootingOptions(tolerance=1e-12), FourierOptions(tolerance=1e-9))
    at = angles(31)
    states = np.column_stack([np.cos(at), np.sin(at), np.zeros((31, 2))])
    return problem, TorusStart(states, constant_bases(np.eye(4), 31), p, CIRCLE_TURN)


@pytest.mark.parametrize(
    ("kind", "name", "wavy"),
    [
        ("branch_point", "BRANCH_POINT", WAVY),
        ("period_doubling", "PERIOD_DOUBLING", WAVY),
        ("hopf", "HOPF", WAVY),
        ("moebius", "PERIOD_DOUBLING", 0.0),
    ],
)
def test_a_torus_that_loses_its_stability(kind: str, name: str, wavy: float) -> None:
    exact = 2.0 / (1.0 + math.sqrt(1.0 - wavy**2))
    problem, start = losing_start(kind, 0.8 * exact, wavy)
    options = TorusOptions((0.8 * exact, 1.3 * exact), step=0.07, maximum_step=0.07)
    run = trace_torus(problem, start, options)
    assert run.result.stop is TorusStop.RANGE
    (event,) = run.events
    assert event.kind is TorusEventKind[name]
    assert event.unknowns.parameter == pytest.approx(exact, abs=1e-6)
    assert event.destabilises
    assert event.residual < 1e-6
    assert event.moduli[0] == pytest.approx(1.0, abs=1e-6)
    unstable = 2 if kind == "hopf" else 1
    assert [state.unstable for state in run.states] == [
        unstable if parameter > exact else 0 for parameter in run.parameters
    ]


def test_a_torus_that_becomes_stable_again_says_so() -> None:
    exact = 2.0 / (1.0 + math.sqrt(1.0 - WAVY**2))
    problem, start = losing_start("hopf", 1.2 * exact, WAVY)
    options = TorusOptions((0.8 * exact, 1.3 * exact), direction=-1, step=0.07, maximum_step=0.07)
    (event,) = trace_torus(problem, start, options).events
    assert event.kind is TorusEventKind.HOPF
    assert not event.destabilises


def folded_start() -> tuple[TorusProblem, TorusStart, TorusOptions]:
    """Stable circles of a family that turns back."""
    d, e = FOLDED
    circle = PeriodCircle(folded_circle(), np.array([-0.05, d, e, CLOCK]), "m", 1)
    problem = TorusProblem(circle, ShootingOptions(tolerance=1e-12), FourierOptions(tolerance=1e-9))
    square = (d + math.sqrt(d * d - 4.0 * e * 0.05)) / (2.0 * e)
    w = math.sqrt(square) * np.exp(1j * angles(31))
    seen = w / (1.0 - 0.3 * w)
    start = TorusStart(np.column_stack([seen.real, seen.imag]), constant_bases(np.eye(2), 31), -0.05, 1.0)
    options = TorusOptions((-0.2, -0.02), direction=-1, step=0.03, maximum_step=0.03)
    return problem, start, options


def test_the_fold_of_a_family_of_circles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The branch turns, with one event although the multiplier passes one as well.

    Its residual is the slope dlambda/ds there.
    """
    slopes: list[float] = []
    tangent_of = TorusSegment.tangent_of

    def watched(segment: TorusSegment, torus: Torus) -> TorusUnknowns | None:
        tangent = tangent_of(segment, torus)
        assert tangent is not None
        slopes.append(abs(tangent.parameter) / segment.metric.norm(tangent))
        return tangent

    monkeypatch.setattr(TorusSegment, "tangent_of", watched)
    d, e = FOLDED
    problem, start, options = folded_start()
    run = trace_torus(problem, start, options)
    assert run.result.stop is TorusStop.RANGE
    (event,) = run.events
    assert event.kind is TorusEventKind.FOLD
    assert event.unknowns.parameter == pytest.approx(-d * d / (4.0 * e), abs=1e-8)
    radius = np.abs((lambda s: s / (1.0 + 0.3 * s))(event.unknowns.states @ [1.0, 1.0j]))
    assert radius == pytest.approx(math.sqrt(d / (2.0 * e)), abs=1e-5)
    assert event.destabilises
    assert any(event.residual == pytest.approx(slope, rel=1e-9, abs=0.0) for slope in slopes)
    assert event.residual < 1e-6
    assert [state.unstable for state in run.states][-1] == 1


@pytest.mark.parametrize(("unstable", "destabilises"), [(0, True), (1, None), (UNDECIDED, None)])
def test_a_fold_tells_the_change_of_stability_where_both_sides_are_known(
    unstable: int, destabilises: bool | None
) -> None:
    """Behind it one multiplier is unstable; ``unstable``: how many are said to be so before it."""
    problem, start, options = folded_start()
    run = trace_torus(problem, start, options)
    (fold,) = run.events
    last = [state for state in run.states if state.arclength < fold.arclength][-1]
    again = trace_torus(
        problem, replace(last, unstable=unstable), replace(options, max_points=last.index + 2)
    )
    assert [state.unstable for state in again.states] == [1]
    assert [(event.kind, event.destabilises) for event in again.events] == [
        (TorusEventKind.FOLD, destabilises)
    ]


def test_a_restart_finds_the_same_events() -> None:
    exact = 2.0 / (1.0 + math.sqrt(1.0 - WAVY**2))
    problem, start = losing_start("period_doubling", 0.8 * exact, WAVY)
    options = TorusOptions((0.8 * exact, 1.3 * exact), step=0.07, maximum_step=0.07)
    run = trace_torus(problem, start, options)
    before = int(np.flatnonzero(run.parameters < exact)[-1])
    again = trace_torus(problem, type(run.states[0]).from_arrays(run.states[before].arrays()), options)
    assert again.events[0].unknowns.parameter == run.events[0].unknowns.parameter
    np.testing.assert_array_equal(again.events[0].unknowns.states, run.events[0].unknowns.states)
