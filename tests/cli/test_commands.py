"""What the commands say and return, from configuration to store, with stages that do as they are told."""

from __future__ import annotations

import errno
import json
import math
import os
import shlex
import signal
from pathlib import Path

import pytest

from agfb_cli.errors import ExitCode
from pipelines.case.reading import NamedCase
from pipelines.datasets.store import CorruptedError
from pipelines.stages.results import StageResult
from tests.cli.conftest import Program, succeed

CHAIN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")


def test_the_chain_runs_every_stage_on_every_case(program: Program, three: Path) -> None:
    done = program("run", "three.toml")
    assert done.exit_code == ExitCode.DONE
    stages = [stage for stage, _ in program.computed]
    assert stages == [stage for stage in CHAIN for _ in range(3)]
    assert len({case for _, case in program.computed}) == 3
    assert "instability speed 1.0778" in done.stdout
    assert "results are in build/three.zarr" in done.stderr


@pytest.mark.parametrize(
    ("command", "stage"),
    [
        ("linearize", "linearize"),
        ("criticals", "criticals"),
        ("continue-cycles", "continue_cycles"),
        ("continue", "continue_cycles"),
    ],
)
def test_each_command_runs_its_stage(program: Program, smoke: Path, command: str, stage: str) -> None:
    assert program(command, "smoke.toml").exit_code == ExitCode.DONE
    assert program.computed == [(stage, "smoke")]


@pytest.mark.parametrize("kind", ["pd", "ns", "folds"])
def test_curves_follow_the_branch_that_they_start_from(program: Program, smoke: Path, kind: str) -> None:
    assert program(f"track-{kind}", "smoke.toml").exit_code == ExitCode.DONE
    assert program.computed == [("continue_cycles", "smoke"), (f"track_{kind}", "smoke")]


def test_tori_follow_the_branch_that_they_are_born_on_and_need_none_with_unbalance(
    program: Program, smoke: Path
) -> None:
    assert program("continue-tori", "smoke.toml").exit_code == ExitCode.DONE
    assert program.computed == [("continue_cycles", "smoke"), ("continue_tori", "smoke")]
    driven = ("--set", "continue_tori.origin=unbalance", "--set", "unbalance.planes=[{node=2, moment=0.1}]")
    planned = program("continue-tori", "smoke.toml", *driven, "--dry-run")
    assert "continue-tori" in planned.stdout
    assert "continue-cycles" not in planned.stdout
    refused = program("continue-tori", "smoke.toml", *driven[:2])
    assert refused.exit_code == ExitCode.USAGE
    assert "needs the table [unbalance]" in refused.stderr
    assert len(program.computed) == 2


def test_a_refinement_follows_the_stages_of_all_cases(program: Program, three: Path) -> None:
    assert program("continue", "three.toml", "--refine").exit_code == ExitCode.DONE
    assert [stage for stage, _ in program.computed] == ["continue_cycles"] * 3 + ["refine"] * 3
    planned = program("run", "three.toml", "--refine", "--dry-run")
    assert planned.stdout.count(" refine ") == 3
    refused = program("linearize", "three.toml", "--refine")
    assert refused.exit_code == ExitCode.USAGE
    assert len(program.computed) == 6


def test_the_chain_without_figures(program: Program, smoke: Path) -> None:
    assert program("run", "smoke.toml", "--no-figures").exit_code == ExitCode.DONE
    assert not (program.folder / "build" / "smoke-figures").exists()
    assert "No such option" in program("linearize", "smoke.toml", "--no-figures").stderr


def test_the_time_of_several_cases_is_told(program: Program, three: Path) -> None:
    several = program("linearize", "three.toml")
    assert "all 3" in several.stderr
    assert "took 0 s" in several.stderr
    document = json.loads(program("linearize", "three.toml", "--json").stdout)
    assert set(document["seconds"]["cases"]) == {"stiffness=5", "stiffness=10", "stiffness=20"}
    assert "took" not in program("linearize", "three.toml", "--case", "*=5").stderr


def test_a_single_figure_goes_to_a_file(program: Program, smoke: Path) -> None:
    program("linearize", "smoke.toml")
    done = program("figures", "build/smoke.zarr", "-o", "a.svg", "--figure", "machine")
    assert done.stdout == "a.svg\n"
    assert (program.folder / "a.svg").is_file()
    for words, told in (
        (["-o", "a.svg", "--format", "png"], "a.svg says another one"),
        (["-o", "b.svg", "--figure", "tree"], "no figure"),
    ):
        refused = program("figures", "build/smoke.zarr", *words)
        assert refused.exit_code == ExitCode.USAGE
        assert told in refused.stderr
    assert not (program.folder / "b.svg").exists()


