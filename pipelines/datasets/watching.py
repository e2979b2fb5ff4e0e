"""What is going on in a store, seen from another process: reads metadata only and takes no lock.

A group that has not ended is being written if a process still holds its lock.  Trying the lock would
disturb a writer that opens at the same moment, so the process named in the lock file is looked for instead;
on another computer it cannot be, and is believed.
"""

from __future__ import annotations

import os
import socket
import time
from dataclasses import dataclass
from pathlib import Path

from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import METADATA
from pipelines.datasets.reading import describe
from pipelines.datasets.records import COMPLETE, ENDED, RUNNING

INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class GroupState:
    """A group of a case: ``state`` is ``running``, ``interrupted`` or ``ended``; ``points`` of at most
    ``capacity`` rows; ``age`` [s] of its newest commit; ``writer``: who writes it, ``PID on HOST``.
    """

    case: str
    group: str
    state: str
    stop_reason: str
    points: int | None
    capacity: int | None
    age: float
    writer: str | None


def watch(path: Path, now: float | None = None) -> list[GroupState]:
    """The state of every group that a computation writes, by case.

    ``now``: seconds since the epoch, by default the clock. Raises StoreError for what is no store.
    """
    content = describe(path)
    moment = time.time() if now is None else now
    known = set(GroupLock.known(Path(content["path"])))
    found = []
    for case, described in content["cases"].items():
        for group, state in described["groups"].items():
            if state["status"] in (None, COMPLETE):  # written in one piece
                continue
            name = f"cases/{case}/{group}"
            writer = _writer(Path(content["path"]), name) if name in known else None
            metadata = Path(content["path"]) / name / METADATA
            found.append(
                GroupState(
                    case,
                    group,
                    ENDED if state["status"] == ENDED else INTERRUPTED if writer is None else RUNNING,
                    state["stop_reason"] or "",
                    state["n_points"],
                    state["capacity"],
                    max(0.0, moment - metadata.stat().st_mtime),
                    writer,
                )
            )
    return found


def _writer(store: Path, group: str) -> str | None:
    """The process that holds the lock of a group, None when it is gone."""
    try:
        words = GroupLock.file(store, group).read_text().split()
    except FileNotFoundError:  # released meanwhile
        return None
    if len(words) != 2 or not words[0].isdecimal():
        return None
    number, host = int(words[0]), words[1]
    if host == socket.gethostname() and not _is_alive(number):
        return None
    return f"{number} on {host}"


def _is_alive(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True
