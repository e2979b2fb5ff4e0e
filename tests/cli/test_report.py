"""`agfb report`: what it prints, what it writes, what it says when there is nothing to tell."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.reports.operating_range import operating_range
from tests.figures.synthetic_store import ATTRIBUTES, make_store
from tests.helpers.surveys import write_survey


def report(*words: str) -> Result:
    return CliRunner().invoke(app, ["report", *words], prog_name="agfb")


@pytest.fixture
def store(tmp_path: Path) -> Path:
    make_store(tmp_path / "a.zarr", 5)
    return tmp_path / "a.zarr"


def test_a_table_a_conclusion_and_data(store: Path) -> None:
    done = report(str(store))
    assert done.exit_code == ExitCode.DONE
    assert "kb10: bifurcation-free from speed 0.2500" in done.stdout
    assert "Neimark-Sacker, supercritical" in done.stdout
    assert "best: excitation frequency" in done.stdout
    assert "against displacement 0 (unstable from 1.0500" in done.stdout
    assert "against excitation frequency 0.2" in done.stdout
    assert "caution" in done.stderr, "one of its curves stopped before its end"
    written = read_group(open_for_reading(store), "cases/kb10/operating_range")
    assert written["speed"].max() == written.attributes["best"]["speed"]


def test_the_same_as_json(store: Path) -> None:
    document = json.loads(report(str(store), "--json").stdout)
    case = document["cases"]["kb10"]
    assert document["written"] is True
    assert case["best"]["speed"] > case["passive_instability_speed"]
    assert case["passive_gain"] == pytest.approx(case["best"]["speed"] / 1.05 - 1.0)
    assert {row["bifurcation"] for row in case["boundary"]} >= {"neimark_sacker"}


@pytest.mark.parametrize(
    ("error", "caution"), [(0.1731, "the condensed rotor has a mode 17.3 % off"), (0.0021, ""), (None, "")]
)
def test_the_error_of_the_condensed_rotor_is_told_with_its_caution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: float | None, caution: str
) -> None:
    """What `agfb criticals` has stored; nothing where it could not be known."""
    monkeypatch.setitem(ATTRIBUTES, "criticals", {"condensation_error": error, "caution": caution})
    make_store(tmp_path / "a.zarr", 5)
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.DONE
    line = "condensed rotor: modes below the highest speed at most"
    assert ([each for each in done.stdout.splitlines() if each.startswith(line)]) == (
        [] if error is None else [f"{line} {'17' if error > 0.1 else '0.21'} % off"]
    )
    assert ("caution: kb10: the condensed rotor has a mode 17.3 % off" in done.stderr) is bool(caution)
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["cases"]["kb10"]
    assert told["condensation_error"] == error
    assert told["condensation_caution"] == caution


def test_without_critical_speeds_nothing_is_told_of_the_condensed_rotor(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 5, parts=("machine", "curves", "set"))
    assert "condensed rotor" not in report(str(tmp_path / "a.zarr")).output
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["cases"]["kb10"]
    assert told["condensation_error"] is None


def test_a_store_without_curves_says_what_to_run(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 3, parts=("machine", "cycles"))
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.USAGE
    assert "no bifurcation set" in done.stderr
    assert "agfb run" in done.stderr


def test_a_survey_is_told_with_the_range_and_alone(tmp_path: Path) -> None:
    """All its onsets lie at the speed of one boundary: with curves it tells how many are theirs."""
    store = make_store(tmp_path / "a.zarr", 5)
    boundaries = [each for each in operating_range(store, "kb10").boundaries if each.curve >= 0]
    speed = boundaries[len(boundaries) // 2].speed
    write_survey(store, "kb10", onset=speed, points=(37, 7))
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.DONE
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("survey: ")]
    assert "of 259 cells unstable, 1 without a usable cycle" in line
    assert re.search(
        rf"lowest onset at speed {speed:.4g} \(\d+ rpm\), excitation frequency 0.2 \([0-9.]+ Hz\) "
        r"\(period doubling\)",
        line,
    )
    assert re.search(r"within 0.011 \([0-9.]+ rpm\) of the first bifurcation of the curves", line)
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["surveys"]["kb10"]
    assert told["lowest"]["across"] == pytest.approx(speed)
    assert 0 < told["agreeing"] < told["compared"] <= 37

    write_survey(make_store(tmp_path / "b.zarr", parts=("machine",)), "kb10")
    alone = report(str(tmp_path / "b.zarr"))
    assert alone.exit_code == ExitCode.DONE
    assert alone.stdout.startswith("kb10: survey: 30 of 70 cells unstable")
    assert alone.stderr == ""