def test_results_as_json(program: Program, smoke: Path) -> None:
    done = program("linearize", "smoke.toml", "--json", "-o", "a.zarr")
    (result,) = json.loads(done.stdout)["results"]
    assert result["stage"] == "linearize"
    assert result["summary"] == {"instability_speed": 1.0778}


def test_the_chain_prints_one_json_document(program: Program, smoke: Path) -> None:
    document = json.loads(program("run", "smoke.toml", "--json").stdout)
    assert tuple(result["stage"] for result in document["results"]) == CHAIN
    # The stages of this test write nothing: the machine is all that can be drawn.
    assert document["figures"] == ["build/smoke-figures/smoke/machine.png"]


def test_a_glob_chooses_cases_and_the_store_holds_all(program: Program, three: Path) -> None:
    first = program("linearize", "three.toml", "--case", "*=5*")
    assert first.exit_code == ExitCode.DONE
    assert len(program.computed) == 1
    # The other cases can follow later in the same store.
    assert program("linearize", "three.toml").exit_code == ExitCode.DONE
    assert len(program.computed) == 4


def test_a_glob_that_matches_nothing_names_the_cases(program: Program, three: Path) -> None:
    done = program("linearize", "three.toml", "--case", "none*")
    assert done.exit_code == ExitCode.USAGE
    assert "stiffness=5" in done.stderr
    assert not (program.folder / "build").exists()


def test_a_dry_run_writes_nothing(program: Program, three: Path) -> None:
    done = program("run", "three.toml", "--dry-run")
    assert done.exit_code == ExitCode.DONE
    for stage in CHAIN:
        assert done.stdout.count(f" {stage.replace('_', '-')} ") == 3
    assert program.computed == []
    assert not (program.folder / "build").exists()


def test_a_dry_run_refuses_what_the_run_would_refuse(program: Program, smoke: Path) -> None:
    assert program("linearize", "smoke.toml").exit_code == ExitCode.DONE
    words = ["linearize", "smoke.toml", "--dry-run", "--set", "excitation.displacement=0.1"]
    done = program(*words)
    assert done.exit_code == ExitCode.STORE
    assert "excitation.displacement" in done.stderr
    assert program(*words, "--force").exit_code == ExitCode.DONE
    assert len(program.computed) == 1


def test_one_failed_case_does_not_sink_the_others(program: Program, three: Path) -> None:
    def fail_second(case: NamedCase) -> StageResult:
        if len(program.computed) == 2:
            return StageResult(case.case_id, False, "no equilibrium", "raise the lowest speed")
        return succeed(case)

    program.behaviour = fail_second
    done = program("linearize", "three.toml")
    assert done.exit_code == ExitCode.CASES_FAILED
    assert len(program.computed) == 3
    assert "failed: no equilibrium" in done.stderr
    assert "raise the lowest speed" in done.stderr
    assert "1 of 3 results failed" in done.stderr
    assert done.stdout.count("instability speed") == 2


@pytest.mark.parametrize("traceback", [False, True])
def test_an_exception_in_a_case_is_a_failed_result(program: Program, three: Path, traceback: bool) -> None:
    def divide(case: NamedCase) -> StageResult:
        raise ZeroDivisionError("nothing to divide")

    program.behaviour = divide
    done = program("linearize", "three.toml", *(["--traceback"] if traceback else []))
    assert done.exit_code == ExitCode.CASES_FAILED
    assert len(program.computed) == 3
    assert "unexpected ZeroDivisionError: nothing to divide" in done.stderr
    assert "please report" in done.stderr
    assert ("Traceback (most recent call last)" in done.stderr) is traceback


