"""Tongues between two strong resonances of a Neimark-Sacker curve, beside those of Mathieu's equation."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.curve import (
    CurveOptions,
    CurveState,
    CurveStop,
    SpecialKind,
    TongueSide,
    around_tongue,
)
from pipelines.bifurcations.plane import CurveProblem
from pipelines.bifurcations.switching import joined_curve
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.curve_runs import FLIP, NS, Run, start, trace
from tests.systems import LEVER, damped_mathieu, mathieu_tongue

PLANE = ("omega", "damping")
# far longer than the narrow tongues, as where kinks of the equations forbid shorter steps
OPTIONS = CurveOptions(((0.4, 2.5), (-1.0, 1.0)), minimum_step=5e-4, normal_form=None)


def problem(h: float) -> CurveProblem:
    period_map = PeriodMap(damped_mathieu(), DOPRI8, samples=16, minimum_steps=32)
    options = ShootingOptions(tolerance=1e-10, multiplier_tolerance=1e-12)
    return CurveProblem(period_map, NS, np.array([1.0, 0.0, h]), PLANE, options)


def line(h: float, order: int, **options: float) -> Run:
    """The Neimark-Sacker curve damping = 0 from below the n-th tongue upwards."""
    omega = 2.0 / order - 0.13
    angle = 2.0 * np.pi / omega % (2.0 * np.pi)
    begin = start([0.0, 0.0], (omega, 0.0), min(angle, 2.0 * np.pi - angle))
    return trace(
        problem(h), begin, replace(OPTIONS, ranges=((0.4, 2.0 / order + 0.13), (-1.0, 1.0)), **options)
    )


@pytest.mark.parametrize(
    ("order", "h"),
    [(1, 1e-2), (1, 1e-3), (1, 1e-4), (1, 1e-5), (3, 0.3), (3, 0.1)],
    ids=lambda value: f"{value:g}",
)
def test_a_resolved_tongue_is_followed_around(order: int, h: float) -> None:
    """It is h wide at omega = 2, and 1e-4 at omega = 2/3 for h = 0.1."""
    low, high = mathieu_tongue(order, h)
    found = line(h, order)
    assert found.result.stop is CurveStop.RESONANCE_2
    near, far = found.specials[-2:]
    assert [(each.kind, each.tongue) for each in (near, far)] == [
        (SpecialKind.R2, TongueSide.NEAR), (SpecialKind.R2, TongueSide.FAR)
    ]  # fmt: skip
    error = 1e-6  # of the multipliers by the time steps, whose angle changes by more than one per frequency
    assert near.parameters[0] == pytest.approx(low, abs=error)
    assert far.parameters[0] == pytest.approx(high, abs=error)
    assert near.width == far.width == pytest.approx(high - low, rel=5e-3)

    # the period doublings go once around the tongue, through both resonances
    flips, begin = joined_curve(problem(h), near)
    assert flips.kind is FLIP
    around = trace(flips, begin, around_tongue(OPTIONS, begin.width))
    assert around.result.stop is CurveStop.CLOSED
    assert {special.kind for special in around.specials} == {SpecialKind.R2}
    ends = sorted({round(special.parameters[0], 7) for special in around.specials})
    assert ends[0] == pytest.approx(low, abs=error)
    assert ends[-1] == pytest.approx(high, abs=error)
    damping = around.parameters[:, 1]
    # the largest growth rate in the tongue is half of its width times n/2, in first order of h
    assert damping.max() == pytest.approx(LEVER * (high - low) * order / 4.0, rel=max(0.02, 0.6 * h * order))
    assert damping.min() == pytest.approx(-damping.max(), rel=1e-2)

    # and the Neimark-Sacker curve goes on behind it, in whatever direction it is asked for; trial steps of
    # 5e-5 find its sense, also where they cross the tongue
    behind = replace(OPTIONS, ranges=((0.4, high + 0.1), (-1.0, 1.0)), step=0.05)
    beyond, begin = joined_curve(problem(h), far)
    assert beyond.kind is NS
    for direction in (1, -1):
        rest = trace(beyond, begin, replace(behind, direction=direction))
        assert rest.result.stop is CurveStop.RANGE
        assert rest.points[0].parameters[0] == pytest.approx(high, abs=error)
        assert rest.points[-1].parameters[0] == high + 0.1
        assert np.max(np.abs(rest.parameters[:, 1])) < 1e-8


def test_the_middle_of_the_period_doublings_is_sharp() -> None:
    """Halfway they have the damping that equals the growth of the undamped equation: an exact ellipse."""
    h = 1e-3
    flips, begin = joined_curve(problem(h), line(h, 1).specials[-2])
    around = trace(flips, begin, around_tongue(OPTIONS, begin.width))
    omega, damping = around.parameters.T
    low, high = mathieu_tongue(1, h)
    # first order of h: (omega - 2)^2 + (2 damping/LEVER)^2 = (h/2)^2
    across, along = (omega - 0.5 * (low + high)) / (0.5 * h), 2.0 * damping / LEVER / (0.5 * h)
    np.testing.assert_allclose(across**2 + along**2, 1.0, rtol=0, atol=3.0 * h)


@pytest.mark.parametrize("step", [0.11, 0.13, 0.065], ids=lambda value: f"{value:g}")
def test_an_unresolved_tongue_is_told_and_crossed(step: float) -> None:
    """Its multipliers differ by 1.6e-6, the time steps leave 1e-6; 0.13 and 0.065 would end in its middle."""
    h = 1e-6
    found = line(h, 1, step=step, maximum_step=step)
    assert found.result.stop is CurveStop.RANGE
    assert found.points[-1].parameters[0] == 2.13
    assert np.max(np.abs(found.parameters[:, 1])) < 1e-8
    (tongue,) = (special for special in found.specials if special.kind is SpecialKind.R2)
    assert tongue.tongue is TongueSide.UNRESOLVED
    low, high = mathieu_tongue(1, h)
    assert low - tongue.width <= tongue.parameters[0] <= high + tongue.width
    assert high - low < tongue.width < 5.0 * (high - low)
    assert joined_curve(problem(h), tongue) is None


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_what_is_resolved_depends_on_the_error_of_the_multipliers(factor: float) -> None:
    """In the middle of the tongue they are 2 sinh(h T/4) apart, four times the error asked for or not."""
    h = 1e-4
    error = 2.0 * np.sinh(0.25 * np.pi * h) / 4.0 * factor
    loose = problem(h)
    loose = replace(loose, options=replace(loose.options, step_tolerance=error))
    begin = start([0.0, 0.0], (1.87, 0.0), 2.0 * np.pi - 2.0 * np.pi / 1.87)
    run = trace(loose, begin, replace(OPTIONS, ranges=((0.4, 2.13), (-1.0, 1.0))))
    wanted = TongueSide.UNRESOLVED if factor > 1.0 else TongueSide.NEAR
    assert run.result.stop is (CurveStop.RANGE if factor > 1.0 else CurveStop.RESONANCE_2)
    assert wanted in [special.tongue for special in run.specials]


def test_tongues_of_the_other_resonance() -> None:
    """At omega = 1 the multipliers meet at 1: the sides of that tongue are told alike."""
    low, high = mathieu_tongue(2, 0.1)
    found = line(0.1, 2)
    assert found.result.stop is CurveStop.RESONANCE_1
    near, far = found.specials[-2:]
    assert (near.kind, near.tongue, far.tongue) == (SpecialKind.R1, TongueSide.NEAR, TongueSide.FAR)
    assert near.parameters[0] == pytest.approx(low, abs=1e-7)
    assert far.parameters[0] == pytest.approx(high, abs=1e-7)
    beyond, begin = joined_curve(problem(0.1), far)
    rest = trace(beyond, begin, replace(OPTIONS, ranges=((0.4, 1.13), (-1.0, 1.0))))
    assert rest.result.stop is CurveStop.RANGE
    assert rest.points[-1].parameters[0] == 1.13


def test_a_wide_tongue_has_one_side() -> None:
    """The other is more than a few steps away: the period doublings lead there.  Its width is guessed."""
    found = line(0.2, 1, maximum_step=0.02)
    low, high = mathieu_tongue(1, 0.2)
    assert found.result.stop is CurveStop.RESONANCE_2
    (near,) = (special for special in found.specials if special.kind is SpecialKind.R2)
    assert near.tongue is TongueSide.NEAR
    assert near.width == pytest.approx(high - low, rel=0.3)
    flips, begin = joined_curve(problem(0.2), near)
    around = trace(flips, begin, replace(OPTIONS, ranges=((0.4, 2.5), (-4.0, 4.0))))
    far = [special for special in around.specials if special.parameters[0] > 2.0]
    assert far[0].parameters[0] == pytest.approx(high, abs=1e-6)


@pytest.mark.parametrize("cut", [3, 20])
def test_a_restart_around_a_tongue_gives_the_same_bits(cut: int) -> None:
    h = 1e-3
    flips, begin = joined_curve(problem(h), line(h, 1).specials[-2])
    options = replace(around_tongue(OPTIONS, begin.width), max_points=28)
    whole = trace(flips, begin, options)
    rest = trace(
        flips, CurveState.from_arrays(pickle.loads(pickle.dumps(whole.states[cut].arrays()))), options
    )
    for old, new in zip(whole.states[cut + 1 :], rest.states, strict=True):
        for name, value in old.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(new.arrays()[name]).tobytes(), name
