"""Read stores into plain arrays, and describe what they hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipelines.datasets.chunks import read_array
from pipelines.datasets.layout import ArrayLayout
from pipelines.datasets.metadata import (
    CASE,
    CONTAINER,
    FAILURES,
    METADATA,
    GroupMetadata,
    Stamp,
    file_stamp,
    group_folder,
    read_group_metadata,
    require_metadata,
)
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS, Array
from pipelines.datasets.store import Store, case_group, local_name, open_for_reading


def list_cases(store: Store) -> list[str]:
    """Ids of the cases, sorted."""
    return _members(store, "cases")


def case_attributes(store: Store, case: str) -> dict[str, Any]:
    """Attributes of a case: name, parameters, scales."""
    return read_group_metadata(store.path, case_group(case), CASE).attributes


def list_groups(store: Store, case: str) -> list[str]:
    """Names of all groups of a case that hold data, for instance ``cases/kb10/cycles/b000``, sorted.

    Groups whose making was interrupted are left out: for them everything is still to be computed. Raises
    StoreError for metadata that are damaged or foreign, those of the case among them.
    """
    case_attributes(store, case)
    found = []
    for name in _members(store, case_group(case)):
        path = case_group(case, name)
        kind = read_group_metadata(store.path, path).kind
        found += [f"{path}/{inner}" for inner in _members(store, path)] if kind == CONTAINER else [path]
    return found


def _members(store: Store, group: str) -> list[str]:
    folder = group_folder(store.path, group)
    if not folder.is_dir():
        return []
    require_metadata(store.path, group)
    folders = sorted(entry for entry in folder.iterdir() if entry.is_dir())
    names = [entry.name for entry in folders if (entry / METADATA).is_file()]
    for name in names:
        group_folder(store.path, f"{group}/{name}")  # refuses links: to leave them out would lose results
    for entry in folders:
        if entry.name not in names:
            require_metadata(store.path, f"{group}/{entry.name}")
    return names


def read_group(store: Store, group: str, names: Sequence[str] | None = None) -> Group:
    """A group as plain arrays, with committed rows and events only; ``names`` restricts the arrays.

    Works while the group is being written: it sees the rows committed when it began. Arrays of slots belong
    to the newest row only and are read when named. Raises CorruptedError naming the file, ForeignStoreError,
    KeyError for an array that the group does not have.
    """
    metadata = read_group_metadata(store.path, group)
    if names is not None and (unknown := sorted(set(names) - set(metadata.arrays))):
        raise KeyError(f"{group} has no array {', '.join(unknown)}")
    wanted = [a for n, a in metadata.arrays.items() if n in names] if names is not None else None
    chosen = wanted if wanted is not None else [a for a in metadata.arrays.values() if a.role != "slot"]
    arrays = {a.spec.name: _read(store, group, metadata, a) for a in chosen}
    slots = {a.spec.name: arrays.pop(a.spec.name) for a in chosen if a.role == "slot"}
    return Group(group, metadata.kind, metadata.attributes, arrays, slots)


def metadata_stamp(store: Store, group: str) -> Stamp | None:
    """Distinguishes commits, each of which replaces the group's ``zarr.json``; None without one."""
    try:
        return file_stamp(group_folder(store.path, group) / METADATA)
    except FileNotFoundError:
        return None


def read_branch(store: Store, group: str, names: Sequence[str] | None = None) -> Group:
    """A group with rows (see `read_group`). Raises ValueError for other groups."""
    branch = read_group(store, group, names)
    if KINDS[branch.kind].row is None or "n_points" not in branch.attributes:
        raise ValueError(f"{group} is not a branch")
    return branch


def committed_rows(metadata: GroupMetadata, array: ArrayLayout) -> slice:
    """The part of an array that holds data."""
    points, events = metadata.attributes.get("n_points"), metadata.attributes.get("n_events")
    if array.role == "slot":
        newest = (points - 1) % 2 if points else 0
        return slice(newest, newest + (1 if points else 0))
    counts = {"row": points, "event": events}
    stop = counts.get(array.role)
    return slice(0, array.shape[0] if stop is None else stop)


def _read(store: Store, group: str, metadata: GroupMetadata, array: ArrayLayout) -> Array:
    rows = committed_rows(metadata, array)
    content = read_array(store, group, array, rows.start, rows.stop)
    return content[0] if array.role == "slot" and len(content) else content


def describe(store: Store | Path | str) -> dict[str, Any]:
    """The content of a store as plain data.

    Root attributes, and for each case its scales, its groups with their status, and the ``reason`` and
    ``advice`` of every stage that failed (see `pipelines.datasets.failures`).

    Only metadata are read. A group has ``kind``, ``status``, ``stop_reason``, ``stop_advice``, ``n_points``,
    ``capacity``, ``n_events`` and ``speeds_without_equilibrium`` (None where it has no such thing), and that
    of `agfb criticals` its ``condensation_error`` and ``caution``.
    """
    opened = store if isinstance(store, Store) else open_for_reading(store)
    cases = {case: describe_case(opened, case) for case in list_cases(opened)}
    hidden = ("kind", "attributes_crc32c", "Conventions")
    root = {key: value for key, value in opened.attributes.items() if key not in hidden}
    return {"path": str(opened.path), "attributes": root, "cases": cases}


def describe_case(store: Store, case: str) -> dict[str, Any]:
    """The groups and the failures of a case, as in `describe`."""
    groups = {local_name(group): _describe_group(store, group) for group in list_groups(store, case)}
    attributes = case_attributes(store, case)
    return {
        "name": attributes.get("name", case),
        "scales": attributes.get("scales"),
        "groups": groups,
        "failures": attributes.get(FAILURES, {}),
    }


_CONDENSATION = ("condensation_error", "caution")  # by `agfb criticals`


def _describe_group(store: Store, group: str) -> dict[str, Any]:
    metadata = read_group_metadata(store.path, group)
    attributes = metadata.attributes
    row = KINDS[metadata.kind].row
    keys = ("status", "stop_reason", "stop_advice", "n_points", "n_events", "speeds_without_equilibrium")
    condensation = {key: attributes[key] for key in _CONDENSATION if key in attributes}
    capacity = attributes["dimensions"].get(row) if "n_points" in attributes else None
    return (
        {"kind": metadata.kind, "capacity": capacity}
        | {key: attributes.get(key) for key in keys}
        | condensation
    )
