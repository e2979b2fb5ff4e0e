"""A failed stage is told by its case until it succeeds, and then leaves no trace."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets import durable
from pipelines.datasets.failures import Failure, clear_failure, read_failures, record_failure
from pipelines.datasets.integrity import verify
from pipelines.datasets.metadata import CASE, encode_group, read_group_metadata
from pipelines.datasets.store import ForeignStoreError, Store
from tests.helpers.synthetic import compute, open_or_create
from tests.helpers.trees import tree

DIED = Failure("synthetic", "continue_cycles", "the process that computed it died 3 times", "use more memory")
NO_FILM = Failure("synthetic", "criticals", "no_equilibrium", "")


def test_failures_are_kept_by_stage_until_it_succeeds(store: Store) -> None:
    before = tree(store.path)
    record_failure(store, NO_FILM)
    record_failure(store, Failure("synthetic", "continue_cycles", "another", ""))
    record_failure(store, DIED)
    assert read_failures(store, "synthetic") == [DIED, NO_FILM]
    assert verify(store) == []
    clear_failure(store, "synthetic", "continue_cycles")
    assert read_failures(store, "synthetic") == [NO_FILM]
    clear_failure(store, "synthetic", "criticals")
    clear_failure(store, "synthetic", "criticals")
    assert read_failures(store, "synthetic") == []
    assert tree(store.path) == before


def test_a_success_without_a_failure_writes_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(durable, "_write", None)
    clear_failure(store, "synthetic", "criticals")


def test_what_an_interrupted_record_left_is_swept(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(store.path)

    def killed(path: Path, data: bytes, forced: bool) -> None:
        path.write_bytes(data[:20])
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(durable, "_write", killed)
        with pytest.raises(KeyboardInterrupt):
            record_failure(store, DIED)
    assert tree(store.path) != before
    assert read_failures(store, "synthetic") == []
    clear_failure(store, "synthetic", "criticals")
    assert tree(store.path) == before


def test_a_full_disk_keeps_what_was_known(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    record_failure(store, NO_FILM)
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", _full)
        with pytest.raises(OSError, match="No space left"):
            record_failure(store, DIED)
    assert read_failures(store, "synthetic") == [NO_FILM]
    assert verify(store) == []


def _full(source: Path, target: Path) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(
    "told", [3, {"run": "why"}, {"run": {"reason": "x"}}, {"run": {"reason": 1, "advice": ""}}]
)
def test_foreign_failures_are_refused(store: Store, told: object) -> None:
    group = "cases/synthetic"
    attributes = read_group_metadata(store.path, group, CASE).attributes | {"failures": told}
    (store.path / group / "zarr.json").write_bytes(encode_group(CASE, attributes))
    with pytest.raises(ForeignStoreError, match="the attribute failures is"):
        read_failures(store, "synthetic")


def test_the_commands_say_why(tmp_path: Path) -> None:
    runner, path = CliRunner(), tmp_path / "store.zarr"
    compute(path, 2, {"point": 4, "component": 6, "extended": 7, "column": 3}, durable=False)
    store = open_or_create(path, durable=False)
    record_failure(store, DIED)
    done = runner.invoke(app, ["status", str(path)])
    assert done.stdout.endswith(f"\ncontinue-cycles synthetic: failed: {DIED.reason}\n")
    assert done.stderr == f"  {DIED.advice}\n"
    answered = json.loads(runner.invoke(app, ["status", str(path), "--json"]).stdout)
    assert answered["failures"] == [vars(DIED)]
    lines = runner.invoke(app, ["info", str(path)]).stdout.splitlines()
    assert any(line.startswith("synthetic  continue-cycles") and DIED.reason in line for line in lines)
    clear_failure(store, "synthetic", "continue_cycles")
    assert "failed" not in runner.invoke(app, ["status", str(path)]).output
    assert "failed" not in runner.invoke(app, ["info", str(path)]).output
