"""Surveys into a store: numbers against Newton's method, resume, cells without a cycle, dry runs, checks."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.reading import CaseError, NamedCase, read_cases
from pipelines.case.survey_settings import survey_axes
from pipelines.datasets.exporting import planned_files, write_files
from pipelines.datasets.integrity import verify as verify_files
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import OtherConfigurationError, open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.machine_cycles import cycle_shape
from pipelines.orbits.shooting import CycleProblem, Unknowns, correct
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.reports.verify import verify
from pipelines.stages.scheduling.plan import StageStatus, plan
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.survey import line as module
from pipelines.stages.survey.cells import bifurcation_of
from pipelines.stages.survey.line import compute_line, survey_problem
from pipelines.stages.survey.onsets import first_rise, onsets
from pipelines.stages.survey.survey import plan_survey
from tests.helpers.tiny import CONFIG, PASSIVE, Watched, tiny_case
from tests.helpers.trees import compare_trees

GRID = ("survey.points=[4, 3]", "survey.ranges=[[0.5, 0.8], [0.8, 1.3]]")


def rows_of(path: Path) -> Group:
    return read_group(open_for_reading(path), "cases/smoke/survey")


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("surveyed") / "a.zarr"
    result = Watched("survey", tiny_case(*GRID), path).result
    assert result.ok
    assert result.stop_reason == "all lines are computed"
    assert result.summary["cells"] == 12
    assert 0 < result.summary["unstable"] < 12
    return path


def shot(named: NamedCase, speed: float, frequency: float) -> CycleProblem:
    """The cycles of plain shooting at a point of the plane, all columns and many time steps."""
    problem = cycle_problem(build_machine(named.case), named.case)
    parameters = parameter_vector(named.case)
    parameters[:2] = speed, frequency
    return replace(problem, parameters=parameters, parameter="speed")


def test_every_cell_is_a_cycle_of_plain_shooting(surveyed: Path) -> None:
    """Growth rate, leading multiplier, unstable multipliers, smallest film: at two corners and between."""
    rows, named = rows_of(surveyed), tiny_case(*GRID)
    machine = build_machine(named.case)
    assert np.all(rows.labels("status") == "found")
    np.testing.assert_allclose(rows["along"], [0.5, 0.6, 0.7, 0.8])
    np.testing.assert_allclose(rows["across"], [0.8, 1.05, 1.3])
    for line, cell in ((0, 0), (1, 2), (2, 3)):
        problem = shot(named, rows["across"][line], rows["along"][cell])
        start = module._resting_system(survey_problem(machine, named.case, problem.parameters), line, cell)
        assert start is not None
        guess = problem.consistent(Unknowns(start.state, 0.0, float(rows["across"][line])))
        found = correct(problem, guess, problem.fixed_parameter(guess.parameter), np.eye(machine.size), 96)
        assert found.cycle is not None
        multipliers = found.cycle.spectrum.multipliers
        assert abs(abs(rows["multiplier"][line, cell]) - abs(multipliers[0])) < 1e-3
        assert np.min(np.abs(multipliers - rows["multiplier"][line, cell])) < 1e-3
        growth = np.log(abs(multipliers[0])) / found.cycle.unknowns.period
        assert rows["growth_rate"][line, cell] == pytest.approx(growth, abs=1e-4)
        assert rows["unstable_count"][line, cell] == np.sum(np.abs(multipliers) > 1.0)
        shape = cycle_shape(machine, found.cycle.image.orbit, problem.parameters)
        assert rows["minimum_film"][line, cell] == pytest.approx(shape.film_trace.min(), abs=2e-3)


def test_kinds_follow_the_leading_multiplier(surveyed: Path) -> None:
    rows = rows_of(surveyed)
    kinds = rows.labels("bifurcation")
    for multiplier, kind in zip(rows["multiplier"].ravel(), kinds.ravel(), strict=True):
        assert kind == bifurcation_of(multiplier)
    assert "period_doubling" in kinds, "the tongue at twice the whirl frequency"
    assert "neimark_sacker" in kinds
    assert bifurcation_of(1.2 + 0j) == "fold"
    assert np.all(rows["miss"] <= 5e-4)
    assert np.all(rows["step_error"] <= 5e-4)
    assert np.all(rows["multiplier"].imag >= 0.0)


def test_lines_computed_side_by_side_leave_the_same_bytes(surveyed: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    prepare_store(path, [tiny_case(*GRID)], ["agfb", "test"])
    plan = plan_survey(tiny_case(*GRID), path, lambda progress: None, lambda: False)
    first, *ahead = plan.parts()
    assert [part.group for part in (first, *ahead)] == ["survey", "ahead/survey-0001", "ahead/survey-0002"]
    for part in (ahead[1], first, ahead[0]):
        plan.compute(part, plan.job)
    assert list(plan.parts()) == []
    assert plan.result().ok
    assert plan.job.groups("ahead") == []
    assert compare_trees(surveyed, path) == []


def test_a_line_that_two_processes_compute_is_stored_once(surveyed: Path, tmp_path: Path) -> None:
    """One has it ahead and the other in its turn, whichever ends first; also after one was killed."""
    path = tmp_path / "a.zarr"
    prepare_store(path, [tiny_case(*GRID)], ["agfb", "test"])
    plan = plan_survey(tiny_case(*GRID), path, lambda progress: None, lambda: False)
    first, second, third = plan.parts()
    plan.compute(first, plan.job)
    in_turn = next(iter(plan.parts()))  # the second line, whose group ahead is not there yet
    assert in_turn.group == "survey"
    assert in_turn.arguments == second.arguments
    plan.compute(second, plan.job)
    assert [part.arguments for part in plan.parts()] == [third.arguments], "the line ahead has taken its turn"
    plan.compute(in_turn, plan.job)
    assert plan.job.read("survey", ()).n_points == 2
    with plan.open(third.group, 1) as branch:  # committed, and killed before it ended
        branch.commit(plan.row(plan.job, third.arguments)[0])
    plan.compute(third, plan.job)
    writer = plan.open("survey", 3)  # of a process that has committed and is about to close
    threading.Timer(0.2, writer.close).start()
    assert list(plan.parts()) == []
    assert plan.result().ok
    assert compare_trees(surveyed, path) == []


@pytest.mark.parametrize("stop_after", [1, 2])
def test_a_stopped_survey_resumes_to_the_same_bytes(surveyed: Path, tmp_path: Path, stop_after: int) -> None:
    path = tmp_path / "a.zarr"
    stopped = Watched("survey", tiny_case(*GRID), path, stop_after=stop_after)
    assert stopped.result.stop_reason == "stopped on request"
    assert rows_of(path).n_points == stop_after
    assert Watched("survey", tiny_case(*GRID), path).result.ok
    assert compare_trees(surveyed, path) == []


def test_a_line_depends_on_its_number_alone(surveyed: Path) -> None:
    """What a task on any worker may compute: the last line, without those before it."""
    case = tiny_case(*GRID).case
    row = compute_line(survey_problem(build_machine(case), case, parameter_vector(case)), 2)
    rows = rows_of(surveyed)
    for name, value in row.items():
        np.testing.assert_array_equal(rows[name][2], value, err_msg=name)


def test_a_finished_survey_is_left_alone_and_other_settings_are_refused(surveyed: Path) -> None:
    again = Watched("survey", tiny_case(*GRID), surveyed)
    assert again.finished == 0
    assert again.result.ok
    with pytest.raises(OtherConfigurationError, match="harmonics"):
        Watched("survey", tiny_case(*GRID, "survey.harmonics=4"), surveyed)


def test_the_store_is_intact_and_its_lines_are_those_of_the_equations(surveyed: Path) -> None:
    findings, checked = verify(surveyed, sample=1)
    assert findings == []
    assert [(each.group, each.row, each.residual) for each in checked] == [("cases/smoke/survey", 0, 0.0)]
    assert verify_files(open_for_reading(surveyed)) == []
    assert set(rows_of(surveyed).arrays) == {spec.name for spec in KINDS["survey"].arrays}


def test_a_survey_is_exported(surveyed: Path, tmp_path: Path) -> None:
    files = write_files(planned_files(open_for_reading(surveyed), "smoke", tmp_path, "csv", full=False))
    table = next(path for path in files if path.name == "smoke-survey-line.csv").read_text()
    assert "bifurcation[0]" in table
    assert "neimark_sacker" in table


def test_onsets_lie_between_the_lines(surveyed: Path) -> None:
    rows = rows_of(surveyed)
    found = onsets(rows)
    assert found
    for onset in found:
        cell = int(np.flatnonzero(rows["along"] == onset.along)[0])
        line = int(np.searchsorted(rows["across"], onset.across))
        assert rows["growth_rate"][line - 1, cell] < 0.0 <= rows["growth_rate"][line, cell]
        assert onset.bifurcation == rows.labels("bifurcation")[line, cell]


def test_the_first_rise_is_interpolated_between_known_numbers() -> None:
    positions = np.array([1.0, 2.0, 3.0, 4.0])
    assert first_rise(positions, np.array([-1.0, -0.25, 0.75, -1.0])) == (2, pytest.approx(2.25))
    assert first_rise(positions, np.array([-1.0, np.nan, 1.0, 2.0])) is None
    assert first_rise(positions, np.array([1.0, 2.0, 3.0, 4.0])) is None


def test_speeds_without_equilibrium_and_thin_films_are_results(tmp_path: Path) -> None:
    grid = ("survey.points=[2, 2]", "survey.ranges=[[0.7, 0.8], [0.001, 1.0]]")
    thin = "continue_cycles.minimum_film=0.9"
    result = Watched("survey", tiny_case(*grid, thin), tmp_path / "a.zarr").result
    rows = rows_of(tmp_path / "a.zarr")
    assert np.all(rows.labels("status")[0] == "no_equilibrium")
    assert np.all(rows.labels("status")[1] == "thin_film")
    assert np.all(np.isnan(rows["growth_rate"][0]))
    assert np.all(np.isfinite(rows["growth_rate"][1]))
    assert result.summary["no equilibrium"] == 2
    assert "2 of 4 cells have no equilibrium" in result.advice
    assert not result.ok
    assert result.stop_reason == "no cell has a cycle"


def test_a_cell_that_is_not_found_is_followed_from_the_other_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first cell fails without a neighbour; on the way back its neighbour leads to it."""
    case = tiny_case(*GRID).case
    problem = survey_problem(build_machine(case), case, parameter_vector(case))
    plain, alone = module.forced_cycle, []

    def forced(cycles, resting, options, beside=None):  # type: ignore[no-untyped-def]
        first = cycles.parameters[1] == problem.abscissae[0]
        alone.append(first and beside is None)
        return module.NewtonStop.NON_FINITE if alone[-1] else plain(cycles, resting, options, beside)

    monkeypatch.setattr(module, "forced_cycle", forced)
    row = compute_line(problem, 0)
    assert alone == [True, False, False, False, False]
    assert np.all(row["status"] == 0)
    monkeypatch.setattr(module, "forced_cycle", lambda *arguments: module.NewtonStop.NON_FINITE)
    lost = compute_line(problem, 0)
    assert np.all(lost["status"] == KINDS["survey"].array("status").flag("no_cycle"))
    assert np.all(lost["unstable_count"] == -1)


