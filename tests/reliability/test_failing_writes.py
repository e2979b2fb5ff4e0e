"""Every write fails once, on a full disk: nothing committed is lost and resuming gives the same bytes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from pipelines.datasets.branch import open_branch
from pipelines.datasets.reading import read_branch
from tests.helpers.faults import BEFORE, fault, full_disk
from tests.helpers.synthetic import GROUP, LEAN, compute, extend, following, open_or_create, static
from tests.helpers.trees import compare_trees

POINTS = 2


@pytest.mark.parametrize("step", BEFORE)
def test_every_failing_write_resumes_to_identical_bytes(tmp_path: Path, step: str) -> None:
    undisturbed = tmp_path / "undisturbed"
    compute(undisturbed, POINTS, LEAN, durable=False)
    # each write of the whole run in the first case; the second differs only in the file left behind: every
    # seventh
    for k in itertools.count(1, 1 if step == "write" else 7):
        path = tmp_path / f"failing{k}"
        with fault(k, full_disk(), (step,)):
            failed = _error_of(lambda path=path: compute(path, POINTS, LEAN, durable=False))
        if failed is None:
            break  # the run has fewer than k writes
        assert Path(failed.filename).is_relative_to(tmp_path), "the message names the file"
        compute(path, POINTS, LEAN, durable=False)
        assert compare_trees(undisturbed, path) == [], f"after write {k} failed"
    assert k > 70, "a run of two points has more writes than that"


def test_a_failed_commit_can_be_tried_again(tmp_path: Path) -> None:
    undisturbed = tmp_path / "undisturbed"
    compute(undisturbed, POINTS, LEAN, durable=False)
    path = tmp_path / "retried"
    store = open_or_create(path, durable=False)
    with open_branch(store, GROUP, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
        extend(writer, POINTS - 1)
        row, slots, events = following(writer.resume_row(), writer.arrays)
        for k in range(1, len(writer.arrays) + 2):  # one write for every array, one for the group
            twice = [*events, *events]  # more events than the attempt that will succeed
            with fault(k, full_disk(), ("write",)), pytest.raises(OSError, match="No space left"):
                writer.commit(row, slots, twice)
            assert read_branch(store, GROUP).n_points == POINTS - 1
        writer.commit(row, slots, events)
    compute(path, POINTS, LEAN, durable=False)
    assert compare_trees(undisturbed, path) == []


def _error_of(run: Callable[[], None]) -> OSError | None:
    try:
        run()
    except OSError as error:
        return error
    return None
