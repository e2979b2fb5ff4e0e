"""What another process sees of a store: running, interrupted, ended."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.branch import open_branch
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.store import LockedStoreError, NotAStoreError, Store, move_aside
from pipelines.datasets.watching import GroupTotals, command_lock, commands, totals, watch
from tests.helpers.curves import empty_store
from tests.helpers.synthetic import GROUP, LEAN, extend, open_or_create, static


def test_an_ended_branch(finished: Path) -> None:
    criticals, state = watch(finished)
    assert (criticals.group, criticals.state, criticals.points) == ("criticals", "ended", None)
    assert (state.group, state.state, state.stop_reason) == ("cycles/b000", "ended", "maximum_points")
    assert (state.points, state.capacity, state.writer) == (20, 40, None)
    metadata = finished / GROUP / "zarr.json"
    _, later = watch(finished, now=metadata.stat().st_mtime + 90.0)
    assert later.age == pytest.approx(90.0)


def test_a_branch_that_is_being_written_is_left_alone(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
        for points in (1, 4):
            extend(writer, points)
            (state,) = watch(store.path)
            assert (state.state, state.points) == ("running", points)
            assert state.writer == f"{os.getpid()} on {socket.gethostname()}"
    (state,) = watch(store.path)
    assert (state.state, state.points, state.writer) == ("interrupted", 4, None)


def test_a_lock_left_by_a_killed_process(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
        extend(writer, 1)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    lock = GroupLock.file(store.path, GROUP)
    lock.parent.mkdir(exist_ok=True)
    lock.write_text(f"{gone.pid} {socket.gethostname()}\n")
    assert watch(store.path)[0].state == "interrupted"
    lock.write_text(f"{gone.pid} elsewhere\n")
    assert watch(store.path)[0].writer == f"{gone.pid} on elsewhere"


def test_the_sum_of_a_case(finished: Path) -> None:
    now = (finished / GROUP / "zarr.json").stat().st_mtime + 60.0
    found = totals(watch(finished, now))
    assert found == GroupTotals("ended", 0, 0, 2, 20, 40, pytest.approx(60.0, abs=30.0))
    assert totals([]) == GroupTotals("not begun", 0, 0, 0, 0, 0, None)


def test_a_command_is_seen_between_two_groups(store: Store) -> None:
    lock = GroupLock.file(store.path, "command/elsewhere-1")
    with command_lock(store.path):
        assert commands(store.path) == [f"{os.getpid()} on {socket.gethostname()}"]
        assert watch(store.path) == []
        with pytest.raises(LockedStoreError, match=f"process {os.getpid()}"):
            move_aside(store.path)
        lock.write_text("1 elsewhere\n")
        assert commands(store.path)[0] == "1 on elsewhere", "another computer is believed"
        lock.unlink()
    assert commands(store.path) == []
    assert not lock.parent.exists()


def test_what_a_killed_command_left_is_removed_by_the_next(store: Store) -> None:
    left = GroupLock.file(store.path, "command/elsewhere-1")
    left.parent.mkdir()
    left.write_text("1 elsewhere\n")
    with command_lock(store.path):
        assert commands(store.path) == [f"{os.getpid()} on {socket.gethostname()}"]
        with GroupLock(store.path, "command/elsewhere-2"), command_lock(store.path.with_name("other.zarr")):
            assert len(GroupLock.known(store.path)) == 2, "a living command is left alone"
    assert not left.parent.exists()


def test_no_store(tmp_path: Path) -> None:
    with pytest.raises(NotAStoreError):
        watch(tmp_path)


def test_the_command(store: Store) -> None:
    runner = CliRunner()
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
        extend(writer, 3)
        done = runner.invoke(app, ["status", str(store.path)])
        assert done.exit_code == 0
        assert "3 of at most 40" in done.stdout
        assert "1 of 1 cases begun; groups: 1 running, 0 interrupted, 0 ended" in done.stdout
        content = json.loads(runner.invoke(app, ["status", str(store.path), "--json"]).stdout)
        assert content["groups"][0]["points"] == 3
        assert content["cases"]["synthetic"]["state"] == "running"
        writer.finish("range")
    done = runner.invoke(app, ["status", str(store.path), "--watch", "0.1"])
    assert done.exit_code == 0, "watching ends when nothing is written"
    assert "0 running, 0 interrupted, 1 ended" in done.stdout
    assert runner.invoke(app, ["status", str(store.path), "--case", "other"]).exit_code == 2
    assert open_or_create(store.path, durable=False).has_group(GROUP)


def test_cases_that_have_not_begun(tmp_path: Path) -> None:
    store = empty_store(tmp_path / "a.zarr", "first", "second", "third")
    group = GROUP.replace("synthetic", "second")
    with open_branch(store, group, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
        extend(writer, 3)
    done = CliRunner().invoke(app, ["status", str(store.path)])
    assert re.search(r"^first +not begun +0 +- +-$", done.stdout, flags=re.MULTILINE)
    assert re.search(r"^second +interrupted +0 +3 of at most 40 +\d+ s ago$", done.stdout, flags=re.MULTILINE)
    assert "1 of 3 cases begun; groups: 0 running, 1 interrupted, 0 ended; 3 points" in done.stdout
    content = json.loads(CliRunner().invoke(app, ["status", str(store.path), "--json"]).stdout)
    assert [case["state"] for case in content["cases"].values()] == ["not begun", "interrupted", "not begun"]
    assert content["total"]["points"] == 3
