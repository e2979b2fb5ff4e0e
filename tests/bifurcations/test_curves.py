"""Bifurcation curves of maps and flows in closed form: where they run, end, and what lies on them."""

from __future__ import annotations

import gc
import math
import pickle
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveState, CurveStop, SpecialKind
from pipelines.bifurcations.curve_continuation import would_end_on
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.bifurcations.switching import joined_curve
from pipelines.orbits import period_map
from pipelines.orbits.integration.passes import implicit_pass
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.steppers import DOPRI8, ESDIRK5
from tests.bifurcations.curve_runs import FLIP, FOLD, NS, map_problem, start, trace
from tests.bifurcations.explicit_maps import (
    ExplicitMap,
    cusp_map,
    delayed_logistic,
    explicit_map,
    flip_map,
    henon,
    narrow_tongue,
    product_map,
    rotation_map,
)
from tests.bifurcations.polar_cycles import polar_cycles
from tests.systems import implicit

BOTH = pytest.mark.parametrize("formulation", list(CurveFormulation))
PLANE = ((-5.0, 5.0), (-3.0, 3.0))
B = 0.3
HENON_FLIP = start([2.0 / (3.0 * (1.0 - B)), 2.0 * B / (3.0 * (1.0 - B))], (0.75 * (1.0 - B) ** 2, B))
HENON_FOLD = start([2.0 / (1.0 - B), 2.0 * B / (1.0 - B)], (-0.25 * (1.0 - B) ** 2, B))


def kinds(run) -> list[SpecialKind]:  # type: ignore[no-untyped-def]
    return [special.kind for special in run.specials]


@BOTH
def test_henon_curves_are_parabolas(formulation: CurveFormulation) -> None:
    options = CurveOptions(((-2.0, 2.0), (-0.9, 0.9)), maximum_step=0.1)
    flips = trace(map_problem(henon(), FLIP, (0, 0), ("a", "b"), formulation), HENON_FLIP, options)
    folds = trace(map_problem(henon(), FOLD, (0, 0), ("a", "b"), formulation), HENON_FOLD, options)
    for run, factor in ((flips, 0.75), (folds, -0.25)):
        assert run.result.stop is CurveStop.RANGE
        a, b = run.parameters.T
        assert np.max(np.abs(a - factor * (1.0 - b) ** 2)) < 1e-9
        assert max(point.cycle.residual for point in run.points) <= 1e-12


def test_bending_curves_and_their_resonances() -> None:
    """At b = -1 the Henon map keeps areas: R2 on the flip curve at a = 3, R1 on the fold curve at a = -1."""
    options = CurveOptions(((-1.5, 3.5), (-1.2, 0.9)), maximum_step=0.1)
    flips = trace(map_problem(henon(), FLIP, (0, 0), ("a", "b")), HENON_FLIP, options)
    assert kinds(flips) == [SpecialKind.R2]
    assert np.allclose(flips.specials[0].parameters[:2], [3.0, -1.0], rtol=0, atol=1e-9)
    folds = trace(map_problem(henon(), FOLD, (0, 0), ("a", "b")), HENON_FOLD, replace(options, direction=-1))
    assert kinds(folds) == [SpecialKind.R1]
    assert np.allclose(folds.specials[0].parameters[:2], [-1.0, -1.0], rtol=0, atol=1e-9)


