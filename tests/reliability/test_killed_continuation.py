"""The real continuation, killed or interrupted, resumes to the bytes of a quiet run."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray

from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_branch
from pipelines.datasets.store import open_for_reading
from tests.helpers.forked import MESSAGES, kill_at_random
from tests.helpers.tiny import CONFIG, ROOT, TINY
from tests.helpers.trees import compare_trees

POINTS = 12
STORE = "run.zarr"  # the same command, and so the same argv in the store, in every folder
GROUP = "cases/smoke/cycles/b000"
OVERRIDES = (*TINY, "continue_cycles.range=[1.05, 1.5]", f"continue_cycles.max_points={POINTS}")
WORDS = ["continue", str(CONFIG), "-o", STORE, *(w for override in OVERRIDES for w in ("--set", override))]
COMMAND = [sys.executable, "-m", "agfb_cli", *WORDS]


def start(folder: Path, command: list[str] = COMMAND) -> subprocess.Popen[str]:
    """The command in a folder of its own."""
    folder.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def points(folder: Path) -> int:
    """Committed points, read as any other program would."""
    metadata = folder / STORE / GROUP / "zarr.json"
    return int(json.loads(metadata.read_text())["attributes"]["n_points"]) if metadata.exists() else 0


def wait_for(folder: Path, count: int, ended: Callable[[], object]) -> None:
    """Wait until so many points are committed or the process has ended."""
    while points(folder) < count and ended() is None:
        time.sleep(0.002)


@dataclass(frozen=True)
class Undisturbed:
    """A finished run, and how long it took from one point to the next [s]."""

    store: Path
    seconds_per_point: float


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    process = start(folder)
    wait_for(folder, 1, process.poll)
    first = time.monotonic()
    wait_for(folder, POINTS, process.poll)
    last = time.monotonic()
    _, messages = process.communicate()
    assert process.returncode == 0, messages
    assert points(folder) == POINTS
    return Undisturbed(folder / STORE, (last - first) / (POINTS - 1))


def test_killed_continuation_resumes_to_identical_bytes(
    tmp_path: Path, undisturbed: Undisturbed, kills: int
) -> None:
    pause, seen = undisturbed.seconds_per_point, set()
    # while the store is made or opened, or while one of the next points is computed and committed
    for folder, at_kills in kill_at_random(tmp_path, WORDS, points, kills, (0, 1, 1, 2), 1.5 * pause):
        seen.update(at_kills)
        assert compare_trees(undisturbed.store, folder / STORE) == []
        assert verify(folder / STORE) == []
        left = sorted(path.name for path in folder.iterdir())
        assert left == [MESSAGES, STORE], "locks and building folders are removed"
    assert len(seen) >= 6, "the kills are spread over the life of the run"


def test_interrupted_continuation_says_how_to_resume(tmp_path: Path, undisturbed: Undisturbed) -> None:
    """Other programs read the store while it grows; Ctrl-C ends after a point and tells how to go on."""
    folder = tmp_path / "interrupted"
    process = start(folder)
    wait_for(folder, 2, process.poll)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tree = xarray.open_datatree(folder / STORE, engine="zarr", consolidated=False)
        branch = tree[GROUP].to_dataset()
        seen = int(branch.attrs["n_points"])
        assert seen >= 2
        assert np.all(np.isfinite(branch["speed"].values[:seen]))
        assert np.all(np.isfinite(branch["state"].values[:seen]))
    assert process.poll() is None, "the store was read while the run went on"
    process.send_signal(signal.SIGINT)
    _, messages = process.communicate()
    assert process.returncode == 130, messages
    assert "SIGINT received: finishing the current point" in messages
    stopped = points(folder)
    assert 2 <= stopped < POINTS
    attributes = read_branch(open_for_reading(folder / STORE), GROUP, ()).attributes
    assert attributes["status"] == "running"
    resume = shlex.split(messages.splitlines()[-1])
    assert resume == COMMAND
    process = start(folder, resume)
    process.communicate()
    assert process.returncode == 0
    assert compare_trees(undisturbed.store, folder / STORE) == []
