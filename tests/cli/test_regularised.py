"""Points of curves that were computed with regularised clipping are told by whatever shows the curve."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.regularised import Regularised, in_words
from tests.figures.synthetic_store import make_store
from tests.helpers.curves import curve_rows, write_curve

CURVE = "cases/kb10/ns/c003"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Two of six points of one curve among others, one of them with an unknown effect."""
    path = tmp_path / "a.zarr"
    made = make_store(path, 5, parts=("machine", "curves", "set"))
    curve = curve_rows(lambda f: np.column_stack([f, 1.3 + 0.0 * f]), (0.3, 0.4), 6)
    curve["clipping_width"] = np.array([0.0, 0.005, 0.01, 0.0, 0.0, 0.0])
    curve["width_effect"] = np.array([0.0, np.nan, 1.25e-3, 0.0, 0.0, 0.0])
    write_curve(made, CURVE, "neimark_sacker", curve)
    return path


def tell(*words: str) -> str:
    done = CliRunner().invoke(app, list(words), prog_name="agfb")
    assert done.exit_code == 0, done.stderr
    return done.stdout


def test_info(store: Path) -> None:
    (line,) = (line for line in tell("info", str(store)).splitlines() if "regularised" in line)
    assert "ns/c003" in line
    told = "regularised clipping at 2 of 6 points, up to 0.0013 from the exact curve"
    assert line.endswith(f"{told}, at 1 by an unknown distance")
    groups = json.loads(tell("info", str(store), "--json"))["cases"]["kb10"]["groups"]
    assert groups["ns/c003"]["points_with_regularised_clipping"] == 2
    assert groups["ns/c003"]["largest_width_effect"] == 1.25e-3
    assert groups["ns/c000"]["points_with_regularised_clipping"] == 0
    assert groups["ns/c000"]["largest_width_effect"] is None


def test_report(store: Path) -> None:
    curves = [name for name in (store / "cases/kb10").glob("[pnf]*/c*") if name.is_dir()]
    opened = open_for_reading(store)
    points = sum(read_group(opened, str(curve.relative_to(store)), ()).n_points for curve in curves)
    assert f"curves past kinks of the clipping: regularised clipping at 2 of {points} points" in tell(
        "report", str(store)
    )
    told = json.loads(tell("report", str(store), "--json"))["cases"]["kb10"]
    assert told["points_with_regularised_clipping"] == 2
    assert told["largest_width_effect"] == 1.25e-3


def test_wording() -> None:
    assert in_words(Regularised(0, 20, None, 0)) == ""
    assert in_words(Regularised(1, 20, None, 1)) == "at 1 of 20 points, at 1 by an unknown distance"
    assert in_words(Regularised(3, 20, 1e-4, 0)) == "at 3 of 20 points, up to 0.0001 from the exact curve"
