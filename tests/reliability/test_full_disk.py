"""A disk without space: the command says so with exit code 5, and goes on to the bytes of a quiet run."""

from __future__ import annotations

import errno
import itertools
import os
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from agfb_cli.errors import ExitCode
from pipelines.datasets import durable
from pipelines.datasets.integrity import verify
from pipelines.datasets.watching import watch
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.scheduling.tasks import run_task, task
from tests.helpers import forked
from tests.helpers.faults import full_disk
from tests.helpers.tiny import CONFIG, TINY, tiny_case
from tests.helpers.trees import compare_trees, tree

STAGES = ("criticals", "continue_cycles", "track_ns")
OVERRIDES = (
    "excitation.frequency=0.77",
    "continue_cycles.start=1.2",
    "continue_cycles.range=[1.2, 1.24]",
    "continue_cycles.max_points=4",
    "track_curves.ranges=[[0.72, 0.82], [1.2, 1.24]]",
    "track_curves.maximum_step=0.04",
    "track_curves.max_points=2",
    "track_curves.normal_forms=false",
    "numerics.multiplier_tolerance=1e-5",
)
STORE = "run.zarr"
WORDS = ["continue", str(CONFIG), "-o", STORE]
WORDS += [word for override in (*TINY, *OVERRIDES) for word in ("--set", override)]

Write = Callable[[Path, bytes, bool], None]


def compute(path: Path) -> None:
    """Make or resume a store with several stages, in this process, as the command does; raises OSError."""
    case = tiny_case(*OVERRIDES)
    prepare_store(path, [case], ["agfb"])
    for stage in STAGES:
        result = run_task(task(stage, case, path), lambda progress: None, lambda: False)
        assert result["ok"], result


@contextmanager
def writing(write: Write) -> Iterator[None]:
    """Files are written by another function, and not forced to disk, which takes half the time."""
    with patch.object(durable, "_write", write), patch.object(os, "fsync", lambda descriptor: None):
        yield


def test_every_write_of_the_stages_fails_once(tmp_path: Path, kills: int) -> None:
    """The branch, its curve and what is written at once; with few ``--kills`` so many of the writes, spread
    over all of them.
    """
    original, plain, path = durable._write, tmp_path / "plain" / STORE, tmp_path / "failing" / STORE
    made: list[tuple[str, bytes]] = []

    def identity(target: Path, data: bytes) -> tuple[str, bytes]:
        return target.relative_to(tmp_path).as_posix().partition("/")[2], bytes(data)

    def noted(target: Path, data: bytes, forced: bool) -> None:
        made.append(identity(target, data))
        original(target, data, forced)

    with writing(noted):
        compute(plain)
    chosen = np.unique(np.linspace(0, len(made) - 1, min(len(made), kills)).round().astype(int))
    waiting = [made[index] for index in chosen]

    def failing(target: Path, data: bytes, forced: bool) -> None:
        if waiting and identity(target, data) == waiting[0]:
            del waiting[0]
            target.write_bytes(bytes(data)[: len(data) // 2])
            raise full_disk()
        original(target, data, forced)

    with writing(failing):
        points = [0]
        for attempt in itertools.count():
            error = error_of(compute, path)
            assert attempt + len(waiting) + (error is None) <= len(chosen) + 1
            if error is None:
                break
            assert error.errno == errno.ENOSPC
            assert Path(error.filename).is_relative_to(tmp_path), "the message names the file"
            if path.exists():
                points.append(sum(state.points or 0 for state in watch(path)))
                assert points[-1] >= points[-2], "what was committed is never lost"
    assert [name for name, _ in waiting] == [], "a resumed run writes the same files with the same bytes"
    assert compare_trees(plain, path) == []
    assert verify(path) == []


def error_of(run: Callable[[Path], None], path: Path) -> OSError | None:
    try:
        run(path)
    except OSError as error:
        return error
    return None


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    assert forked.run(folder, WORDS) == 0, forked.messages(folder)
    return folder / STORE


def fill_the_disk(writes: int) -> None:
    """From so many writes on there is no space."""
    original, made = durable._write, itertools.count()

    def failing(target: Path, data: bytes, forced: bool) -> None:
        if next(made) >= writes:
            raise full_disk()
        original(target, data, forced)

    durable._write = failing


def limit_files(size: int) -> None:
    """The kernel refuses every larger file, as a quota does."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("writes", [0, 5, 60, 120, 170])
def test_the_command_says_that_the_disk_is_full(tmp_path: Path, undisturbed: Path, writes: int) -> None:
    code = forked.run(tmp_path, WORDS, fill_the_disk, writes)
    assert_resumes(tmp_path, undisturbed, code, "no space left on the disk")


def test_the_kernel_refuses_a_file(tmp_path: Path, undisturbed: Path) -> None:
    sizes = sorted(len(data) for data in tree(undisturbed).values() if data is not None)
    code = forked.run(tmp_path, WORDS, limit_files, sizes[-1] - 1)
    assert_resumes(tmp_path, undisturbed, code, "file too large")


def assert_resumes(folder: Path, undisturbed: Path, code: int, message: str) -> None:
    told = forked.messages(folder)
    assert code == ExitCode.RESOURCES, told
    error, hint = told.splitlines()[-2:]
    assert error.startswith("error: ")
    assert error.endswith(message)
    assert str(folder) in error, "the file is named"
    assert hint == "hint: make room; committed points are kept; the same command resumes"
    assert forked.run(folder, WORDS) == 0, forked.messages(folder)
    assert compare_trees(undisturbed, folder / STORE) == []
    assert verify(folder / STORE) == []
