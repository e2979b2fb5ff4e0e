"""A search that asks for a certificate finds a tongue that none of its lines meets."""

from __future__ import annotations

import json
import random
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zarr
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.case.reading import CaseError
from pipelines.datasets.integrity import verify as verify_files
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.figures.drawing import draw_figures
from pipelines.machine.assembly import parameter_vector
from pipelines.stages.certificate import certify as module
from pipelines.stages.certificate.comparison import membership
from pipelines.stages.certificate.crossings import Crossing
from pipelines.stages.curves import bifurcation_set as search
from pipelines.stages.curves.lines import Line, line_groups
from pipelines.stages.curves.outlook import outlook
from pipelines.stages.job import Job
from pipelines.stages.reports.operating_range import set_cautions
from pipelines.stages.results import StageResult
from pipelines.stages.scheduling import campaign
from pipelines.stages.scheduling.agenda import Agenda, Chain, Work
from pipelines.stages.scheduling.plan import StageStatus, plan
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.survey.line import survey_problem
from tests.helpers.tiny import PASSIVE, Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

# Lines at the frequencies 0.70 and 0.80, a tongue of period doublings between 0.81 and 0.88.
HIDDEN = (
    "excitation.displacement=0.1",
    "track_curves.ranges=[[0.7, 0.9], [0.8, 0.93]]",
    "track_curves.maximum_step=0.05",
    "track_curves.normal_forms=false",
    "bifurcation_set.frequencies=1",
    "bifurcation_set.speeds=0",
    "bifurcation_set.resonances=false",
    "bifurcation_set.max_rounds=2",
    "bifurcation_set.certify=true",
    "survey.points=[9, 4]",
)
SET = "bifurcation_set"


@pytest.fixture(scope="module", autouse=True)
def _few_points() -> object:
    patch = pytest.MonkeyPatch()
    patch.setattr(module, "POINTS", 8)
    yield
    patch.undo()


def group(path: Path, name: str) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/{name}")


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("certified") / "a.zarr"
    watched = Watched(SET, tiny_case(*HIDDEN), path)
    assert watched.result.ok, watched.result.advice
    work = [progress.work for progress in watched.reported]
    assert all(done >= 0.0 and 0.0 <= least <= most for done, least, most in work)
    assert work[-1][0] > work[0][0]
    return path


def test_a_tongue_that_no_line_meets_is_found(searched: Path) -> None:
    for name in ("cycles/s000", "cycles/s001"):
        assert group(searched, name).n_events == 0
    first, last = (group(searched, f"certificate/r00{number}") for number in (0, 1))
    assert first.attributes["curves"] == []
    assert first.attributes["cells_disagreeing"] > 0
    assert not first.attributes["certified"]
    assert last.attributes["certified"]
    assert last.attributes["cells_agreeing"] > 0.8 * 36
    assert last.attributes["curves"] == ["pd/c000", "pd/c001"]
    np.testing.assert_array_equal(last["point_found"], first["point_found"])
    found = group(searched, SET)
    asked = first["asked_fixed"].tolist()
    assert found["line_fixed"][2:].tolist() == asked
    assert found["line_round"].tolist() == [0, 1, *[2] * len(asked)]
    assert found.attributes["complete"] is True
    assert found.attributes["certificate"] == "certificate/r001"
    assert found.attributes["resolution"] == pytest.approx([0.025, 0.13 / 3.0])
    assert group(searched, "cycles/sc000").attributes["fixed"] == {"speed": pytest.approx(asked[0])}
    assert "certified on cells of 0.025 x 0.0433" in found.attributes["covered"]
    assert verify_files(searched) == []


