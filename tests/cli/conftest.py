"""A small configuration, and the program run in this process with stages that tests replace."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer.main
from typer.testing import CliRunner, Result

from agfb_cli.main import app
from pipelines.case.reading import NamedCase
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult
from pipelines.stages.scheduling import registry

ROOT = Path(__file__).resolve().parents[2]


def leaf_commands() -> dict[str, Any]:
    """Every command by the words behind `agfb`; those of a group have two."""
    commands: dict[str, Any] = {}
    for name, command in typer.main.get_group(app).commands.items():
        inner = getattr(command, "commands", None)
        if inner is None:
            commands[name] = command
        else:
            commands |= {f"{name} {below}": each for below, each in inner.items()}
    return commands


Behaviour = Callable[[NamedCase], StageResult]


@dataclass
class Program:
    """`agfb` with a stage that does what the test says; remembers what it was asked to compute."""

    monkeypatch: pytest.MonkeyPatch
    folder: Path

    def __post_init__(self) -> None:
        self.computed: list[tuple[str, str]] = []
        self.behaviour: Behaviour = succeed
        self.monkeypatch.setattr(registry, "stage_function", self.stage)
        self.monkeypatch.chdir(self.folder)

    def stage(self, name: str) -> Callable[..., StageResult]:
        def compute(case: NamedCase, store: Path, report: Report, should_stop: ShouldStop) -> StageResult:
            assert (store / "zarr.json").is_file()
            self.computed.append((name, case.case_id))
            report(Progress(name, case.case_id, 1, 1))
            return self.behaviour(case)

        return compute

    def __call__(self, *words: str) -> Result:
        self.monkeypatch.setattr(sys, "argv", ["agfb", *words])
        return CliRunner().invoke(app, list(words), prog_name="agfb")


def succeed(case: NamedCase) -> StageResult:
    return StageResult(case.case_id, True, "range", "", {"instability_speed": 1.0778})


@pytest.fixture
def smoke(tmp_path: Path) -> Path:
    """The smoke configuration under a name of its own."""
    path = tmp_path / "smoke.toml"
    path.write_text((ROOT / "configs" / "smoke.toml").read_text())
    return path


@pytest.fixture
def three(smoke: Path) -> Path:
    """Three cases: the smoke configuration swept over the foil stiffness."""
    path = smoke.with_name("three.toml")
    path.write_text(smoke.read_text() + "\n[sweep]\n'bearings.foil.stiffness' = [5.0, 10.0, 20.0]\n")
    return path


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Program:
    return Program(monkeypatch, tmp_path)
