"""Durable files: written beside their target, forced to disk, then renamed over it.

After a power cut a file that was renamed but not forced to disk may be empty. Everything a store writes goes
through `replace_file`. Files that become visible together are forced to disk side by side (`replace_files`):
a file system forces thirty of them in little more time than one.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PARTIAL = ".partial"
_SIDE_BY_SIDE = 8  # files
MAKING = "making" + PARTIAL
"""Lies in the folder of a group's first array while the group is made: it has no metadata of its own yet."""


def replace_file(
    path: Path, data: bytes | memoryview, *, scratch: Path | None = None, durable: bool = True
) -> None:
    """Replace a file atomically: after any interruption it has its old or its new content.

    ``scratch`` is the folder of the temporary file (same file system; default: the folder of ``path``).
    Raises OSError, naming ``path``.
    """
    partial = (scratch or path.parent) / (path.name + PARTIAL)
    try:
        _write(partial, data, durable)
        os.replace(partial, path)
        if durable:
            sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise about(error, path) from error


def replace_files(files: Sequence[tuple[Path, bytes]], *, durable: bool = True) -> None:
    """Replace files, each one atomically and in no particular order; when it returns, all are there.

    Raises the OSError of the first that fails; others may have been replaced.
    """
    if not durable:
        for path, data in files:
            replace_file(path, data, durable=False)
        return
    # threads of their own for every call: a process that forks between two calls has none that it would lose
    with ThreadPoolExecutor(_SIDE_BY_SIDE) as threads:
        for _ in threads.map(lambda file: replace_file(*file), files):
            pass


def _write(path: Path, data: bytes | memoryview, durable: bool) -> None:
    with open(path, "wb") as file:
        file.write(data)
        if durable:
            file.flush()
            os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Force the names in a folder to disk.

    File systems that cannot sync folders (some network ones) are left alone.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EBADF, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def make_folder(folder: Path, *, durable: bool = True) -> None:
    """Make a folder and its parents, forced to disk. Raises OSError, naming ``path``."""
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if durable:
            for made in missing:
                sync_folder(made.parent)
    except OSError as error:
        raise about(error, folder) from error


def sweep_partials(folder: Path, *, below: bool = True) -> None:
    """Remove the remains of interrupted writes in a folder and below it.

    Only the holder of the folder's lock may do so.
    """
    pattern = "*" + PARTIAL
    for left in list(folder.rglob(pattern) if below else folder.glob(pattern)):
        left.unlink(missing_ok=True)


def about(error: OSError, path: Path) -> OSError:
    """An error of the operating system with its errno and subclass, naming the file concerned."""
    return OSError(error.errno, error.strerror or str(error), str(path))