def test_neimark_sacker_curve_ends_on_the_fold_curve() -> None:
    """Delayed logistic map: at e = 0, r = 2 and theta = pi/3; R4 at r = e = 1; R1 at r = 3, e = -1/3."""
    problem = map_problem(delayed_logistic(), NS, (0, 0), ("r", "e"))
    begin = start([0.5, 0.5], (2.0, 0.0), math.pi / 3.0)
    down = trace(problem, begin, CurveOptions(((0.5, 5.0), (-2.0, 2.0)), direction=-1))
    assert SpecialKind.R4 in kinds(down)
    r4 = next(special for special in down.specials if special.kind is SpecialKind.R4)
    assert np.allclose(r4.parameters[:2], [1.0, 1.0], rtol=0, atol=1e-9)
    up = trace(problem, begin, CurveOptions(((0.5, 5.0), (-2.0, 2.0))))
    assert up.result.stop is CurveStop.RESONANCE_1
    assert np.allclose(up.points[-1].parameters, [3.0, -1.0 / 3.0], rtol=0, atol=1e-8)
    assert up.points[-1].cos_theta == pytest.approx(1.0, abs=1e-9)
    # nothing follows the end, but the fold curve goes on both ways
    assert trace(problem, up.result.state, CurveOptions(((0.5, 5.0), (-2.0, 2.0)))).points == []
    joined = joined_curve(problem, up.specials[-1])
    assert joined is not None
    folds, begin = joined
    assert folds.kind is FOLD
    for direction in (1, -1):
        run = trace(folds, begin, CurveOptions(((2.0, 4.0), (-2.0, 2.0)), direction=direction))
        assert run.result.stop is CurveStop.RANGE
        # fixed points r x^2 + (1 - r) x = e meet where (1 - r)^2 + 4 r e = 0
        r, e = run.parameters.T
        assert np.max(np.abs((1.0 - r) ** 2 + 4.0 * r * e)) < 1e-9


@pytest.mark.parametrize(
    ("depth", "stop"),
    [(1e-5, CurveStop.RESONANCE_2), (1e-10, CurveStop.RESONANCE_2), (1e-14, CurveStop.RANGE)],
)
def test_a_tongue_within_one_step(depth: float, stop: CurveStop) -> None:
    """The curve ends at it, unless the multipliers inside are nearer to -1 than what time steps leave."""
    problem = map_problem(narrow_tongue(depth), NS, (0, 0), ("e", "r"))
    begin = start([0.0, 0.0], (-0.33, 1.0), math.acos(-1.0 - depth + 0.33**2))
    # e is the first parameter of the plane, so that the curve starts upwards
    run = trace(problem, begin, CurveOptions(((-0.4, 0.4), (0.5, 1.5)), maximum_step=0.1))
    assert run.result.stop is stop
    assert np.max(np.abs(run.parameters[:, 1] - 1.0)) < 1e-9
    end = 0.4 if stop is CurveStop.RANGE else -math.sqrt(depth)
    assert run.points[-1].parameters[0] == pytest.approx(end, abs=1e-7)


def test_a_curve_may_start_on_a_resonance() -> None:
    """From R1 the Neimark-Sacker curve leaves inwards, whatever direction is asked for."""
    problem = map_problem(delayed_logistic(), NS, (0, 0), ("r", "e"))
    begin = start([1.0 / 3.0, 1.0 / 3.0], (3.0, -1.0 / 3.0), 0.0)
    for direction in (1, -1):
        run = trace(problem, begin, CurveOptions(((1.5, 5.0), (-2.0, 2.0)), direction=direction))
        assert run.result.stop is CurveStop.RANGE
        assert run.points[-1].parameters[0] == 1.5
        assert kinds(run) == []


def test_cusp() -> None:
    half = math.sqrt(0.1)
    begin = start([half, 1.25 * half], (-2.0 * half**3, 0.3))
    run = trace(map_problem(cusp_map(), FOLD, (0, 0), ("m", "n")), begin, CurveOptions(((-1, 1), (-1, 1))))
    assert kinds(run) == [SpecialKind.CUSP]
    assert np.allclose(run.specials[0].parameters[:2], 0.0, atol=1e-8)
    m, n = run.parameters.T
    assert np.max(np.abs((m / 2.0) ** 2 - (n / 3.0) ** 3)) < 1e-10
    assert np.min(m) < -0.05
    assert np.max(m) > 0.1


