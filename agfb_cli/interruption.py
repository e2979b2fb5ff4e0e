"""Ctrl-C and SIGTERM: the first asks to stop at the next commit, the second ends the process at once."""

from __future__ import annotations

import shlex
import shutil
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from agfb_cli.console import Console

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """Context manager that turns the first signal into a flag.

    The handlers go back to the system's default as soon as the flag is set: a second signal then ends the
    process inside compiled code too. That is safe because a store never shows a row that is not complete.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._previous: dict[int, Any] = {}
        self._received: int | None = None

    @property
    def exit_code(self) -> int | None:
        """128 + number of the signal that arrived (130 for Ctrl-C, 143 for SIGTERM), or None."""
        return None if self._received is None else 128 + self._received

    def requested(self) -> bool:
        """Whether the computation should stop at its next commit."""
        return self._received is not None

    def __enter__(self) -> Interruption:
        for number in _SIGNALS:
            self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._received = number
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_DFL)
        self._console.error(
            f"{signal.Signals(number).name} received: finishing the current point (once more: stop at once)"
        )


def resume_command(arguments: Sequence[str]) -> str:
    """The command that resumes this one: without `--force`, quoted for a shell.

    `arguments` is `sys.argv`. Resuming is the default, and `--force` would start afresh.
    """
    program = Path(arguments[0])
    if program.name == "__main__.py":
        command = [sys.executable, "-m", "agfb_cli"]
    else:
        found = shutil.which(program.name)
        on_path = found is not None and Path(found).resolve() == program.resolve()
        command = [program.name if on_path else arguments[0]]
    return shlex.join([*command, *(word for word in arguments[1:] if word != "--force")])
