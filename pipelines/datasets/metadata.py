"""The ``zarr.json`` files of a store: written as deterministic bytes, checked before Zarr reads them.

A group's attributes say which arrays it has and how large they are; with the schema they fix every array's
metadata. Reading compares the files with that, so that shapes, types, codecs and links made elsewhere are
refused before memory is asked for.
"""

from __future__ import annotations

import copy
import json
import math
import os
import re
import stat
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeGuard

import google_crc32c
import numpy as np

from pipelines.datasets.durable import MAKING
from pipelines.datasets.errors import CorruptedError, ForeignStoreError, StoreError
from pipelines.datasets.layout import CONVENTIONS, LARGEST_ROWS, ArrayLayout, array_metadata, layout
from pipelines.datasets.schema import KINDS, SCHEMA_VERSION

METADATA = "zarr.json"
CHECKSUM = "attributes_crc32c"
LARGEST_METADATA_BYTES = 16 * 1024**2
DEEPEST_METADATA = 40  # tables within tables; a configuration has 8
CONTAINER = "container"
NUMBERED = ("point", "sample")
"""Rows of the kinds of which a case holds several groups, in a container."""
KINDS_OF_A_CASE = frozenset(name for name, kind in KINDS.items() if kind.row not in NUMBERED)
ROOT = "store"
CASE = "case"
FAILURES = "failures"

FOREIGN = "Name a store that agfb wrote"
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.=,@-]*")
RECOMPUTE = "Remove this folder and run the same command again: it is computed anew, everything else is kept"
RESTORE = (
    "Restore this file from a copy of the store, or start afresh with --force, which moves the store aside"
)


@dataclass(frozen=True)
class GroupMetadata:
    """A group as described by its ``zarr.json``: attributes and, by name, the arrays that it must have."""

    folder: Path
    kind: str
    attributes: dict[str, Any]
    arrays: dict[str, ArrayLayout]


def encode(content: Mapping[str, Any]) -> bytes:
    """JSON with sorted keys. Raises ValueError for NaN and infinities, which JSON does not have."""
    return json.dumps(content, indent=2, sort_keys=True, allow_nan=False, default=_plain).encode() + b"\n"


def _plain(value: object) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"an attribute cannot hold a {type(value).__name__}")


def encode_group(kind: str, attributes: Mapping[str, Any]) -> bytes:
    """``zarr.json`` of a group, with a checksum over its attributes.

    A flipped bit in JSON is often valid JSON.
    """
    known = {"kind": kind, "schema_version": SCHEMA_VERSION, "Conventions": CONVENTIONS}
    content = json.loads(encode({**attributes, **known}))
    content[CHECKSUM] = _checksum(content)
    return encode({"zarr_format": 3, "node_type": "group", "attributes": content})


def encode_array(array: ArrayLayout) -> bytes:
    """``zarr.json`` of an array."""
    return encode(array_metadata(array))


def _checksum(attributes: Mapping[str, Any]) -> int:
    return int(google_crc32c.value(encode({k: v for k, v in attributes.items() if k != CHECKSUM})))


def group_folder(store: Path, group: str) -> Path:
    """Folder of a group. Raises StoreError for names that leave the store, and for links on the way."""
    folder = store
    for name in group.split("/") if group else ():
        if not _NAME.fullmatch(name):
            raise StoreError(
                f"{group!r} is not the name of a group", "Names have letters, digits and _ . = , @ -", store
            )
        folder = folder / name
        if folder.is_symlink():
            raise ForeignStoreError(
                "a link inside a store", "Copy the data it points to into its place", folder
            )
    return folder


def has_lost_metadata(folder: Path) -> bool:
    """Whether arrays or groups lie below a folder without metadata that no process is creating."""

    def is_bare() -> bool:
        return not os.path.lexists(folder / METADATA)

    # asked twice: whoever makes the group publishes its metadata first and removes the mark then
    return (
        is_bare() and any(folder.glob(f"*/{METADATA}")) and not any(folder.glob(f"*/{MAKING}")) and is_bare()
    )


