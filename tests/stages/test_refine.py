"""`--refine`: bifurcations on finer grids, their orders and errors, resume, and what cannot be refined."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurvePoint, CurveStart, CurveState, SpecialPoint
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.plane import CurveProblem
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase, read_cases
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.branch import open_branch
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import OtherConfigurationError, open_for_reading, open_for_writing
from pipelines.machine.assembly import build_machine
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.refinement import levels as refine_levels
from pipelines.stages.refinement.levels import (
    BOUND,
    GRID_TOO_LARGE,
    NOT_CONVERGED,
    OTHER_BIFURCATION,
    REFINED,
    UNSUPPORTED,
    Grid,
    Refinement,
    build_level,
    estimate,
    formal_order,
    grid_family,
    refine_point,
)
from pipelines.stages.refinement.points import StoredPoint, stored_points
from pipelines.stages.refinement.refine import plan_refine
from tests.helpers.tiny import CONFIG, Watched, tiny_case
from tests.helpers.trees import compare_trees
from tests.machines import case as reconstruction

pytestmark = pytest.mark.slow

# Neimark-Sacker speed of configs/smoke.toml: 1.2126721 on 96 x 4 and 1.2129437 on 144 x 4, extrapolated with
# the formal order 2 to 1.21316.
CONVERGED_SPEED = 1.21316
# Grids and time steps that cost little; the time steps leave 1e-4 in the multipliers.
CHEAP = ("refine.factors=[1.25, 1.5]", "numerics.multiplier_tolerance=1e-4")


def refinement(path: Path, case_id: str = "smoke") -> Group:
    return read_group(open_for_reading(path), f"cases/{case_id}/refinement")


def points_of(path: Path, per_curve: int = 1) -> list[StoredPoint]:
    return stored_points(open_for_reading(path), "smoke", per_curve)


def write_curve(path: Path, case: NamedCase, group: str, direction: int) -> None:
    """A short Neimark-Sacker curve from the event of the branch, with what is read of a curve."""
    machine = build_machine(case.case)
    problem = cycle_problem(machine, case.case)
    (event,) = points_of(path)[:1]
    names = ("excitation_frequency", "speed")
    curves = CurveProblem(problem.period_map, event.kind, event.parameters, names, problem.options)
    first, second = (float(event.parameters[PARAMETERS.index(name)]) for name in names)
    start = CurveStart(event.state, (first, second), event.period, event.angle)
    ranges = ((0.5, 0.9), (1.0, 1.4))
    found: list[tuple[CurvePoint, CurveState]] = []

    def record(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        found.append((point, state))

    options = CurveOptions(ranges, direction=direction, max_points=3, normal_form=None)
    continue_curve(curves, start, options, record)
    attributes = {
        "bifurcation": "neimark_sacker", "parameters": list(names), "ranges": [list(r) for r in ranges],
        "turns": 1, "half": 0 if direction > 0 else 1,
    }  # fmt: skip
    sizes = {"point": 3, "component": machine.size, "free": 2}
    with open_branch(
        open_for_writing(path), f"cases/smoke/{group}", "curve", sizes, {}, attributes
    ) as branch:
        for point, state in found:
            row = {name: np.zeros(array.row_shape, array.spec.dtype) for name, array in branch.arrays.items()}
            row = {name: row[name] for name in row if branch.arrays[name].role == "row"}
            row |= dict(zip(PARAMETERS, point.cycle.parameters, strict=True))
            row |= {
                "period": state.period, "state": state.state, "arclength": state.arclength,
                "parameter_tangent": state.tangent_parameters, "angle": point.angle,
                "steps_per_period": np.int32(state.steps),
            }  # fmt: skip
            branch.commit(row, {"basis_columns": np.int32(0)})
        branch.finish("maximum_points")


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny machine's Neimark-Sacker point, and a curve through it in both directions."""
    path, case = tmp_path_factory.mktemp("traced") / "a.zarr", tiny_case(*CHEAP)
    assert Watched("continue_cycles", case, path).result.ok
    write_curve(path, case, "ns/c000", 1)
    write_curve(path, case, "ns/c001", -1)
    return path


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory, traced: Path) -> Path:
    """The same with its refinement."""
    path = tmp_path_factory.mktemp("refined") / "a.zarr"
    shutil.copytree(traced, path)
    result = Watched("refine", tiny_case(*CHEAP, "refine.points_per_curve=1"), path).result
    assert result.ok
    assert result.summary["refined"] == result.summary["points"] == 3
    return path


