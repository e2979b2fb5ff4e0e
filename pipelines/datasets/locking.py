"""One writer per group: a lock of the operating system, which ends with the process that holds it.

Lock files live beside the store, in ``.<store name>.locks``, so that the store itself holds results only.
They are removed when the writer closes.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
from io import FileIO
from pathlib import Path
from types import TracebackType

from pipelines.datasets.durable import about
from pipelines.datasets.errors import LockedStoreError, StoreError


class GroupLock:
    """Exclusive right to write one group; a context manager.

    ``wait`` queues behind another writer instead of raising LockedStoreError. Raises OSError when the lock
    file cannot be made.
    """

    @staticmethod
    def known(store: Path) -> list[str]:
        """Groups of a store that have a lock file: being written, or left by a killed writer."""
        names = sorted(path.stem for path in GroupLock.file(store, "").parent.glob("*.lock"))
        return ["" if name == "store" else name.replace("+", "/") for name in names]

    @staticmethod
    def file(store: Path, group: str) -> Path:
        """The lock file of a group; its text names the process that holds the lock and its computer."""
        return store.parent / f".{store.name}.locks" / ((group.replace("/", "+") or "store") + ".lock")

    def __init__(self, store: Path, group: str, *, wait: bool = False) -> None:
        self.path = self.file(store, group)
        self.folder = self.path.parent
        self.group = group
        self._file: FileIO | None = None
        self._acquire(wait)

    def _acquire(self, wait: bool) -> None:
        while self._file is None:
            file = self._locked_file(wait)
            # a writer that closed meanwhile removed the file it had locked: then this lock guards nothing,
            # try again
            if _same_file(file, self.path):
                self._file = file
            else:
                file.close()
        with contextlib.suppress(OSError):  # on a full disk the lock holds as well, without a name
            self._file.truncate(0)
            self._file.write(f"{os.getpid()} {socket.gethostname()}\n".encode())

    def _locked_file(self, wait: bool) -> FileIO:
        try:
            descriptor = _open_or_create(self.path)
        except OSError as error:
            raise about(error, self.path) from error
        file = FileIO(descriptor, "r+")
        try:
            fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise self._locked_by(file) from None
        except OSError as error:
            file.close()
            raise StoreError(
                f"this file system cannot lock files ({error.strerror})",
                "Put the store on another one with -o",
                self.path,
            ) from error
        return file

    def _locked_by(self, file: FileIO) -> LockedStoreError:
        holder = file.read(200).decode(errors="replace").split()
        file.close()
        who = f"process {holder[0]} on {holder[1]}" if len(holder) == 2 else "another process"
        return LockedStoreError(
            f"{self.group or 'the store'} is being written by {who}",
            "Wait for it, or stop it, and run the command again",
            self.path,
        )

    def release(self) -> None:
        """Release the lock and remove the lock file."""
        if self._file is None:
            return
        with contextlib.suppress(OSError):
            self.path.unlink()
        self._file.close()
        self._file = None
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def __enter__(self) -> GroupLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def _open_or_create(path: Path) -> int:
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):  # the last writer removed the folder in between
            return os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def _same_file(file: FileIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False
