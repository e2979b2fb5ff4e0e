"""Check a store: every required file is examined and every chunk decoded."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.transient_settings import EQUILIBRIUM
from pipelines.datasets.chunks import read_array
from pipelines.datasets.durable import PARTIAL
from pipelines.datasets.errors import StoreError
from pipelines.datasets.layout import ArrayLayout
from pipelines.datasets.metadata import (
    METADATA,
    GroupMetadata,
    has_lost_metadata,
    read_group_metadata,
    read_json,
)
from pipelines.datasets.reading import committed_rows
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, case_group, open_for_reading

DEEPEST_GROUP = 4  # cases, CASE, cycles, b000


@dataclass(frozen=True)
class Finding:
    """An error in a file or folder: ``severity`` is ``error`` (data lost) or ``note`` (harmless)."""

    path: Path
    problem: str
    advice: str
    severity: str = "error"


def verify(store: Store | Path | str) -> list[Finding]:
    """Everything that is wrong with a store; an empty list if it is intact.

    Checks all metadata against the schema, that every chunk of a committed row exists, decodes it
    (checksums), and that the cases and groups which others refer to are there. Chunks are read one at a time.
    Raises StoreError when the root is unusable.
    """
    opened = store if isinstance(store, Store) else open_for_reading(store)
    findings: list[Finding] = []
    groups: dict[str, GroupMetadata] = {}
    for group in _all_groups(opened):
        try:
            groups[group] = read_group_metadata(opened.path, group)
        except StoreError as error:
            findings.append(_finding(error))
            continue
        absent = _absent_parameters(groups, group)
        for array in groups[group].arrays.values():
            findings += _check_chunks(opened, group, groups[group], array, absent)
        findings += _check_capacities(groups[group])
    findings = [*_stray(opened.path, groups, [each.path for each in findings]), *findings]
    findings += _missing_cases(opened, groups)
    findings += _broken_references(groups)
    return list(dict.fromkeys(findings))


def _finding(error: StoreError) -> Finding:
    return Finding(error.path or Path(), error.message, error.advice)


def _all_groups(store: Store) -> Iterator[str]:
    """Every folder that is a group or has lost the metadata of one."""
    level = ["cases"]
    for _ in range(DEEPEST_GROUP):
        level = [group for group in level if _is_group(store.path / group)]
        yield from level
        level = [f"{group}/{name}" for group in level for name in _folders(store.path / group)]


def _is_group(folder: Path) -> bool:
    """Whether a folder is a group: not an array, and not a folder without store content."""
    if not os.path.lexists(folder / METADATA):
        return has_lost_metadata(folder)
    try:
        return read_json(folder / METADATA).get("node_type") != "array"
    except StoreError:
        return True


def _folders(folder: Path) -> list[str]:
    if folder.is_symlink() or not folder.is_dir():
        return []
    return sorted(p.name for p in folder.iterdir() if p.is_dir() and not p.is_symlink())


def _stray(root: Path, groups: Mapping[str, GroupMetadata], damaged: Sequence[Path]) -> Iterator[Finding]:
    """Entries that do not belong in a store; folders that are damaged groups are reported elsewhere."""
    known = {root} | {metadata.folder for metadata in groups.values()}
    known |= {metadata.folder / array for metadata in groups.values() for array in metadata.arrays}
    lost = {path.parent if path.name == METADATA else path for path in damaged}
    for path in sorted(root.rglob("*")):
        if path.is_symlink():
            yield Finding(path, "a link inside a store", "Copy the data it points to into its place")
        elif path.name.endswith(PARTIAL):
            yield Finding(path, "left by an interrupted write", "Resuming removes it", "note")
        elif path.is_dir():
            continue
        elif not path.is_file():
            yield Finding(path, "not a plain file", "Stores hold plain files only: replace it by a copy")
        elif lost.intersection(path.parents) or (path.name == METADATA and path.parent in known):
            continue
        elif not path.name.startswith("c.") or path.parent not in known:
            yield Finding(path, "does not belong to a store", "Move it elsewhere", "note")


def _missing_cases(store: Store, groups: Mapping[str, GroupMetadata]) -> Iterator[Finding]:
    """Cases of the store's configuration without a folder."""
    for case in store.attributes.get("configuration", {}):
        path = store.path / "cases" / case
        if case_group(case) not in groups and not path.is_dir():
            yield Finding(path, "the case is missing", "Restore this folder from a copy of the store")