@pytest.mark.parametrize(
    ("name", "kind", "second", "expected"),
    [
        ("flip_pair", FLIP, 0.0, SpecialKind.FLIP_NEIMARK_SACKER),
        ("fold_pair", FOLD, 0.0, SpecialKind.FOLD_NEIMARK_SACKER),
        ("rotation_pair", NS, 0.0, SpecialKind.DOUBLE_NEIMARK_SACKER),
        ("flip_real", FLIP, 1.0, SpecialKind.FOLD_FLIP),
        ("fold_real", FOLD, -1.0, SpecialKind.FOLD_FLIP),
    ],
)
def test_two_critical_events_at_once(name: str, kind, second: float, expected: SpecialKind) -> None:  # type: ignore[no-untyped-def]
    """Events in independent directions, so that the second lies where its own parameter says."""
    explicit = product_map(name)
    half = math.sqrt(0.1)
    size = explicit.size
    mixing = np.eye(size) + 0.3 * np.sin(1.0 + np.arange(size * size)).reshape(size, size)
    at_fold = kind is FOLD
    state = mixing @ np.array([half if at_fold else 0.0] + [0.0] * (size - 1))
    m = -2.0 * half**3 if at_fold else 0.0
    begin = start(state, (second - 0.07, m), 1.0)
    problem = map_problem(explicit, kind, (m, 0.3, 0.0), ("t", "m"))
    run = trace(problem, begin, CurveOptions(((second - 0.1, second + 0.1), (-1.0, 1.0)), step=0.05))
    assert kinds(run) == [expected]
    assert run.specials[0].parameters[2] == pytest.approx(second, abs=1e-8)
    # the curve of the second event crosses there, at its own parameter whatever that of the first is
    joined = joined_curve(problem, run.specials[0])
    assert joined is not None
    for direction in (1, -1):
        crossing = trace(
            *joined, CurveOptions(((second - 0.1, second + 0.1), (-0.1, 0.05)), direction=direction)
        )
        assert crossing.result.stop is CurveStop.RANGE
        np.testing.assert_allclose(crossing.parameters[:, 0], second, rtol=0, atol=1e-8)
        assert kinds(crossing) == []


@pytest.mark.parametrize(
    ("second", "expected"), [(0.7, SpecialKind.FOLD_NEIMARK_SACKER), (-1.3, SpecialKind.FLIP_NEIMARK_SACKER)]
)
def test_a_real_multiplier_crosses_on_a_neimark_sacker_curve(second: float, expected: SpecialKind) -> None:
    problem = map_problem(rotation_map(), NS, (0, 1.2, -0.5, 0, 0.8), ("t", "m"))
    begin = start(np.zeros(3), (second - 0.03, 0.0), 1.2)
    run = trace(problem, begin, CurveOptions(((second - 0.1, second + 0.1), (-1.0, 1.0)), step=0.05))
    assert kinds(run) == [expected]
    assert run.specials[0].parameters[3] == pytest.approx(second, abs=1e-8)


def test_strong_resonances_and_chenciner() -> None:
    problem = map_problem(rotation_map(), NS, (0, 1.2, 0.5, 0, 0.8), ("theta", "m"))
    run = trace(problem, start(np.zeros(3), (1.2, 0.0), 1.2), CurveOptions(((1.0, 2.5), (-1, 1))))
    assert kinds(run) == [SpecialKind.R4, SpecialKind.R3]
    assert run.specials[0].parameters[1] == pytest.approx(math.pi / 2.0, abs=1e-8)
    assert run.specials[1].parameters[1] == pytest.approx(2.0 * math.pi / 3.0, abs=1e-8)
    problem = map_problem(rotation_map(), NS, (0, 1.2, 0, 0, 0.8), ("d_r", "m"))
    run = trace(problem, start(np.zeros(3), (-0.21, 0.0), 1.2), CurveOptions(((-0.3, 0.3), (-1, 1))))
    assert kinds(run) == [SpecialKind.CHENCINER]
    assert run.specials[0].parameters[2] == pytest.approx(0.0, abs=1e-8)


