"""The chunks of one commit: written by Zarr, and by the writer of the stores."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import zarr

from pipelines.datasets.branch import open_branch
from pipelines.datasets.chunks import chunk_file
from pipelines.datasets.durable import replace_files
from tests.benchmarks.measuring import Measurement, interleaved
from tests.benchmarks.settings import Settings
from tests.helpers.synthetic import GROUP, open_or_create, static

SIZES = {  # of a branch on 24x2
    "point": 200,
    "component": 166,
    "extended": 167,
    "column": 24,
    "multiplier": 24,
    "sample": 64,
    "coordinate": 14,
    "bearing": 2,
    "snapshot": 4,
    "theta": 24,
    "iteration": 12,
}


def commits(settings: Settings) -> list[Measurement]:
    """CPU time of Zarr's way over ours, files not forced to disk in either."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_or_create(Path(folder) / "a.zarr", durable=False)
        with open_branch(store, GROUP, "cycles", SIZES, static(SIZES), {}) as writer:
            arrays = [array for array in writer.arrays.values() if array.role != "static"]
        rng = np.random.default_rng(1)
        # whole chunks, which neither has to read before it writes
        whole = [(min(a.chunks[0], a.shape[0]), *a.row_shape) for a in arrays]
        rows = [rng.normal(size=n).astype(a.spec.dtype) for n, a in zip(whole, arrays, strict=True)]
        opened = [zarr.open_array(store.path / GROUP / array.spec.name, mode="r+") for array in arrays]

        def by_zarr() -> None:
            for target, content in zip(opened, rows, strict=True):
                target[: len(content)] = content

        def by_the_writer() -> None:
            chunks = zip(arrays, rows, strict=True)
            replace_files([chunk_file(store, GROUP, a, 0, rows) for a, rows in chunks], durable=False)

        pair = interleaved(by_zarr, by_the_writer, settings.tangent_pairs)
    told = f"the {len(arrays)} chunks of one commit to a branch on 24x2, in Zarr / in the stores' writer"
    return [
        Measurement("commit_ratio", pair.ratio, "1", told),
        Measurement("commit", 1e3 * pair.second, "ms", "CPU time of the latter"),
    ]