def test_the_extrapolated_speed_is_nearer_to_that_of_a_fine_grid(tmp_path: Path) -> None:
    """24 x 2 with 36 x 2, 54 x 2 and 24 x 4: thirty times nearer (68 times was measured), as is claimed."""
    overrides = ("continue_cycles.start=1.19", "continue_cycles.range=[1.19, 1.21]")
    (case,) = read_cases(CONFIG.read_text(), CONFIG.name, overrides)
    path = tmp_path / "a.zarr"
    Watched("continue_cycles", case, path)
    assert Watched("refine", case, path).result.summary["refined"] == 1
    group = refinement(path)
    row = {name: group.labels(name)[0] for name in group.arrays if not name.startswith("level_")}
    assert (row["source"], row["bifurcation"]) == ("cycles", "neimark_sacker")
    assert (row["held"], row["free"]) == ("excitation_frequency", "speed")
    assert group["level_circumferential"].tolist() == [24, 36, 54, 24]
    assert group["level_axial"].tolist() == [2, 2, 2, 4]
    assert group["level_unknowns"].tolist() == [166, 238, 346, 258]
    assert abs(row["value"] - CONVERGED_SPEED) > 30.0 * abs(row["richardson"] - CONVERGED_SPEED)
    # what is said of the errors holds
    assert row["error"] == pytest.approx(abs(row["value"] - CONVERGED_SPEED), rel=0.05)
    assert abs(row["richardson"] - CONVERGED_SPEED) < row["richardson_error"] < 0.1 * row["error"]
    assert 2.0 < row["observed_order"] < 3.0
    # the time steps leave 1e-6 in the multipliers, of which one moves by 0.3 per unit of the speed
    assert row["step_error"] < 1e-5
    assert row["axial_error"] == pytest.approx(2.4e-4, rel=0.1)
    assert np.all(np.diff(group["level_value"][0, :3]) > 0.0)
    assert np.ptp(group["level_angle"][0]) < 0.01


def test_points_of_branches_and_curves(refined: Path) -> None:
    """The event, then of each half its middle: their first points are the event again."""
    group = refinement(refined)
    places = list(zip(group.labels("source"), group["source_number"], group["source_index"], strict=True))
    ns = "neimark_sacker_points"
    assert places == [("cycles", 0, 0), (ns, 0, 1), (ns, 1, 1)]
    assert verify(refined) == []
    for row, point in enumerate(points_of(refined)):
        for name, value in zip(PARAMETERS, point.parameters, strict=True):
            assert group[name][row] == value
        held = PARAMETERS.index(str(group.labels("held")[row]))
        assert PARAMETERS[held] == "excitation_frequency"
        assert group["value"][row] == point.value == group["speed"][row]
        assert group["error"][row] == abs(group["value"][row] - group["richardson"][row])
        assert group["level_steps"][row, 0] == 2 * point.steps
        # the stored grid with finer steps gives the stored value again
        assert 0.0 < abs(group["level_value"][row, 0] - point.value) < 1e-3
    assert group["excitation_frequency"][1] > 0.7 > group["excitation_frequency"][2]


def test_a_refinement_goes_on_with_the_same_bytes(tmp_path: Path, traced: Path, refined: Path) -> None:
    """After more points were asked for, after an interruption, and where another process was ahead.

    Never again, and never on other grids.
    """
    path = tmp_path / "a.zarr"
    none, one = (tiny_case(*CHEAP, f"refine.points_per_curve={count}") for count in (0, 1))
    shutil.copytree(traced, path)
    assert Watched("refine", none, path).result.summary["points"] == 1, "both curves start at the event"
    plan = plan_refine(one, path, lambda progress: None, lambda: False)
    *_, last = plan.parts()
    plan.compute(last, plan.job)
    assert plan.job.groups("ahead") == [last.group]
    stopped = Watched("refine", one, path, stop_after=1)
    assert (stopped.result.stop_reason, stopped.finished) == ("stopped on request", 1)
    assert (stopped.reported[-1].done, stopped.reported[-1].total) == (2, 3)
    resumed = Watched("refine", one, path)
    assert resumed.reported == []
    assert compare_trees(refined, path) == []
    for case in (none, one):
        again = Watched("refine", case, path)
        assert again.reported == []
        assert again.result == resumed.result
    with pytest.raises(OtherConfigurationError, match="request is"):
        Watched("refine", tiny_case(*CHEAP, "refine.factors=[1.5, 2.0]"), path)


def test_without_bifurcations_there_is_nothing_to_do(tmp_path: Path) -> None:
    result = Watched("refine", tiny_case(), tmp_path / "a.zarr").result
    assert result.ok
    assert result.stop_reason == "no bifurcation is stored"


def test_the_family_of_grids() -> None:
    central = reconstruction((40, 3))
    assert [(g.circumferential, g.axial) for g in grid_family(central)] == [
        (40, 3),
        (60, 3),
        (90, 3),
        (40, 5),
    ]
    paper = reconstruction((40, 4), numerics={"scheme": "backward", "axial_scheme": "uniform"})
    assert [(g.circumferential, g.axial) for g in grid_family(paper)] == [(40, 4), (60, 6), (90, 9)]
    assert formal_order(central) == 2
    assert formal_order(paper) == 1
    fourth = reconstruction((24, 3), numerics={"scheme": "fourth_order"})
    assert formal_order(fourth) == 4
    mixed = reconstruction((24, 3), numerics={"scheme": "fourth_order", "axial_scheme": "uniform"})
    assert formal_order(mixed) == 2
    close = reconstruction((8, 1), refine={"factors": (1.01, 1.02)})
    assert [g.circumferential for g in grid_family(close)] == [8, 9, 10, 8]