def test_generalised_flip() -> None:
    """b = c + q^2 changes its sign at c = -q^2."""
    problem = map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m"))
    run = trace(problem, start(np.zeros(2), (-0.45, 0.0)), CurveOptions(((-0.5, -0.2), (-1, 1))))
    assert kinds(run) == [SpecialKind.GENERALISED_FLIP]
    assert run.specials[0].parameters[2] == pytest.approx(-0.36, abs=1e-8)


# --- Cycles of unknown period ---------------------------------------------------------------------


def polar_problem(kind, names: tuple[str, str], parameters: tuple[float, ...]) -> CurveProblem:  # type: ignore[no-untyped-def]
    period_map = PeriodMap(polar_cycles(), DOPRI8, Formulation.AUTONOMOUS, samples=32, minimum_steps=64)
    options = ShootingOptions(tolerance=1e-11, multiplier_tolerance=1e-10)
    return CurveProblem(period_map, kind, np.array(parameters), names, options)


def test_folds_of_cycles_of_unknown_period() -> None:
    e = 0.3
    begin = start([math.sqrt(1 + e), 0, 0, 0], (-2 * e**3, 3 * e * e), period=2 * math.pi / (1 + 0.4 * e))
    problem = polar_problem(FOLD, ("m", "n"), (0, 0, -0.2, 0.35, 0.4))
    options = CurveOptions(((-0.2, 0.2), (-1.0, 0.5)), maximum_step=0.1)
    run = trace(problem, begin, options)
    assert run.result.stop is CurveStop.RANGE
    assert kinds(run) == [SpecialKind.CUSP]
    m, n = run.parameters.T
    assert np.max(np.abs((m / 2.0) ** 2 - (n / 3.0) ** 3)) < 1e-9
    excess = np.cbrt(-m / 2.0)
    periods = [point.cycle.unknowns.period for point in run.points]
    assert np.allclose(periods, 2.0 * math.pi / (1.0 + 0.4 * excess), rtol=0, atol=1e-7)
    with pytest.raises(ValueError, match="bordered"):
        replace(problem, formulation=CurveFormulation.EXTENDED)


def test_points_hold_no_factors() -> None:
    """They are kept, and the factors of an orbit may take 256 MiB."""
    problem = polar_problem(FOLD, ("m", "n"), (0, 0, -0.2, 0.35, 0.4))
    stiff = replace(problem.period_map, system=implicit(polar_cycles()), stepper=ESDIRK5)
    begin = start([math.sqrt(1.3), 0, 0, 0], (-0.054, 0.27), period=2 * math.pi / 1.12)
    run = trace(replace(problem, period_map=stiff), begin, CurveOptions(((-1, 1), (-1, 1)), max_points=2))
    assert len(run.points) == 2
    assert [point.cycle.image.factors for point in run.points] == [None, None]


