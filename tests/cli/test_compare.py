"""`agfb compare`: what it prints and its exit codes (the comparison itself: tests/datasets)."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr
from typer.testing import CliRunner, Result

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from tests.helpers.synthetic import FULL, GROUP, compute


def compare(*words: str) -> Result:
    return CliRunner().invoke(app, ["compare", *words], prog_name="agfb")


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """Two stores that differ in one element of the periods, by about 1e-5 of the largest."""
    compute(tmp_path / "a.zarr", 5, FULL, durable=False)
    shutil.copytree(tmp_path / "a.zarr", tmp_path / "b.zarr")
    period = zarr.open_array(tmp_path / "b.zarr" / GROUP / "period", mode="r+")
    period[2] = period[2] + 1e-5 * np.nanmax(period[:])
    return tmp_path / "a.zarr", tmp_path / "b.zarr"


def test_equal_within_the_tolerance_asked_for(pair: tuple[Path, Path]) -> None:
    done = compare(*map(str, pair), "--rtol", "1e-4")
    assert done.exit_code == ExitCode.DONE
    assert done.stdout.splitlines()[-1] == "equal"
    assert f"{GROUP}  equal" in done.stdout


def test_different_names_the_array_and_the_place(pair: tuple[Path, Path]) -> None:
    done = compare(*map(str, pair))
    assert done.exit_code == ExitCode.CASES_FAILED == 3
    assert f"{GROUP}: period: different by 1e-05 at [2]" in done.stdout
    assert "orbit: " not in done.stdout
    assert "orbit: identical" in compare(*map(str, pair), "-v").stdout
    assert done.stdout.splitlines()[-1] == "different"


def test_the_same_as_json(pair: tuple[Path, Path]) -> None:
    document = json.loads(compare(*map(str, pair), "--json").stdout)
    assert document["equal"] is False
    (branch,) = [group for group in document["groups"] if group["group"] == GROUP]
    (period,) = [array for array in branch["arrays"] if array["array"] == "period"]
    assert (period["verdict"], period["place"]) == ("different", [2])


def test_something_else_than_a_store(pair: tuple[Path, Path], tmp_path: Path) -> None:
    assert compare(str(pair[0]), str(tmp_path)).exit_code == ExitCode.USAGE