def require_metadata(store: Path, group: str) -> None:
    """Raise CorruptedError for a group whose metadata are lost: recreating it would lose its rows."""
    folder = group_folder(store, group)
    if has_lost_metadata(folder):
        raise CorruptedError("the file is missing", _remedy(store, group), folder / METADATA)


def read_group_metadata(store: Path, group: str, kind: str | None = None) -> GroupMetadata:
    """Attributes and array layouts of a group, checked against the schema; nothing else is read.

    Raises ForeignStoreError, CorruptedError, and StoreError when the group does not exist or is not of
    ``kind``.
    """
    try:
        metadata = _read_group_metadata(group_folder(store, group), kind)
        _check_place(group, metadata)
        return metadata
    except StoreError as error:
        if RECOMPUTE not in error.advice:
            raise
        raise type(error)(error.message, _remedy(store, group), error.path) from error


def _check_place(group: str, metadata: GroupMetadata) -> None:
    """Refuse kinds that do not belong where the group is."""
    depth = len(group.split("/")) if group else 0
    structure = {0: ROOT, 1: CONTAINER, 2: CASE}
    allowed = metadata.kind in KINDS or (depth == 3 and metadata.kind == CONTAINER)
    if metadata.kind != structure[depth] if depth in structure else not allowed:
        raise ForeignStoreError(
            f"a group of kind {metadata.kind[:100]!r} does not belong here", FOREIGN, metadata.folder
        )


def _remedy(store: Path, group: str) -> str:
    """What to do about a damaged group; the root and the cases are written once and cannot be recomputed."""
    depth = group.count("/")
    written_once = depth < 2 or (depth == 2 and group.rsplit("/", 1)[1] not in KINDS_OF_A_CASE)
    return RESTORE if written_once else RECOMPUTE.replace("this folder", f"the folder {store / group}")


Stamp = tuple[int, ...]
_SETTLED = 50_000_000  # ns: a file may change twice between two ticks of the file system's clock
_KNOWN = 1000  # groups that are kept as they were read: a search reads those of its case again and again


def _read_group_metadata(folder: Path, kind: str | None) -> GroupMetadata:
    declared = _latest(_declared, folder, _stamps(folder))
    if kind is not None and declared.kind != kind:
        raise ForeignStoreError(
            f"this is a group of kind {declared.kind!r}, not {kind!r}", "Name another store or group", folder
        )
    metadata = _latest(_checked, folder, _stamps(folder, *declared.arrays))
    return GroupMetadata(folder, metadata.kind, copy.deepcopy(metadata.attributes), dict(metadata.arrays))


def _stamps(folder: Path, *arrays: str) -> tuple[Stamp, ...]:
    """A stamp of the metadata of a group and of some of its arrays; empty if a file is missing or recent."""
    try:
        stamps = tuple(file_stamp(place / METADATA) for place in (folder, *map(folder.joinpath, arrays)))
    except OSError:
        return ()
    settled = time.time_ns() - _SETTLED
    return stamps if all(changed < settled for _, _, *times in stamps for changed in times) else ()


def file_stamp(path: Path) -> Stamp:
    """Inode, size and times of the last changes of a file: replacing it gives another stamp."""
    status = path.lstat()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _latest(read: Any, folder: Path, stamps: tuple[Stamp, ...]) -> GroupMetadata:
    """What ``read`` makes of a folder, remembered for its stamps if there are any."""
    found: GroupMetadata = read(folder, stamps) if stamps else read.__wrapped__(folder, stamps)
    return found


