"""Groups of samples and checkpoints: several rows in one commit, and events under another name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.datasets import durable
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.errors import StoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_branch
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import create_store, open_for_reading, open_for_writing
from tests.helpers.synthetic import LEAN, PROVENANCE, static
from tests.helpers.trees import compare_trees

GROUP = "cases/synthetic/transient/t000"
SIZES = {"sample": 1200, "checkpoint": 6, "coordinate": 4, "bearing": 2, "axis": 2, "component": 9}
SIZES |= {"extreme": 10, "plane": 1}
BLOCK = 300


def opened(path: Path, sizes: dict[str, int] = SIZES) -> BranchWriter:
    if path.exists():
        store = open_for_writing(path, PROVENANCE)
    else:
        store = create_store(path, {"synthetic": {"name": "synthetic"}}, PROVENANCE)
    arrays = {
        "coordinate_node": np.array([0, 0, 1, 1]),
        "coordinate_axis": np.array([0, 1, 0, 1], dtype=np.int8),
        "plane_node": np.array([1]),
        "plane_moment": np.array([1e-6]),
        "plane_phase": np.array([0.0]),
    }
    return open_branch(store, GROUP, "transient", sizes, arrays, {"request": {"transient": 1}})


def values(writer: BranchWriter, role: str, number: int) -> dict[str, Any]:
    """A row or an event whose every value follows from its number."""
    return {
        name: np.full(array.row_shape, number).astype(array.spec.dtype)
        for name, array in writer.arrays.items()
        if array.role == role
    }


def add_blocks(writer: BranchWriter, until: int) -> None:
    while writer.n_events < until:
        block = writer.n_events
        rows = [values(writer, "row", writer.n_points + k) for k in range(BLOCK)]
        writer.extend(rows, [values(writer, "event", block)])


def test_blocks_come_back_and_resume_to_the_same_bytes(tmp_path: Path) -> None:
    with opened(tmp_path / "whole.zarr") as writer:
        add_blocks(writer, 4)
        writer.finish("finished")
    for until in (1, 2, 4):
        with opened(tmp_path / "parts.zarr") as writer:
            add_blocks(writer, until)
            newest = writer.newest_event()
            assert newest is not None
            np.testing.assert_array_equal(newest["checkpoint_state"], np.full(9, until - 1.0))
            if until == 4:
                writer.finish("finished")
    assert compare_trees(tmp_path / "whole.zarr", tmp_path / "parts.zarr") == []
    found = read_branch(open_for_reading(tmp_path / "whole.zarr"), GROUP)
    assert (found.n_points, found.n_events) == (1200, 4)
    np.testing.assert_array_equal(found["time"], np.arange(1200.0))
    np.testing.assert_array_equal(found["checkpoint_time"], np.arange(4.0))
    assert verify(tmp_path / "whole.zarr") == []


def test_a_block_that_fails_half_way_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.zarr"
    write = durable._write
    # the ninth write lies in the second chunk of a column: the block goes over both
    with opened(path) as writer:
        add_blocks(writer, 1)
        calls = iter(range(100))

        def failing(target: Path, data: bytes, forced: bool) -> None:
            if next(calls) == 9:
                raise OSError(28, "no space")
            write(target, data, forced)

        monkeypatch.setattr(durable, "_write", failing)
        with pytest.raises(OSError, match="no space"):
            add_blocks(writer, 2)
        monkeypatch.setattr(durable, "_write", write)
        found = read_branch(open_for_reading(path), GROUP)
        assert (found.n_points, found.n_events) == (BLOCK, 1)
        np.testing.assert_array_equal(found["time"], np.arange(float(BLOCK)))
        add_blocks(writer, 4)
    found = read_branch(open_for_reading(path), GROUP)
    np.testing.assert_array_equal(found["displacement"][:, 0], np.arange(1200.0))


def test_a_checkpoint_without_samples_and_what_does_not_fit(tmp_path: Path) -> None:
    with opened(tmp_path / "run.zarr") as writer:
        assert writer.newest_event() is None
        writer.extend([], [values(writer, "event", 0)])
        assert (writer.n_points, writer.n_events) == (0, 1)
        with pytest.raises(StoreError, match="the branch is full"):
            writer.extend([values(writer, "row", k) for k in range(1201)])
        with pytest.raises(StoreError, match="the branch is full"):
            writer.extend([], [values(writer, "event", k) for k in range(6)])
        row = values(writer, "row", 0)
        del row["time"]
        with pytest.raises(ValueError, match="missing: time"):
            writer.extend([row])
        assert (writer.n_points, writer.n_events) == (0, 1)


def test_rows_with_slots_are_committed_one_by_one(tmp_path: Path) -> None:
    store = create_store(tmp_path / "run.zarr", {"synthetic": {"name": "synthetic"}}, PROVENANCE)
    with (
        open_branch(store, "cases/synthetic/cycles/b000", "cycles", LEAN, static(LEAN)) as branch,
        pytest.raises(ValueError, match="one by one"),
    ):
        branch.extend([])


def test_the_kind_names_its_own_events() -> None:
    kind = KINDS["transient"]
    roles = {spec.name: kind.role(spec) for spec in kind.arrays}
    assert roles["time"] == "row"
    assert roles["checkpoint_state"] == "event"
    assert roles["plane_moment"] == "static"
