"""A store: create it, or open it for writing or reading.

<store>                     root: resolved configuration, its hash, versions, git commit, argv
<store>/cases/<id>          one case: name, parameters, scales
<store>/cases/<id>/machine, linear, criticals, cycles/b000, ...
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.case.identity import differences
from pipelines.datasets.durable import about, make_folder, replace_file, sweep_partials, sync_folder
from pipelines.datasets.errors import (
    CorruptedError,
    ForeignStoreError,
    LockedStoreError,
    NotAStoreError,
    OtherConfigurationError,
    StoreError,
)
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import (
    CASE,
    CONTAINER,
    METADATA,
    RESTORE,
    ROOT,
    encode_group,
    group_folder,
    read_group_metadata,
)

__all__ = [
    "CorruptedError",
    "ForeignStoreError",
    "LockedStoreError",
    "NotAStoreError",
    "OtherConfigurationError",
    "Store",
    "StoreError",
    "create_store",
    "move_aside",
    "open_for_reading",
    "open_for_writing",
]


def case_group(case: str, *names: str) -> str:
    """The name of a group of a case: kb10, ``cycles/b000`` -> ``cases/kb10/cycles/b000``.

    Without ``names`` that of the case itself.
    """
    return "/".join(("cases", case, *names))


def local_name(group: str) -> str:
    """The name of a group within its case: ``cases/kb10/cycles/b000`` -> ``cycles/b000``."""
    return group.split("/", 2)[2]


@dataclass(frozen=True)
class Store:
    """An open store. ``attributes`` are those of the root. ``durable`` forces every write to disk (fsync)."""

    path: Path
    attributes: Mapping[str, Any]
    read_only: bool
    durable: bool = True

    def has_group(self, group: str) -> bool:
        """Whether the group exists; a group whose creation was interrupted does not."""
        return (group_folder(self.path, group) / METADATA).is_file()


def create_store(
    path: Path | str,
    cases: Mapping[str, Mapping[str, Any]],
    provenance: Mapping[str, Any],
    *,
    durable: bool = True,
) -> Store:
    """Create a store with one group per case, atomically, and open it for writing.

    ``cases`` maps case ids to the attributes of their groups, ``provenance`` holds the attributes of the root
    (see `pipelines.datasets.provenance`). Raises StoreError when the path is taken, OSError when it cannot be
    written.
    """
    final = _resolved(path)
    _refuse_taken(final)
    building = final.parent / f".{final.name}.building"
    make_folder(final.parent, durable=durable)
    with GroupLock(final, ""):
        shutil.rmtree(building, ignore_errors=True)
        _build(building, cases, provenance, durable)
        try:
            os.rename(building, final)  # replaces an empty folder, refuses any other
            sync_folder(final.parent)
        except OSError as error:
            _refuse_taken(final)
            raise about(error, final) from error
    return open_for_writing(final, durable=durable)


def _build(
    folder: Path, cases: Mapping[str, Mapping[str, Any]], provenance: Mapping[str, Any], durable: bool
) -> None:
    groups: dict[str, tuple[str, Mapping[str, Any]]] = {"": (ROOT, provenance), "cases": (CONTAINER, {})}
    groups |= {case_group(identifier): (CASE, attributes) for identifier, attributes in cases.items()}
    for group, (kind, attributes) in groups.items():
        place = group_folder(folder, group)
        make_folder(place, durable=durable)
        replace_file(place / METADATA, encode_group(kind, attributes), durable=durable)


def _refuse_taken(path: Path) -> None:
    if not path.exists():
        return
    if (path / METADATA).exists():
        raise StoreError(
            "there is a store already", "Resume it, name another with -o, or move it aside with --force", path
        )
    if not path.is_dir() or any(path.iterdir()):
        raise NotAStoreError("something else is there", "Name another place with -o", path)


def open_for_reading(path: Path | str) -> Store:
    """Open a store; its files are never changed. Raises NotAStoreError, ForeignStoreError, CorruptedError."""
    return _open(path, read_only=True, durable=False)


def open_for_writing(
    path: Path | str, provenance: Mapping[str, Any] | None = None, *, durable: bool = True
) -> Store:
    """Open an existing store to resume it. Groups are locked one by one when they are written.

    With ``provenance`` the store must belong to the same configuration: its ``configuration_hash`` is
    compared and OtherConfigurationError says what differs. Raises also NotAStoreError, ForeignStoreError,
    CorruptedError, OSError.
    """
    store = _open(path, read_only=False, durable=durable)
    if not os.access(store.path, os.W_OK):
        raise PermissionError(13, "not writable", str(store.path))
    if provenance is not None:
        _refuse_other_configuration(store, provenance)
    return store


def _open(path: Path | str, *, read_only: bool, durable: bool) -> Store:
    resolved = _resolved(path)
    if not resolved.exists():
        raise NotAStoreError("no such store", "Check the name; a computation makes one with -o", resolved)
    if not (resolved / METADATA).is_file():
        if (resolved / "cases" / METADATA).is_file():
            raise CorruptedError("the file is missing", RESTORE, resolved / METADATA)
        raise NotAStoreError("this is not a store", "A store is a folder with a zarr.json in it", resolved)
    metadata = read_group_metadata(resolved, "", ROOT)
    return Store(resolved, metadata.attributes, read_only, durable)


def _resolved(path: Path | str) -> Path:
    return Path(path).expanduser().resolve()


def _refuse_other_configuration(store: Store, provenance: Mapping[str, Any]) -> None:
    if store.attributes.get("configuration_hash") == provenance["configuration_hash"]:
        return
    stored, given = store.attributes.get("configuration", {}), provenance["configuration"]
    found = [f"case {case} is only in the store" for case in sorted(set(stored) - set(given))]
    found += [f"case {case} is not in the store" for case in sorted(set(given) - set(stored))]
    for case in sorted(set(stored) & set(given)):
        found += [f"{case}: {sentence}" for sentence in differences(stored[case], given[case])]
    shown = "; ".join(found[:8]) + (f"; and {len(found) - 8} more" if len(found) > 8 else "")
    raise OtherConfigurationError(
        f"the store belongs to another configuration (store / now): {shown or 'the hashes differ'}",
        "Name another store with -o, or move this one aside with --force",
        store.path,
    )


def ensure_container(store: Store, group: str) -> None:
    """Create the groups between the case and ``group`` (cycles, pd, ns) once, whichever writer comes first.

    The case itself is made with the store and never here, where its attributes are not known. Raises
    CorruptedError when it is missing, and ValueError for a store that was opened for reading.
    """
    if store.read_only:
        raise ValueError(f"{store.path} was opened for reading")
    parents = group.split("/")[:-1]
    if (case := "/".join(parents[:2])).startswith("cases/") and not store.has_group(case):
        raise CorruptedError("the file is missing", RESTORE, store.path / case / METADATA)
    for depth in range(1, len(parents) + 1):
        name = "/".join(parents[:depth])
        if store.has_group(name):
            continue
        folder = group_folder(store.path, name)
        with GroupLock(store.path, name, wait=True):
            if not store.has_group(name):
                make_folder(folder, durable=store.durable)
                sweep_partials(folder, below=False)
                replace_file(folder / METADATA, encode_group(CONTAINER, {}), durable=store.durable)


def move_aside(path: Path | str) -> Path:
    """Rename a store to the first free ``<name>.old-<number>`` and return its new place.

    A damaged store is moved like any other. Raises LockedStoreError while any of its groups is being written,
    NotAStoreError when it is not a store.
    """
    store = _resolved(path)
    with suppress(CorruptedError):
        open_for_reading(store)
    with ExitStack() as held:
        for name in GroupLock.known(store):
            held.enter_context(GroupLock(store, name))
        number = 1
        while (target := store.with_name(f"{store.name}.old-{number}")).exists():
            number += 1
        try:
            os.rename(store, target)
            sync_folder(target.parent)
        except OSError as error:
            raise about(error, store) from error
    return target
