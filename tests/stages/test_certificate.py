"""Certificates against planes whose stability is known in closed form.

A period-doubling tongue, an oval, lies across a line of Neimark-Sacker points: the cycle has one unstable
multiplier inside the oval and two above the line, so three where both are.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from pipelines.datasets.branch import write_group
from pipelines.datasets.curves import BifurcationCurve, curves_of_plane, read_curve
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.orbits.forced_cycle import ForcedCycle, Method
from pipelines.stages.certificate.agreement import (
    AGREES,
    DISAGREES,
    NOT_DECIDED,
    Judge,
    Places,
    Verdicts,
    judge_grid,
    judge_points,
)
from pipelines.stages.certificate.asked import Asked, asked_lines
from pipelines.stages.certificate.certify import _bifurcating, _grid_arrays, _point_arrays
from pipelines.stages.certificate.comparison import Comparison, membership
from pipelines.stages.certificate.crossings import UNKNOWN, Crossing, Leg, PlaneCurves, carried
from pipelines.stages.certificate.summary import Summary
from tests.helpers.curves import PLANE, Path2, curve_rows, empty_store, oval

NAMES = ("excitation_frequency", "speed")
KINDS = ("period_doubling", "neimark_sacker", "fold")
CENTRE, RADII, LINE = (1.1, 0.85), (0.35, 0.25), 0.97


def curve(
    path: Path2, ends: tuple[float, float], kind: str, unstable: object, points: int = 60, turns: int = 1
) -> BifurcationCurve:
    rows = curve_rows(path, ends, points)
    place = np.column_stack([rows[name] for name in NAMES])
    rows |= {"unstable_count": np.array([unstable(*p) if callable(unstable) else unstable for p in place])}
    found = read_curve("x", rows, {"bifurcation": kind, "parameters": list(NAMES), "turns": turns})
    assert found is not None
    return found


def inside(f: np.ndarray | float, speed: np.ndarray | float) -> np.ndarray:
    return np.hypot((f - CENTRE[0]) / RADII[0], (np.asarray(speed) - CENTRE[1]) / RADII[1]) < 1.0


def number(f: np.ndarray | float, speed: np.ndarray | float) -> np.ndarray:
    """Unstable multipliers in closed form."""
    return inside(f, speed) * 1 + (np.asarray(speed) > LINE) * 2


def tongue() -> BifurcationCurve:
    return curve(
        oval(*CENTRE, *RADII), (0.0, 2.0 * np.pi), "period_doubling", lambda f, speed: 2 * (speed > LINE)
    )


def line() -> BifurcationCurve:
    def path(a: np.ndarray) -> np.ndarray:
        return np.column_stack([a, LINE + 0.0 * a])

    return curve(path, PLANE[0], "neimark_sacker", lambda f, speed: int(inside(f, speed)))


def places(
    along: np.ndarray, across: np.ndarray, found: np.ndarray, missing: str = "period_doubling"
) -> Places:
    """The nearest multiplier is one of the curve that is left out."""
    nearest = np.full(found.shape, -1.1 if missing == "period_doubling" else 1.1j, dtype=complex)
    return Places(along, across, found, nearest)


def grid(cells: int = 19, lines: int = 14, missing: str = "period_doubling") -> Places:
    along, across = np.linspace(*PLANE[0], cells), np.linspace(*PLANE[1], lines)
    return places(along, across, number(*np.meshgrid(along, across)), missing)


def judge(*curves: BifurcationCurve, **more: object) -> Judge:
    return Judge(PlaneCurves(curves), 0, **({"kinds": KINDS} | more))


@pytest.mark.parametrize("size", [(19, 14), (7, 5), (40, 31)])
def test_all_curves_explain_every_cell_and_every_point(size: tuple[int, int]) -> None:
    found = judge_grid(judge(tongue(), line()), grid(*size))
    assert found.cells.number(AGREES) == size[0] * size[1]
    assert found.pairs(DISAGREES) == found.pairs(NOT_DECIDED) == 0
    assert found.pairs(AGREES) == size[0] * (size[1] - 1) + size[1] * (size[0] - 1)
    drawn = np.array(PLANE)[:, 0] + np.ptp(PLANE, axis=1) * np.random.default_rng(3).random((500, 2))
    points = places(*drawn.T, number(*drawn.T))
    told = judge_points(judge(tongue(), line()), grid(*size), points)
    np.testing.assert_array_equal(told.verdict, AGREES)
    np.testing.assert_array_equal(told.expected, points.found)


def test_the_cells_of_a_tongue_without_a_curve_disagree() -> None:
    """A small one lies in one cell; of a large one its rim. Expected is what there would be without it."""
    cells = grid()
    rim = inside(*np.meshgrid(cells.along, cells.across))
    cells.found[:] = rim
    within = rim[1:-1, 1:-1] & rim[:-2, 1:-1] & rim[2:, 1:-1] & rim[1:-1, :-2] & rim[1:-1, 2:]
    rim[1:-1, 1:-1] &= ~within
    found = judge_grid(judge(), cells).cells
    np.testing.assert_array_equal(found.verdict == DISAGREES, rim)
    np.testing.assert_array_equal(found.expected, np.where(rim, 0, cells.found))
    single = replace(cells, found=np.zeros_like(cells.found))
    single.found[5, 9] = 1
    alone = judge_grid(judge(), single)
    assert np.argwhere(alone.cells.verdict == DISAGREES).tolist() == [[5, 9]]
    assert alone.pairs(DISAGREES) == 4
    single.found[:], single.found[5, 9] = 2, 0
    island = judge_grid(judge(), replace(single, nearest=np.full(single.found.shape, 1.1j)))
    assert np.argwhere(island.cells.verdict == DISAGREES).tolist() == [[5, 9]], "a stable one among unstable"


def test_a_curve_that_is_not_there_disagrees_too() -> None:
    cells = replace(grid(), found=np.zeros((14, 19), dtype=int))
    assert judge_grid(judge(tongue()), cells).pairs(DISAGREES) > 0


def test_a_path_passes_a_curve_only_with_the_number_beside_it() -> None:
    """From u to u + m and back; a cycle with another number cannot meet the curve."""
    across = judge(tongue(), line()).curves.crossings(Leg(0, 1.1, 0.3, 0.7))
    assert [crossing.curve.bifurcation for crossing in across] == ["period_doubling"]
    (crossing,) = across
    assert crossing.position == pytest.approx(0.6, abs=1e-5)
    assert carried(0, across) == {1}
    assert carried(1, across) == {0}
    assert carried(2, across) == frozenset()
    through = judge(tongue(), line()).curves.crossings(Leg(0, 1.1, 0.3, 1.3))
    assert [crossing.curve.bifurcation for crossing in through] == [
        "period_doubling", "neimark_sacker", "period_doubling",
    ]  # fmt: skip
    assert carried(0, through) == {2}
    assert carried(2, through[::-1]) == {0}
    back = judge(tongue(), line()).curves.crossings(Leg(0, 1.1, 1.3, 0.3))
    assert [each.position for each in back] == [each.position for each in through[::-1]]


def test_both_directions_of_a_curve_are_passed_once_where_they_begin() -> None:
    """A line meets a curve exactly where the search started it; so do lines through the ends of an oval."""
    angles = (0.3, 1.2)
    halves = [curve(oval(*CENTRE, *RADII), ends, "period_doubling", 0) for ends in (angles, (0.3, -1.2))]
    start = halves[0].points[0]
    for axis in (0, 1):
        leg = Leg(axis, float(start[axis]), float(start[1 - axis]) - 0.01, float(start[1 - axis]) + 0.01)
        met = PlaneCurves(halves).crossings(leg)
        assert carried(0, met) == {1}
    closed = tongue()
    assert carried(0, PlaneCurves([closed]).crossings(Leg(1, CENTRE[1], 1.1, 1.6))) == {1}
    others = [halves[0], replace(halves[1], bifurcation="neimark_sacker")]
    leg = Leg(0, float(start[0]), float(start[1]) - 0.01, float(start[1]) + 0.01)
    assert len(PlaneCurves(others).crossings(leg)) == 2


def test_curves_meet_a_path_with_an_error_of_fourth_order() -> None:
    """The oval is stored in points: the crossing converges like the cubics between them."""
    beside = np.linspace(-0.25, 0.25, 41)
    exact = CENTRE[1] - RADII[1] * np.sqrt(1.0 - (beside / RADII[0]) ** 2)
    errors = []
    for points in (17, 33, 65):
        coarse = curve(oval(*CENTRE, *RADII), (0.0, 2.0 * np.pi), "period_doubling", 0, points)
        curves = PlaneCurves([coarse])
        met = [curves.crossings(Leg(0, float(CENTRE[0] + each), 0.3, CENTRE[1])) for each in beside]
        errors.append(np.max(np.abs([one.position for (one,) in met] - exact)))
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 3.5)


def test_curves_of_doubled_cycles_are_not_counted(tmp_path: object) -> None:
    rows = curve_rows(oval(*CENTRE, *RADII), (0.0, 6.0), 20)
    attributes = {"bifurcation": "period_doubling", "parameters": list(NAMES)}
    groups = [
        Group(f"cases/a/pd/c00{turns}", "curve", attributes | {"turns": turns}, rows) for turns in (1, 2)
    ]
    assert [found.name for found in curves_of_plane(groups, NAMES)] == ["pd/c001"]
    assert curves_of_plane(groups, NAMES[::-1]) == ()


def test_curves_of_coexisting_cycles_are_not_counted() -> None:
    """A tongue of a cycle that the survey does not show: its crossings belong to another one."""
    cells = replace(grid(), found=np.zeros((14, 19), dtype=int))
    others = judge(tongue(), belongs=lambda crossing: False)
    assert judge_grid(others, cells).cells.number(AGREES) == cells.found.size
    unknown = judge_grid(judge(tongue(), belongs=lambda crossing: None), cells)
    assert unknown.pairs(NOT_DECIDED) > 0
    assert unknown.pairs(DISAGREES) == 0


def test_the_angle_of_a_curve_is_known_between_its_rows_alone() -> None:
    """Where it changes by 1 rad from row to row, any angle between those of the rows is critical."""
    found = replace(line(), angle=np.where(np.arange(60) < 30, 0.5, 1.5))
    place = 0.5 * float(found.arclength[29] + found.arclength[30])
    assert found.angles_around(place) == (0.5, 1.5)
    assert found.angles_around(float(found.arclength[-1])) == (1.5, 1.5)

    def belongs(multiplier: complex) -> bool | None:
        spectrum = SimpleNamespace(multipliers=np.array([multiplier, multiplier.conjugate(), 0.1]))
        cycle = ForcedCycle(SimpleNamespace(spectrum=spectrum), Method.NEWTON, 0.0)  # type: ignore[arg-type]
        folds = replace(found, name="fold", bifurcation="fold")
        return membership([found, folds], NAMES, lambda along, across: cycle)(Crossing(found, place, 0.0))

    assert belongs(np.exp(0.8j))
    assert belongs(np.exp(1.45j))
    assert not belongs(np.exp(1.6j))
    assert not belongs(1.05 * np.exp(0.8j))
    assert membership([found], NAMES, lambda along, across: None)(Crossing(found, place, 0.0))


def test_behind_a_fold_any_number_may_be_found() -> None:
    """Such pairs are not decided, unless nothing changes: then the fold is one of other cycles."""
    fold = replace(tongue(), bifurcation="fold")
    unchanged = replace(grid(), found=np.zeros((14, 19), dtype=int))
    assert judge_grid(judge(fold), unchanged).pairs(AGREES) == 14 * 18 + 13 * 19
    jumping = replace(unchanged, found=3 * inside(*np.meshgrid(unchanged.along, unchanged.across)))
    found = judge_grid(judge(fold), jumping)
    assert found.pairs(DISAGREES) == 0
    assert found.pairs(NOT_DECIDED) > 0


def test_only_what_was_asked_for_can_disagree() -> None:
    without = judge_grid(judge(line(), kinds=("neimark_sacker", "fold")), grid())
    assert without.pairs(DISAGREES) == 0
    assert without.pairs(NOT_DECIDED) > 0


def test_boundaries_alone_are_compared_where_only_they_were_traced() -> None:
    """The parts of both curves between unstable cycles lack; the others explain where cycles are stable."""
    cells = grid()
    angle = np.arcsin((LINE - CENTRE[1]) / RADII[1])
    below = curve(oval(*CENTRE, *RADII), (np.pi - angle, 2.0 * np.pi + angle), "period_doubling", 0)
    assert judge_grid(judge(below, line()), cells).pairs(DISAGREES) > 0
    bounded = judge_grid(judge(below, line(), boundaries=True), cells)
    assert bounded.cells.number(AGREES) == cells.found.size
    lacking = judge_grid(judge(line(), boundaries=True), cells).cells
    rows = np.argwhere(lacking.verdict == DISAGREES)[:, 0]
    assert len(rows) > 0
    assert np.all(cells.across[rows] < LINE)


def test_unknown_numbers_are_not_decided() -> None:
    cells = grid()
    cells.found[3, 4] = UNKNOWN
    found = judge_grid(judge(tongue(), line()), cells)
    assert found.cells.verdict[3, 4] == NOT_DECIDED
    assert found.pairs(NOT_DECIDED) == 4
    assert found.cells.number(AGREES) == cells.found.size - 1


def test_a_patch_gets_a_line_along_either_parameter_through_its_middle() -> None:
    cells = grid()
    verdict = np.full(cells.found.shape, AGREES)
    verdict[2:5, 7:10] = verdict[10, 2] = verdict[11, 3] = (
        DISAGREES  # cells that share a corner are one patch
    )
    points = places(np.array([cells.along[8], 0.3]), np.array([cells.across[5], 1.3]), np.zeros(2, dtype=int))
    at_points = Verdicts(points.found, np.full(2, DISAGREES))
    chosen = (NAMES, cells, Verdicts(cells.found, verdict), points, at_points)
    lines = asked_lines(*chosen, ())
    assert len(lines) == 6, "two patches, and the point that is not beside one"
    assert Asked("excitation_frequency", cells.across[3]) in lines
    assert Asked("speed", cells.along[8]) in lines
    assert Asked("speed", 0.3) in lines
    assert Asked("excitation_frequency", 1.3) in lines
    assert asked_lines(*chosen, lines[:5]) == lines[5:]


def test_random_points_bound_the_share_of_the_plane_that_disagrees() -> None:
    """With a larger share so few points would disagree in 5 % of all draws only (Clopper and Pearson)."""
    cells = grid()
    agreeing = judge_grid(judge(tongue(), line()), cells)

    def compared(at_points: Verdicts) -> Comparison:
        return Comparison(NAMES, cells, cells, agreeing, at_points)

    for wrong in (0, 3):
        verdict = np.array([DISAGREES] * wrong + [AGREES] * (97 - wrong) + [NOT_DECIDED] * 3)
        numbers = compared(Verdicts(verdict, verdict)).numbers()
        assert binom.cdf(wrong, 97, numbers["share_at_most"]) == pytest.approx(0.05)
        assert numbers["certified"] is (wrong == 0)
    nothing = Verdicts(*[np.full(5, NOT_DECIDED)] * 2)
    assert compared(nothing).share_at_most == 1.0


def test_a_stored_certificate_names_every_place_that_disagrees(tmp_path: object) -> None:
    store = empty_store(tmp_path / "a.zarr", "a")  # type: ignore[operator]
    cells, points = grid(), places(np.array([1.1, 0.3]), np.array([0.8, 0.3]), np.array([1, 0]))
    told = Comparison.of(judge(line()), NAMES, cells, points)
    told.at_points.verdict[0], told.at_points.expected[0] = DISAGREES, UNKNOWN
    arrays = _grid_arrays(told) | _point_arrays(told)
    attributes = {"parameters": list(NAMES), "resolution": list(told.resolution), **told.numbers()}
    write_group(store, "cases/a/certificate/verified", "certificate", arrays, attributes)
    found = Summary.stored(read_group(store, "cases/a/certificate/verified"))
    assert not found.certified
    assert found.cells.agreeing + found.cells.disagreeing == cells.found.size
    assert len(found.disagreements) == found.cells.disagreeing + 1
    assert {each.kind for each in found.disagreements} == {"period_doubling"}
    *_, last = found.as_dict()["disagreements"]
    assert last == {"excitation_frequency": 1.1, "speed": 0.8, "found": 1, "expected": None,
                    "kind": "period_doubling", "random": True}  # fmt: skip
    expected = f"do not explain the stability of {found.cells.disagreeing} cells and 1 random points"
    assert found.sentence().startswith("not certified on cells of 0.1 x 0.0923: the curves")
    assert expected in found.sentence()
    assert found.cells.percent == pytest.approx(100.0 * found.cells.agreeing / cells.found.size)


def test_a_curve_counts_as_far_as_its_rows_are_critical() -> None:
    """Behind R2 a pair on the unit circle becomes mu and 1/mu: a neutral saddle."""
    rows = curve_rows(oval(*CENTRE, *RADII), (0.0, 3.0), 5)
    rows["angle"] = np.array([3.0, 3.1, np.pi, np.pi, np.pi])
    pairs = [np.exp(1j * angle) for angle in (3.0, 3.1)] + [-1.01, -1.2, -1.4]
    rows["multipliers"] = np.array([[mu, 1.0 / mu, np.nan] for mu in pairs])
    kept = _bifurcating(Group("cases/a/ns/c000", "curve", {}, rows))
    assert len(kept["angle"]) == len(kept["speed"]) == 3


def test_the_place_of_a_crossing_is_on_its_curve() -> None:
    found = tongue()
    (arclength, _) = found.where(0, 1.2)
    crossing = Crossing(found, float(arclength), float(found.at(arclength)[1]))
    assert crossing.place == pytest.approx([1.2, crossing.position])
    assert not crossing.is_fold
