"""Chunk files are those that Zarr would write, byte for byte."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from pipelines.datasets.chunks import array_files, chunk_file, read_array
from pipelines.datasets.durable import replace_file, replace_files
from pipelines.datasets.layout import ArrayLayout, array_metadata, layout
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store

SIZES = {dimension: 5 for kind in KINDS.values() for spec in kind.arrays for dimension in spec.dimensions}
LAYOUTS = [a for k in KINDS.values() for a in layout(k.kind, {**SIZES, "slot": 2}).values()]
IN_PIECES = [replace(array, chunks=(2, *array.chunks[1:])) for array in LAYOUTS if array.role != "slot"]


def make(store: Store, group: str, array: ArrayLayout) -> Path:
    folder = store.path / group / array.spec.name
    folder.mkdir(parents=True)
    (folder / "zarr.json").write_text(json.dumps(array_metadata(array)))
    return folder


def content_of(array: ArrayLayout) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(3)
    content = np.asarray(100.0 * rng.standard_normal(array.shape)).astype(array.spec.dtype)
    content.flat[::3] = array.spec.fill
    return content


@pytest.mark.parametrize("array", LAYOUTS + IN_PIECES, ids=lambda a: f"{a.spec.name}-{a.chunks[0]}")
def test_the_files_are_those_of_zarr(store: Store, array: ArrayLayout) -> None:
    ours, theirs = make(store, "ours", array), make(store, "theirs", array)
    content = content_of(array)
    replace_files(list(array_files(store, "ours", array, content)))
    opened = zarr.open_array(theirs, mode="r+").with_config({"write_empty_chunks": True})
    opened[...] = content
    assert sorted(p.name for p in ours.iterdir()) == sorted(p.name for p in theirs.iterdir())
    for file in ours.iterdir():
        assert file.read_bytes() == (theirs / file.name).read_bytes()
    np.testing.assert_array_equal(read_array(store, "ours", array), content)


def test_a_chunk_of_many_compressed_blocks(store: Store) -> None:
    array = layout("cycles", {"point": 5, "component": 2000, "column": 300, "slot": 2})["basis"]
    test_the_files_are_those_of_zarr(store, array)
    assert (store.path / "ours" / "basis" / "c.0.0.0").stat().st_size > 2**20


def test_rows_that_are_not_given_are_fill_values(store: Store) -> None:
    array = layout("cycles", {"point": 5})["speed"]
    make(store, "group", array)
    replace_file(*chunk_file(store, "group", array, 0, np.array([1.0, 2.0])))
    np.testing.assert_array_equal(read_array(store, "group", array), [1.0, 2.0, *3 * [np.nan]])
