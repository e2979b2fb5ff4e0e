"""Progress of long computations: how far, how fast, how long still."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from agfb_cli.console import Console

if TYPE_CHECKING:
    from pipelines.stages.results import Progress

SECONDS_BETWEEN_LINES = 5.0
SECONDS_BETWEEN_FRAMES = 0.1


class ProgressReporter:
    """Shows every `Progress` it is given.

    On a terminal one line is overwritten; elsewhere (a log, CI) a line is written every few seconds and at
    the end of each case, so that a long run is alive but does not fill a disk.
    """

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._clock = clock
        self._interval = SECONDS_BETWEEN_FRAMES if console.animated else SECONDS_BETWEEN_LINES
        self._subject: tuple[str, str] | None = None
        self._started = 0.0
        self._first_done = 0
        self._last_done = 0
        self._shown = 0.0

    def __call__(self, progress: Progress) -> None:
        """Take one report; show it when it is time."""
        if self._console.quiet:
            return
        now = self._clock()
        if (progress.stage, progress.case_id) != self._subject or progress.done < self._last_done:
            self._begin(progress, now)
        self._last_done = progress.done
        finished = progress.total is not None and progress.done >= progress.total
        if finished or now - self._shown >= self._interval:
            self._shown = now
            self._show(progress, now)

    def _begin(self, progress: Progress, now: float) -> None:
        # A resumed branch starts at its last committed point: the rate counts only what is computed now, and
        # of a stage with several branches the one that it is at.
        self._subject = (progress.stage, progress.case_id)
        self._started, self._first_done = now, progress.done
        self._shown = -math.inf

    def _show(self, progress: Progress, now: float) -> None:
        text = describe(progress, progress.done - self._first_done, now - self._started)
        if self._console.animated:
            self._console.transient(text)
        else:
            self._console.message(text)

    def close(self) -> None:
        """Clear the overwritten line, so that what follows starts on a clean one."""
        if self._subject is not None and self._console.animated:
            self._console.transient("")
        self._subject = None


def describe(progress: Progress, newly_done: int, elapsed: float) -> str:
    """One line: stage, case, `done/total`, rate and time left as far as they are known."""
    parts = [f"{progress.done}/{progress.total}" if progress.total else f"{progress.done}"]
    if newly_done > 0 and elapsed > 0:
        rate = newly_done / elapsed
        parts.append(f"{rate:.3g}/s" if rate >= 1 else f"{1 / rate:.3g} s each")
        if progress.total is not None and progress.total > progress.done:
            parts.append(f"at most {duration((progress.total - progress.done) / rate)} left")
    if progress.message:
        parts.append(progress.message)
    return f"{progress.stage} {progress.case_id}: " + ", ".join(parts)


def duration(seconds: float) -> str:
    """Seconds as `45 s`, `3 min 05 s` or `2 h 07 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
