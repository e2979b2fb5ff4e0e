"""A writer that is killed leaves a store that resumes to the bytes of an undisturbed run."""

from __future__ import annotations

import multiprocessing
import random
import time
from pathlib import Path

from pipelines.datasets.integrity import verify
from tests.helpers.synthetic import FULL, compute
from tests.helpers.trees import compare_trees

POINTS = 24


def test_killed_writer_resumes_to_identical_bytes(tmp_path: Path, kills: int) -> None:
    # children are forked from a server that has imported everything: kills hit the writing, not the imports
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["tests.helpers.synthetic"])
    undisturbed = tmp_path / "undisturbed"
    compute(undisturbed, POINTS, FULL)
    moments = random.Random(20)
    killed, stores = 0, 0
    while killed < kills:
        path = tmp_path / f"killed{stores}"
        stores += 1
        ended = False
        while not ended and killed < kills:
            writer = processes.Process(target=compute, args=(path, POINTS, FULL))
            writer.start()
            time.sleep(moments.uniform(0.02, 0.25))
            ended = not writer.is_alive()
            if not ended:
                writer.kill()
                killed += 1
            writer.join()
            assert not ended or writer.exitcode == 0
        compute(path, POINTS, FULL)
        assert compare_trees(undisturbed, path) == []
        assert verify(path) == []
        assert not list(tmp_path.glob(".*")), "locks and building folders are removed"
    assert stores < kills, "runs must be longer than the time between kills"
