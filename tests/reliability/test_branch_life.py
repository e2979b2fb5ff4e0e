"""Any life of a branch: opened, grown, enlarged, ended, killed at any step of a write, and all of it again.

The model is a branch in memory: lists of rows and events. What a reader finds in the store is always what
the model holds, and at the end the files are those of a writer that was never disturbed.
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from pipelines.datasets import reading
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.errors import LockedStoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_branch
from pipelines.datasets.records import Group, MemoryBranch
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, open_for_reading, open_for_writing
from tests.helpers.faults import AROUND, BEFORE, Death, fault, full_disk
from tests.helpers.synthetic import GROUP, PROVENANCE, following, open_or_create, static
from tests.helpers.trees import compare_trees

# one array or two of every role, so that a life is short; orbits of 48 KB: two rows in a chunk
ARRAYS = frozenset(
    {"speed", "state", "newton_iterations", "orbit", "event_kind", "event_state", "basis", "basis_columns",
     "coordinate_node"}
)  # fmt: skip
FEW = replace(KINDS["cycles"], arrays=tuple(a for a in KINDS["cycles"].arrays if a.name in ARRAYS))
SIZES = {"point": 30, "component": 6, "column": 3, "sample": 100, "coordinate": 60}
FIRST_ROWS = 30
ENDED = {"stop_reason": "range", "stop_advice": "Widen the range", "status": "ended"}
STEPS_OF_A_COMMIT = 3 * 9  # of nine files
STEPS_OF_MAKING = 3 * 13


def open_writer(store: Store, rows: int) -> BranchWriter:
    sizes = SIZES | {"point": rows}
    return open_branch(store, GROUP, "cycles", sizes, static(SIZES), {"parameter": "speed"})


class BranchLife(RuleBasedStateMachine):
    """Rules are what may happen to a branch; each names the state in which it can."""

    def __init__(self) -> None:
        super().__init__()
        self.kinds = patch.dict(KINDS, cycles=FEW)
        self.kinds.start()
        self.folder = Path(tempfile.mkdtemp())
        self.path = self.folder / "store"
        self.model = MemoryBranch("cycles", SIZES, static(SIZES))
        self.rows = FIRST_ROWS
        self.writer: BranchWriter | None = None

    @initialize()
    def make(self) -> None:
        self.store = open_or_create(self.path, durable=False)

    @precondition(lambda self: self.writer is None)
    @rule(more=st.sampled_from([0, 0, 10]))
    def open(self, more: int) -> None:
        self.rows += more
        self.writer = open_writer(self.store, self.rows)
        self.check_resume()

    @precondition(lambda self: self.writer is None)
    @rule(more=st.sampled_from([0, 10]), step=st.integers(1, STEPS_OF_MAKING))
    def die_while_opening(self, more: int, step: int) -> None:
        with fault(step, Death(), AROUND) as hit:
            try:
                self.writer = open_writer(self.store, self.rows + more)
            except Death:
                assert hit
            else:
                self.rows += more

    @precondition(lambda self: self.writer is not None)
    @rule()
    def append(self) -> None:
        row = self.next_row()
        self.writer.commit(*row)
        self.model.commit(*row)

    @precondition(lambda self: self.writer is not None)
    @rule(step=st.integers(1, STEPS_OF_A_COMMIT * 2 // 3))
    def append_on_a_full_disk(self, step: int) -> None:
        """What fails has not happened, and the same writer may try again."""
        row = self.next_row()
        with fault(step, full_disk(), BEFORE) as hit:
            try:
                self.writer.commit(*row)
            except OSError:
                assert hit
            else:
                self.model.commit(*row)

    @precondition(lambda self: self.writer is not None)
    @rule(step=st.integers(1, STEPS_OF_A_COMMIT))
    def die_while_appending(self, step: int) -> None:
        """The row exists if the group's own file was renamed, and not before."""
        row = self.next_row()
        with fault(step, Death(), AROUND) as hit:
            try:
                self.writer.commit(*row)
            except Death:
                self.forget_writer()
        if not hit or (hit[0] == self.path / GROUP / "zarr.json" and self.committed() > len(self.model.rows)):
            self.model.commit(*row)

    @precondition(lambda self: self.writer is not None)
    @rule()
    def end(self) -> None:
        self.writer.finish(ENDED["stop_reason"], ENDED["stop_advice"])
        self.model.finish(ENDED["stop_reason"], ENDED["stop_advice"])

    @precondition(lambda self: self.writer is not None)
    @rule()
    def close(self) -> None:
        self.writer.close()
        self.writer = None

    @precondition(lambda self: self.writer is not None)
    @rule()
    def die(self) -> None:
        self.forget_writer()

    @precondition(lambda self: self.writer is not None)
    @rule(more=st.sampled_from([0, 10]))
    def refuse_a_second_writer(self, more: int) -> None:
        with pytest.raises(LockedStoreError):
            open_writer(open_for_writing(self.path, PROVENANCE, durable=False), self.rows + more)

    @precondition(lambda self: self.writer is not None)
    @rule()
    def append_while_it_is_read(self) -> None:
        """A row that is committed after a reader has begun is not in what it reads."""
        before, row, read = self.model.group(GROUP), self.next_row(), reading.read_array
        waiting = [row]

        def interrupted(*arguments: Any) -> Any:
            while waiting:
                self.writer.commit(*waiting.pop())
            return read(*arguments)

        with patch.object(reading, "read_array", interrupted):
            found = read_branch(open_for_reading(self.path), GROUP)
        self.model.commit(*row)
        assert_same(found, before)

    @invariant()
    def a_reader_finds_what_was_committed(self) -> None:
        if self.store.has_group(GROUP):
            assert_same(read_branch(open_for_reading(self.path), GROUP), self.model.group(GROUP))
        else:
            assert not self.model.rows

    def teardown(self) -> None:
        try:
            self.check_the_end()
        finally:
            self.kinds.stop()
            shutil.rmtree(self.folder)

    def check_the_end(self) -> None:
        """One more row, so that what a dead writer left behind the last one is written over, and the end."""
        if self.writer is None:
            self.writer = open_writer(self.store, self.rows)
        self.append()
        self.end()
        self.close()
        assert verify(self.path) == []
        undisturbed = open_or_create(self.folder / "undisturbed", durable=False)
        capacity = read_branch(self.store, GROUP, ()).attributes["dimensions"]["point"]
        with open_writer(undisturbed, capacity) as writer:
            while writer.n_points < len(self.model.rows):
                writer.commit(*following(writer.resume_row(), writer.arrays))
            writer.finish(ENDED["stop_reason"], ENDED["stop_advice"])
        assert compare_trees(undisturbed.path, self.path) == []
        assert not list(self.folder.glob(".*")), "locks are removed"

    def next_row(self) -> tuple[Any, ...]:
        """The row that follows the newest one: it depends on nothing else."""
        return following(self.writer.resume_row(), self.writer.arrays)

    def committed(self) -> int:
        return read_branch(open_for_reading(self.path), GROUP, ()).n_points

    def forget_writer(self) -> None:
        """A killed process: the kernel closes its files, and nobody removes the lock file."""
        self.writer._lock._file.close()
        self.writer = None

    def check_resume(self) -> None:
        stored, model = self.writer.resume_row(), self.model.resume_row()
        assert (stored is None) == (model is None)
        if model is not None:
            assert (stored.n_points, stored.n_events) == (model.n_points, model.n_events)
            for mine, other in ((stored.row, model.row), (stored.slots, model.slots)):
                assert set(mine) == set(other)
                for name in mine:
                    np.testing.assert_array_equal(mine[name], other[name], err_msg=name)


def assert_same(found: Group, model: Group) -> None:
    """All rows, events and fixed arrays, and how the branch stands."""
    assert (found.n_points, found.n_events) == (model.n_points, model.n_events)
    assert all(found.attributes[key] == model.attributes[key] for key in ENDED)
    for name, values in model.arrays.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


# a life takes a hundred times longer than another example
TestBranchLife = BranchLife.TestCase
TestBranchLife.settings = settings(
    max_examples=settings.default.max_examples // 5, stateful_step_count=15, deadline=None
)
