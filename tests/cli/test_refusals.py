"""What a command cannot compute is refused when it starts: exit 2, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agfb_cli.errors import ExitCode
from tests.cli.conftest import ROOT, Program


@pytest.fixture
def without_table(tmp_path: Path) -> Path:
    """The configuration to start from, without its table [continue_cycles]."""
    text = (ROOT / "configs" / "your_rotor.toml").read_text()
    begin, end = text.index("[continue_cycles]"), text.index("[track_curves]")
    path = tmp_path / "mine.toml"
    path.write_text(text[:begin] + text[end:])
    return path


FAST = ("--set", "operation.speed_rpm=40000.0")


@pytest.mark.parametrize("command", [["continue"], ["run"], ["run", "--dry-run"], ["track-pd"]])
@pytest.mark.usefixtures("without_table")
def test_a_table_at_its_defaults_is_checked_where_it_is_used(program: Program, command: list[str]) -> None:
    name, *words = command
    done = program(name, "mine.toml", *FAST, *words)
    assert done.exit_code == ExitCode.USAGE
    assert "mine.toml:1: continue_cycles.range = [0.2, 1.6]" in done.stderr
    assert "own speed = 2.58118" in done.stderr
    assert program.computed == []
    assert not Path("build").exists()


@pytest.mark.usefixtures("without_table")
def test_validate_says_what_would_be_refused(program: Program) -> None:
    done = program("validate", "mine.toml", *FAST)
    assert done.exit_code == ExitCode.DONE
    assert "`agfb run` would refuse mine.toml:1: continue_cycles.range" in done.stderr
    (entry,) = json.loads(program("validate", "mine.toml", *FAST, "--json").stdout)
    assert len(entry["refused"]) == 1
    assert program("validate", "mine.toml").stderr == ""


@pytest.mark.usefixtures("smoke")
def test_tables_of_other_stages_do_not_stop_a_stage(program: Program) -> None:
    outside = ("--set", "operation.speed=2.0", "--set", "continue_cycles.start=1.6")
    words = ("--set", "continue_cycles.range=[5000, 40000]", "--set", "continue_cycles.start=7000.0")
    assert program("linearize", "smoke.toml", *words).exit_code == ExitCode.DONE
    assert program("continue", "smoke.toml", *words).exit_code == ExitCode.USAGE
    assert program.computed == [("linearize", "smoke")]
    assert program("validate", "smoke.toml", *outside).exit_code == ExitCode.USAGE


@pytest.mark.usefixtures("smoke")
def test_only_the_chosen_cases_are_checked(program: Program) -> None:
    words = ("--set", "sweep.continue_cycles.range=[[1.1, 1.25], [1.1, 900]]")
    assert program("continue", "smoke.toml", *words).exit_code == ExitCode.USAGE
    assert program("continue", "smoke.toml", *words, "--case", "*1.25").exit_code == ExitCode.DONE
    assert len(program.computed) == 1


@pytest.mark.parametrize(
    "words",
    [
        ["info", "x" * 300],
        ["verify", "x" * 300],
        ["validate", "x" * 300],
        ["linearize", "smoke.toml", "-o", "x" * 300],
        ["linearize", "smoke.toml", "-o", "x" * 250],  # the folder beside it, in which it is made, is longer
        ["linearize", "smoke.toml", "-o", "x" * 300, "--dry-run"],
        ["transient", "smoke.toml", "-o", "x" * 300],
    ],
)
@pytest.mark.usefixtures("smoke")
def test_names_that_are_too_long(program: Program, words: list[str]) -> None:
    done = program(*words)
    assert done.exit_code == ExitCode.USAGE, done.stderr
    assert "too long" in done.stderr or "no such" in done.stderr
    assert program.computed == []
    assert [path.name for path in Path().iterdir()] == ["smoke.toml"]