def test_an_interrupted_search_resumes_to_the_same_bytes(searched: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    for stop in (3, 22, 9, 4):  # on a line, among the random points, on a curve, ...
        stopped = Watched(SET, tiny_case(*HIDDEN), path, stop_after=stop)
        assert stopped.result.stop_reason == "stopped on request"
    assert Watched(SET, tiny_case(*HIDDEN), path).result.ok
    assert compare_trees(searched / "cases", path / "cases") == []
    assert Watched(SET, tiny_case(*HIDDEN), path).reported == []


@pytest.mark.parametrize("workers", [2, 7])
def test_any_number_of_workers_leaves_the_same_bytes(
    searched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    """So many pieces of work have begun at any time, and end in an order that was drawn."""
    monkeypatch.setattr(campaign, "Event", lambda name: SimpleNamespace(is_set=lambda: False))
    path, case = tmp_path / "a.zarr", tiny_case(*HIDDEN)
    prepare_store(path, [case], ["agfb", "test"])
    agenda, drawn = Agenda([Chain(case, [SET])]), random.Random(workers)
    begun: list[Work] = []
    results: list[StageResult] = []
    while agenda.chains:
        while len(begun) < workers and (work := agenda.begin_next()) is not None:
            begun.append(work)
        work = begun.pop(drawn.randrange(len(begun)))
        answer = campaign.carry_out(work.message(path), str(path), lambda progress: None, lambda: False)
        results += [result for _, result in agenda.end(work, answer)]
    assert all(result.ok for result in results), results
    assert compare_trees(searched / "cases", path / "cases") == []


def test_a_curve_counts_where_the_cycle_found_has_its_critical_multiplier(searched: Path) -> None:
    """Where folds let cycles coexist this tells whose curve it is: not that of the cycle beside a curve."""
    named = tiny_case(*HIDDEN)
    job = Job.of("test", named, searched, lambda progress: None, lambda: False)
    problem = survey_problem(job.machine, job.case, parameter_vector(job.case))
    (own, *_) = module.stored_curves(job)
    other = replace(own, name="pd/other", points=own.points - [0.12, 0.0])
    belongs = membership(
        [own, other, replace(own, bifurcation="fold")],
        (problem.along.parameter, problem.across.parameter),
        module._cycles(job, problem),
    )
    places = [(curve, 0.5 * float(curve.arclength[-1])) for curve in (own, other)]
    assert [belongs(Crossing(curve, place, 0.0)) for curve, place in places] == [True, False]


def test_what_remains_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Places that disagree and get no line leave the search incomplete."""
    monkeypatch.setattr(search, "stored_lines", lambda certificate: [])
    path = tmp_path / "a.zarr"
    result = Watched(SET, tiny_case(*HIDDEN), path).result
    assert result.ok
    assert "not certified on cells of 0.025 x 0.0433: the curves do not explain the stability of" in (
        result.stop_reason
    )
    found = group(path, SET).attributes
    assert (found["complete"], found["certificate"]) == (False, "certificate/r000")
    assert any("not certified" in told for told in set_cautions(found))


def test_verify_compares_the_plane(searched: Path, tmp_path: Path) -> None:
    """A search that called itself complete without a certificate; then the certified one."""
    path = tmp_path / "a.zarr"
    plain = tiny_case(*HIDDEN, "bifurcation_set.certify=false")
    result = Watched(SET, plain, path).result
    assert "met no new curve" in result.stop_reason
    done = CliRunner().invoke(app, ["verify", str(path), "--plane", "--json", "--sample", "0"])
    assert done.exit_code == ExitCode.STORE
    told = json.loads(done.stdout)["certificates"]["smoke"]
    assert not told["certified"]
    assert {each["kind"] for each in told["disagreements"]} == {"period_doubling"}
    assert all(each["found"] == 1 and each["expected"] == 0 for each in told["disagreements"])
    assert all(0.8 < each["excitation_frequency"] < 0.9 for each in told["disagreements"])
    assert compare_trees(searched / "cases/smoke/survey", path / "cases/smoke/survey") == []
    shown = CliRunner().invoke(app, ["verify", str(path), "--plane", "--sample", "0"])
    assert shown.exit_code == ExitCode.STORE
    assert "curve likely missing" in shown.stdout
    whole = CliRunner().invoke(app, ["verify", str(searched), "--plane", "--sample", "1"])
    assert whole.exit_code == ExitCode.DONE, whole.output
    assert "smoke: certified on cells of 0.025 x 0.0433" in whole.stdout
    assert not (searched / "cases/smoke/certificate/verified").exists(), (
        "that of the search is of the same curves"
    )
    assert [file.name for file in draw_figures(path, tmp_path, kinds=("certificate",))] == ["certificate.png"]


def test_a_changed_curve_gets_a_certificate_of_its_own(searched: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(searched, tmp_path / "a.zarr"))
    for half in ("c000", "c001"):
        stored = zarr.open_array(path / f"cases/smoke/pd/{half}/excitation_frequency", mode="r+")
        stored[:] = stored[:] - 0.05
    done = CliRunner().invoke(app, ["verify", str(path), "--plane", "--json", "--sample", "0"])
    assert done.exit_code == ExitCode.STORE
    assert json.loads(done.stdout)["certificates"]["smoke"]["pairs"]["disagreeing"] > 0


def test_a_plane_without_excitation_has_no_certificate(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    prepare_store(path, [tiny_case(config=PASSIVE)], ["agfb", "test"])
    done = CliRunner().invoke(app, ["verify", str(path), "--plane", "--json", "--sample", "0"])
    assert done.exit_code == ExitCode.DONE
    assert "cannot be surveyed" in json.loads(done.stdout)["certificates"]["passive"]["reason"]


def test_a_certificate_needs_a_plane_that_can_be_surveyed() -> None:
    with pytest.raises(CaseError, match=r"survey\.ranges"):
        tiny_case(*HIDDEN, "survey.ranges=[[-0.1, 0.9], [0.8, 0.9]]", stages=(SET,))


def test_the_time_left_is_a_range(searched: Path, tmp_path: Path) -> None:
    case = tiny_case(*HIDDEN)
    (fresh,) = plan([SET], [case], tmp_path / "none.zarr")
    assert fresh.least_seconds is not None
    assert fresh.seconds is not None
    assert 0.0 < fresh.least_seconds < fresh.seconds
    assert "2 to 4 lines" in fresh.note
    (ended,) = plan([SET], [case], searched)
    assert (ended.there, ended.seconds) == (StageStatus.COMPLETE, 0.0)
    uncertified = tmp_path / "a.zarr"
    Watched(SET, tiny_case(*HIDDEN, "bifurcation_set.certify=false"), uncertified)
    (begun,) = plan([SET], [case], uncertified)
    assert begun.there is StageStatus.PARTIAL


def test_what_a_search_took_was_foreseen(searched: Path) -> None:
    """The work that a finished search has done lies between the least and the most told before."""
    plan_of = search.plan_bifurcation_set(tiny_case(*HIDDEN), searched, lambda progress: None, lambda: False)
    names = plan_of.job.groups("cycles", "pd", "survey")
    groups = {name: plan_of.job.read(name, ()).attributes for name in names}
    before, after = outlook(plan_of.job.case, {}), outlook(plan_of.job.case, groups)
    assert before.done == 0.0
    assert before.least <= after.done <= before.most
    assert after.least == 0.0


def test_lines_of_certificates_are_numbered_by_themselves() -> None:
    """More rounds may come later: their lines get the names that they always have."""
    lines = [Line("speed", 0.5, 0), Line("speed", 0.6, 1, asked=True), Line("speed", 0.7, 2)]
    assert line_groups(lines) == ["cycles/s000", "cycles/sc000", "cycles/s001"]
