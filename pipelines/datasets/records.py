"""Rows, slots and events of a branch in memory, checked against the schema without any file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pipelines.datasets.layout import ArrayLayout, layout
from pipelines.datasets.schema import KINDS, SLOT, Array, Role

Values = Mapping[str, Any]
RUNNING, ENDED, COMPLETE = "running", "ended", "complete"


@dataclass(frozen=True)
class Group:
    """One group as plain arrays: committed rows and events, flags as stored integers."""

    name: str
    kind: str
    attributes: Mapping[str, Any]
    arrays: Mapping[str, Array]
    slots: Mapping[str, Array] = field(default_factory=dict)

    @property
    def n_points(self) -> int:
        """Number of committed rows (0 for groups without rows)."""
        return int(self.attributes.get("n_points", 0))

    @property
    def n_events(self) -> int:
        """Number of committed events."""
        return int(self.attributes.get("n_events", 0))

    def __getitem__(self, name: str) -> Array:
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def labels(self, name: str) -> Array:
        """A flag array as its meanings (strings), "unset" where nothing was written.

        Other arrays are unchanged.
        """
        flags = KINDS[self.kind].array(name).flags
        return np.array(["unset", *flags])[self.arrays[name] + 1] if flags else self.arrays[name]

    def labelled(self) -> dict[str, Array]:
        """All arrays, flags as their meanings."""
        return {name: self.labels(name) for name in self.arrays}


@dataclass(frozen=True)
class Resume:
    """The state of a branch: its newest row with its slot."""

    n_points: int
    n_events: int
    row: Mapping[str, Array]
    slots: Mapping[str, Array]
    status: str
    stop_reason: str


class Branch(Protocol):
    """A recorder of a branch: a store (`BranchWriter`) or memory (`MemoryBranch`)."""

    def commit(self, row: Values, slots: Values | None = None, events: Sequence[Values] = ()) -> None:
        """Add one row, with the events found since the previous row."""

    def finish(self, stop_reason: str, advice: str = "", **attributes: Any) -> None:
        """Store why the branch ended."""

    def resume_row(self) -> Resume | None:
        """The newest row; None if there is none yet."""


def branch_sizes(kind: str, sizes: Mapping[str, int]) -> dict[str, int]:
    """Sizes of all dimensions of a branch; by default twice as many events fit as rows."""
    row = KINDS[kind].row
    if row is None or row not in sizes:
        raise ValueError(f"a branch of kind {kind!r} needs the size of its dimension {row!r}")
    complete = {SLOT: 2, KINDS[kind].event: 2 * sizes[row] + 16} | dict(sizes)
    used = {dimension for spec in KINDS[kind].arrays for dimension in spec.dimensions}
    if unknown := sorted(set(sizes) - used):
        raise ValueError(f"{kind} has no dimension {', '.join(unknown)}; it has {', '.join(sorted(used))}")
    return {dimension: size for dimension, size in complete.items() if dimension in used}


def with_role(arrays: Mapping[str, ArrayLayout], role: Role) -> dict[str, ArrayLayout]:
    """The arrays that have a role."""
    return {name: array for name, array in arrays.items() if array.role == role}


def fit_all(arrays: Mapping[str, ArrayLayout], values: Values, whole: bool = False) -> dict[str, Array]:
    """One value for every array, in its type and shape (its row shape unless ``whole``).

    Raises ValueError naming what is missing, unknown or of the wrong shape.
    """
    missing, unknown = sorted(set(arrays) - set(values)), sorted(set(values) - set(arrays))
    if missing or unknown:
        raise ValueError(
            f"missing: {', '.join(missing) or 'nothing'}; unknown: {', '.join(unknown) or 'nothing'}"
        )
    return {
        n: fit(array, values[n], array.shape if whole else array.row_shape) for n, array in arrays.items()
    }


def fit(array: ArrayLayout, value: Any, shape: tuple[int, ...]) -> Array:
    """A value in the array's type, padded to ``shape`` where the schema allows shorter data."""
    spec, given = array.spec, np.asarray(value)
    if not _is_representable(given, np.dtype(spec.dtype)):
        raise ValueError(f"{spec.name}: {given.dtype} given, {spec.dtype} expected")
    short = (
        spec.padded
        and given.ndim == len(shape)
        and all(a <= b for a, b in zip(given.shape, shape, strict=True))
    )
    if given.shape != shape and not short:
        raise ValueError(f"{spec.name}: shape {given.shape} given, {shape} expected")
    fitted = np.full(shape, spec.fill, dtype=spec.dtype)
    fitted[tuple(slice(n) for n in given.shape)] = given
    return fitted


def _is_representable(given: Array, dtype: np.dtype[Any]) -> bool:
    if dtype.kind != "i":
        return np.can_cast(given.dtype, dtype, "same_kind")
    if given.dtype.kind not in "iub":
        return False
    limits = np.iinfo(dtype)
    return given.size == 0 or bool(limits.min <= given.min() and given.max() <= limits.max)


class MemoryBranch:
    """A branch in memory with the interface and checks of the store's writer, for tests of algorithms."""

    def __init__(self, kind: str, sizes: Mapping[str, int], static: Values | None = None) -> None:
        self.kind = kind
        self.arrays = layout(kind, branch_sizes(kind, sizes))
        self.static = fit_all(with_role(self.arrays, "static"), static or {}, whole=True)
        self.rows: list[dict[str, Array]] = []
        self.events: list[dict[str, Array]] = []
        self.slots: dict[str, Array] = {}
        self.attributes: dict[str, Any] = {"status": RUNNING, "stop_reason": "", "stop_advice": ""}

    def commit(self, row: Values, slots: Values | None = None, events: Sequence[Values] = ()) -> None:
        """Add one row (see `Branch`). Raises ValueError for values that violate the schema."""
        fitted = fit_all(with_role(self.arrays, "row"), row)
        new_slots = fit_all(with_role(self.arrays, "slot"), slots or {})
        new_events = [fit_all(with_role(self.arrays, "event"), event) for event in events]
        self.rows.append(fitted)
        self.slots = new_slots
        self.events.extend(new_events)
        self.attributes |= {"status": RUNNING, "stop_reason": "", "stop_advice": ""}

    def finish(self, stop_reason: str, advice: str = "", **attributes: Any) -> None:
        """Store why the branch ended (see `Branch`)."""
        self.attributes |= {**attributes, "status": ENDED, "stop_reason": stop_reason, "stop_advice": advice}

    def resume_row(self) -> Resume | None:
        """The newest row (see `Branch`)."""
        if not self.rows:
            return None
        status, reason = self.attributes["status"], self.attributes["stop_reason"]
        return Resume(len(self.rows), len(self.events), self.rows[-1], self.slots, status, reason)

    def group(self, name: str = "memory") -> Group:
        """Everything committed, as `read_branch` would return it."""
        grown = {"row": self.rows, "event": self.events}
        arrays = dict(self.static)
        for array_name, array in self.arrays.items():
            if array.role in grown:
                values = [row[array_name] for row in grown[array.role]]
                empty = np.empty((0, *array.row_shape), dtype=array.spec.dtype)
                arrays[array_name] = np.stack(values) if values else empty
        counts = {"n_points": len(self.rows), "n_events": len(self.events)}
        return Group(name, self.kind, self.attributes | counts, arrays, self.slots)
