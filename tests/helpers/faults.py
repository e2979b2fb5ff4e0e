"""Files that cannot be written, and processes that die while they write."""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from pipelines.datasets import durable

FULL_DISK = errno.ENOSPC
BEFORE = ("write", "rename")
"""Where a file's replacement may fail: with half a temporary file written, or before it is renamed."""
AROUND = (*BEFORE, "renamed")
"""And behind its renaming, where only the process can die."""


class Death(BaseException):
    """The process dies here: nothing that it would still do is done."""


def full_disk() -> OSError:
    return OSError(FULL_DISK, os.strerror(FULL_DISK))


@contextmanager
def fault(number: int, raised: BaseException, steps: tuple[str, ...] = BEFORE) -> Iterator[list[Path]]:
    """The ``number``-th of the ``steps`` of all files that are replaced raises, once.

    Yields a list that then holds the file concerned.
    """
    calls, hit = itertools.count(1), list[Path]()
    write, rename = durable._write, os.replace

    def step(name: str, path: Path, before: Callable[[], object] = bool) -> None:
        if name in steps and next(calls) == number:
            before()
            hit.append(Path(path))
            raise raised

    def failing_write(path: Path, data: bytes, forced: bool) -> None:
        step("write", path, lambda: path.write_bytes(bytes(data)[: len(data) // 2]))
        write(path, data, forced)

    def failing_rename(source: Path, target: Path) -> None:
        step("rename", target)
        rename(source, target)
        step("renamed", target)

    with patch.object(durable, "_write", failing_write), patch.object(os, "replace", failing_rename):
        yield hit
