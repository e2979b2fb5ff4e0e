"""Curves of a large system in a slow subspace: the same as with the whole space, for few passes."""

from __future__ import annotations

import csv
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveState, CurveStop, SpecialKind
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.bifurcations.switching import joined_curve
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, ShootingOptions, Unknowns, correct
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.curve_runs import FLIP, NS, CountingMap, Run, start, trace
from tests.bifurcations.embedded_tondl import embedded_tondl

REFERENCE = Path(__file__).parents[1] / "reference"
TABLE = csv.DictReader((REFERENCE / "tondl_verified_points.csv").read_text().splitlines())
ROWS = {(row["kind"], float(row["eta"])): row for row in TABLE}
KINDS = {"NS": NS, "PD": FLIP}
CROWD = 28
FULL = BasisOptions(initial_columns=4 + CROWD, maximum_columns=4 + CROWD)
SLOW = BasisOptions(initial_columns=12)


def problem(
    kind: str,
    feedback: float,
    basis: BasisOptions = SLOW,
    formulation: CurveFormulation = CurveFormulation.BORDERED,
    counting: bool = False,
) -> CurveProblem:
    options = ShootingOptions(tolerance=1e-11, multiplier_tolerance=1e-10, basis=basis)
    make = CountingMap if counting else PeriodMap
    period_map = make(embedded_tondl(CROWD), DOPRI8, samples=32, minimum_steps=32)
    parameters = np.array([0.0, 0.0, feedback])
    return CurveProblem(period_map, KINDS[kind], parameters, ("c1", "eta"), options, formulation)


def run_to(curves: CurveProblem, begin, target: float, **more) -> Run:  # type: ignore[no-untyped-def]
    eta = begin.parameters[1]
    low, high = sorted((target, eta + 0.02 * np.sign(eta - target)))
    options = CurveOptions(
        ((-0.1, 0.2), (low, high)),
        **({"parameter_scales": (0.05, 0.5), "normal_form": None} | more),  # type: ignore[arg-type]
    )
    return trace(curves, begin, options)


TONDL = PeriodMap(embedded_tondl(0), DOPRI8, samples=32, minimum_steps=32)


def tabulated_small(kind: str, eta: float):  # type: ignore[no-untyped-def]
    begin = tabulated(kind, eta)
    return replace(begin, state=begin.state[:4])


def tabulated(kind: str, eta: float):  # type: ignore[no-untyped-def]
    row = ROWS[kind, eta]
    state = np.concatenate([[float(row[f"u{i}_at_phase0"]) for i in range(1, 5)], np.zeros(CROWD)])
    return start(state, (float(row["c1"]), eta), float(row["theta"]))


@pytest.mark.slow
@pytest.mark.parametrize("formulation", list(CurveFormulation))
@pytest.mark.parametrize(
    ("kind", "eta", "target", "direction"),
    [("NS", 3.05, 3.15, -1), ("NS", 3.15, 3.05, 1), ("PD", 2.5, 2.4, 1)],
)
def test_the_crowd_changes_nothing_without_feedback(
    kind: str, eta: float, target: float, direction: int, formulation: CurveFormulation
) -> None:
    curves = problem(kind, 0.0, formulation=formulation)
    run = run_to(curves, tabulated(kind, eta), target, direction=direction, maximum_step=0.1)
    assert run.result.stop is CurveStop.RANGE
    assert run.points[-1].cycle.basis.shape[1] < 30
    assert run.points[-1].parameters[1] == target
    assert run.points[-1].parameters[0] == pytest.approx(float(ROWS[kind, target]["c1"]), abs=1e-8)
    assert run.points[-1].angle == pytest.approx(float(ROWS[kind, target]["theta"]), abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "eta"), [("PD", 2.5), ("NS", 3.05)])
