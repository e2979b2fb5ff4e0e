"""SIGTERM and Ctrl-C: once for the next commit, twice for now; the store goes on either way."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest

from agfb_cli.progress import ProgressReporter
from pipelines.datasets.integrity import verify
from tests.helpers import forked
from tests.helpers.tiny import CONFIG, TINY
from tests.helpers.trees import compare_trees

STORE = "run.zarr"
POINTS = 5
STUCK_AT = 3
OVERRIDES = (*TINY, f"continue_cycles.max_points={POINTS}")
WORDS = ["continue", str(CONFIG), "-o", STORE, *(w for override in OVERRIDES for w in ("--set", override))]
SIGNALS = [(signal.SIGTERM, 143), (signal.SIGINT, 130)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    assert forked.run(folder, WORDS) == 0, forked.messages(folder)
    return folder / STORE


def points(folder: Path) -> int:
    metadata = folder / STORE / "cases/smoke/cycles/b000/zarr.json"
    return int(json.loads(metadata.read_text())["attributes"]["n_points"]) if metadata.exists() else 0


def compute_for(seconds: float) -> None:
    """Behind the third point comes one that takes long."""
    show = ProgressReporter.__call__

    def slow(reporter: ProgressReporter, progress: object) -> None:
        show(reporter, progress)
        if progress.done == STUCK_AT:
            time.sleep(seconds)

    ProgressReporter.__call__ = slow


def is_told(folder: Path, number: int) -> bool:
    return f"{signal.Signals(number).name} received: finishing the current point" in forked.messages(folder)


def assert_resumes(folder: Path, undisturbed: Path) -> None:
    assert points(folder) == STUCK_AT
    assert "Traceback" not in forked.messages(folder)
    assert forked.run(folder, WORDS) == 0, forked.messages(folder)
    assert compare_trees(undisturbed, folder / STORE) == []
    assert verify(folder / STORE) == []
    assert sorted(path.name for path in folder.iterdir()) == [forked.MESSAGES, STORE]


@pytest.mark.parametrize(("number", "code"), SIGNALS)
def test_the_first_signal_ends_the_run_at_a_commit(
    tmp_path: Path, undisturbed: Path, number: int, code: int
) -> None:
    process = forked.start(tmp_path, WORDS, compute_for, 1.0)
    forked.wait_for(lambda: points(tmp_path) == STUCK_AT, process)
    os.kill(process.pid, number)
    assert forked.finish(process) == code
    assert is_told(tmp_path, number)
    assert "everything committed is in run.zarr. To resume:" in forked.messages(tmp_path)
    assert_resumes(tmp_path, undisturbed)


@pytest.mark.parametrize(("number", "code"), SIGNALS)
def test_the_second_signal_ends_it_at_once(tmp_path: Path, undisturbed: Path, number: int, code: int) -> None:
    process = forked.start(tmp_path, WORDS, compute_for, 10.0 * forked.LONGEST)
    forked.wait_for(lambda: points(tmp_path) == STUCK_AT, process)
    os.kill(process.pid, number)
    forked.wait_for(lambda: is_told(tmp_path, number), process)
    assert process.exitcode is None, "the point is not finished"
    os.kill(process.pid, number)
    ended_by = -forked.finish(process)
    assert 128 + ended_by == code, "what a shell makes of a process that a signal ended"
    assert_resumes(tmp_path, undisturbed)
