"""Is a store whole? Every file that must exist is looked at and every chunk decoded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.datasets.chunks import read_array
from pipelines.datasets.durable import PARTIAL
from pipelines.datasets.errors import StoreError
from pipelines.datasets.layout import ArrayLayout
from pipelines.datasets.metadata import METADATA, GroupMetadata, read_group_metadata
from pipelines.datasets.reading import committed_rows
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, open_for_reading

NUMBERED = ("point", "sample")
"""Rows of the kinds of which a case holds several groups, in a folder."""


@dataclass(frozen=True)
class Finding:
    """Something wrong with a file or folder: ``severity`` is ``error`` (data lost) or ``note`` (harmless)."""

    path: Path
    problem: str
    advice: str
    severity: str = "error"


def verify(store: Store | Path | str) -> list[Finding]:
    """Everything wrong with a store, an empty list when it is whole.

    Checks all metadata against the schema, that every chunk of a committed row exists, and decodes it
    (checksums). Chunks are read one at a time. Raises StoreError when the root is unusable.
    """
    opened = store if isinstance(store, Store) else open_for_reading(store)
    findings = list(_stray(opened.path))
    for group in _all_groups(opened):
        try:
            metadata = read_group_metadata(opened.path, group)
        except StoreError as error:
            findings.append(_finding(error))
            continue
        for array in metadata.arrays.values():
            findings += _check_chunks(opened, group, metadata, array)
        findings += _check_capacities(metadata)
    return list(dict.fromkeys(findings))


def _finding(error: StoreError) -> Finding:
    return Finding(error.path or Path(), error.message, error.advice)


def _all_groups(store: Store) -> Iterator[str]:
    """Every folder that must be a group: what has metadata itself or below, except arrays."""
    yield "cases"
    for case in _folders(store.path / "cases"):
        yield f"cases/{case}"
        for name in _folders(store.path / "cases" / case):
            path = f"cases/{case}/{name}"
            if name in KINDS and KINDS[name].row not in NUMBERED:
                if _is_made(store.path / path):
                    yield path
                continue
            yield path
            yield from (f"{path}/{n}" for n in _folders(store.path / path) if _is_made(store.path / path / n))


def _folders(folder: Path) -> list[str]:
    if folder.is_symlink() or not folder.is_dir():
        return []
    return sorted(p.name for p in folder.iterdir() if p.is_dir())


def _is_made(folder: Path) -> bool:
    return (folder / METADATA).is_file()


def _stray(root: Path) -> Iterator[Finding]:
    for path in sorted(root.rglob("*")):
        if path.is_symlink():
            yield Finding(path, "a link inside a store", "Copy the data it points to into its place")
        elif path.name.endswith(PARTIAL):
            yield Finding(path, "left by an interrupted write", "Resuming removes it", "note")
        elif path.is_dir():
            continue
        elif not path.is_file():
            yield Finding(path, "not a plain file", "Stores hold plain files only: replace it by a copy")
        elif path.name == METADATA:
            continue
        elif not path.name.startswith("c.") or not _is_made(path.parent):
            yield Finding(path, "does not belong to a store", "Move it elsewhere", "note")


def _check_chunks(store: Store, group: str, metadata: GroupMetadata, array: ArrayLayout) -> list[Finding]:
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
        row = KINDS[metadata.kind].row
        if array.role == "row" and array.spec.name in (*KINDS[metadata.kind].coordinates, row):
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