def test_cycles_of_more_excitation_periods(traced: Path) -> None:
    """A simple cycle is one of two periods too, with the squares of its multipliers: twice the angle."""
    case = tiny_case(*CHEAP).case
    source, level, point = build_machine(case), build_level(case, Grid(16, 1)), points_of(traced)[0]
    assert point.angle is not None
    angle = abs(2.0 * point.angle - 2.0 * np.pi)
    twice = replace(point, turns=2, period=2.0 * point.period, steps=2 * point.steps, angle=angle)
    once, found = (refine_point(source, [level], one) for one in (point, twice))
    assert found.values[0] == pytest.approx(once.values[0], abs=1e-8)
    assert found.angles[0] == pytest.approx(abs(2.0 * once.angles[0] - 2.0 * np.pi), abs=1e-7)


def test_failures_are_results_with_reasons(refined: Path) -> None:
    """Each way to fail, on the first of two levels; the values found before it are kept."""
    case = tiny_case(*CHEAP).case
    source, (point, *_) = build_machine(case), points_of(refined)
    stored = build_level(case, Grid(16, 1))
    large = build_level(case, Grid(1024, 32))
    assert large.machine is None
    found = refine_point(source, [stored, large], point)
    assert (found.status, found.failed_level) == (GRID_TOO_LARGE, 1)
    assert abs(found.values[0] - point.value) < 1e-3
    assert np.isnan(found.values[1])
    assert found.steps.tolist() == [2 * point.steps, -1]
    assert point.angle is not None
    for changed, status, reason in (
        ({"angle": point.angle + 0.5}, OTHER_BIFURCATION, "the angle changes"),
        ({"state": point.state + 10.0}, NOT_CONVERGED, ""),
        ({"state": point.state[:-1]}, UNSUPPORTED, "the state has"),
        ({"held": "speed"}, UNSUPPORTED, "two different parameters"),
    ):
        found = refine_point(source, [stored], replace(point, **changed))
        assert (found.status, found.failed_level) == (status, 0)
        assert reason in found.reason
        known = estimate(point.value, [stored.grid], found, 2)
        assert known.status == status
        assert np.isnan(known.error)


def test_a_failure_is_a_row(tmp_path: Path, traced: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No angle is near enough: the point keeps a row that says so, and the case is well."""
    path = tmp_path / "a.zarr"
    shutil.copytree(traced, path)
    monkeypatch.setattr(refine_levels, "SAME_PAIR", -1.0)
    told = Watched("refine", tiny_case(*CHEAP, "refine.points_per_curve=0"), path)
    assert told.result.ok
    assert told.result.summary == {"points": 1, "other bifurcation": 1}
    group = refinement(path)
    assert group.labels("status").tolist() == ["other_bifurcation"]
    assert group["failed_level"].tolist() == [0]
    assert np.all(np.isnan(group["error"]))
    assert "the angle changes" in told.reported[-1].message


def test_without_a_clean_order_the_largest_difference_is_a_bound() -> None:
    grids = [Grid(24, 2), Grid(36, 2), Grid(54, 2), Grid(24, 4)]
    steps = np.full(4, 90, dtype=np.int32)
    scattered = Refinement(np.array([1.1, 1.103, 1.101, 1.0995]), np.zeros(4), steps, REFINED, -1)
    known = estimate(1.1001, grids, scattered, 2)
    assert known.status == BOUND
    assert known.error == pytest.approx(0.0029)
    assert known.step_error == pytest.approx(1e-4)
    h = 1.0 / np.array([24.0, 36.0, 54.0])
    clean = Refinement(
        np.append(1.1 + 2.0 * h**2, 1.1 + 2.0 * h[0] ** 2 + 0.001), np.zeros(4), steps, REFINED, -1
    )
    known = estimate(float(clean.values[0]), grids, clean, 2)
    assert known.status == REFINED
    assert known.richardson == pytest.approx(1.101, abs=1e-12), "the axial part is added"
    assert known.axial_error == pytest.approx(0.001)
    assert known.richardson_error == pytest.approx(0.0005)


def test_steps_that_the_user_fixed_are_doubled_on_every_grid() -> None:
    fixed: Case = reconstruction((16, 1), numerics={"steps_per_period": 40})
    level = build_level(fixed, Grid(20, 1))
    assert level.problem is not None
    assert level.problem.period_map.steps_per_period == 80
    chosen = build_level(reconstruction((16, 1)), Grid(20, 1))
    assert chosen.problem is not None
    assert chosen.problem.options.step_tolerance == pytest.approx(1e-7)
