"""Standard output and standard error that accept every text and survive failures."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import Any, TextIO, cast

_NAMES = {"stdout": "standard output", "stderr": "standard error"}


class Unfailing:
    """A stream that stays silent once it has failed: the computation matters more than its messages.

    `unread` is whether nobody reads any more, as behind `| head`, which is no error; `lost` is the error of
    any other failure, a full disk for instance.
    """

    def __init__(self, stream: TextIO, name: str) -> None:
        self._stream, self._name = stream, name
        self.unread = False
        self.lost: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, or lose it."""
        if not self._is_silent:
            with self._losing():
                return self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream."""
        if not self._is_silent:
            with self._losing():
                self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @property
    def _is_silent(self) -> bool:
        return self.unread or self.lost is not None

    @contextmanager
    def _losing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno == errno.EPIPE:
                self.unread = True
            else:
                self.lost = OSError(error.errno, error.strerror, self._name)
            # what is left in the buffers would fail once more when Python ends
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())


@contextmanager
def unfailing_streams() -> Iterator[list[Unfailing]]:
    """Replace both streams while the block runs.

    Also a stream that the caller closed, which is None in Python; characters that its encoding lacks are
    replaced.
    """
    before = sys.stdout, sys.stderr
    made = [_unfailing(name) for name in _NAMES]
    sys.stdout, sys.stderr = (cast(TextIO, stream) for stream in made)
    try:
        yield made
    finally:
        sys.stdout, sys.stderr = before


def _unfailing(name: str) -> Unfailing:
    stream = getattr(sys, name)
    if stream is None:
        stream = open(os.devnull, "w")  # noqa: SIM115 - it lives as long as the process
    elif isinstance(stream, TextIOWrapper) and stream.errors == "strict":
        stream.reconfigure(errors="backslashreplace")
    return Unfailing(stream, _NAMES[name])


def is_unread() -> bool:
    """Whether standard output has no reader any more."""
    return isinstance(sys.stdout, Unfailing) and (sys.stdout.unread or sys.stdout.lost is not None)