@lru_cache(_KNOWN)
def _declared(folder: Path, stamps: tuple[Stamp, ...]) -> GroupMetadata:
    """The group as its own metadata describe it; ``stamps`` tell when they must be read again."""
    attributes = _group_attributes(folder)
    found = attributes["kind"]
    arrays = _declared_arrays(folder, found, attributes) if found in KINDS else {}
    return GroupMetadata(folder, found, attributes, arrays)


@lru_cache(_KNOWN)
def _checked(folder: Path, stamps: tuple[Stamp, ...]) -> GroupMetadata:
    """The group with its arrays as their metadata describe them."""
    declared = _latest(_declared, folder, stamps[:1])
    counts = {"row": declared.attributes.get("n_points", 0), "event": declared.attributes.get("n_events", 0)}
    checked = {name: check_array(folder / name, a, counts.get(a.role)) for name, a in declared.arrays.items()}
    return replace(declared, arrays=checked)


def _group_attributes(folder: Path) -> dict[str, Any]:
    path = folder / METADATA
    content = read_json(path)
    attributes = content.get("attributes")
    if (
        content.get("node_type") != "group"
        or content.get("zarr_format") != 3
        or not isinstance(attributes, dict)
    ):
        raise ForeignStoreError("not the metadata of a Zarr v3 group", FOREIGN, path)
    version = attributes.get("schema_version")
    if type(version) is not int or not isinstance(attributes.get("kind"), str):
        raise ForeignStoreError("this group was not written by agfb", FOREIGN, path)
    if version != SCHEMA_VERSION:
        raise ForeignStoreError(
            f"written with schema version {version}, this program has {SCHEMA_VERSION}",
            "Read it with the version of agfb named in the store's attributes, or compute it again",
            path,
        )
    if attributes.get(CHECKSUM) != _checksum(attributes):
        raise CorruptedError("the attributes were changed or damaged (checksum)", RECOMPUTE, path)
    for name, is_allowed in _ALLOWED.get(attributes["kind"], _OF_RESULTS).items():
        if name in attributes and not is_allowed(attributes[name]):
            raise ForeignStoreError(f"the attribute {name} is {str(attributes[name])[:100]}", FOREIGN, path)
    return attributes


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_table(value: object) -> bool:
    return isinstance(value, dict)


def _are_words(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(word, str) for word in value)


def _are_numbers(value: object) -> bool:
    return isinstance(value, dict) and all(type(number) in (int, float) for number in value.values())


def _are_failures(value: object) -> bool:
    """Whether a value maps names of stages to reason and advice."""
    return isinstance(value, dict) and all(
        isinstance(why, dict) and set(why) == {"reason", "advice"} and all(map(_is_text, why.values()))
        for why in value.values()
    )


# What readers rely on, where it is there.
_OF_RESULTS: Mapping[str, Callable[[object], bool]] = {
    "status": _is_text,
    "stop_reason": _is_text,
    "stop_advice": _is_text,
}
_ALLOWED: Mapping[str, Mapping[str, Callable[[object], bool]]] = {
    ROOT: {
        "configuration": _is_table,
        "configuration_hash": _is_text,
        "versions": _is_table,
        "argv": _are_words,
    },
    CASE: {"name": _is_text, "parameters": _is_table, "scales": _are_numbers, FAILURES: _are_failures},
}


def _declared_arrays(folder: Path, kind: str, attributes: Mapping[str, Any]) -> dict[str, ArrayLayout]:
    sizes, names = attributes.get("dimensions"), attributes.get("arrays")
    if (
        not _are_sizes(sizes)
        or not isinstance(names, list)
        or not all(isinstance(name, str) for name in names)
    ):
        raise ForeignStoreError("the attributes do not list dimensions and arrays", FOREIGN, folder)
    try:
        arrays = layout(kind, sizes, tuple(names))
    except ValueError as error:
        raise ForeignStoreError(str(error), FOREIGN, folder) from error
    if unknown := sorted(set(names) - set(arrays)):
        raise ForeignStoreError(f"unknown arrays {', '.join(unknown)[:200]}", FOREIGN, folder)
    _check_counts(folder, kind, attributes, sizes)
    return arrays


