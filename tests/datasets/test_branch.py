"""Rows come back as they were written; branches resume, grow and refuse what is not theirs."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipelines.datasets import durable
from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.errors import LockedStoreError, OtherConfigurationError, StoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.layout import ArrayLayout, layout
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.reading import describe, read_branch, read_group
from pipelines.datasets.records import MemoryBranch
from pipelines.datasets.store import Store, open_for_reading, open_for_writing
from tests.helpers.synthetic import (
    FULL,
    GROUP,
    LEAN,
    compute,
    extend,
    following,
    open_or_create,
    static,
    step,
)
from tests.helpers.trees import compare_trees

ROOT = Path(__file__).resolve().parents[2]


def assert_same_groups(first: Any, second: Any) -> None:
    assert set(first.arrays) == set(second.arrays)
    for name in first.arrays:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_store_and_memory_hold_the_same(finished: Path) -> None:
    memory = MemoryBranch("cycles", FULL, static(FULL))
    for _ in range(20):
        step(memory, memory.arrays)
    memory.finish("maximum_points", "Raise max_points")
    stored = read_branch(open_for_reading(finished), GROUP)
    assert stored.n_points == 20
    assert stored.n_events == memory.group().n_events == 19
    assert_same_groups(stored, memory.group())
    assert set(stored.labels("direction")) == {"down", "up"}
    for key, value in memory.attributes.items():
        assert stored.attributes[key] == value
    newest = read_group(open_for_reading(finished), GROUP, ["basis", "basis_columns"]).slots
    np.testing.assert_array_equal(newest["basis"], memory.slots["basis"])


def any_row(arrays: dict[str, ArrayLayout]) -> st.SearchStrategy[dict[str, Any]]:
    elements = {
        "float64": st.floats(),
        "complex128": st.complex_numbers(),
        "int32": st.integers(-(2**31), 2**31 - 1),
    }
    return st.fixed_dictionaries(
        {
            name: hnp.arrays(
                a.spec.dtype,
                a.row_shape,
                elements=elements.get(a.spec.dtype, st.integers(0, max(0, len(a.spec.flags) - 1))),
            )
            for name, a in arrays.items()
        }
    )


TINY = {"speed": 3, "component": 2, "bearing": 1, "axis": 2, "eigenvalue": 2}
TINY_ROWS = {name: a for name, a in layout("linear", TINY).items() if a.role == "row"}


@settings(max_examples=15, deadline=None)
@given(st.lists(any_row(TINY_ROWS), max_size=3))
def test_any_rows_come_back_bit_for_bit(rows: list[dict[str, Any]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = open_or_create(Path(folder) / "store", durable=False)
        with open_branch(store, "cases/synthetic/linear", "linear", TINY) as writer:
            for row in rows:
                writer.commit(row)
        found = read_branch(store, "cases/synthetic/linear")
        for name in writer.arrays:
            expected = [row[name] for row in rows]
            assert found[name].shape[0] == len(rows)
            if rows:
                assert found[name].tobytes() == np.stack(expected).tobytes()


def test_a_larger_capacity_enlarges_a_branch_to_the_bytes_of_a_larger_one(tmp_path: Path) -> None:
    small, large = tmp_path / "small", tmp_path / "large"
    compute(small, 5, {**LEAN, "point": 5}, durable=False)
    compute(small, 9, {**LEAN, "point": 600}, durable=False)  # more than one chunk of scalars
    store = open_for_writing(small, durable=False)
    with open_branch(store, GROUP, "cycles", {**LEAN, "point": 600}) as writer:
        assert writer.capacity == 600
        writer.finish("maximum_points", "Raise max_points")
    compute(large, 9, {**LEAN, "point": 600}, durable=False)
    assert compare_trees(small, large) == []


def test_an_interrupted_enlargement_is_repeated_and_readable_meanwhile(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for path in (first, second):
        compute(path, 3, {**LEAN, "point": 3}, durable=False)
    metadata = second / GROUP / "state" / "zarr.json"
    content = json.loads(metadata.read_text())
    content["shape"][0] = 700
    metadata.write_text(json.dumps(content))
    assert read_branch(open_for_reading(second), GROUP)["state"].shape == (3, 6)
    for path in (first, second):
        compute(path, 4, {**LEAN, "point": 500}, durable=False)
    assert compare_trees(first, second) == []


def test_a_full_branch_says_so(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", {**LEAN, "point": 2}, static(LEAN)) as writer:
        extend(writer, 2)
        with pytest.raises(StoreError, match=r"the branch is full .*Raise max_points"):
            step(writer, writer.arrays)
        assert writer.n_points == 2


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"period": None}, "missing: period"),
        ({"nonsense": 1.0}, "unknown: nonsense"),
        ({"state": np.zeros(5)}, r"state: shape \(5,\) given, \(6,\) expected"),
        ({"period": 1.0j}, "period: complex128 given, float64 expected"),
        ({"newton_iterations": 2.5}, "newton_iterations: float64 given, int32 expected"),
        ({"newton_iterations": 2**40}, "newton_iterations: int64 given, int32 expected"),
        ({"state": np.array([object()] * 6)}, "state: object given"),
    ],
)
def test_rows_outside_the_schema_are_refused_and_change_nothing(
    store: Store, change: dict[str, Any], complaint: str
) -> None:
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN)) as writer:
        row, slots, events = following(None, writer.arrays)
        row = {k: v for k, v in (row | change).items() if v is not None}
        with pytest.raises(ValueError, match=complaint):
            writer.commit(row, slots, events)
        assert writer.n_points == 0
        assert not list((store.path / GROUP).rglob("c.*"))


def test_shorter_data_are_filled_up_where_the_schema_allows(store: Store) -> None:
    sizes = {**LEAN, "multiplier": 4}
    with open_branch(store, GROUP, "cycles", sizes) as writer:
        row, slots, events = following(None, writer.arrays)
        writer.commit(row | {"multipliers": [1.0, -0.5 + 0.1j]}, slots, events)
    stored = read_branch(store, GROUP)["multipliers"][0]
    assert stored[1] == -0.5 + 0.1j
    assert np.isnan(stored[2:]).all()


def test_attributes_without_nan(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        with pytest.raises(ValueError, match="JSON compliant"):
            writer.finish("closed", instability_speed=float("nan"))
        writer.finish("closed", instability_speed=None)
    assert read_branch(store, GROUP).attributes["status"] == "ended"


def test_finish_is_kept_and_a_later_commit_runs_again(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        extend(writer, 2)
        writer.finish("step_too_small", "Refine the grid", smallest_step=np.float64(1e-5))
    group = describe(store)["cases"]["synthetic"]["groups"]["cycles/b000"]
    assert group == {
        "kind": "cycles",
        "capacity": 40,
        "status": "ended",
        "stop_reason": "step_too_small",
        "stop_advice": "Refine the grid",
        "n_points": 2,
        "n_events": 1,
        "speeds_without_equilibrium": None,
    }
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        assert writer.resume_row().stop_reason == "step_too_small"
        extend(writer, 3)
    attributes = read_branch(store, GROUP).attributes
    assert (attributes["status"], attributes["stop_reason"]) == ("running", "")


def test_another_branch_in_its_place_is_refused(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN, {}, {"parameter": "speed"}) as writer:
        extend(writer, 1)
    with pytest.raises(OtherConfigurationError, match="component has size 6 in the store and 8 now"):
        open_branch(store, GROUP, "cycles", {**LEAN, "component": 8}, {}, {"parameter": "speed"})
    with pytest.raises(OtherConfigurationError, match="parameter is 'speed' in the store and 'period' now"):
        open_branch(store, GROUP, "cycles", LEAN, {}, {"parameter": "period"})
    open_branch(store, GROUP, "cycles", LEAN).close()  # the refused ones gave their locks back


def test_of_two_requests_only_what_differs_is_told(store: Store) -> None:
    request = {"step": 0.02, "range": [1.0, 2.0]}
    with open_branch(store, GROUP, "cycles", LEAN, {}, {"request": request}) as writer:
        extend(writer, 1)
    with pytest.raises(OtherConfigurationError) as error:
        open_branch(store, GROUP, "cycles", LEAN, {}, {"request": {**request, "step": 0.01}})
    assert error.value.message.endswith("request is {'step': 0.02} in the store and {'step': 0.01} now")


def test_a_branch_without_rows_is_made_as_it_is_asked_for_now(store: Store) -> None:
    """As after a corrected configuration: nothing that was computed is lost."""
    with open_branch(store, GROUP, "cycles", LEAN, {}, {"parameter": "speed"}) as writer:
        writer.finish("no_start", "Choose another start")
    open_branch(store, GROUP, "cycles", {**LEAN, "component": 8}, {}, {"parameter": "speed"}).close()
    with open_branch(store, GROUP, "cycles", LEAN, {}, {"parameter": "period"}) as writer:
        assert (writer.status, writer.n_points) == ("running", 0)
        extend(writer, 2)
    assert read_branch(store, GROUP).attributes["parameter"] == "period"
    assert verify(store) == []


def test_second_writer_is_refused_with_the_process_of_the_first(store: Store) -> None:
    code = (
        "import sys; from pathlib import Path; from pipelines.datasets.locking import GroupLock\n"
        f"lock = GroupLock(Path(sys.argv[1]), {GROUP!r}); print('locked', flush=True); sys.stdin.read()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(store.path)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert other.stdout.readline() == b"locked\n"
    with pytest.raises(LockedStoreError, match=f"written by process {other.pid} on"):
        open_branch(store, GROUP, "cycles", LEAN)
    open_branch(store, GROUP.replace("b000", "b001"), "cycles", LEAN).close()  # another group is free
    other.kill()
    other.communicate()
    open_branch(store, GROUP, "cycles", LEAN).close()  # the kernel gave the lock of the killed process back


def test_lock_files_leave_with_their_writer(store: Store) -> None:
    with GroupLock(store.path, "a"):
        with GroupLock(store.path, "b"), pytest.raises(LockedStoreError):
            GroupLock(store.path, "a")
        assert GroupLock.known(store.path) == ["a"]
    assert not list(store.path.parent.glob(".*"))


def test_a_file_system_without_locks_is_refused(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("pipelines.datasets.locking.fcntl.flock", flock)
    with pytest.raises(StoreError, match=r"cannot lock files .*Put the store on another one"):
        open_branch(store, GROUP, "cycles", LEAN)


def test_leftovers_of_interrupted_writes_are_swept(store: Store) -> None:
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        extend(writer, 1)
    left = [store.path / GROUP / "state" / "c.0.0.partial", store.path / GROUP / "speed" / "x.partial"]
    for path in left:
        path.write_bytes(b"half")
    open_branch(store, GROUP, "cycles", LEAN).close()
    assert not any(path.exists() for path in left)


def test_group_written_at_once_is_replaced_whole(store: Store) -> None:
    name = "cases/synthetic/criticals"
    three = {"critical_speed": [1.0, 2.0, 3.0], "critical_direction": [0, 1, 1]}
    write_group(store, name, "criticals", three)
    one = {"critical_speed": np.array([4.0]), "resonance_kind": np.zeros(0, int)}
    write_group(store, name, "criticals", one)
    group = read_group(store, name)
    assert set(group.arrays) == {"critical_speed", "resonance_kind"}
    assert group["critical_speed"].tolist() == [4.0]
    assert group["resonance_kind"].shape == (0,)
    with pytest.raises(ValueError, match="critical has size 2, other arrays have 1"):
        write_group(store, name, "criticals", {"critical_speed": [4.0], "critical_direction": [0, 1]})


def test_every_write_is_forced_to_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[str] = []
    renamed: list[str] = []
    original = durable.os.replace

    def fsync(descriptor: int) -> None:
        synced.append(str(Path(f"/proc/self/fd/{descriptor}").resolve()))

    monkeypatch.setattr(durable.os, "fsync", fsync)

    def replace(source: Path, target: Path) -> None:
        assert str(source) in synced, "content first, then the name"
        renamed.append(str(target))
        original(source, target)

    monkeypatch.setattr(durable.os, "replace", replace)
    store = open_or_create(tmp_path / "store")
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        synced.clear()
        renamed.clear()
        extend(writer, 1)
    assert renamed[-1] == str(store.path / GROUP / "zarr.json"), "the row exists when all else is written"
    written = [name for name, a in writer.arrays.items() if a.role in ("row", "slot")]
    assert len(renamed) == len(written) + 1
    assert {str(Path(name).parent) for name in renamed} <= set(synced)


def test_files_side_by_side_are_all_there_or_one_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [(tmp_path / f"{number}", bytes([number])) for number in range(50)]
    durable.replace_files(files)
    assert [path.read_bytes() for path, _ in files] == [data for _, data in files]
    write = durable._write

    def failing(partial: Path, data: bytes, forced: bool) -> None:
        if partial.name == "30.partial":
            raise OSError(errno.ENOSPC, "No space left")
        write(partial, data, forced)

    monkeypatch.setattr(durable, "_write", failing)
    with pytest.raises(OSError, match="No space left") as caught:
        durable.replace_files([(path, b"new") for path, _ in files])
    assert caught.value.filename == str(tmp_path / "30")
    assert (tmp_path / "30").read_bytes() == bytes([30])
    assert list(tmp_path.glob("*.partial")) == []
