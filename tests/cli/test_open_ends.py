"""Curve ends from which no curve goes on, as `agfb info` and `agfb report` tell them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from agfb_cli.main import app
from tests.figures.synthetic_store import make_store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One fold curve of stable cycles and one Neimark-Sacker curve of unstable ones end too early."""
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    make_store(path, 5)
    return path


def invoke(command: str, *words: str) -> Result:
    return CliRunner().invoke(app, [command, *words], prog_name="agfb")


@pytest.mark.parametrize("command", ["info", "report"])
def test_open_ends_are_told(store: Path, command: str) -> None:
    told = invoke(command, str(store)).stderr
    sentence = "a boundary of stable cycles ends inside the plane, and no curve goes on from there"
    assert f"caution: kb10: {sentence}: folds/c001 at 0.42, 0.586: minimum step" in " ".join(told.split())


@pytest.mark.parametrize("command", ["info", "report"])
def test_open_ends_are_data(store: Path, command: str) -> None:
    case = json.loads(invoke(command, str(store), "--json").stdout)["cases"]["kb10"]
    assert [(end["curve"], end["bounds"]) for end in case["open_ends"]] == [
        ("folds/c001", True), ("ns/c002", False)
    ]  # fmt: skip
    assert case["open_ends"][0]["parameters"] == pytest.approx([0.42, 0.586])
