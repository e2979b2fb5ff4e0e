"""Activity in a store, seen from another process: reads metadata only and takes no lock.

A group that has not ended is being written if a process still holds its lock.  Trying the lock would
disturb a writer that opens at the same moment, so the process named in the lock file is looked for instead;
on another computer it cannot be, and is believed.  Between two groups, and while one is computed that is
written in one piece, no group is locked: a command that computes therefore holds a lock of its own.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.datasets.errors import CorruptedError, LockedStoreError
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import METADATA
from pipelines.datasets.reading import describe
from pipelines.datasets.records import COMPLETE, ENDED, RUNNING
from pipelines.datasets.store import case_group

NOT_BEGUN, INTERRUPTED = "not begun", "interrupted"
_GEOMETRY = "machine"  # the kind of group that is made with the store
_COMMANDS = "command/"


@dataclass(frozen=True)
class GroupState:
    """The state of a group of a case.

    ``state`` is ``running``, ``interrupted`` or ``ended``; ``points`` of at most ``capacity`` rows, None
    for a group without rows; ``age`` [s] of its newest commit; ``writer``: the process that writes it,
    ``PID on HOST``; ``speeds_without_equilibrium``: its speeds that have none, with the reason.
    """

    case: str
    group: str
    state: str
    stop_reason: str
    points: int | None
    capacity: int | None
    age: float
    writer: str | None
    speeds_without_equilibrium: tuple[str, ...] = ()


@dataclass(frozen=True)
class GroupTotals:
    """Progress of one or several cases.

    The number of groups by state, and ``points`` of at most ``capacity`` of their rows; ``state`` is
    ``running`` or ``interrupted`` if a group is, else ``ended``, and ``not begun`` without any group;
    ``age`` [s] of the newest commit, None without any.
    """

    state: str
    running: int
    interrupted: int
    ended: int
    points: int
    capacity: int
    age: float | None


def watch(path: Path, now: float | None = None) -> list[GroupState]:
    """The state of every group that a computation writes, by case.

    ``now``: seconds since the epoch, by default the clock. Raises StoreError for what is no store.
    """
    moment = time.time() if now is None else now
    try:
        return _states(path, moment)
    except (CorruptedError, FileNotFoundError):
        return _states(path, moment)  # a group that is written in one piece is gone while it is replaced


def _states(path: Path, moment: float) -> list[GroupState]:
    content = describe(path)
    known = set(GroupLock.known(Path(content["path"])))
    found = []
    for case, described in content["cases"].items():
        for group, state in described["groups"].items():
            if state["kind"] == _GEOMETRY:
                continue
            name = case_group(case, group)
            writer = _writer(Path(content["path"]), name) if name in known else None
            has_ended = state["status"] in (None, ENDED, COMPLETE)
            metadata = Path(content["path"]) / name / METADATA
            found.append(
                GroupState(
                    case,
                    group,
                    ENDED if has_ended else INTERRUPTED if writer is None else RUNNING,
                    state["stop_reason"] or "",
                    state["n_points"],
                    state["capacity"],
                    max(0.0, moment - metadata.stat().st_mtime),
                    writer,
                    tuple(state["speeds_without_equilibrium"] or ()),
                )
            )
    return found


def totals(states: Sequence[GroupState]) -> GroupTotals:
    """The sum over some groups, for instance those of a case."""
    found = [state.state for state in states]
    begun = next((name for name in (RUNNING, INTERRUPTED, ENDED) if name in found), NOT_BEGUN)
    return GroupTotals(
        begun,
        found.count(RUNNING),
        found.count(INTERRUPTED),
        found.count(ENDED),
        _sum(state.points for state in states),
        _sum(state.capacity for state in states),
        min((state.age for state in states), default=None),
    )


def _sum(counts: Iterable[int | None]) -> int:
    return sum(count for count in counts if count is not None)


def command_lock(path: Path) -> GroupLock:
    """A lock held while a command computes, so that others see it between the writing of groups.

    Any number of commands may hold one; locks left by killed commands are removed. Raises OSError when
    the lock file cannot be made.
    """
    store = path.expanduser().resolve()
    lock = GroupLock(store, f"{_COMMANDS}{socket.gethostname()}-{os.getpid()}", wait=True)
    for name in GroupLock.known(store):
        if name.startswith(_COMMANDS) and name != lock.group:
            with contextlib.suppress(LockedStoreError):  # it is alive
                GroupLock(store, name).release()
    return lock


def commands(path: Path) -> list[str]:
    """The commands that are computing into a store, each as ``PID on HOST``."""
    store = path.expanduser().resolve()
    names = (name for name in GroupLock.known(store) if name.startswith(_COMMANDS))
    return [writer for name in names if (writer := _writer(store, name)) is not None]


def _writer(store: Path, group: str) -> str | None:
    """The process that holds the lock of a group; None if it has ended."""
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