def test_a_damaged_group_fails_its_case_with_the_code_of_a_store(program: Program, three: Path) -> None:
    def damaged(case: NamedCase) -> StageResult:
        if len(program.computed) == 1:
            raise CorruptedError("the checksum does not hold", "Remove this file", "cases/a/linear")
        return succeed(case)

    program.behaviour = damaged
    done = program("linearize", "three.toml")
    assert done.exit_code == ExitCode.STORE
    assert len(program.computed) == 3
    assert "the checksum does not hold" in done.stderr


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), MemoryError()])
def test_what_no_case_survives_ends_the_run(program: Program, three: Path, error: Exception) -> None:
    def exhausted(case: NamedCase) -> StageResult:
        raise error

    program.behaviour = exhausted
    done = program("linearize", "three.toml")
    assert done.exit_code == ExitCode.RESOURCES
    assert len(program.computed) == 1


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_says_how_to_go_on(program: Program, three: Path, number: int, code: int) -> None:
    def interrupt(case: NamedCase) -> StageResult:
        os.kill(os.getpid(), number)
        return succeed(case)

    program.behaviour = interrupt
    words = ["run", "three.toml", "--force", "--set", "numerics.axial=2", "-o", "my results.zarr"]
    done = program(*words)
    assert done.exit_code == code
    assert len(program.computed) == 1
    resume = done.stderr.splitlines()[-1].strip()
    assert shlex.split(resume) == ["agfb", *(word for word in words if word != "--force")]
    # That very command goes on in the same store.
    program.behaviour = succeed
    assert program(*shlex.split(resume)[1:]).exit_code == ExitCode.DONE


def test_an_interrupted_run_answers_with_json_too(program: Program, three: Path) -> None:
    def interrupt(case: NamedCase) -> StageResult:
        os.kill(os.getpid(), signal.SIGINT)
        return succeed(case)

    program.behaviour = interrupt
    done = program("linearize", "three.toml", "--json")
    assert done.exit_code == ExitCode.INTERRUPTED
    document = json.loads(done.stdout)
    assert [result["case_id"] for result in document["results"]] == ["stiffness=5"]
    assert document["resume"] in done.stderr


def test_results_are_told_when_the_figures_fail(program: Program, smoke: Path) -> None:
    (program.folder / "build").mkdir()
    (program.folder / "build" / "smoke-figures").touch()  # a file where the folder of the figures shall be
    done = program("run", "smoke.toml", "--json")
    assert done.exit_code == ExitCode.STORE
    assert len(json.loads(done.stdout)["results"]) == len(CHAIN)
    assert "smoke-figures" in done.stderr


def test_quiet_keeps_the_advice_on_a_failure(program: Program, smoke: Path) -> None:
    program.behaviour = lambda case: StageResult(case.case_id, False, "no equilibrium", "raise the speed")
    done = program("linearize", "smoke.toml", "-q")
    assert "raise the speed" in done.stderr
    assert "1 of 1 results failed\n" in done.stderr


def test_a_store_of_another_configuration_is_refused(program: Program, smoke: Path) -> None:
    assert program("linearize", "smoke.toml").exit_code == ExitCode.DONE
    done = program("linearize", "smoke.toml", "--set", "excitation.displacement=0.1")
    assert done.exit_code == ExitCode.STORE
    assert "excitation.displacement" in done.stderr
    assert "0.2" in done.stderr
    assert "0.1" in done.stderr
    assert len(program.computed) == 1


def test_asking_for_more_of_the_same_machine_uses_the_same_store(program: Program, smoke: Path) -> None:
    assert program("linearize", "smoke.toml").exit_code == ExitCode.DONE
    more = program("continue", "smoke.toml", "--set", "continue_cycles.max_points=40")
    assert more.exit_code == ExitCode.DONE


def test_force_moves_the_old_store_aside(program: Program, smoke: Path) -> None:
    assert program("linearize", "smoke.toml").exit_code == ExitCode.DONE
    done = program("linearize", "smoke.toml", "--force", "--set", "excitation.displacement=0.1")
    assert done.exit_code == ExitCode.DONE
    assert "build/smoke.zarr.old-1" in done.stderr
    assert (program.folder / "build" / "smoke.zarr.old-1" / "zarr.json").is_file()


def test_force_never_moves_what_is_not_a_store(program: Program, smoke: Path) -> None:
    (program.folder / "thesis").mkdir()
    (program.folder / "thesis" / "chapter.tex").touch()
    done = program("linearize", "smoke.toml", "--force", "-o", "thesis")
    assert done.exit_code == ExitCode.STORE
    assert (program.folder / "thesis" / "chapter.tex").exists()
    assert program.computed == []


def test_quiet_leaves_results_only(program: Program, smoke: Path) -> None:
    done = program("linearize", "smoke.toml", "-q")
    assert done.stderr == ""
    assert done.stdout.startswith("linearize smoke: range")


