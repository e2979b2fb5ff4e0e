"""The real continuation, killed, interrupted or without disk space, resumes to the bytes of a quiet run."""

from __future__ import annotations

import errno
import itertools
import json
import multiprocessing
import os
import random
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

from pipelines.datasets import durable
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_branch
from pipelines.datasets.store import open_for_reading
from pipelines.stages.preparation import prepare_store
from pipelines.stages.scheduling import run_task, task
from tests.helpers.tiny import CONFIG, ROOT, TINY, run_command, tiny_case
from tests.helpers.trees import compare_trees

KILLS = 20
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


def test_killed_continuation_resumes_to_identical_bytes(tmp_path: Path, undisturbed: Undisturbed) -> None:
    # children are forked from a server that has imported everything: kills hit the computation, not imports
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["tests.helpers.tiny", "pipelines.stages.continue_cycles"])
    moments, pause = random.Random(2), undisturbed.seconds_per_point
    kills, folders, points_at_kill = 0, 0, []
    while kills < KILLS:
        folder, finished = tmp_path / f"killed{folders}", False
        folder.mkdir()
        folders += 1
        while not finished:
            process = processes.Process(target=run_command, args=(folder, WORDS))
            process.start()
            if kills < KILLS:
                # while the store is made or opened, or while one of the next points is computed and committed
                further = moments.choice((0, 1, 1, 2))
                wait_for(folder, points(folder) + further, lambda process=process: process.exitcode)
                time.sleep(moments.uniform(0.0, 1.0 if further else 3.0) * pause)
                if process.exitcode is None:
                    process.kill()
                    kills += 1
                    points_at_kill.append(points(folder))
            process.join()
            finished = process.exitcode == 0
            assert finished or process.exitcode == -signal.SIGKILL
        assert compare_trees(undisturbed.store, folder / STORE) == []
        assert verify(folder / STORE) == []
        assert [path.name for path in folder.iterdir()] == [STORE], "locks and building folders are removed"
    assert len(set(points_at_kill)) >= 6, "the kills are spread over the life of the run"


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


def test_a_continuation_on_a_full_disk_resumes_to_identical_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One write of every attempt fails, another one each time; what was committed before is never lost."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    plain = tmp_path / "plain"
    attempt(plain)
    write, numbers = durable._write, random.Random(5)
    failed, path, before = 0, tmp_path / "failing", 0

    def failing_at(number: int) -> Callable[[Path, bytes, bool], None]:
        calls = itertools.count(1)

        def failing(target: Path, data: bytes, forced: bool) -> None:
            if next(calls) == number:
                target.write_bytes(bytes(data)[: len(data) // 2])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            write(target, data, forced)

        return failing

    finished = False
    while not finished:
        monkeypatch.setattr(durable, "_write", failing_at(numbers.randint(1, 70)))
        error = error_of(attempt, path)
        if error is None:
            finished = True
        else:
            assert error.errno == errno.ENOSPC
            assert Path(error.filename).is_relative_to(tmp_path), "the message names the file"
            failed += 1
        if (path / GROUP / "zarr.json").exists():
            committed = read_branch(open_for_reading(path), GROUP, ()).n_points
            assert committed >= before
            before = committed
    assert failed >= 10
    assert compare_trees(plain, path) == []
    assert verify(path) == []


def attempt(path: Path) -> None:
    """Make or resume the store in this process, as the command does; raises OSError."""
    case = tiny_case(*OVERRIDES, "continue_cycles.max_points=5")
    prepare_store(path, [case], ["agfb", "continue"])
    result = run_task(task("continue_cycles", case, path), lambda progress: None, lambda: False)
    assert result["ok"], result


def error_of(run: Callable[[Path], None], path: Path) -> OSError | None:
    try:
        run(path)
    except OSError as error:
        return error
    return None
