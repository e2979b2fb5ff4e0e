"""A campaign on any number of workers that exist in virtual time only.

Each piece of work is computed once, in this process, and kept; its group appears in the store when the worker
that computes it would have ended. So the speed-up that the agenda allows is told without a second core.
"""

from __future__ import annotations

import heapq
import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipelines.case.reading import NamedCase
from pipelines.datasets.metadata import CHECKSUM, METADATA, encode_group
from pipelines.datasets.records import RUNNING
from pipelines.datasets.store import case_group, ensure_container, open_for_writing
from pipelines.stages.parts import Part
from pipelines.stages.results import StageResult
from pipelines.stages.scheduling import campaign
from pipelines.stages.scheduling.agenda import Agenda, Chain, Work
from pipelines.stages.scheduling.preparation import prepare_store

GROUPS = {"linearize": "linear", "criticals": "criticals"}  # of the stages without parts


@dataclass(frozen=True)
class Kept:
    """A piece of work that has been computed: its ``folder``, its answer, and the time that it took."""

    folder: Path
    answer: dict[str, Any]
    duration: float
    points: int = 0


@dataclass(frozen=True)
class Span:
    """A piece of work on a virtual worker; ``doubtful``: it was computed ahead of its turn."""

    name: str
    begin: float
    end: float
    doubtful: bool


@dataclass(frozen=True)
class Run:
    """What ran when, and the results."""

    spans: list[Span]
    results: list[StageResult]

    @property
    def duration(self) -> float:
        """Until the last piece of work ended."""
        return max(span.end for span in self.spans)

    def width(self, at: float) -> int:
        """How many pieces of work were being computed at a time."""
        return sum(span.begin <= at < span.end for span in self.spans)


@dataclass
class VirtualWorkers:
    """Virtual workers for one case; what one run has computed serves the next.

    ``duration(seconds, points)``: what a piece of work takes that took so many seconds of processor time
    and has so many points. Every ``tick``, those whose work is doubtful ask whether it is still needed.
    """

    named: NamedCase
    folder: Path
    duration: Callable[[float, int], float] = lambda seconds, points: seconds
    tick: float = 1.0
    kept: dict[str, Kept] = field(default_factory=dict)

    def run(self, stages: Sequence[str], workers: int) -> Run:
        """All stages on so many workers, into the store ``<workers>.zarr``."""
        store = self.folder / f"{workers}.zarr"
        prepare_store(store, [self.named], ["test"])
        agenda = Agenda([Chain(self.named, list(stages))])
        now, spans, results = 0.0, list[Span](), list[StageResult]()
        running: list[tuple[float, int, Work, Kept]] = []
        while agenda.chains:
            while len(running) < workers and (work := agenda.begin_next()) is not None:
                kept = self._computed(work, store)
                heapq.heappush(running, (now + kept.duration, len(spans), work, kept))
                doubtful = work.part is not None and bool(work.part["doubtful"])
                spans.append(Span(work.name, now, now + kept.duration, doubtful))
            now = min(now + self.tick, running[0][0])
            self._reveal(running, spans, now, store)
            for end, number, work, kept in list(running):
                needed = end > now and self._is_needed(work, store)
                if needed and end > now:
                    continue
                running.remove((end, number, work, kept))
                heapq.heapify(running)
                spans[number] = replace(spans[number], end=now)
                if end > now:
                    shutil.rmtree(self._folder(work, store), ignore_errors=True)
                answer = kept.answer if end <= now else {**kept.answer, "stopped": True}
                results += [result for _, result in agenda.end(work, answer)]
        return Run(spans, results)

    def _computed(self, work: Work, store: Path) -> Kept:
        message = work.message(store)
        if "settled" in message:
            answer, seconds = _timed(message, str(store))
            return Kept(Path(), answer, self.duration(seconds, 0))
        same = {"stage": work.stage.name, "part": dict(work.part["arguments"]) if work.part else None}
        if same["part"] is not None:
            same["part"].pop("after", None)
            same["part"].setdefault("group", "" if "half" in same["part"] else work.name)
        key = json.dumps(same)
        if key not in self.kept:
            answer, seconds = _timed(message, str(store))
            group = self._folder(work, store)
            folder = self.folder / f"kept-{len(self.kept)}"
            shutil.move(group, folder)
            metadata = json.loads((folder / METADATA).read_text())["attributes"]
            points = int(metadata.get("n_points", 0))
            self.kept[key] = Kept(folder, answer, self.duration(seconds, points), points)
        return self.kept[key]

    def _folder(self, work: Work, store: Path) -> Path:
        name = GROUPS.get(work.name, work.name)
        return store / case_group(self.named.case_id, name)

    def _reveal(
        self, running: Sequence[tuple[float, int, Work, Kept]], spans: Sequence[Span], now: float, store: Path
    ) -> None:
        """Show of every group that is being computed the points that it would have."""
        for end, number, work, kept in running:
            if kept.folder == Path() or (end > now and not kept.points):
                continue
            folder = self._folder(work, store)
            if not folder.exists():
                ensure_container(open_for_writing(store), str(folder.relative_to(store)))
                shutil.copytree(kept.folder, folder)
            attributes = json.loads((kept.folder / METADATA).read_text())["attributes"]
            del attributes[CHECKSUM]
            if end > now:
                share = (now - spans[number].begin) / kept.duration
                attributes |= {"n_points": int(share * kept.points), "n_events": 0, "status": RUNNING}
            (folder / METADATA).write_bytes(encode_group(attributes["kind"], attributes))

    def _is_needed(self, work: Work, store: Path) -> bool:
        if work.part is None or not work.part["doubtful"]:
            return True
        message = work.message(store)
        plan = campaign._plan(str(store), message["stage"], json.dumps(message["case"]), message["store"])
        return plan.is_needed(Part(**work.part))


def _timed(message: dict[str, Any], name: str) -> tuple[dict[str, Any], float]:
    begin = time.process_time()
    answer = campaign.carry_out(message, name, lambda progress: None, lambda: False)
    return answer, time.process_time() - begin