def test_info_of_a_store(program: Program, three: Path) -> None:
    program("linearize", "three.toml")
    done = program("info", "build/three.zarr", "--case", "*=20*")
    assert done.exit_code == ExitCode.DONE
    assert done.stdout.count("nothing computed yet") == 1
    assert "agfb linearize three.toml" in done.stderr
    content = json.loads(program("info", "build/three.zarr", "--json").stdout)
    assert len(content["cases"]) == 3


def test_validate_reports_every_problem_of_every_file(program: Program, smoke: Path) -> None:
    wrong = smoke.with_name("wrong.toml")
    text = smoke.read_text().replace("clearance = 20.4e-6", "clearance = -1.0")
    wrong.write_text(text.replace("viscosity", "viscosety"))
    done = program("validate", "smoke.toml", "wrong.toml", "smoke.tom")
    assert done.exit_code == ExitCode.USAGE
    assert "smoke.toml" in done.stdout
    assert "clearance" in done.stderr
    assert "viscosety" in done.stderr
    assert "did you mean smoke.toml?" in done.stderr


def test_validate_prints_the_resolved_configuration(program: Program, smoke: Path) -> None:
    (resolved,) = json.loads(program("validate", "smoke.toml", "--json").stdout)
    assert resolved["case"] == "smoke"
    assert resolved["configuration"]["numerics"]["newton_iterations"] == 12


def test_validate_tells_what_the_drawing_makes_of_the_machine(program: Program, smoke: Path) -> None:
    """Two discs of 79 g on 360 mm x 17.6 mm of steel, symmetric; k_b = 10 at a clearance of 20.4 um."""
    (content,) = json.loads(program("validate", "smoke.toml", "--json").stdout)
    machine, mass = content["machine"], 2 * 0.079 + 7850.0 * math.pi / 4 * 0.0176**2 * 0.36
    assert machine["mass"] == pytest.approx(mass, rel=1e-9)
    assert machine["centre_of_gravity"] == pytest.approx(0.18, rel=1e-9)
    gravity = content["configuration"]["rotor"]["gravity"]
    for bearing in machine["bearings"]:
        assert bearing["load"] == pytest.approx(0.5 * mass * gravity, rel=1e-6)
        assert bearing["bearing_number"] == pytest.approx(1.1, rel=1e-12)
        assert bearing["foil_stiffness"] == 10.0
        assert bearing["areal_stiffness"] == pytest.approx(10.0 * 101325.0 / 20.4e-6, rel=1e-12)
        assert bearing["stroke"] == pytest.approx(0.2 * 20.4, rel=1e-12)
    shown = program("validate", "smoke.toml").stdout
    assert f"{mass:.4g} kg" in shown


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run", "nowhere.toml"], "no such file"),
        (["run", "."], "is a directory"),
        (["run"], "Missing argument"),
        (["run", "smoke.toml", "--set", "gas.viscosety=1"], "viscosity"),
        (["run", "smoke.toml", "--set", "nonsense"], "nonsense"),
        (["track", "smoke.toml"], "No such command"),
        (["run", "smoke.toml", "--colour"], "No such option"),
        (["info", "nowhere.zarr"], "no such store"),
        (["info", "smoke.toml"], "not a Zarr v3 store"),
        (["figures", "nowhere.zarr"], "no such store"),
        (["schema", "--md", "--json"], "exclude each other"),
    ],
)
def test_usage_errors(program: Program, smoke: Path, words: list[str], told: str) -> None:
    done = program(*words)
    assert done.exit_code == ExitCode.USAGE
    assert told in done.stderr
    if "--json" in words:
        assert json.loads(done.stdout)["error"]["code"] == ExitCode.USAGE
    else:
        assert done.stdout == ""
    assert program.computed == []


@pytest.mark.parametrize(("option", "word"), [("--format", "gif"), ("--figure", "portrait")])
def test_unknown_figures_are_refused(program: Program, smoke: Path, option: str, word: str) -> None:
    program("linearize", "smoke.toml")
    done = program("figures", "build/smoke.zarr", option, word)
    assert done.exit_code == ExitCode.USAGE
    assert word in done.stderr


def test_the_reference_of_the_configuration(program: Program) -> None:
    markdown = program("schema")
    assert markdown.stdout.startswith("# Configuration")
    assert program("schema", "--md").stdout == markdown.stdout
    assert json.loads(program("schema", "--json").stdout)["$schema"].startswith("https://json-schema.org/")
