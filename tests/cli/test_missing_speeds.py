"""Speeds without equilibrium are named by `status` and `info`, also where the stage has succeeded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.branch import write_group
from pipelines.datasets.reading import list_cases
from pipelines.datasets.store import open_for_writing
from tests.cli.conftest import Program
from tests.figures.synthetic_store import make_store

TOLD = ["speed 0.1475: on the grid 24 x 2 ...", "speed 0.195: on the grid 24 x 2 ..."]


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "a.zarr"
    make_store(path, 3, parts=("machine",))
    opened = open_for_writing(path)
    attributes = {"speeds_without_equilibrium": TOLD, "stop_reason": "some speeds have no equilibrium"}
    group = f"cases/{list_cases(opened)[0]}/criticals"
    write_group(opened, group, "criticals", {"critical_speed": np.array([0.5])}, attributes)
    return path


@pytest.mark.parametrize("command", ["status", "info"])
def test_they_are_named(program: Program, store: Path, command: str) -> None:
    done = program(command, str(store))
    assert "some speeds have no equilibrium (0.1475, 0.195" in done.stdout
    told = program(command, str(store), "--json")
    assert all(json.dumps(one) in told.stdout for one in TOLD)
