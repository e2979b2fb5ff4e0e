"""Points whose error by the time steps is unknown are told by whatever shows the branch."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.orbits import time_steps
from tests.figures.synthetic_store import cycles, make_store, write_branch
from tests.helpers.curves import curve_rows, write_curve
from tests.helpers.tiny import CONFIG, TINY

BRANCH = "cases/kb10/cycles/b000"
CURVE = "cases/kb10/ns/c003"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Errors unknown at three of nine cycles and at one of six points of a curve, among others."""
    path = tmp_path / "a.zarr"
    made = make_store(path, 5, parts=("machine", "tori", "curves", "set"))
    rows, events = cycles(9)
    rows["step_error"][[0, 4, 8]] = np.nan
    write_branch(made, BRANCH, (rows, events))
    curve = curve_rows(lambda f: np.column_stack([f, 1.3 + 0.0 * f]), (0.3, 0.4), 6)
    curve["step_error"] = np.where(np.arange(6) == 2, np.nan, 1e-7)
    write_curve(made, CURVE, "neimark_sacker", curve)
    return path


def tell(*words: str) -> tuple[str, str]:
    done = CliRunner().invoke(app, list(words), prog_name="agfb")
    assert done.exit_code == 0, done.stderr
    return done.stdout, done.stderr


def test_info(store: Path) -> None:
    said, cautions = tell("info", str(store))
    (line,) = (line for line in said.splitlines() if "cycles/b000" in line)
    assert line.endswith("time-step error unknown for 3 of 9 points")
    assert "caution: kb10 cycles/b000: time-step error unknown for 3 of 9 points: passes with" in cautions
    assert "caution: kb10 ns/c003: time-step error unknown for 1 of 6 points: passes with" in cautions
    assert said.count("unknown") == 2
    groups = json.loads(tell("info", str(store), "--json")[0])["cases"]["kb10"]["groups"]
    unknown = {name: group["points_without_step_error"] for name, group in groups.items()}
    assert {name for name, count in unknown.items() if count} == {"cycles/b000", "ns/c003"}
    assert unknown["cycles/b000"] == 3


def test_report_tells_of_the_curves(store: Path) -> None:
    _, cautions = tell("report", str(store))
    curves = [name for name in (store / "cases/kb10").glob("[pnf]*/c*") if name.is_dir()]
    opened = open_for_reading(store)
    points = sum(read_group(opened, str(curve.relative_to(store)), ()).n_points for curve in curves)
    assert f"caution: kb10: time-step error unknown for 1 of {points} points: " in cautions
    assert (
        json.loads(tell("report", str(store), "--json")[0])["cases"]["kb10"]["points_without_step_error"] == 1
    )


@pytest.mark.parametrize("error", [np.nan, 1e-5])
def test_the_command_that_computes_them(
    error: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time_steps, "_errors", lambda *_: (1e-5, error))
    settings = [word for override in TINY for word in ("--set", override)]
    settings += ["--set", "continue_cycles.max_points=2", "-o", str(tmp_path / "a.zarr")]
    said, cautions = tell("continue", str(CONFIG), *settings)
    assert ("time-step error unknown for 2 of 2 points" in said) == np.isnan(error)
    assert ('bearings.clipping = "smooth"' in cautions) == np.isnan(error)
