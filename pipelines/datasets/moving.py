"""Move and remove whole groups; readers see a group at its old place, at its new place, or not at all."""

from __future__ import annotations

import os
import shutil

from pipelines.datasets.branch import making
from pipelines.datasets.durable import about, sync_folder
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import METADATA, group_folder, read_group_metadata
from pipelines.datasets.store import Store, ensure_container


def move_group(store: Store, group: str, target: str) -> None:
    """Give a group another name, at which no group may be; waits for its writer.

    Raises StoreError, OSError.
    """
    ensure_container(store, target)
    old, new = group_folder(store.path, group), group_folder(store.path, target)
    with GroupLock(store.path, group, wait=True), GroupLock(store.path, target, wait=True):
        if store.has_group(target):
            raise ValueError(f"{target} exists")
        try:
            shutil.rmtree(new, ignore_errors=True)  # left by an interrupted making
            os.rename(old, new)
            if store.durable:
                sync_folder(new.parent)
                sync_folder(old.parent)
        except OSError as error:
            raise about(error, new) from error


def remove_group(store: Store, group: str, *, wait: bool = False) -> None:
    """Remove a group with all of its rows.

    ``wait``: for its writer, instead of raising LockedStoreError. Raises StoreError, OSError.
    """
    folder = group_folder(store.path, group)
    with GroupLock(store.path, group, wait=wait):
        with making(store, folder, sorted(read_group_metadata(store.path, group).arrays)):
            pass
        shutil.rmtree(folder)


def remove_container(store: Store, container: str) -> None:
    """Remove a container that has no groups left; nothing happens if there is none. Raises OSError."""
    if not store.has_group(container):
        return
    folder = group_folder(store.path, container)
    with GroupLock(store.path, container, wait=True):
        (folder / METADATA).unlink()
        shutil.rmtree(folder)
        if store.durable:
            sync_folder(folder.parent)
