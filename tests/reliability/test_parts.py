"""The parts of one case side by side: the same bytes, whatever dies on the way."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pipelines.datasets.integrity import verify
from tests.helpers import forked
from tests.helpers.cluster import cluster
from tests.helpers.tiny import CONFIG, TINY
from tests.helpers.trees import compare_trees

CASE = "run.zarr/cases/smoke"
OVERRIDES = (
    *TINY,
    "track_curves.max_points=4",
    "track_curves.step=0.005",
    "track_curves.maximum_step=0.005",
    "track_curves.normal_forms=false",
)
SET = [word for override in OVERRIDES for word in ("--set", override)]
BRANCH = ["continue", str(CONFIG), "-o", "run.zarr", *SET]
CURVE = ["track-ns", str(CONFIG), "-o", "run.zarr", *SET]


def points(folder: Path, group: str) -> int:
    """Committed points of a group; 0 without it."""
    try:
        metadata = json.loads((folder / CASE / group / "zarr.json").read_text())
    except (FileNotFoundError, NotADirectoryError):  # it is not there yet, or has taken its turn
        return 0
    return int(metadata["attributes"]["n_points"])


def points_ahead(folder: Path) -> int:
    """Points of what is traced ahead of its turn."""
    return sum(points(folder, f"ahead/{path.name}") for path in (folder / CASE / "ahead").glob("*"))


@pytest.fixture(scope="module")
def branched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("branched")
    assert forked.run(folder, BRANCH) == 0, forked.messages(folder)
    return folder


@pytest.fixture(scope="module")
def alone(branched: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("alone") / "alone"
    shutil.copytree(branched, folder)
    assert forked.run(folder, CURVE) == 0, forked.messages(folder)
    assert [points(folder, f"ns/c{half:03d}") for half in range(2)] == [4, 4]
    return folder


def test_workers_die_while_they_trace_both_directions(branched: Path, alone: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    shutil.copytree(branched, folder)
    with cluster(tmp_path, 2) as machines:
        process = forked.start(folder, [*CURVE, "--scheduler", machines.address])
        forked.wait_for(lambda: points_ahead(folder) > 0, process)
        machines.kill_worker(0)
        machines.kill_worker(0)
        assert forked.finish(process) == 0, forked.messages(folder)
    assert compare_trees(alone / CASE, folder / CASE) == []
    assert verify(folder / "run.zarr") == []


def test_a_driver_dies_while_a_direction_is_traced_ahead(branched: Path, alone: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    shutil.copytree(branched, folder)
    process = forked.start(folder, [*CURVE, "--workers", "2"])
    forked.wait_for(lambda: points_ahead(folder) > 0, process)
    process.kill()
    forked.finish(process)
    while (code := forked.run(folder, CURVE)) == 4:  # until the orphaned workers have noticed
        assert "is being written by" in forked.messages(folder)
    assert code == 0, forked.messages(folder)
    assert compare_trees(alone / CASE, folder / CASE) == []
    assert verify(folder / "run.zarr") == []
