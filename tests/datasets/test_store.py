"""Making and opening stores; everything that is not one is refused, with advice, before it can do harm."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipelines.case.reading import read_cases
from pipelines.datasets import metadata
from pipelines.datasets import store as store_module
from pipelines.datasets.branch import open_branch
from pipelines.datasets.errors import (
    CorruptedError,
    ForeignStoreError,
    LockedStoreError,
    NotAStoreError,
    OtherConfigurationError,
    StoreError,
)
from pipelines.datasets.metadata import encode_group, read_group_metadata, regular_file_size
from pipelines.datasets.provenance import provenance
from pipelines.datasets.reading import describe, list_cases, list_groups, read_branch, read_group
from pipelines.datasets.schema import SCHEMA_VERSION
from pipelines.datasets.store import Store, create_store, move_aside, open_for_reading, open_for_writing
from tests.helpers.synthetic import GROUP, LEAN, PROVENANCE, extend, static

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.fixture
def branch(store: Store) -> Path:
    """Folder of a branch with three points."""
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        extend(writer, 3)
    return store.path / GROUP


def read_all(path: Path) -> None:
    store = open_for_reading(path)
    for case in list_cases(store):
        for group in list_groups(store, case):
            read_group(store, group)


@pytest.mark.parametrize("make", ["nothing", "file", "empty", "other", "zarr2"])
def test_what_is_not_a_store_is_refused(tmp_path: Path, make: str) -> None:
    path = tmp_path / "place"
    if make == "file":
        path.write_text("text")
    elif make != "nothing":
        path.mkdir()
        if make == "zarr2":
            (path / ".zgroup").write_text('{"zarr_format": 2}')
        if make == "other":
            (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    for open_store in (open_for_reading, open_for_writing):
        with pytest.raises((NotAStoreError, ForeignStoreError)) as error:
            open_store(path)
        assert error.value.advice
        assert str(path) in str(error.value)


@pytest.mark.parametrize("make", ["file", "other", "store"])
def test_a_store_is_not_made_over_something(tmp_path: Path, make: str) -> None:
    path = tmp_path / "place"
    if make == "file":
        path.write_text("text")
    elif make == "other":
        path.mkdir()
        (path / "thesis.tex").write_text("text")
    else:
        create_store(path, {}, PROVENANCE)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(StoreError):
        create_store(path, {"other": {}}, PROVENANCE)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_store_is_made_in_an_empty_folder_and_below_new_ones(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert list_cases(create_store(tmp_path / "empty", {"a": {}, "b": {}}, PROVENANCE)) == ["a", "b"]
    assert list_cases(create_store(tmp_path / "new" / "deep", {"a": {}}, PROVENANCE)) == ["a"]


def test_an_interrupted_creation_leaves_no_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "place"
    with monkeypatch.context() as patch:
        patch.setattr(store_module.os, "rename", interrupted)
        with pytest.raises(KeyboardInterrupt):
            create_store(path, {"a": {}}, PROVENANCE)
    assert not path.exists()
    create_store(path, {"b": {}}, PROVENANCE)
    assert [p.name for p in tmp_path.iterdir()] == ["place"]
    assert list_cases(open_for_reading(path)) == ["b"]


def _configured(tmp_path: Path, *overrides: str) -> dict[str, Any]:
    text = (CONFIGS / "smoke.toml").read_text()
    return provenance(read_cases(text, "smoke.toml", overrides), ["agfb", "run"])


def test_another_configuration_is_refused_and_told_apart(tmp_path: Path) -> None:
    given = _configured(tmp_path)
    create_store(tmp_path / "store", {case: {} for case in given["configuration"]}, given)
    open_for_writing(tmp_path / "store", _configured(tmp_path, "continue_cycles.max_points=7"))
    with pytest.raises(OtherConfigurationError, match=r"operation\.speed: .* / 0\.123"):
        open_for_writing(tmp_path / "store", _configured(tmp_path, "operation.speed=0.123"))
    attributes = describe(tmp_path / "store")["attributes"]
    assert attributes["versions"]["zarr"] >= "3.1.6"
    assert attributes["argv"] == ["agfb", "run"]


def test_other_cases_are_refused(tmp_path: Path) -> None:
    stored = {"configuration": {"a": {}, "b": {}}, "configuration_hash": "1"}
    create_store(tmp_path / "store", {}, stored)
    with pytest.raises(OtherConfigurationError, match="b is only in the store; case c is not in the store"):
        open_for_writing(tmp_path / "store", {"configuration": {"a": {}, "c": {}}, "configuration_hash": "2"})


def test_errors_cross_process_borders() -> None:
    error = pickle.loads(pickle.dumps(LockedStoreError("is locked", "Wait", Path("/a"))))
    assert (type(error), str(error)) == (LockedStoreError, "/a: is locked. Wait")


OUTSIDE = ["../outside", "cases/../../outside", "/etc", "cases//..", "cases/a b", "cases/.x", "cases/"]


@pytest.mark.parametrize("group", OUTSIDE)
def test_names_do_not_leave_the_store(store: Store, group: str) -> None:
    with pytest.raises(StoreError):
        read_group(store, group)
    with pytest.raises(StoreError):
        open_branch(store, group, "cycles", LEAN)


@pytest.mark.parametrize("level", ["case", "group", "array", "chunk", "metadata"])
def test_links_are_refused(tmp_path: Path, store: Store, branch: Path, level: str) -> None:
    place = {
        "case": store.path / "cases" / "synthetic",
        "group": branch,
        "array": branch / "state",
        "chunk": branch / "state" / "c.0.0",
        "metadata": branch / "state" / "zarr.json",
    }[level]
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ForeignStoreError):
        read_group(open_for_reading(store.path), GROUP)


def rewrite(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    content = json.loads(path.read_text())
    change(content)
    if content["node_type"] == "group":  # a hostile writer knows the checksum
        attributes = {k: v for k, v in content["attributes"].items() if k != "attributes_crc32c"}
        text = encode_group(attributes["kind"], attributes)
        path.write_bytes(text)
    else:
        path.write_text(json.dumps(content))


TEXT = {"name": "null_terminated_bytes", "configuration": {"length_bytes": 8}}
PICKLE = {"name": "numcodecs.pickle", "configuration": {"protocol": 5}}
HOSTILE_ARRAYS = {
    "terabytes": lambda m: m.update(shape=[10**12, 6]),
    "one chunk of terabytes": lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=[10**12, 6]),
    "wide": lambda m: m.update(shape=[40, 10**12]),
    "negative": lambda m: m.update(shape=[-1, 6]),
    "not numbers": lambda m: m.update(shape=["40", 6]),
    "strings": lambda m: m.update(data_type="string"),
    "text": lambda m: m.update(data_type=TEXT),
    "pickles": lambda m: m["codecs"].insert(0, PICKLE),
    "no checksum": lambda m: m["codecs"].pop(),
    "shards": lambda m: m.update(codecs=[{"name": "sharding_indexed", "configuration": {}}]),
    "fill value": lambda m: m.update(fill_value=0.0),
    "transformers": lambda m: m.update(storage_transformers=[{"name": "x"}]),
    "units": lambda m: m["attributes"].update(units="m"),
}


@pytest.mark.parametrize("change", HOSTILE_ARRAYS.values(), ids=HOSTILE_ARRAYS)
def test_foreign_arrays_are_refused_before_memory_is_asked_for(
    store: Store, branch: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    rewrite(branch / "state" / "zarr.json", change)
    tracemalloc.start()
    try:
        for use in (read_all, lambda path: open_branch(open_for_writing(path), GROUP, "cycles", LEAN)):
            with pytest.raises(ForeignStoreError, match="state"):
                use(store.path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


HOSTILE_GROUPS = {
    "rows": lambda a: a["dimensions"].update(point=10**12),
    "columns": lambda a: a["dimensions"].update(component=10**12),
    "both": lambda a: a["dimensions"].update(component=10**5, column=10**5),
    "text": lambda a: a["dimensions"].update(point="40"),
    "list": lambda a: a.update(dimensions=[1, 2]),
    "more rows than there are": lambda a: a.update(n_points=41),
    "negative rows": lambda a: a.update(n_points=-1),
    "rows as a fraction": lambda a: a.update(n_points=1.5),
    "unknown array": lambda a: a["arrays"].append("../../outside"),
    "arrays as text": lambda a: a.update(arrays="state"),
}


@pytest.mark.parametrize("change", HOSTILE_GROUPS.values(), ids=HOSTILE_GROUPS)
def test_foreign_groups_are_refused(store: Store, branch: Path, change: Callable) -> None:
    rewrite(branch / "zarr.json", lambda m: change(m["attributes"]))
    with pytest.raises(ForeignStoreError):
        read_all(store.path)


def test_a_newer_schema_is_refused(store: Store, branch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    newer = SCHEMA_VERSION + 1
    monkeypatch.setattr("pipelines.datasets.metadata.SCHEMA_VERSION", newer)
    with pytest.raises(ForeignStoreError, match=f"version {SCHEMA_VERSION}, this program has {newer}"):
        open_for_reading(store.path)


def test_what_is_written_once_is_not_said_to_be_computed_anew(store: Store, branch: Path) -> None:
    case = "/".join(GROUP.split("/")[:2])
    for folder, advice in (
        (branch / "state", f"Remove the folder {branch} "),
        (branch, f"Remove the folder {branch} "),
        (store.path / case, "Restore this file"),
        (store.path, "Restore this file"),
    ):
        whole = (folder / "zarr.json").read_bytes()
        (folder / "zarr.json").write_bytes(whole[:50])
        with pytest.raises(CorruptedError) as error:
            describe(store.path)
        assert error.value.advice.startswith(advice)
        (folder / "zarr.json").write_bytes(whole)


def test_a_case_that_lost_its_description_is_not_replaced_by_an_empty_one(store: Store, branch: Path) -> None:
    case = branch.parent.parent
    (case / "zarr.json").unlink()
    with pytest.raises(CorruptedError, match="missing") as error:
        open_branch(store, GROUP, "cycles", LEAN)
    assert error.value.path == case / "zarr.json"
    assert not (case / "zarr.json").exists()


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b"[]", b"\xff\xfe", b'"text"'])
def test_metadata_that_are_not_json_objects(store: Store, branch: Path, content: bytes) -> None:
    (branch / "zarr.json").write_bytes(content)
    with pytest.raises(CorruptedError) as error:
        read_all(store.path)
    assert error.value.path == branch / "zarr.json"


def test_a_chunk_that_announces_gigabytes_is_refused(store: Store, branch: Path) -> None:
    chunk = branch / "state" / "c.0.0"
    header = bytearray(chunk.read_bytes())
    header[4:8] = (2**31 - 64).to_bytes(4, "little")
    chunk.write_bytes(header)
    with pytest.raises(CorruptedError, match="announces 2147483584 bytes"):
        read_all(store.path)


def test_a_chunk_replaced_while_it_is_looked_at_is_not_damaged(
    store: Store, branch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chunk = branch / "state" / "c.0.0"
    earlier = chunk.read_bytes()
    with open_branch(store, GROUP, "cycles", LEAN) as writer:
        extend(writer, 9)
    later = chunk.read_bytes()
    assert len(earlier) != len(later), "the sizes tell the files apart"

    def then_the_writer_replaces_it(path: Path) -> int | None:
        size = regular_file_size(path)
        if path == chunk:
            chunk.write_bytes(later)
        return size

    chunk.write_bytes(earlier)
    monkeypatch.setattr("pipelines.datasets.chunks.regular_file_size", then_the_writer_replaces_it)
    assert read_branch(open_for_reading(store.path), GROUP).n_points == 9


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError):
        create_store(tmp_path / "store", {}, PROVENANCE)


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    with pytest.raises(OSError, match="file") as error:
        create_store(tmp_path / "file" / "store", {}, PROVENANCE)
    assert error.value.filename


def test_moving_aside_waits_for_no_one_and_keeps_everything(store: Store, branch: Path) -> None:
    with open_branch(store, GROUP, "cycles", LEAN), pytest.raises(LockedStoreError):
        move_aside(store.path)
    first = move_aside(store.path)
    assert first.name == "store.zarr.old-1"
    read_all(first)
    shutil.copytree(first, store.path)
    assert move_aside(store.path).name == "store.zarr.old-2"


def test_a_damaged_store_can_be_moved_aside(store: Store) -> None:
    (store.path / "zarr.json").write_bytes(b"{")
    assert (move_aside(store.path) / "zarr.json").read_bytes() == b"{"
    assert not store.path.exists()


def test_metadata_are_parsed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until any of the files changes."""
    store = create_store(tmp_path / "run.zarr", {"synthetic": {"name": "synthetic"}}, PROVENANCE)
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN)) as writer:
        extend(writer, 2)
        array = store.path / GROUP / "state" / "zarr.json"
        time.sleep(0.1)  # what changed just now is read again: the clock of a file system is coarse
        first, original, parsed = read_group_metadata(store.path, GROUP), metadata.read_json, list[Path]()
        monkeypatch.setattr(metadata, "read_json", lambda path: parsed.append(path) or original(path))
        assert read_group_metadata(store.path, GROUP) == first
        assert parsed == []
        first.attributes["n_points"] = 7
        assert read_group_metadata(store.path, GROUP).attributes["n_points"] == 2, "each caller has its own"
        extend(writer, 3)
        assert read_group_metadata(store.path, GROUP).attributes["n_points"] == 3
    array.write_text(array.read_text().replace("float64", "float32"))
    with pytest.raises(ForeignStoreError, match="data_type"):
        read_group_metadata(store.path, GROUP)
