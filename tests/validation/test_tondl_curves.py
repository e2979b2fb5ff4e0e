"""Bifurcation curves of Tondl's system through every verified point, to their codimension-two ends.

Three tables of tests/reference: points, special points and normal forms.  A curve whose range ends at the
forcing frequency of a tabulated point lands exactly there, so that the other numbers can be compared.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveResult,
    CurveStart,
    CurveState,
    CurveStop,
    SpecialKind,
    SpecialPoint,
    TongueSide,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.bifurcations.switching import joined_curve
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.systems import tondl

REFERENCE = Path(__file__).parents[1] / "reference"
KINDS = {"NS": EventKind.NEIMARK_SACKER, "PD": EventKind.PERIOD_DOUBLING}
TOLERANCE = 1e-8  # what the tables are good for
EVERYWHERE = ((-0.1, 0.2), (0.4, 4.2))
SCALES = (0.05, 0.5)


def table(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((REFERENCE / f"tondl_{name}.csv").read_text().splitlines()))


POINTS = {(row["kind"], float(row["eta"])): row for row in table("verified_points")}
SPECIAL = table("codim2")
FORMS = table("normal_forms")


def problem(
    kind: str,
    formulation: CurveFormulation = CurveFormulation.BORDERED,
    period: Formulation = Formulation.STROBOSCOPIC,
) -> CurveProblem:
    options = ShootingOptions(tolerance=1e-12, multiplier_tolerance=1e-10)
    period_map = PeriodMap(tondl(), DOPRI8, period)
    return CurveProblem(period_map, KINDS[kind], np.zeros(2), ("c1", "eta"), options, formulation)


def state_of(row: dict[str, str]) -> np.ndarray:
    return np.array([float(row[f"u{i}_at_phase0"]) for i in range(1, 5)])


def start_at(kind: str, eta: float) -> CurveStart:
    row = POINTS[kind, eta]
    return CurveStart(state_of(row), (float(row["c1"]), eta), angle=float(row["theta"]))


def trace(
    curves: CurveProblem, start: CurveStart, ranges: tuple[tuple[float, float], tuple[float, float]], **more
) -> tuple[CurveResult, list[CurvePoint], list[SpecialPoint]]:  # type: ignore[no-untyped-def]
    points: list[CurvePoint] = []
    specials: list[SpecialPoint] = []
    settings = {"maximum_step": 0.1, "parameter_scales": SCALES, "normal_form": None} | more
    result = continue_curve(
        curves,
        start,
        CurveOptions(ranges, **settings),
        lambda point, state, found: (points.append(point), specials.extend(found)),  # type: ignore[func-returns-value]
    )
    return result, points, specials


# start and target on the same arc, with the initial sense of c1 that leads there
ARCS = [
    ("NS", 0.76, 0.72, 1),
    ("NS", 0.72, 0.76, -1),
    ("NS", 0.72, 0.68, 1),
    ("NS", 0.68, 0.64, -1),
    ("NS", 0.84, 0.88, -1),
    ("NS", 0.98, 0.84, 1),
    ("NS", 0.88, 0.98, -1),
    ("NS", 1.45, 1.35, 1),
    ("NS", 1.35, 1.45, -1),
    ("NS", 1.45, 1.55, -1),
    ("NS", 1.55, 2.0, -1),
    ("NS", 3.15, 3.05, 1),
    ("NS", 3.05, 2.7, 1),
    ("NS", 3.05, 3.15, -1),
    ("NS", 3.15, 3.8, -1),
    ("PD", 2.5, 2.4, 1),
    ("PD", 2.4, 2.5, -1),
]


def between(start: float, target: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """A range of eta that ends at the target and leaves room behind the start."""
    room = start + 0.05 * np.sign(start - target)
    return ((-0.1, 0.2), (min(room, target), max(room, target)))


@pytest.mark.parametrize(("kind", "start", "target", "direction"), ARCS)
@pytest.mark.parametrize("formulation", list(CurveFormulation))
def test_curves_pass_through_every_row(
    kind: str, start: float, target: float, direction: int, formulation: CurveFormulation
) -> None:
    curves, ranges = problem(kind, formulation), between(start, target)
    result, points, _ = trace(curves, start_at(kind, start), ranges, direction=direction)
    assert result.stop is CurveStop.RANGE
    end, row = points[-1], POINTS[kind, target]
    assert end.parameters[1] == target
    assert end.parameters[0] == pytest.approx(float(row["c1"]), abs=TOLERANCE)
    assert end.angle == pytest.approx(float(row["theta"]), abs=TOLERANCE)
    assert np.allclose(end.cycle.unknowns.state, state_of(row), rtol=0, atol=TOLERANCE)
    for text in row["multipliers_forced_system"].split(";"):
        assert np.min(np.abs(end.cycle.spectrum.multipliers - complex(text))) < TOLERANCE


@pytest.mark.parametrize("formulation", list(CurveFormulation))
def test_unknown_period_gives_the_same_curve(formulation: CurveFormulation) -> None:
    """Eq. 17 instead of the stroboscopic map."""
    period_map = PeriodMap(tondl(), DOPRI8, Formulation.AUTONOMOUS)
    curves = replace(problem("NS", formulation), period_map=period_map)
    known = start_at("NS", 3.05)
    begin = replace(known, state=period_map.extend(known.state), period=2.0 * np.pi / 3.05)
    result, points, _ = trace(curves, begin, between(3.05, 3.15), direction=-1)
    assert result.stop is CurveStop.RANGE
    row = POINTS["NS", 3.15]
    assert points[-1].parameters[0] == pytest.approx(float(row["c1"]), abs=TOLERANCE)
    assert points[-1].angle == pytest.approx(float(row["theta"]), abs=TOLERANCE)
    assert points[-1].cycle.unknowns.period == pytest.approx(2.0 * np.pi / 3.15, abs=TOLERANCE)


def test_a_range_may_end_at_zero() -> None:
    """No digit of zero limits how near to it a parameter is: without a tolerance another step follows."""
    result, points, _ = trace(problem("NS"), start_at("NS", 2.7), ((0.0, 0.2), (2.6, 3.2)), direction=-1)
    assert result.stop is CurveStop.RANGE
    first, last = (point.parameters for point in points[-2:])
    assert abs(last[0]) < 1e-13
    assert np.max(np.abs(first - last) / SCALES) > 1e-3


def test_every_row_is_a_target() -> None:
    assert {(kind, target) for kind, _, target, _ in ARCS} == set(POINTS)


@pytest.mark.parametrize("period", list(Formulation))
@pytest.mark.parametrize("row", FORMS, ids=lambda row: f"{row['kind']}-{row['eta']}")
def test_normal_forms(row: dict[str, str], period: Formulation) -> None:
    """The table was made with differences of one order; its column fd_change says how much they moved."""
    curves, start = problem(row["kind"], period=period), start_at(row["kind"], float(row["eta"]))
    start = replace(
        start, state=curves.period_map.extend(start.state), period=2.0 * np.pi / float(row["eta"])
    )
    _, points, _ = trace(curves, start, EVERYWHERE, max_points=1, normal_form=NormalFormOptions())
    form = points[0].normal_form
    assert form is not None
    expected = complex(float(row["re_coeff"]), float(row["im_coeff"]))
    assert abs(form.coefficient - expected) < min(1e-6, float(row["fd_change"]))
    assert form.error < 1e-4
    assert form.supercritical == (row["criticality"] == "supercritical")


# the arcs between the tabulated special points, each traced from one tabulated point in both directions
@pytest.fixture(scope="module")
def neimark_sacker_arcs() -> dict[float, list[tuple[CurveStop, list[SpecialPoint]]]]:
    arcs: dict[float, list[tuple[CurveStop, list[SpecialPoint]]]] = {}
    for eta in (0.72, 0.88, 1.55, 3.05):
        arcs[eta] = []
        for direction in (1, -1):
            result, _, specials = trace(
                problem("NS"), start_at("NS", eta), EVERYWHERE, direction=direction, step=0.1
            )
            arcs[eta].append((result.stop, specials))
    return arcs


@pytest.mark.slow
def test_special_points(neimark_sacker_arcs: dict[float, list[tuple[CurveStop, list[SpecialPoint]]]]) -> None:
    found = [
        special
        for arc in neimark_sacker_arcs.values()
        for _, specials in arc
        for special in specials
        if special.tongue is not TongueSide.FAR  # another arc ends there
    ]
    for row in SPECIAL:
        same = [
            special
            for special in found
            if special.kind.name == row["kind"]
            and np.allclose(special.parameters, [float(row["c1"]), float(row["eta"])], rtol=0, atol=TOLERANCE)
        ]
        assert len(same) == 1, row
        assert np.allclose(same[0].state, state_of(row), rtol=0, atol=TOLERANCE)


def test_neimark_sacker_arcs_end_at_resonances(
    neimark_sacker_arcs: dict[float, list[tuple[CurveStop, list[SpecialPoint]]]],
) -> None:
    """At eta = 0.82 two arcs end 0.0004 apart on one tiny period-doubling oval, within a single long step."""
    ends = {
        eta: {
            stop: [each for each in specials if each.tongue is not TongueSide.FAR][-1].parameters[1]
            for stop, specials in arc
            if specials
        }
        for eta, arc in neimark_sacker_arcs.items()
    }
    assert ends[0.72].keys() == {CurveStop.RESONANCE_1, CurveStop.RESONANCE_2}
    assert ends[0.88][CurveStop.RESONANCE_2] - ends[0.72][CurveStop.RESONANCE_2] == pytest.approx(
        0.82054382 - 0.82014896, abs=1e-8
    )
    assert ends[1.55][CurveStop.RESONANCE_2] == pytest.approx(2.376866561164, abs=TOLERANCE)
    assert ends[3.05][CurveStop.RESONANCE_2] == pytest.approx(2.502502126, abs=TOLERANCE)


@pytest.mark.parametrize("direction", [1, -1])
def test_oval_is_traced_once(direction: int) -> None:
    result, points, specials = trace(
        problem("PD"), start_at("PD", 2.5), EVERYWHERE, direction=direction, normal_form=NormalFormOptions()
    )
    assert result.stop is CurveStop.CLOSED
    assert np.allclose(points[-1].parameters, points[0].parameters, rtol=0, atol=1e-10)
    # seen from inside, the chords turn by one full circle
    offsets = np.array([(point.parameters - [0.03, 2.44]) / SCALES for point in points])
    angles = np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0]))
    assert abs(angles[-1] - angles[0]) == pytest.approx(2.0 * np.pi, abs=1e-6)
    assert sorted(special.kind.name for special in specials) == [
        "GENERALISED_FLIP",
        "GENERALISED_FLIP",
        "R2",
        "R2",
    ]


def test_a_curve_that_is_in_a_loop_ends_after_one_turn() -> None:
    """The start is not on the loop: what looks like a curve that came into it from elsewhere."""
    states: list[CurveState] = []
    options = CurveOptions(EVERYWHERE, maximum_step=0.1, parameter_scales=SCALES, normal_form=None)

    def record(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        states.append(state)

    closed = continue_curve(problem("PD"), start_at("PD", 2.5), options, record)
    assert closed.stop is CurveStop.CLOSED
    once, elsewhere = len(states), states[2].start_parameters + 1.0
    states = states[2:3]
    going_on = replace(states[0], start_parameters=elsewhere)
    again = continue_curve(problem("PD"), going_on, options, record)
    assert (again.stop, again.message) == (CurveStop.TRACED, "it runs along itself")
    assert abs(len(states) - once) <= 3


@pytest.mark.slow
def test_curves_are_joined_at_the_strong_resonances() -> None:
    """Over R2 round the oval and out on the next Neimark-Sacker curve; over R1 to the fold curve."""
    curves = problem("NS")
    _, _, specials = trace(curves, start_at("NS", 2.0), EVERYWHERE, direction=-1)
    assert specials[-1].kind is SpecialKind.R2
    joined = joined_curve(curves, specials[-1])
    assert joined is not None
    oval, start = joined
    assert oval.kind is EventKind.PERIOD_DOUBLING
    result, _, on_oval = trace(oval, start, EVERYWHERE)
    assert result.stop is CurveStop.CLOSED
    resonances = [special for special in on_oval if special.kind is SpecialKind.R2]
    assert len(resonances) == 2
    (other,) = [special for special in resonances if special.parameters[1] > 2.5]
    back = joined_curve(oval, other)
    assert back is not None
    result, points, found = trace(*back, EVERYWHERE)
    assert result.stop is CurveStop.RANGE
    assert points[-1].parameters[1] == 4.2
    assert [special.kind for special in found] == [SpecialKind.R3]
    assert joined_curve(curves, found[0]) is None
    _, _, specials = trace(curves, start_at("NS", 0.64), EVERYWHERE, direction=-1)
    assert specials[-1].kind is SpecialKind.R1
    joined = joined_curve(curves, specials[-1])
    assert joined is not None
    folds, start = joined
    _, _, on_fold = trace(folds, start, ((0.0, 0.08), (0.4, 4.2)))
    assert SpecialKind.CUSP in {special.kind for special in on_fold}