def test_another_plane(tmp_path: Path) -> None:
    """Displacement over speed: the state at rest changes from cell to cell."""
    plane = (
        "track_curves.parameters=['speed', 'displacement']",
        "track_curves.ranges=[[0.9, 1.1], [0.1, 0.2]]",
        "survey.points=[2, 2]",
    )
    case = tiny_case(*plane)
    assert Watched("survey", case, tmp_path / "a.zarr").result.ok
    rows = rows_of(tmp_path / "a.zarr")
    assert rows.attributes["parameters"] == ["speed", "displacement"]
    assert rows.attributes["constants"]["excitation_frequency"] == 0.7
    assert len(np.unique(rows["growth_rate"])) == 4
    assert np.all(rows.labels("status") == "found")


def test_a_dry_run_knows_what_is_there(surveyed: Path, tmp_path: Path) -> None:
    def planned(named: NamedCase, path: Path) -> tuple[StageStatus, int, int | None]:
        (found,) = plan(("survey",), (named,), path)
        return found.there, found.points, found.most

    assert planned(tiny_case(*GRID), tmp_path / "none.zarr") == (StageStatus.NOTHING, 0, 3)
    assert planned(tiny_case(*GRID), surveyed) == (StageStatus.COMPLETE, 3, 3)
    finer = tiny_case("survey.points=[4, 4]", *GRID[1:])
    assert planned(finer, surveyed)[0] is StageStatus.DIFFERENT_SETTINGS
    Watched("survey", tiny_case(*GRID), tmp_path / "a.zarr", stop_after=1)
    assert planned(tiny_case(*GRID), tmp_path / "a.zarr") == (StageStatus.PARTIAL, 1, 3)


