"""On the first run a second process compiles a part of the kernels."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest

from pipelines.orbits.integration import equations
from pipelines.stages.scheduling import first_run


class Beside:
    """A second process that notes what is asked of it."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def kill(self) -> None:
        self.asked.append("kill")

    def wait(self) -> None:
        self.asked.append("wait")


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Beside:
    """A first run on two cores."""
    process = Beside()
    monkeypatch.setattr(first_run, "_started", lambda: process.asked.append("start") or process)
    monkeypatch.setattr(first_run, "_is_first", lambda: True)
    monkeypatch.setattr(first_run.os, "cpu_count", lambda: 2)
    return process


def test_the_first_run_waits_for_the_second_process(beside: Beside) -> None:
    with first_run.compiling_beside():
        assert beside.asked == ["start"]
    assert beside.asked == ["start", "wait"]


def test_a_failure_ends_the_second_process(beside: Beside) -> None:
    with pytest.raises(KeyboardInterrupt), first_run.compiling_beside():
        raise KeyboardInterrupt
    assert beside.asked == ["start", "kill", "wait"]


def test_one_core_compiles_alone(beside: Beside, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_run.os, "cpu_count", lambda: 1)
    with first_run.compiling_beside():
        pass
    assert beside.asked == []


def test_a_later_run_starts_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equations, "combine", SimpleNamespace(stats=SimpleNamespace(cache_misses={})))
    monkeypatch.setattr(first_run, "_started", lambda: pytest.fail("nothing is left to compile"))
    with first_run.compiling_beside():
        pass


def test_what_the_second_process_runs_compiles_the_loops() -> None:
    code = f"{first_run.BESIDE} as passes; print(passes.propagate_implicit.signatures)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told.startswith("[(int64")
