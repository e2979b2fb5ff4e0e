"""Write groups: branches row by row, everything else at once.

A commit writes the row's chunks, the slot and the events, and then replaces the group's ``zarr.json``, whose
``n_points`` and ``n_events`` say what is valid. That one atomic replace makes the row exist; whatever stopped
a commit before it left nothing that counts, and the next commit writes the same files again. So an
interrupted and resumed branch has the same bytes as an undisturbed one, provided that its rows are computed
from the last committed one.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pipelines.datasets.chunks import array_files, chunk_file, read_array
from pipelines.datasets.durable import (
    MAKING,
    make_folder,
    replace_file,
    replace_files,
    sweep_partials,
    sync_folder,
)
from pipelines.datasets.errors import OtherConfigurationError, StoreError
from pipelines.datasets.layout import ArrayLayout, layout
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import (
    METADATA,
    encode_array,
    encode_group,
    group_folder,
    read_group_metadata,
    require_metadata,
)
from pipelines.datasets.records import (
    COMPLETE,
    ENDED,
    RUNNING,
    Resume,
    Values,
    branch_sizes,
    fit_all,
    with_role,
)
from pipelines.datasets.schema import KINDS, Array
from pipelines.datasets.store import Store, ensure_container

RESERVED = frozenset(
    {"kind", "dimensions", "arrays", "n_points", "n_events", "status", "stop_reason", "stop_advice"}
)


def open_branch(
    store: Store,
    group: str,
    kind: str,
    sizes: Mapping[str, int],
    static: Values | None = None,
    attributes: Mapping[str, Any] | None = None,
    *,
    renew: bool = False,
    wait: bool = False,
) -> BranchWriter:
    """Open a branch for writing: create it, or resume it if it exists.

    ``sizes`` gives the capacity along the kind's row dimension and the sizes of all other dimensions; arrays
    with a dimension that has no size are left out. ``static`` holds the arrays that are written once. On
    resuming, a larger capacity enlarges the branch; other sizes and ``attributes`` must be those of the
    store. Where they are not, a branch without rows is made anew, and with ``renew`` any branch. ``wait``:
    for another writer, which commits and closes at once, instead of raising LockedStoreError. Raises
    LockedStoreError, OtherConfigurationError, CorruptedError, ForeignStoreError, OSError, and ValueError for
    data outside the schema.
    """
    given = dict(attributes or {})
    if taken := RESERVED & set(given):
        raise ValueError(f"attributes {', '.join(sorted(taken))} belong to the writer")
    complete = branch_sizes(kind, sizes)
    ensure_container(store, group)
    lock = GroupLock(store.path, group, wait=wait)
    try:
        require_metadata(store.path, group)
        if store.has_group(group):
            sweep_partials(group_folder(store.path, group))
        if not store.has_group(group) or not _adopt(store, group, kind, complete, given, renew):
            _make(store, group, kind, complete, static or {}, given)
        return BranchWriter(store, group, kind, lock)
    except BaseException:
        lock.release()
        raise


def write_group(
    store: Store, group: str, kind: str, arrays: Values, attributes: Mapping[str, Any] | None = None
) -> None:
    """Write a whole group at once; an existing group is replaced.

    After an interruption the group is complete or absent.

    Sizes follow from the arrays; arrays of the kind that are not given are left out. Raises like
    `open_branch`.
    """
    sizes = sizes_of(kind, arrays)
    layouts = layout(kind, sizes, tuple(arrays))
    fitted = fit_all(layouts, arrays, whole=True)
    ensure_container(store, group)
    folder = group_folder(store.path, group)
    with GroupLock(store.path, group), making(store, folder, sorted(layouts)):
        _make_arrays(store, group, layouts, fitted)
        content = {**(attributes or {}), "status": COMPLETE, "dimensions": sizes, "arrays": sorted(layouts)}
        _publish(store, folder, kind, content)


def has_ended(attributes: Mapping[str, Any], n_points: int, wanting_points: str, max_points: int) -> bool:
    """Whether a branch has ended for good.

    A branch that ended for lack of points (stop reason ``wanting_points``) has not if more are allowed
    now.
    """
    if attributes["status"] != ENDED:
        return False
    return bool(attributes["stop_reason"] != wanting_points or n_points >= max_points)


def sizes_of(kind: str, arrays: Values) -> dict[str, int]:
    """Sizes of the dimensions of given arrays.

    Raises ValueError where two arrays disagree, KeyError for unknown arrays.
    """
    sizes: dict[str, int] = {}
    for name, value in arrays.items():
        dimensions, shape = KINDS[kind].array(name).dimensions, np.shape(value)
        if len(dimensions) != len(shape):
            raise ValueError(f"{name}: shape {shape} given for dimensions {dimensions}")
        for dimension, size in zip(dimensions, shape, strict=True):
            if sizes.setdefault(dimension, size) != size:
                raise ValueError(f"{name}: {dimension} has size {size}, other arrays have {sizes[dimension]}")
    return sizes


class BranchWriter:
    """The only writer of a branch (see `open_branch`); a context manager that releases the lock."""

    def __init__(self, store: Store, group: str, kind: str, lock: GroupLock) -> None:
        metadata = read_group_metadata(store.path, group, kind)
        self.store, self.group, self.kind = store, group, kind
        self.arrays = metadata.arrays
        self._folder, self._lock = metadata.folder, lock
        self._attributes = metadata.attributes
        self._rows = {
            n: _Column(store, group, a, self.n_points) for n, a in with_role(self.arrays, "row").items()
        }
        self._events = {
            n: _Column(store, group, a, self.n_events) for n, a in with_role(self.arrays, "event").items()
        }
        self._slots = with_role(self.arrays, "slot")

    @property
    def n_points(self) -> int:
        """Number of committed rows."""
        return int(self._attributes["n_points"])

    @property
    def n_events(self) -> int:
        """Number of committed events."""
        return int(self._attributes["n_events"])

    @property
    def status(self) -> str:
        """``running`` or ``ended``."""
        return str(self._attributes["status"])

    @property
    def capacity(self) -> int:
        """Number of rows that fit."""
        return next(iter(self._rows.values())).array.shape[0]

    def commit(self, row: Values, slots: Values | None = None, events: Sequence[Values] = ()) -> None:
        """Add one row with its slot data and the events found since the previous row.

        Every row, slot and event array of the group must be given. When it returns, all of it is on disk;
        when it raises (OSError: disk full, ...), nothing of it counts and the same commit can be tried again.
        Raises ValueError for data outside the schema and StoreError when the capacity is used up.
        """
        new_slots = fit_all(self._slots, slots or {})
        self._write([row], new_slots, events)

    def extend(self, rows: Sequence[Values], events: Sequence[Values] = ()) -> None:
        """Add any number of rows and events in one commit, for kinds without slots.

        Raises like ``commit``.
        """
        if self._slots:
            raise ValueError(f"{self.kind} has slots, which belong to one row: commit its rows one by one")
        self._write(rows, {}, events)

    def _write(self, rows: Sequence[Values], slots: Values, events: Sequence[Values]) -> None:
        new_rows = [fit_all(with_role(self.arrays, "row"), row) for row in rows]
        new_events = [fit_all(with_role(self.arrays, "event"), event) for event in events]
        self._check_capacity(len(new_rows), len(new_events))
        files = list[tuple[Path, bytes]]()
        for name, column in self._rows.items():
            files += column.write(self.n_points, [row[name] for row in new_rows])
        for name, array in self._slots.items():
            # the other slot belongs to the row before, which stays the newest one until the group's metadata
            # change
            number = self.n_points % 2
            files.append(chunk_file(self.store, self.group, array, number, slots[name][np.newaxis]))
        for name, column in self._events.items():
            files += column.write(self.n_events, [event[name] for event in new_events])
        replace_files(files, durable=self.store.durable)
        counts = {"n_points": self.n_points + len(new_rows), "n_events": self.n_events + len(new_events)}
        self._replace_attributes({**counts, "status": RUNNING, "stop_reason": "", "stop_advice": ""})

    def newest_event(self) -> dict[str, Array] | None:
        """A copy of the newest event; None if there is none yet."""
        if self.n_events == 0:
            return None
        return {name: column.newest(self.n_events - 1) for name, column in self._events.items()}

    def finish(self, stop_reason: str, advice: str = "", **attributes: Any) -> None:
        """Store why the branch ended, with advice and further attributes (no NaN).

        A later commit sets it running again.
        """
        if taken := RESERVED & set(attributes):
            raise ValueError(f"attributes {', '.join(sorted(taken))} belong to the writer")
        self._replace_attributes(
            {**attributes, "status": ENDED, "stop_reason": stop_reason, "stop_advice": advice}
        )

    def resume_row(self) -> Resume | None:
        """The newest committed row with its slot; None if there is none yet. Raises CorruptedError."""
        if self.n_points == 0:
            return None
        newest = self.n_points - 1
        row = {n: column.newest(newest) for n, column in self._rows.items()}
        slots = {
            n: read_array(self.store, self.group, self.arrays[n], newest % 2, newest % 2 + 1)[0]
            for n in self._slots
        }
        return Resume(
            self.n_points, self.n_events, row, slots, self.status, str(self._attributes["stop_reason"])
        )

    @property
    def attributes(self) -> Mapping[str, Any]:
        """The attributes of the group, as of the last commit."""
        return self._attributes

    def is_complete(self, wanting_points: str, max_points: int) -> bool:
        """Whether the branch has ended for good (see `has_ended`)."""
        return has_ended(self._attributes, self.n_points, wanting_points, max_points)

    def close(self) -> None:
        """Release the lock."""
        self._lock.release()

    def __enter__(self) -> BranchWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_capacity(self, new_rows: int, new_events: int) -> None:
        events = next((column.array.shape[0] for column in self._events.values()), 0)
        if self.n_points + new_rows > self.capacity or self.n_events + new_events > events:
            points = f"{self.n_points} of {self.capacity} points"
            raise StoreError(
                f"the branch is full ({points}, {self.n_events} of {events} events)",
                "Raise max_points and run the same command again",
                self._folder,
            )

    def _replace_attributes(self, changes: Mapping[str, Any]) -> None:
        attributes = {**self._attributes, **changes}
        _publish(self.store, self._folder, self.kind, attributes)
        self._attributes = attributes


class _Column:
    """The newest chunk of a growing array, kept in memory: a commit rewrites it and reads nothing.

    Rows behind the newest are fill values, whatever an interrupted commit left in the file.
    """

    def __init__(self, store: Store, group: str, array: ArrayLayout, count: int) -> None:
        self.array = array
        self._step = array.chunks[0]
        self._store, self._group = store, group
        self._load(count)

    def _load(self, count: int) -> None:
        """Read the chunk that holds the last of ``count`` committed rows."""
        self._index = max(0, count - 1) // self._step
        self._chunk = self._empty()
        start = self._index * self._step
        if count > start:
            committed = read_array(self._store, self._group, self.array, start, count)
            self._chunk[: count - start] = committed

    def write(self, first: int, rows: Sequence[Array]) -> Iterator[tuple[Path, bytes]]:
        """Put rows at ``first`` and after it; yields the files of their chunks."""
        if rows and first // self._step < self._index:  # a commit of several rows failed in a later chunk
            self._load(first)
        for number, row in enumerate(rows, start=first):
            index, place = divmod(number, self._step)
            if index != self._index:
                yield self._file()
                self._index, self._chunk = index, self._empty()
            self._chunk[place] = row
            self._chunk[place + 1 :] = self.array.spec.fill
        if rows:
            yield self._file()

    def newest(self, number: int) -> Array:
        """A copy of the newest row."""
        return self._chunk[number - self._index * self._step].copy()

    def _file(self) -> tuple[Path, bytes]:
        return chunk_file(self._store, self._group, self.array, self._index, self._chunk)

    def _empty(self) -> Array:
        return np.full((self._step, *self.array.row_shape), self.array.spec.fill, dtype=self.array.spec.dtype)


def _make(
    store: Store,
    group: str,
    kind: str,
    sizes: Mapping[str, int],
    static: Values,
    attributes: Mapping[str, Any],
) -> None:
    arrays = layout(kind, sizes)
    fitted = fit_all(with_role(arrays, "static"), static, whole=True)
    folder = group_folder(store.path, group)
    content = {
        **attributes,
        "dimensions": dict(sizes),
        "arrays": sorted(arrays),
        "n_points": 0,
        "n_events": 0,
    }
    with making(store, folder, sorted(arrays)):
        _make_arrays(store, group, arrays, fitted)
        _publish(store, folder, kind, {**content, "status": RUNNING, "stop_reason": "", "stop_advice": ""})


@contextmanager
def making(store: Store, folder: Path, arrays: Sequence[str]) -> Iterator[None]:
    """Empty a group's folder, mark it as being made (`MAKING`), and remove the mark when done.

    A group that was there does not exist from here on. The mark tells what an interruption left from a group
    that has lost its metadata.
    """
    mark = folder / arrays[0] / MAKING if arrays else None
    if mark is not None:
        make_folder(mark.parent, durable=store.durable)
        replace_file(mark, b"", durable=store.durable)
    (folder / METADATA).unlink(missing_ok=True)
    _clear(folder, mark)
    yield
    if mark is not None:
        mark.unlink(missing_ok=True)


def _clear(folder: Path, mark: Path | None) -> None:
    """Remove everything in a folder except the mark and the lock."""
    for entry in list(folder.iterdir()) if folder.is_dir() else ():
        if mark is not None and entry == mark.parent:
            _clear(entry, mark)
        elif entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        elif entry != mark:
            entry.unlink()


def _make_arrays(
    store: Store, group: str, arrays: Mapping[str, ArrayLayout], contents: Mapping[str, Array]
) -> None:
    """Make the folders and metadata of arrays, and write the contents that there are."""
    folder, files = store.path / group, list[tuple[Path, bytes]]()
    make_folder(folder, durable=store.durable)
    for name, array in arrays.items():
        make_folder(folder / name, durable=False)
        files.append((folder / name / METADATA, encode_array(array)))
        if name in contents and contents[name].size:
            files += array_files(store, group, array, contents[name])
    if store.durable:
        sync_folder(folder)
    replace_files(files, durable=store.durable)


def _publish(store: Store, folder: Path, kind: str, attributes: Mapping[str, Any]) -> None:
    # the temporary file lies in an array's folder, where no reader lists names while the group is being
    # written
    scratch = folder / attributes["arrays"][0] if attributes["arrays"] else folder
    replace_file(folder / METADATA, encode_group(kind, attributes), scratch=scratch, durable=store.durable)


def _adopt(
    store: Store, group: str, kind: str, sizes: Mapping[str, int], attributes: Mapping[str, Any], renew: bool
) -> bool:
    """Whether the existing branch can be resumed.

    Not if it was requested with other attributes and may be replaced (``renew``) or has no rows.
    """
    metadata = read_group_metadata(store.path, group, kind)
    stored, growing = metadata.attributes["dimensions"], {KINDS[kind].row, KINDS[kind].event}
    differing = [
        f"{d} has size {stored.get(d)} in the store and {sizes.get(d)} now"
        for d in sorted(set(stored) | set(sizes))
        if d not in growing and stored.get(d) != sizes.get(d)
    ]
    for key, value in attributes.items():
        before, now = _unlike(metadata.attributes.get(key), value)
        if before != now:
            differing.append(f"{key} is {before!r} in the store and {now!r} now")
    if renew and set(metadata.arrays) != set(layout(kind, sizes)):
        return False  # written by a version that stored less
    if differing and (renew or not (metadata.attributes["n_points"] or metadata.attributes["n_events"])):
        return False
    if differing:
        raise OtherConfigurationError(
            f"the branch was computed with other settings: {'; '.join(differing)}",
            "Name another store with -o, move this one aside with --force, or remove this folder",
            metadata.folder,
        )
    wanted = {d: max(size, sizes[d]) if d in growing else size for d, size in stored.items()}
    _enlarge(store, metadata.folder, kind, metadata.attributes, metadata.arrays, wanted)
    return True


def _unlike(before: Any, now: Any) -> tuple[Any, Any]:
    """The parts in which two attributes differ: of two tables, the unequal entries."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return before, now
    keys = [key for key in sorted({*before, *now}) if before.get(key) != now.get(key)]
    return {key: before.get(key) for key in keys}, {key: now.get(key) for key in keys}


def _enlarge(
    store: Store,
    folder: Path,
    kind: str,
    attributes: Mapping[str, Any],
    found: Mapping[str, ArrayLayout],
    sizes: Mapping[str, int],
) -> None:
    """Bring every array and the group to the wanted capacity; completes an interrupted enlargement."""
    for name, array in layout(kind, sizes, tuple(found)).items():
        if array.shape != found[name].shape:
            replace_file(folder / name / METADATA, encode_array(array), durable=store.durable)
    if sizes != attributes["dimensions"]:
        _publish(store, folder, kind, {**attributes, "dimensions": dict(sizes)})
