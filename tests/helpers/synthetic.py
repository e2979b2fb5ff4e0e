"""A branch that costs nothing to compute, and whose every row follows from the committed one before it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipelines.datasets.branch import BranchWriter, open_branch, write_group
from pipelines.datasets.layout import ArrayLayout, layout
from pipelines.datasets.records import Branch, Resume
from pipelines.datasets.store import Store, create_store, open_for_writing

GROUP = "cases/synthetic/cycles/b000"
CRITICALS = "cases/synthetic/criticals"
LEAN = {"point": 40, "component": 6, "extended": 7, "column": 3}
# 40 samples of 24 coordinates are 7.5 KiB, 17 rows per chunk: a short branch runs over several chunks
FULL = LEAN | {
    "multiplier": 5,
    "sample": 40,
    "coordinate": 24,
    "bearing": 2,
    "snapshot": 2,
    "theta": 9,
    "iteration": 4,
}
PROVENANCE = {"configuration": {"synthetic": {"gas": {"viscosity": 1.8e-5}}}, "configuration_hash": "0123"}


def compute(path: Path, points: int, sizes: dict[str, int], durable: bool = True) -> None:
    """Make or resume the store at ``path`` and bring it to its end."""
    store = open_or_create(path, durable)
    with open_branch(store, GROUP, "cycles", sizes, static(sizes), {"parameter": "speed"}) as writer:
        extend(writer, points)
        if writer.status == "running":
            writer.finish("maximum_points", "Raise max_points")
    if not store.has_group(CRITICALS):
        write_group(
            store, CRITICALS, "criticals", {"critical_speed": np.array([0.5, 1.25])}, {"note": "none"}
        )


def open_or_create(path: Path, durable: bool = True) -> Store:
    if path.exists():
        return open_for_writing(path, PROVENANCE, durable=durable)
    return create_store(path, {"synthetic": {"name": "synthetic"}}, PROVENANCE, durable=durable)


def extend(writer: BranchWriter, points: int) -> None:
    """Commit rows until there are ``points``."""
    while writer.n_points < points:
        step(writer, writer.arrays)


def step(branch: Branch, arrays: dict[str, ArrayLayout]) -> None:
    """Commit the row that follows the newest one."""
    branch.commit(*following(branch.resume_row(), arrays))


def following(
    newest: Resume | None, arrays: dict[str, ArrayLayout]
) -> tuple[dict[str, Any], dict[str, Any], list[dict[str, Any]]]:
    """Row, slot and events behind ``newest``: a chaotic map of its state and its basis, so that an error of
    one
    bit in either would change all that follows.
    """
    number = 0 if newest is None else newest.n_points
    state = np.arange(1.0, 7.0) / 7.0 if newest is None else np.asarray(newest.row["state"])
    basis = np.zeros((6, 3)) if newest is None else np.asarray(newest.slots["basis"])
    state = 4.0 * state * (1.0 - state) * (0.9 + 0.1 * np.cos(np.nansum(basis)))
    columns = 1 + number % 3
    row = {name: _values(a, state, number) for name, a in arrays.items() if a.role == "row"}
    slot = {"basis": np.outer(state, np.arange(1.0, 1.0 + columns)), "basis_columns": columns}
    event = {name: _values(a, state, number) for name, a in arrays.items() if a.role == "event"}
    return row | {"state": state}, slot, [event] * (number % 3)


def _values(array: ArrayLayout, state: np.ndarray, number: int) -> np.ndarray:
    shape = array.row_shape
    if array.spec.dtype.startswith("int"):
        return np.full(shape, number % 2)
    values = np.resize(state, shape) + number
    return values * (1.0 + 0.5j) if array.spec.dtype == "complex128" else values


def static(sizes: dict[str, int]) -> dict[str, np.ndarray]:
    """The arrays that are written once."""
    return {
        name: np.resize(np.arange(2 if a.spec.dtype == "int8" else 1000), a.shape)
        for name, a in layout("cycles", {**sizes, "slot": 2}).items()
        if a.role == "static"
    }
