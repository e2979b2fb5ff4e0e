"""Progress of long computations: points done, rate and time left; and afterwards a table of times."""

from __future__ import annotations

import math
import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from agfb_cli.console import Console, table

if TYPE_CHECKING:
    from pipelines.stages.results import Progress, StageResult

SECONDS_BETWEEN_LINES = 5.0
SECONDS_BETWEEN_FRAMES = 0.1
CASES_SHOWN = 20

Results = Sequence[tuple[str, "StageResult"]]
Left = tuple[float, float]  # seconds at least and at most


@dataclass
class _Track:
    """One stage on one case: the start of its rate, and its last report."""

    started: float
    first_done: int
    shown: float = -math.inf
    newest: Progress | None = None
    left: Left | None = None

    def text(self, now: float) -> str:
        assert self.newest is not None
        return describe(self.newest, self.newest.done - self.first_done, now - self.started, self.left)


class ProgressReporter:
    """Shows every `Progress` that it receives; reports of several cases may alternate.

    On a terminal one line is overwritten; elsewhere (a log, CI) a line is written every few seconds for each
    case and at its end, so that a long run is alive but does not fill a disk. With `tasks`, the number of
    stages times cases, it also counts those that have ended.
    """

    def __init__(
        self, console: Console, clock: Callable[[], float] = time.monotonic, tasks: int | None = None
    ) -> None:
        self._console = console
        self._clock = clock
        self._tasks, self._ended = tasks, 0
        self._tracks: dict[tuple[str, str, str], _Track] = {}  # by stage, case and part
        self._begun: dict[
            tuple[str, str], tuple[float, float]
        ] = {}  # by stage and case: when, with what done
        self._frame = -math.inf

    def __call__(self, progress: Progress) -> None:
        """Take one report; show it when it is time."""
        if self._console.quiet:
            return
        now, subject = self._clock(), (progress.stage, progress.case_id, progress.part)
        track = self._tracks.get(subject)
        if track is None or (track.newest is not None and progress.done < track.newest.done):
            # A resumed branch starts at its last committed point: the rate counts only what is computed now,
            # and of a stage with several branches the one that it is at.
            track = self._tracks[subject] = _Track(now, progress.done)
        track.newest, track.left = progress, self._left(progress, now)
        if self._console.animated:
            self._show_frame(now)
        else:
            self._show_line(track, progress, now)

    def _left(self, progress: Progress, now: float) -> Left | None:
        """The time that the whole stage still takes, by what it has done since its first report."""
        if progress.work is None:
            return None
        done, least, most = progress.work
        started, before = self._begun.setdefault((progress.stage, progress.case_id), (now, done))
        if done <= before or now <= started:
            return None
        pace = (now - started) / (done - before)
        return pace * least, pace * most

    def _show_frame(self, now: float) -> None:
        if now - self._frame < SECONDS_BETWEEN_FRAMES:
            return
        self._frame = now
        line = self._count() + " | ".join(track.text(now) for track in self._tracks.values())
        self._console.transient(line[: shutil.get_terminal_size().columns - 1])

    def _show_line(self, track: _Track, progress: Progress, now: float) -> None:
        finished = progress.total is not None and progress.done >= progress.total
        if finished or now - track.shown >= SECONDS_BETWEEN_LINES:
            track.shown = now
            self._console.message(self._count() + track.text(now))

    def _count(self) -> str:
        return "" if self._tasks is None else f"[{self._ended}/{self._tasks}] "

    def ended(self, stage: str, case_id: str) -> None:
        """End a stage on a case: drop its state and clear the overwritten line."""
        self._ended += 1
        self._begun.pop((stage.replace("_", "-"), case_id), None)
        for subject in [each for each in self._tracks if each[:2] == (stage.replace("_", "-"), case_id)]:
            del self._tracks[subject]
        if self._console.animated and self._frame > -math.inf:
            self._console.transient("")
        self._frame = -math.inf


def describe(progress: Progress, newly_done: int, elapsed: float, left: Left | None = None) -> str:
    """One line: stage, case, `done/total`, rate and time left as far as they are known.

    ``left``: of the whole stage, where a report tells of a part of it.
    """
    parts = [f"{progress.done}/{progress.total}" if progress.total else f"{progress.done}"]
    if newly_done > 0 and elapsed > 0:
        rate = newly_done / elapsed
        parts.append(f"{rate:.3g}/s" if rate >= 1 else f"{1 / rate:.3g} s each")
        if progress.work is None and progress.total is not None and progress.total > progress.done:
            parts.append(f"at most {duration((progress.total - progress.done) / rate)} left")
    if left is not None:
        parts.append(f"{duration(left[0])} to {duration(left[1])} left")
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


def in_words(seconds: float) -> str:
    """A duration in a suitable unit."""
    for unit, size in (("years", 31_557_600.0), ("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} seconds"


def seconds_spent(results: Results, elapsed: float) -> dict[str, Any]:
    """Seconds passed, and seconds computed by stage and by case (larger with several workers)."""
    stages, cases = _spent(results)
    return {"elapsed": elapsed, "stages": stages, "cases": cases}


def where_time_went(results: Results, elapsed: float) -> str:
    """A table of cases over stages, the slowest cases first."""
    stages, cases = _spent(results)
    single = {(result.case_id, stage): duration(result.seconds) for stage, result in results}
    slowest = sorted(cases, key=lambda case: -cases[case])[:CASES_SHOWN]
    rows = [
        [case, *(single.get((case, stage), "-") for stage in stages), duration(cases[case])]
        for case in slowest
    ]
    rows.append([f"all {len(cases)}", *map(duration, stages.values()), duration(sum(stages.values()))])
    header = ["slowest cases" if len(cases) > len(slowest) else "case"]
    header += [*(stage.replace("_", "-") for stage in stages), "all stages"]
    return f"{table(header, rows)}\ntook {duration(elapsed)}"


def _spent(results: Results) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds by stage, in the order of the stages, and by case."""
    stages: dict[str, float] = defaultdict(float)
    cases: dict[str, float] = defaultdict(float)
    for stage, result in results:
        stages[stage] += result.seconds
        cases[result.case_id] += result.seconds
    return dict(stages), dict(cases)