def _broken_references(groups: Mapping[str, GroupMetadata]) -> Iterator[Finding]:
    """Groups that start at a row or an event of another group which is missing."""
    for group, metadata in groups.items():
        case = "/".join(group.split("/")[:2])
        for what, name, count, row in _references(metadata.attributes):
            other = groups.get(f"{case}/{name}")
            there = 0 if other is None else int(other.attributes.get(count, 0))
            if other is None or (row is not None and not 0 <= row < there):
                which = "" if row is None else f", {'event' if count == 'n_events' else 'row'} {row}"
                yield Finding(
                    metadata.folder,
                    f"its {what} is not in the store: {name}{which}",
                    f"Restore {name} from a copy of the store, or run the command that wrote it again",
                )


def _references(attributes: Mapping[str, Any]) -> Iterator[tuple[str, str, str, int | None]]:
    """References of a group: the other group, the attribute that counts its rows or events, and the index."""
    origin, request = attributes.get("origin"), attributes.get("request")
    if isinstance(origin, dict):
        yield "origin", str(origin.get("group")), "n_events", int(origin.get("event", -1))
    table = request.get("transient") if isinstance(request, dict) else None
    if isinstance(table, dict) and table.get("start", EQUILIBRIUM) != EQUILIBRIUM:
        start = str(table["start"])
        count = "n_events" if start.startswith("transient/") else "n_points"  # checkpoints, or points
        yield "start", start, count, table.get("start_row")
    if attributes.get("kind") == "transient_analysis" and "source" in attributes:
        yield "run", str(attributes["source"]), "n_points", None


def _absent_parameters(groups: Mapping[str, GroupMetadata], group: str) -> frozenset[str]:
    """Parameters that the machine of the group's case does not have; its rows hold no number for them."""
    case = groups.get("/".join(group.split("/")[:2]))
    parameters = {} if case is None else case.attributes.get("parameters", {})
    return frozenset(name for name, value in parameters.items() if value is None)


def _check_chunks(
    store: Store, group: str, metadata: GroupMetadata, array: ArrayLayout, absent: frozenset[str]
) -> list[Finding]:
    findings: list[Finding] = []
    rows = committed_rows(metadata, array)
    if 0 in array.shape:
        return findings
    for start in range(rows.start - rows.start % array.chunks[0], rows.stop, array.chunks[0]):
        first, last = max(start, rows.start), min(start + array.chunks[0], rows.stop)
        try:
            content = read_array(store, group, array, first, last)
        except StoreError as error:
            findings.append(_finding(error))
            continue
        spec = KINDS[metadata.kind]
        if array.role == "row" and array.spec.name in {*spec.coordinates, spec.row} - absent:
            findings += _check_written(metadata, array, content, first)
    return findings


def _check_written(
    metadata: GroupMetadata, array: ArrayLayout, content: np.ndarray, first: int
) -> Iterator[Finding]:
    unwritten = np.flatnonzero(np.isnan(content))
    if len(unwritten):
        yield Finding(
            metadata.folder / array.spec.name,
            f"row {first + int(unwritten[0])} counts as committed but holds no number",
            f"Remove the folder {metadata.folder} and run the same command again",
        )


def _check_capacities(metadata: GroupMetadata) -> Iterator[Finding]:
    row = KINDS[metadata.kind].row if metadata.kind in KINDS else None
    wanted = metadata.attributes.get("dimensions", {}).get(row)
    if any(a.shape[0] != wanted for a in metadata.arrays.values() if a.role == "row"):
        yield Finding(
            metadata.folder, "enlarging the branch was interrupted", "Run the same command again", "note"
        )