def _are_sizes(sizes: object) -> TypeGuard[dict[str, int]]:
    return isinstance(sizes, dict) and all(type(n) is int for n in sizes.values())


def _check_counts(folder: Path, kind: str, attributes: Mapping[str, Any], sizes: Mapping[str, int]) -> None:
    row = KINDS[kind].row
    for count, dimension in (("n_points", row), ("n_events", KINDS[kind].event)):
        if count in attributes:
            number, capacity = attributes[count], sizes.get(dimension or "", 0)
            if type(number) is not int or not 0 <= number <= capacity:
                raise ForeignStoreError(
                    f"{count} is {number!r}, allowed are 0 to {capacity}", RECOMPUTE, folder
                )


def check_array(folder: Path, array: ArrayLayout, rows: int | None = None) -> ArrayLayout:
    """The array as in its ``zarr.json``, which must agree with the schema.

    With ``rows``, any capacity that holds so many will do: enlarging a branch rewrites one array after the
    other. Raises ForeignStoreError or CorruptedError.
    """
    if folder.is_symlink():
        raise ForeignStoreError("a link inside a store", "Copy the data it points to into its place", folder)
    found = read_json(folder / METADATA)
    shape = found.get("shape")
    if rows is not None and isinstance(shape, list) and shape and type(shape[0]) is int:
        array = array.with_rows(min(max(shape[0], rows), LARGEST_ROWS))
    expected = array_metadata(array)
    if _as_text(found) == _as_text(expected):
        return array
    for key in sorted(set(found) | set(expected)):
        if _as_text(found.get(key)) != _as_text(expected.get(key)):
            raise ForeignStoreError(
                f"{key} is {str(found.get(key))[:200]}, expected {str(expected.get(key))[:200]}",
                "The file is foreign or damaged. " + RECOMPUTE,
                folder / METADATA,
            )
    return array


def _as_text(content: Any) -> str:
    """A value as text for comparison: 40.0 and true are not 40 and 1 to Zarr."""
    return json.dumps(content, sort_keys=True)


def read_json(path: Path) -> dict[str, Any]:
    """Content of a metadata file.

    Raises ForeignStoreError for links and oversized files, CorruptedError for what is not JSON.
    """
    size = regular_file_size(path)
    if size is None:
        raise CorruptedError("the file is missing", RECOMPUTE, path)
    if size > LARGEST_METADATA_BYTES:
        raise ForeignStoreError(f"metadata of {size} bytes", FOREIGN, path)
    try:
        content = json.loads(path.read_bytes(), parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise CorruptedError(f"not readable as JSON ({str(error)[:100]})", RECOMPUTE, path) from error
    if not isinstance(content, dict):
        raise CorruptedError("not a JSON object", RECOMPUTE, path)
    if (depth := _depth(content)) > DEEPEST_METADATA:
        raise ForeignStoreError(f"metadata nested {depth} deep", FOREIGN, path)
    return content


def _finite(text: str) -> float:
    """A number of JSON, which has neither NaN nor infinities. Raises ValueError."""
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text} is not a number of JSON")
    return number


def _depth(content: dict[str, Any]) -> int:
    """Nesting depth of tables and lists."""
    depth = 0
    level: list[Any] = [content]
    while level:
        depth += 1
        nested: Iterable[Iterable[Any]] = (n.values() if isinstance(n, dict) else n for n in level)
        level = [item for items in nested for item in items if isinstance(item, dict | list)]
    return depth


def regular_file_size(path: Path) -> int | None:
    """Size of a plain file; None if there is none. Raises ForeignStoreError for links and folders."""
    try:
        status = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    if not stat.S_ISREG(status.st_mode):
        raise ForeignStoreError(
            "not a plain file", "Stores hold plain files only: replace it by a copy", path
        )
    return status.st_size