def test_slow_subspace_and_formulations_agree_with_feedback(kind: str, eta: float) -> None:
    """Same end of the range, same c1: slow or whole space, bordered or extended."""
    first = run_to(problem(kind, 0.05), tabulated(kind, eta), eta - 0.4, max_points=1)
    at = first.points[0]
    begin = start(at.cycle.unknowns.state, tuple(at.parameters), at.angle)
    ends, forms = [], []
    for basis in (SLOW, FULL):
        for formulation in CurveFormulation:
            curves = problem(kind, 0.05, basis, formulation)
            run = run_to(
                curves, begin, begin.parameters[1] - 0.015, maximum_step=0.1, normal_form=NormalFormOptions()
            )
            assert run.result.stop is CurveStop.RANGE
            ends.append(run.points[-1].parameters[0])
            forms.append(run.points[-1].normal_form)
    assert np.max(np.abs(np.array(ends) - ends[0])) < 1e-8
    coefficients = np.array([form.coefficient for form in forms])
    assert np.max(np.abs(coefficients - coefficients[-1])) < 1e-6


def cost(passes: list[int]) -> float:
    """In passes with the slow basis: one with few columns costs about half as much."""
    return float(sum(1.0 if columns > 8 else 0.5 for columns in passes))


@pytest.mark.parametrize(("kind", "eta", "direction"), [("PD", 2.5, 1), ("NS", 3.05, -1)])
def test_a_point_costs_at_most_four_cycle_corrections(kind: str, eta: float, direction: int) -> None:
    options = ShootingOptions(basis=SLOW)
    curves = replace(problem(kind, 0.0, counting=True), options=options)
    passes = curves.period_map.passes  # type: ignore[attr-defined]
    marks: list[int] = []
    settings = CurveOptions(
        ((-0.1, 0.2), (2.0, 4.0)),
        direction=direction,
        max_points=12,
        parameter_scales=(0.05, 0.5),
        normal_form=None,
    )
    run = trace(curves, tabulated(kind, eta), settings, should_stop=lambda: marks.append(len(passes)))
    per_point = [cost(passes[a:b]) for a, b in itertools.pairwise(marks[3:])]
    # a cycle in the plane across the branch, from the same predictor and to the same tolerance
    corrections = []
    for before, after in zip(run.states[3:-1], run.points[4:], strict=True):
        cycles = CycleProblem(curves.period_map, after.cycle.parameters, "c1", options)
        guess = before.position.plus(before.tangent, before.step)
        first = len(passes)
        unknowns = Unknowns(guess.state, guess.period, float(guess.parameters[0]))
        correction = correct(
            cycles, unknowns, cycles.fixed_parameter(after.parameters[0]), before.basis, before.steps
        )
        assert correction.cycle is not None
        corrections.append(cost(passes[first:]))
    assert np.mean(per_point) <= 4.0 * np.mean(corrections)


@pytest.mark.slow
def test_special_points_are_sharp_in_the_slow_subspace() -> None:
    """R2 and generalised flip of the oval: their tests need left vectors, which V gives only roughly.

    The differences of the generalised flip have other steps here, because the crowd moves further.
    """
    settings = CurveOptions(
        ((-0.1, 0.2), (2.3, 2.45)),
        direction=-1,
        parameter_scales=(0.05, 0.5),
        maximum_step=0.1,
        max_points=20,
    )
    small = trace(replace(problem("PD", 0.0), period_map=TONDL), tabulated_small("PD", 2.4), settings)
    large = trace(problem("PD", 0.0), tabulated("PD", 2.4), settings)
    assert [special.kind for special in large.specials] == [special.kind for special in small.specials]
    assert len(large.specials) == 2
    for one, other in zip(large.specials, small.specials, strict=True):
        tolerance = 1e-9 if one.kind is SpecialKind.R2 else 1e-7
        assert np.allclose(one.parameters[:2], other.parameters[:2], rtol=0, atol=tolerance)