def test_the_frequency_runs_along_the_lines() -> None:
    case = tiny_case(
        "track_curves.parameters=['speed', 'excitation_frequency']",
        "track_curves.ranges=[[0.4, 1.3], [0.3, 0.9]]",
        "survey.points=[7, 5]",
    ).case
    along, across = survey_axes(case.survey, case.track_curves)
    assert (along.parameter, along.low, along.high, along.points) == ("excitation_frequency", 0.3, 0.9, 5)
    assert (across.parameter, across.low, across.high, across.points) == ("speed", 0.4, 1.3, 7)


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["survey.points=[1, 30]"], "survey.points.0"),
        (["survey.points=[40.0, 30]"], "survey.points.0"),
        (["survey.ranges=[[0.2, 0.1], [0.2, 1.0]]"], "survey.ranges.0"),
        (["survey.ranges=[[0.2, 0.9], [-0.2, 1.0]]"], "survey.ranges.1"),
        (["survey.ranges=[[0.2, 0.9], [5000, 40000]]"], "survey.ranges.1"),
        (["survey.harmonics=5"], "survey.phases"),
        (["bearings.foil={rigid=true}", "track_curves.parameters=['foil_stiffness', 'speed']"],
         "track_curves.parameters.0"),
    ],
)  # fmt: skip
def test_a_survey_that_cannot_be_is_refused(words: list[str], key: str) -> None:
    with pytest.raises(CaseError) as refused:
        read_cases(CONFIG.read_text(), CONFIG.name, words, ("survey",))
    assert [problem.key for problem in refused.value.problems] == [key]


def test_a_machine_whose_rings_rest_is_refused() -> None:
    with pytest.raises(CaseError, match="nothing depends on the excitation frequency"):
        tiny_case(config=PASSIVE, stages=("survey",))
    plane = ("track_curves.parameters=['foil_stiffness', 'speed']", "track_curves.ranges=[[1, 9], [0.5, 1]]")
    with pytest.raises(CaseError, match="the rings rest"):
        tiny_case(*plane, config=PASSIVE, stages=("survey",))
