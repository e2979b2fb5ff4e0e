"""What cannot be written to standard output or standard error ends no computation, and is told at the end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from agfb_cli.errors import ExitCode
from pipelines.datasets.integrity import verify
from tests.helpers.tiny import CONFIG, ROOT, TINY

SETTINGS = [word for override in TINY for word in ("--set", override)]
COMPUTE = ["linearize", str(CONFIG), *SETTINGS, "-o", "run.zarr"]
FULL = "error: standard output: no space left on the disk\nhint: make room"


def agfb(folder: Path, words: Sequence[str], **streams: Any) -> tuple[int, str]:
    """The exit code and what came on stderr, where that is read."""
    done = subprocess.run(
        [sys.executable, "-m", "agfb_cli", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        timeout=150,
        check=False,
        text=True,
        **({"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE} | streams),
    )
    return done.returncode, done.stderr or ""


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a store."""
    folder = tmp_path_factory.mktemp("computed")
    assert agfb(folder, COMPUTE)[0] == ExitCode.DONE
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["--version"],
        ["schema", "--json"],
        ["info", "run.zarr", "--json"],
        ["status", "run.zarr", "--watch", "1"],
        ["export", "run.zarr", "--force"],
        COMPUTE,
    ],
    ids=lambda words: words[0],
)
def test_a_full_disk_below_standard_output(computed: Path, words: list[str]) -> None:
    with open("/dev/full", "w") as full:
        code, told = agfb(computed, words, stdout=full)
    assert code == ExitCode.RESOURCES
    assert FULL in told
    assert "Traceback" not in told
    assert "Exception ignored" not in told


def test_other_stores_are_no_excuse(computed: Path) -> None:
    """That stores differ would have the exit code 3, but nobody learns in what."""
    agfb(computed, [*COMPUTE[:-1], "other.zarr", "--set", "rotor.gravity=0"])
    with open("/dev/full", "w") as full:
        code, _ = agfb(computed, ["compare", "run.zarr", "other.zarr"], stdout=full)
    assert code == ExitCode.RESOURCES


def test_a_full_disk_below_standard_error_ends_nothing(tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        assert agfb(tmp_path, COMPUTE, stderr=full)[0] == ExitCode.RESOURCES
        assert agfb(tmp_path, ["info", "nowhere.zarr"], stderr=full)[0] == ExitCode.USAGE
    assert verify(tmp_path / "run.zarr") == []
    assert "all speeds are computed" in tell(tmp_path)


def test_a_run_goes_on_when_nobody_reads(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    assert agfb(tmp_path, COMPUTE, stdout=writing, stderr=writing)[0] == ExitCode.DONE
    os.close(writing)
    assert verify(tmp_path / "run.zarr") == []
    assert "all speeds are computed" in tell(tmp_path)


def tell(folder: Path) -> str:
    command = [sys.executable, "-m", "agfb_cli", "info", "run.zarr"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return done.stdout