def test_restart_in_a_slow_subspace_gives_the_same_bits() -> None:
    settings = CurveOptions(
        ((-0.1, 0.2), (2.0, 4.0)), parameter_scales=(0.05, 0.5), normal_form=None, max_points=6
    )
    curves = problem("NS", 0.0)
    whole = trace(curves, tabulated("NS", 3.05), settings)
    half = CurveState.from_arrays({name: np.copy(v) for name, v in whole.states[2].arrays().items()})
    rest = trace(curves, half, settings)
    for old, new in zip(whole.states[3:], rest.states, strict=True):
        for name, value in old.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(new.arrays()[name]).tobytes(), name


@pytest.mark.slow
@pytest.mark.parametrize("formulation", list(CurveFormulation))
def test_unknown_period_in_a_slow_subspace(formulation: CurveFormulation) -> None:
    """The same end with the same normal form as in the stroboscopic formulation."""
    stroboscopic = problem("NS", 0.0, formulation=formulation)
    period_map = replace(stroboscopic.period_map, formulation=Formulation.AUTONOMOUS)
    curves = replace(stroboscopic, period_map=period_map)
    known, settings = tabulated("NS", 3.05), {"direction": -1, "maximum_step": 0.1}
    begin = replace(known, state=period_map.extend(known.state), period=2.0 * np.pi / 3.05)
    run = run_to(curves, begin, 3.15, normal_form=NormalFormOptions(), **settings)
    forced = run_to(stroboscopic, known, 3.15, normal_form=NormalFormOptions(), **settings)
    form, expected = run.points[-1].normal_form, forced.points[-1].normal_form
    assert form is not None
    assert expected is not None
    assert abs(form.coefficient - expected.coefficient) < 1e-6
    assert run.result.stop is CurveStop.RANGE
    assert run.points[-1].cycle.basis.shape[1] < period_map.size
    assert run.points[-1].parameters[0] == pytest.approx(float(ROWS["NS", 3.15]["c1"]), abs=1e-8)


@pytest.mark.parametrize("formulation", list(Formulation))
def test_folds_in_a_slow_subspace(formulation: Formulation) -> None:
    """The fold curve that meets the Neimark-Sacker curve at R1, with the crowd and without."""
    settings = CurveOptions(
        ((0.03, 0.07), (0.55, 0.65)), parameter_scales=(0.05, 0.5), maximum_step=0.1, normal_form=None
    )
    small_map = replace(TONDL, samples=64, minimum_steps=64)
    small = replace(problem("NS", 0.0), period_map=small_map)
    arc = trace(small, tabulated_small("NS", 0.64), replace(settings, direction=-1))
    joined = joined_curve(small, arc.specials[-1])
    assert joined is not None
    alone = trace(*joined, settings)
    assert alone.result.stop is CurveStop.RANGE
    period_map = PeriodMap(embedded_tondl(CROWD), DOPRI8, formulation, samples=64, minimum_steps=64)
    at = alone.points[1].cycle
    state = relaxed(replace(period_map, formulation=Formulation.STROBOSCOPIC), at)
    begin = start(period_map.extend(state), tuple(alone.points[1].parameters), period=at.unknowns.period)
    together = trace(replace(joined[0], period_map=period_map), begin, settings)
    assert together.result.stop is CurveStop.RANGE
    assert together.points[-1].cycle.basis.shape[1] < period_map.size
    assert np.allclose(together.parameters[-1], alone.parameters[-1], rtol=0, atol=1e-8)


def relaxed(period_map: PeriodMap, alone: Cycle) -> np.ndarray:
    """The cycle of the small system with a crowd that follows it."""
    crowd = np.zeros(CROWD)
    for _ in range(12):
        state = np.concatenate([alone.unknowns.state, crowd])
        crowd = period_map.evaluate(state, alone.parameters, alone.unknowns.period, 64).state[4:]
    return np.concatenate([alone.unknowns.state, crowd])
