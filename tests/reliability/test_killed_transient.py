"""A transient run, killed at any time or interrupted, resumes to the bytes of a quiet run."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipelines.datasets.integrity import verify
from tests.helpers.forked import kill_at_random
from tests.helpers.tiny import CONFIG, ROOT, TINY
from tests.helpers.trees import compare_trees

BLOCKS = 24
STORE = "run.zarr"  # the same command, and so the same argv in the store, in every folder
GROUP = "cases/smoke/transient/t000"
OVERRIDES = (
    *TINY,
    "unbalance.grade=6.3",
    "unbalance.rated_speed=1.1",
    "transient.times=[0.0, 150.0]",
    "transient.speeds=[0.6, 1.1]",
    "transient.excitation=switch_on",
    "transient.switch_time=50.0",
    "transient.duration=215.0",
    "transient.checkpoint_samples=64",
    "transient.steps_per_period=50",
)
WORDS = ["transient", str(CONFIG), "-o", STORE, *(w for override in OVERRIDES for w in ("--set", override))]
COMMAND = [sys.executable, "-m", "agfb_cli", *WORDS]


def start(folder: Path, command: list[str] = COMMAND) -> subprocess.Popen[str]:
    """The command in a folder of its own."""
    folder.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def checkpoints(folder: Path) -> int:
    """Committed checkpoints, read as any other program would."""
    metadata = folder / STORE / GROUP / "zarr.json"
    return int(json.loads(metadata.read_text())["attributes"]["n_events"]) if metadata.exists() else 0


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    process = start(folder)
    _, messages = process.communicate()
    assert process.returncode == 0, messages
    assert checkpoints(folder) >= BLOCKS
    return folder / STORE


def test_killed_run_resumes_to_identical_bytes(tmp_path: Path, undisturbed: Path, kills: int) -> None:
    seen = set()
    for folder, at_kills in kill_at_random(tmp_path, WORDS, checkpoints, kills, (0, 1, 2, 5), 0.02):
        seen.update(at_kills)
        assert compare_trees(undisturbed, folder / STORE) == []
        assert verify(folder / STORE) == []
    assert len(seen) >= 4, "the kills are spread over the life of the run"


def test_interrupted_run_says_how_to_resume(tmp_path: Path, undisturbed: Path) -> None:
    folder = tmp_path / "interrupted"
    process = start(folder)
    while checkpoints(folder) < 2 and process.poll() is None:
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    _, messages = process.communicate()
    assert process.returncode == 130, messages
    assert 2 <= checkpoints(folder) < BLOCKS
    resume = shlex.split(messages.splitlines()[-1])
    assert resume == COMMAND
    process = start(folder, resume)
    process.communicate()
    assert process.returncode == 0
    assert compare_trees(undisturbed, folder / STORE) == []