@BOTH
def test_one_orbit_has_its_factors_at_a_time(
    formulation: CurveFormulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while special points are located, on many corrected points of one step."""
    made: list[weakref.ref[np.ndarray]] = []
    present = 0

    def counted(*arguments):  # type: ignore[no-untyped-def]
        nonlocal present
        finished, factors = implicit_pass(*arguments)
        if factors is not None:
            made.append(weakref.ref(factors))
            present = max(present, sum(each() is not None for each in made))
        return finished, factors

    monkeypatch.setattr(period_map, "implicit_pass", counted)
    e, n = -0.1, -0.5
    problem = polar_problem(NS, ("omega", "delta"), (e**3 - n * e, n, 0, 0, 0.4))
    stiff = replace(problem.period_map, system=implicit(polar_cycles()), stepper=ESDIRK5)
    problem = replace(problem, period_map=stiff, formulation=formulation)
    begin = start([math.sqrt(1 + e), 0, 0, 0], (0.35, 0.0), period=2 * math.pi / (1 + 0.4 * e))
    options = CurveOptions(((0.2, 0.4), (-1.0, 1.0)), direction=-1)
    gc.disable()  # what refers to itself stays
    try:
        assert kinds(trace(problem, begin, options)) == [SpecialKind.R3, SpecialKind.R4]
    finally:
        gc.enable()
    assert len(made) > 10
    assert present == 1


@BOTH
def test_neimark_sacker_points_of_cycles_of_unknown_period(formulation: CurveFormulation) -> None:
    """delta = 0 for every omega, theta = omega T; d = -2 T, because abs(u)^2 = 2 abs(w)^2."""
    e, n = -0.1, -0.5
    period = 2 * math.pi / (1 + 0.4 * e)
    problem = replace(
        polar_problem(NS, ("omega", "delta"), (e**3 - n * e, n, 0, 0, 0.4)), formulation=formulation
    )
    begin = start([math.sqrt(1 + e), 0, 0, 0], (0.35, 0.0), period=period)
    run = trace(problem, begin, CurveOptions(((0.2, 0.4), (-1.0, 1.0)), direction=-1))
    assert kinds(run) == [SpecialKind.R3, SpecialKind.R4]
    assert run.specials[0].parameters[3] == pytest.approx(2.0 * math.pi / 3.0 / period, abs=1e-8)
    assert np.max(np.abs(run.parameters[:, 1])) < 1e-9
    assert run.points[-1].angle == pytest.approx(0.2 * period, abs=1e-9)
    for point in run.points:
        assert point.normal_form is not None
        assert point.normal_form.coefficient == pytest.approx(-2.0 * period, abs=1e-6)


# --- The loop -------------------------------------------------------------------------------------


def test_restart_gives_the_same_bits() -> None:
    problem = map_problem(delayed_logistic(), NS, (0, 0), ("r", "e"))
    options = CurveOptions(((0.5, 5.0), (-2.0, 2.0)), max_points=12)
    whole = trace(problem, start([0.5, 0.5], (2.0, 0.0), math.pi / 3.0), options)
    assert whole.result.stop is CurveStop.MAXIMUM_POINTS
    half = CurveState.from_arrays(pickle.loads(pickle.dumps(whole.states[5].arrays())))
    rest = trace(problem, half, options)
    assert [state.index for state in rest.states] == list(range(6, 12))
    for old, new in zip(whole.states[6:], rest.states, strict=True):
        for name, value in old.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(new.arrays()[name]).tobytes(), name


def test_every_other_way_to_stop() -> None:
    problem = map_problem(henon(), FLIP, (0, 0), ("a", "b"))
    options = CurveOptions(PLANE, max_points=5)
    limited = trace(problem, HENON_FLIP, options, limit=lambda p: "far" if p.parameters[0] > 0.4 else None)
    assert (limited.result.stop, limited.result.message) == (CurveStop.LIMIT, "far")
    assert all(point.parameters[0] <= 0.4 for point in limited.points)
    interrupted = trace(problem, HENON_FLIP, options, should_stop=lambda: True)
    assert interrupted.result.stop is CurveStop.INTERRUPTED
    assert len(interrupted.points) == 1
    nowhere = trace(problem, start([40.0, -30.0], (3.0, 2.0)), options)
    assert nowhere.result.stop is CurveStop.START_FAILED
    assert nowhere.result.message
    with pytest.raises(ValueError, match="outside the range"):
        trace(problem, start([0, 0], (9.0, 0.0)), options)
    # one iteration is never enough
    hasty = replace(problem, options=replace(problem.options, iterations=1))
    stopped = trace(hasty, HENON_FLIP, replace(options, step=0.05, minimum_step=0.02))
    assert stopped.result.stop is CurveStop.MINIMUM_STEP
    assert "more" in stopped.result.message
    assert all(stop.advice for stop in CurveStop)


def test_ranges_are_hit_exactly() -> None:
    problem = map_problem(henon(), FLIP, (0, 0), ("a", "b"))
    for direction, end in ((1, (1.3, None)), (-1, (None, 0.6))):
        run = trace(problem, HENON_FLIP, CurveOptions(((0.1, 1.3), (-2.0, 0.6)), direction=direction))
        assert run.result.stop is CurveStop.RANGE
        for value, wanted in zip(run.points[-1].parameters, end, strict=True):
            assert wanted is None or value == wanted


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("ranges", ((1.0, 0.0), (0.0, 1.0))),
        ("direction", 0),
        ("step", 1.0),
        ("max_points", 0),
        ("minimum_cosine", 1.0),
        ("parameter_scales", (0.0, 1.0)),
    ],
)
def test_options_are_checked(field: str, value: object) -> None:
    with pytest.raises(ValueError):
        CurveOptions(**({"ranges": PLANE} | {field: value}))  # type: ignore[arg-type]


def test_problems_are_checked() -> None:
    for names in (("a", "a"), ("a", "unknown")):
        with pytest.raises(ValueError):
            map_problem(henon(), FLIP, (0, 0), names)
    with pytest.raises(ValueError, match="parameters given"):
        map_problem(henon(), FLIP, (0,), ("a", "b"))


def test_two_curves_that_cross_at_a_small_angle_are_told_apart() -> None:
    """Period doublings m = 0 and m = t/10 of the same cycle: a point beside their crossing lies on both."""
    flips = explicit_map(
        2,
        ("t", "m"),
        lambda s, p: (-(1.0 + p[1]) * s[0] + s[0] ** 3, -(1.0 + p[1] - 0.1 * p[0]) * s[1] + s[1] ** 3),
    )
    problem = map_problem(flips, FLIP, (0, 0), ("t", "m"))
    options = CurveOptions(((-0.3, 0.3), (-0.1, 0.1)), step=0.05, maximum_step=0.05)
    steep = trace(problem, start([0.0, 0.0], (-0.255, -0.0255)), options)
    assert steep.result.stop is CurveStop.RANGE
    known = {"steep": KnownCurve.of(steep.states)}
    level = trace(problem, start([0.0, 0.0], (-0.255, 0.0)), options, traced=known)
    beside = [point.parameters for point in level.points if known["steep"].runs_along(
        start([0.0, 0.0], tuple(point.parameters), math.pi), np.array([1.0, 0.0])
    )]  # fmt: skip
    assert len(beside) == 1, "one point cannot be told apart by itself"
    assert level.result.stop is CurveStop.RANGE
    assert np.max(np.abs(level.parameters[:, 1])) < 1e-9
    # and one that does run along is recognised at its second point
    again = trace(problem, start([0.0, 0.0], (-0.23, -0.023)), options, traced=known)
    assert again.result.stop is CurveStop.TRACED
    assert len(again.points) == 1
    # or afterwards, where it was traced without knowledge of the other one
    unknowing = trace(problem, start([0.0, 0.0], (-0.23, -0.023)), options)
    assert unknowing.result.stop is CurveStop.RANGE
    assert would_end_on(KnownCurve.of(unknowing.states), known.values(), (1.0, 1.0))
    assert not would_end_on(KnownCurve.of(level.states), known.values(), (1.0, 1.0))


def test_two_curves_beside_each_other_are_told_apart_by_the_other_multiplier() -> None:
    """Period doublings m = 0 and m = 1e-4 of the same cycle, as of a symmetric and an antisymmetric mode."""
    apart = 1e-4
    flips = explicit_map(
        2,
        ("t", "m"),
        lambda s, p: (-(1.0 + p[1]) * s[0] + s[0] ** 3, -(1.0 + p[1] - apart) * s[1] + s[1] ** 3),
    )
    problem = map_problem(flips, FLIP, (0, 0), ("t", "m"))
    options = CurveOptions(((-0.3, 0.3), (-0.1, 0.1)), step=0.05, maximum_step=0.05)
    lower = trace(problem, start([0.0, 0.0], (-0.255, 0.0)), options)
    assert np.max(np.abs(lower.parameters[:, 1])) < 1e-9
    known = KnownCurve.of(lower.states)
    upper = replace(start([0.0, 0.0], (-0.255, apart)), angle=math.pi)
    assert known.holds(upper), "nothing but the count tells them apart"
    # on the lower curve the second multiplier is inside, on the upper one the first is outside
    known = replace(known, unstable=np.zeros(len(lower.states)))
    assert not known.holds(replace(upper, unstable=1))
    run = trace(problem, replace(upper, unstable=1), options, traced={"lower": known})
    assert run.result.stop is CurveStop.RANGE
    again = trace(problem, start([0.0, 0.0], (-0.23, 0.0)), options, traced={"lower": known})
    assert again.result.stop is CurveStop.TRACED
    assert would_end_on(known, [known], (1.0, 1.0))
    above = replace(KnownCurve.of(run.states), unstable=np.ones(len(run.states)))
    assert not would_end_on(above, [known], (1.0, 1.0))


def leaving_folds() -> ExplicitMap:
    """Folds on b = 0 with the other multiplier -1 - a."""
    return explicit_map(
        2, ("a", "b"), lambda s, p: (s[0] + p[1] + s[0] ** 2, -(1.0 + p[0]) * s[1] + 0.1 * s[0] ** 2)
    )


@pytest.mark.parametrize(("direction", "bounds"), [(1, False), (-1, True)])
def test_a_direction_that_leaves_the_boundary_of_stable_cycles_ends_at_once(
    direction: int, bounds: bool
) -> None:
    """Folds on b = 0; the other multiplier is -1 - a, so that those with a > 0 bound no stable points."""
    problem = map_problem(leaving_folds(), FOLD, (0, 0), ("a", "b"))
    options = CurveOptions(((-0.5, 0.5), (-1.0, 1.0)), direction, 0.05, maximum_step=0.1)
    at = start([0.0, 0.0], (-0.01, 0.0))
    assert trace(problem, at, options).result.stop is CurveStop.RANGE, "followed where all are wanted"
    run = trace(problem, at, replace(options, boundary=True))
    assert run.result.stop is (CurveStop.RANGE if bounds else CurveStop.LEAVES_BOUNDARY)
    assert (len(run.states) > 1) == bounds


def test_a_curve_ends_behind_the_special_point_in_which_it_leaves_the_boundary() -> None:
    """There it is stored, so that the end is explained."""
    problem = map_problem(leaving_folds(), FOLD, (0, 0), ("a", "b"))
    options = CurveOptions(((-0.5, 0.5), (-1.0, 1.0)), 1, 0.05, maximum_step=0.1, boundary=True)
    run = trace(problem, start([0.0, 0.0], (-0.3, 0.0)), options)
    assert run.result.stop is CurveStop.LEAVES_BOUNDARY
    (special,) = run.specials
    assert special.kind is SpecialKind.FOLD_FLIP
    assert special.parameters[0] == pytest.approx(0.0, abs=1e-6)
    assert [state.parameters[0] > 0.0 for state in run.states] == [False] * (len(run.states) - 1) + [True]


def test_a_restart_meets_the_curve_itself_where_the_whole_run_does() -> None:
    """Flips on a + b i = e^(i angle), said to begin elsewhere.

    Only what was recorded before a restart comes with the number of other multipliers outside the circle,
    which differs here from that of the points behind it.
    """
    flips = explicit_map(
        2, ("a", "b"), lambda s, p: (-(p[0] ** 2 + p[1] ** 2) * s[0] + s[0] ** 3, 0.5 * s[1] + s[0] ** 2)
    )
    problem = map_problem(flips, FLIP, (0, 0), ("a", "b"))
    options = CurveOptions(((-2.0, 2.0), (-2.0, 2.0)), step=0.1, maximum_step=0.1)
    first = trace(problem, start([0.0, 0.0], (1.0, 0.0)), replace(options, max_points=3)).states[-1]
    first = replace(first, start_parameters=np.array([5.0, 5.0]))
    whole = trace(problem, first, options)
    assert (whole.result.stop, whole.result.message) == (CurveStop.TRACED, "it runs along itself")
    assert len(whole.states) > 60
    before, states = [first, *whole.states[:20]], whole.states[20:]
    stored = replace(KnownCurve.of(before), unstable=np.ones(len(before)))
    again = trace(problem, before[-1], options, own=stored)
    assert (again.result.stop, again.result.message) == (whole.result.stop, whole.result.message)
    assert len(again.states) == len(states)


def passed_twice(special: SpecialKind) -> tuple[CurveProblem, Any, tuple[tuple[float, float], ...]]:
    """A curve on which the test of a special point is e^2 - 1e-4 or its negative, from e = 0.43 to -0.5.

    Its parameter is e, of the cusps -4 e^3 + 12e-4 e along x + m + n x - 6e-4 x^2 + x^4 with x = e.
    """
    shallow, e = 1e-4, 0.43
    double, generalised = SpecialKind.FLIP_NEIMARK_SACKER, SpecialKind.GENERALISED_FLIP
    if special is SpecialKind.CUSP:
        function = lambda s, p: (  # noqa: E731
            s[0] + p[0] + p[1] * s[0] - 6.0 * shallow * s[0] ** 2 + s[0] ** 4,
            0.2 * s[1] + s[0],
        )
        n = 12.0 * shallow * e - 4.0 * e**3
        m = -n * e + 6.0 * shallow * e**2 - e**4
        curves = map_problem(explicit_map(2, ("m", "n"), function), FOLD, (m, n), ("m", "n"))
        return curves, start([e, 1.25 * e], (m, n)), ((-1.0, 1.0), (-1.0, 1.0))
    if special is generalised:
        function = lambda s, p: (  # noqa: E731
            -(1.0 + p[1]) * s[0] + (p[0] ** 2 - shallow) * s[0] ** 3,
            0.4 * s[1] + s[0] ** 2,
        )
        curves = map_problem(explicit_map(2, ("e", "m"), function), FLIP, (e, 0.0), ("e", "m"))
        return curves, start([0.0, 0.0], (e, 0.0)), ((-0.5, 0.5), (-0.5, 0.5))
    at = {SpecialKind.R2: -1.0, SpecialKind.R3: -0.5}.get(special)

    def rotation(s, p):  # type: ignore[no-untyped-def]
        dip = p[0] ** 2 - shallow
        kappa = 0.3 if at is None else at + dip
        third = {double: -1.0 + dip, SpecialKind.FOLD_NEIMARK_SACKER: 1.0 - dip}.get(special, 0.2)
        return 2.0 * kappa * s[0] - p[1] * s[1], s[0], third * s[2]

    curves = map_problem(explicit_map(3, ("e", "r"), rotation), NS, (e, 1.0), ("e", "r"))
    angle = math.acos(0.3 if at is None else at + e**2 - shallow)
    return curves, start([0.0] * 3, (e, 1.0), angle), ((-0.5, 0.5), (0.5, 1.5))


@pytest.mark.parametrize(
    "special",
    [
        SpecialKind.R2,
        SpecialKind.R3,
        SpecialKind.FOLD_NEIMARK_SACKER,
        SpecialKind.FLIP_NEIMARK_SACKER,
        SpecialKind.GENERALISED_FLIP,
        SpecialKind.CUSP,
    ],
)
@pytest.mark.parametrize("longest", [0.2, 0.1, 0.05, 0.025])
def test_special_points_passed_twice_within_a_step(special: SpecialKind, longest: float) -> None:
    """With 0.1 a step ends just on the second one.  A Neimark-Sacker curve ends at the first R2."""
    curves, begin, ranges = passed_twice(special)
    run = trace(curves, begin, CurveOptions(ranges, direction=-1, maximum_step=longest))
    assert [found.kind for found in run.specials] == [special] * 2
    assert run.result.stop is (CurveStop.RESONANCE_2 if special is SpecialKind.R2 else CurveStop.RANGE)
    wanted = np.array([0.01, -0.01])
    if special is SpecialKind.CUSP:
        places = [found.state[0] for found in run.specials]
    else:
        places = [found.parameters[0] for found in run.specials]
    assert np.allclose(places, wanted, rtol=0, atol=1e-7)
    assert not any(point.unlocated for point in run.points)
