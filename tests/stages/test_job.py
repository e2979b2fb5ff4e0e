"""What a job reads of its store is what was committed last."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipelines.datasets.branch import open_branch
from pipelines.datasets.store import create_store
from pipelines.stages.job import Job
from tests.helpers.synthetic import LEAN, PROVENANCE, extend, static
from tests.helpers.tiny import tiny_case


def test_a_group_is_read_again_after_every_commit(tmp_path: Path) -> None:
    case = tiny_case()
    group = f"cases/{case.case_id}/cycles/b000"
    store = create_store(tmp_path / "a.zarr", {case.case_id: {"name": "tiny"}}, PROVENANCE, durable=False)
    job = Job.of("test", case, tmp_path / "a.zarr", lambda progress: None, lambda: False)
    with open_branch(store, group, "cycles", LEAN, static(LEAN)) as writer:
        for points in (1, 2, 5):
            extend(writer, points)
            found = job.read("cycles/b000", ("state",))
            assert found.n_points == len(found["state"]) == points
            assert np.isfinite(found["state"]).all()
            assert job.read("cycles/b000", ("state",)) is found
            assert set(job.read("cycles/b000", ("speed", "state")).arrays) == {"speed", "state"}
        writer.finish("range")
    assert job.read("cycles/b000", ("state",)).attributes["stop_reason"] == "range"
