"""`agfb run` as a user types it: cases side by side, some first and the others later, and watched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import pipelines.stages.scheduling.preparation as preparation
from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.datasets.watching import commands
from tests.helpers.tiny import CONFIG, ROOT, TINY
from tests.helpers.trees import compare_trees, tree

OVERRIDES = (
    *TINY,
    "sweep.excitation.displacement=[0.1, 0.2]",
    "continue_cycles.max_points=3",
    # one line across a small plane, which meets nothing
    "track_curves.ranges=[[0.66, 0.74], [0.9, 0.95]]",
    "bifurcation_set.frequencies=1",
    "bifurcation_set.speeds=0",
    "bifurcation_set.max_rounds=1",
    "bifurcation_set.resonances=false",
)
FIRST, SECOND = "displacement=0.1", "displacement=0.2"
GROUPS = ["bifurcation_set", "criticals", "cycles/b000", "cycles/s000", "linear", "operating_point"]
RUN = ["run", str(CONFIG), "-o", "run.zarr", *(word for each in OVERRIDES for word in ("--set", each))]


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "agfb_cli", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def agfb(folder: Path, *words: str) -> tuple[str, str]:
    """What a command writes to stdout and stderr."""
    process = start(folder, *words)
    out, messages = process.communicate(timeout=180)
    assert process.returncode == 0, messages
    return out, messages


def there(folder: Path) -> dict[str, list[str]]:
    """What a dry run finds of every stage, by case."""
    found: dict[str, list[str]] = {}
    for each in json.loads(agfb(folder, *RUN, "--dry-run", "--json")[0])["plan"]:
        found.setdefault(each["case_id"], []).append(each["there"])
    return found


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict]]:
    """A folder where both cases were computed side by side, and what another process saw meanwhile."""
    folder = tmp_path_factory.mktemp("run")
    running = start(folder, *RUN, "--workers", "2", "-q", "--no-figures")
    while not (folder / "run.zarr").exists():
        assert running.poll() is None, running.communicate()
        time.sleep(0.01)
    looks, _ = agfb(folder, "status", "run.zarr", "--watch", "0.1", "--json")
    _, messages = running.communicate(timeout=180)
    assert running.returncode == 0, messages
    return folder, [json.loads(line) for line in looks.splitlines()]


def test_the_command_is_seen_before_the_store_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store that is there without its command would look ended to who watches it from the start."""
    seen: list[tuple[bool, int]] = []

    def full_disk(store: Path, *rest: object) -> None:
        seen.append((store.exists(), len(commands(store))))
        raise OSError(28, "No space left on device", str(store))

    monkeypatch.setattr(preparation, "prepare_store", full_disk)
    words = ["linearize", str(CONFIG), "-o", str(tmp_path / "run.zarr"), *RUN[4:]]
    assert CliRunner().invoke(app, words).exit_code == ExitCode.RESOURCES
    assert seen == [(False, 1)]
    assert not list(tmp_path.iterdir()), "the lock is gone with its command"


@pytest.mark.slow
def test_watching_sees_all_cases_to_the_end(watched: tuple[Path, list[dict]]) -> None:
    _, looks = watched
    assert all(list(look["cases"]) == [FIRST, SECOND] for look in looks)
    assert all(look["commands"] for look in looks[:-1]), "also where no group was being written"
    assert looks[-1]["commands"] == []
    points = [look["total"]["points"] for look in looks]
    assert points == sorted(points)
    assert {case["state"] for case in looks[-1]["cases"].values()} == {"ended"}
    assert sorted(state["group"] for state in looks[-1]["groups"] if state["case"] == FIRST) == GROUPS


@pytest.mark.slow
def test_some_cases_first_and_the_others_later(tmp_path: Path, watched: tuple[Path, list[dict]]) -> None:
    agfb(tmp_path, *RUN, "--case", FIRST, "--no-figures")
    first = tree(tmp_path / "run.zarr" / "cases" / FIRST)
    status = json.loads(agfb(tmp_path, "status", "run.zarr", "--json")[0])
    assert [case["state"] for case in status["cases"].values()] == ["ended", "not begun"]
    assert there(tmp_path) == {FIRST: ["complete"] * 4, SECOND: ["nothing"] * 4}

    agfb(tmp_path, *RUN, "--workers", "2", "--no-figures")
    assert tree(tmp_path / "run.zarr" / "cases" / FIRST) == first
    assert compare_trees(watched[0] / "run.zarr" / "cases", tmp_path / "run.zarr" / "cases") == []
    assert there(tmp_path) == dict.fromkeys((FIRST, SECOND), ["complete"] * 4)
    assert not (tmp_path / "run-figures").exists(), "drawing is tested where the chain is run alone"
