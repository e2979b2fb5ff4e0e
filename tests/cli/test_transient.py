"""`agfb transient`: what is refused before anything is written, and how long a run would take."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from agfb_cli.errors import ExitCode
from agfb_cli.progress import in_words
from pipelines.stages.transients import transient as stage
from pipelines.stages.transients.transient import Outlook
from tests.cli.conftest import Program
from tests.helpers.tiny import TINY

SETTINGS = [word for override in TINY for word in ("--set", override)]


@pytest.fixture
def hours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run would take three hours."""
    monkeypatch.setattr(stage, "outlook", lambda named, store: Outlook(27_000_000, 10_800.0))


@pytest.mark.usefixtures("hours")
def test_a_long_run_is_refused_and_told(program: Program, smoke: Path) -> None:
    done = program("transient", "smoke.toml")
    assert done.exit_code == ExitCode.USAGE
    assert "27000000 time steps, about 3 hours" in done.stderr
    assert "--yes" in done.stderr
    assert program.computed == []
    assert not Path("build").exists()


@pytest.mark.usefixtures("hours")
def test_a_long_run_starts_when_it_is_wanted(program: Program, smoke: Path) -> None:
    assert program("transient", "smoke.toml", "--yes").exit_code == ExitCode.DONE
    assert program.computed == [("transient", "smoke")]


@pytest.mark.usefixtures("hours")
def test_the_hours_of_all_cases_are_told_together(program: Program, three: Path) -> None:
    done = program("transient", "three.toml")
    assert done.exit_code == ExitCode.USAGE
    assert "81000000 time steps, about 9 hours" in done.stderr


def test_ten_thousand_million_steps(program: Program, smoke: Path) -> None:
    """Measured, not computed: the answer comes at once."""
    words = ["--set", "transient.duration=1.5e9", "--set", "transient.samples_per_period=1e-3"]
    done = program("transient", "smoke.toml", *SETTINGS, *words, "--set", "transient.steps_per_period=60")
    assert done.exit_code == ExitCode.USAGE
    assert "10026761415 time steps, about" in done.stderr
    assert "days" in done.stderr
    assert not Path("build").exists()


def test_a_start_that_is_not_there_is_a_usage_error(program: Program, smoke: Path) -> None:
    words = ["--set", "transient.start=cycles/b000"]
    done = program("transient", "smoke.toml", *SETTINGS, *words, "--json")
    assert done.exit_code == ExitCode.USAGE
    error = json.loads(done.stdout)["error"]
    assert "case smoke: transient.start = cycles/b000" in error["message"]
    assert "agfb continue" in error["hint"]
    assert not Path("build").exists()


def test_a_dry_run_shows_the_plan(program: Program, smoke: Path) -> None:
    done = program("transient", "smoke.toml", *SETTINGS, "--dry-run")
    assert done.exit_code == ExitCode.DONE
    assert re.search(r"smoke +transient +nothing +0 +about .+ at most \(\d+ time steps\)", done.stdout)
    assert program.computed == []


@pytest.mark.usefixtures("hours")
def test_a_dry_run_tells_of_a_long_run_and_does_not_refuse_it(program: Program, smoke: Path) -> None:
    done = program("transient", "smoke.toml", "--dry-run", "--json")
    assert done.exit_code == ExitCode.DONE
    assert json.loads(done.stdout)["seconds"] == 10_800.0


def test_a_dry_run_refuses_a_run_that_cannot_start(program: Program, smoke: Path) -> None:
    words = ["--set", "transient.start=cycles/b000", "--dry-run"]
    done = program("transient", "smoke.toml", *SETTINGS, *words)
    assert done.exit_code == ExitCode.USAGE
    assert "transient.start = cycles/b000" in done.stderr


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.27, "0.27 seconds"),
        (150.0, "2.5 minutes"),
        (7200.0, "2 hours"),
        (3e6, "34.7 days"),
        (1e9, "31.7 years"),
    ],
)
def test_lengths_of_time(seconds: float, words: str) -> None:
    assert in_words(seconds) == words
