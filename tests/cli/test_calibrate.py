"""`agfb calibrate` and `agfb compare-paper` as typed: what they print, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.case.reading import read_cases
from pipelines.stages.calibration import calibrate as stage
from pipelines.stages.calibration.targets import Reached
from tests.figures.synthetic_store import make_store
from tests.helpers.paper import store_of, write_threshold
from tests.helpers.tiny import CONFIG

TABLE = """
[calibrate]
[[calibrate.parameters]]
keys = ["rotor.discs.mass"]     # of both discs
range = [0.05, 0.12]
[[calibrate.targets]]
value = 1.09
uncertainty = 0.01
set = { "excitation.frequency" = 0.2 }
"""


def agfb(*words: str) -> Result:
    return CliRunner().invoke(app, list(words), prog_name="agfb")


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration whose machine is a line: the onset is 1 plus the mass."""

    def line(case: object, values: dict[str, float], *more: Any) -> Reached:
        onset = 1.0 + values["rotor.discs.mass"]
        return Reached("found", onset, onset, "neimark_sacker")

    monkeypatch.setattr(stage, "reached", line)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(CONFIG.read_text() + TABLE)
    return tmp_path / "mine.toml"


def test_tables_and_assignments_of_the_found_machine(config: Path) -> None:
    done = agfb("calibrate", "mine.toml")
    assert done.exit_code == ExitCode.DONE, done.output
    assert "onset speed, excitation.frequency = 0.2  1     1.09    1.09" in done.stdout
    (assignment,) = (line for line in done.stdout.splitlines() if line.startswith("--set"))
    key, _, value = assignment.removeprefix("--set ").partition("=")
    assert key == "rotor.discs.mass"
    assert float(value) == pytest.approx(0.09, abs=1e-6)
    assert (config.parent / "build" / "mine.zarr").is_dir()


def test_the_same_as_json_and_a_copy_with_the_values(config: Path) -> None:
    done = agfb("calibrate", "mine.toml", "--json", "--write", "found.toml")
    document = json.loads(done.stdout)
    found = document["cases"]["smoke"]
    assert found["converged"] is True
    assert found["parameters"][0]["uncertainty"] == pytest.approx(0.01)
    text = Path("found.toml").read_text()
    assert "# of both discs" in text
    (named,) = read_cases(text, "found.toml")
    assert {disc.mass for disc in named.case.rotor.discs} == {found["values"]["rotor.discs.mass"]}


def test_a_limit_is_told_as_one(config: Path) -> None:
    done = agfb("calibrate", "mine.toml", "--set", "calibrate.targets=[{value = 1.2, limit = 'upper'}]")
    assert done.exit_code == ExitCode.DONE, done.output
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("onset speed"))
    assert "at most 1.2" in line
    assert " 0 " in line, "what lies below counts nothing"


def test_one_that_does_not_converge_shows_the_best_and_exits_with_3(config: Path) -> None:
    done = agfb("calibrate", "mine.toml", "--set", "calibrate.max_evaluations=2")
    assert done.exit_code == ExitCode.CASES_FAILED
    assert "raise calibrate.max_evaluations" in done.stderr
    assert "--set rotor.discs.mass=" in done.stdout


def test_what_cannot_be_done_is_refused_before_anything_is_written(config: Path) -> None:
    done = agfb("calibrate", str(CONFIG), "-o", "a.zarr")
    assert done.exit_code == ExitCode.USAGE
    assert "no table [calibrate]" in done.stderr
    done = agfb("calibrate", "mine.toml", "-o", "a.zarr", "--write", "mine.toml")
    assert done.exit_code == ExitCode.USAGE
    assert "this file exists already" in done.stderr
    swept = CONFIG.read_text() + TABLE + '[sweep]\n"excitation.displacement" = [0.1, 0.2]\n'
    Path("swept.toml").write_text(swept)
    done = agfb("calibrate", "swept.toml", "-o", "a.zarr", "--write", "b.toml")
    assert "one case at a time" in done.stderr
    assert not Path("a.zarr").exists()


def test_dry_run_says_what_and_computes_nothing(config: Path) -> None:
    done = agfb("calibrate", "mine.toml", "--dry-run")
    assert done.exit_code == ExitCode.DONE
    assert "calibrate" in done.stdout
    assert not Path("build").exists()


def test_the_comparison_with_the_paper_says_that_the_machine_is_a_reconstruction(tmp_path: Path) -> None:
    write_threshold(store_of(tmp_path / "a.zarr", [(3.0, 0.2)]), "c0", 0.66, 1.3)
    done = agfb("compare-paper", str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.DONE, done.output
    assert done.stdout.splitlines()[-1].endswith("not of the authors' machine.")
    assert "threshold at excitation frequency 0.2" in done.stdout
    document = json.loads(agfb("compare-paper", str(tmp_path / "a.zarr"), "--json").stdout)
    assert "reconstruction" in document["reconstruction"]
    assert all(row["in_the_paper"].startswith("Sec. ") for row in document["rows"])
    told = [row for row in document["rows"] if row["printed"] is not None or row["told"]]
    assert sum(document["verdicts"].values()) == len(told)
    assert all(row["verdict"] in document["verdicts"] and row["sentence"] for row in told)
    assert "the frequency of the anti-resonance rises" in done.stdout
    assert f"{document['verdicts']['not compared']} not compared" in done.stdout


def test_a_store_without_sets_says_what_to_run(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 3, parts=("machine", "cycles"))
    done = agfb("compare-paper", str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.USAGE
    assert "agfb run" in done.stderr
