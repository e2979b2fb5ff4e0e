"""What is to be computed of many cases, and what may be begun now.

Whatever computes asks for the next piece of work (`Agenda.begin_next`) and says how it ended. Nothing of the
order in which pieces end reaches the store; see `pipelines.stages.parts`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipelines.case.reading import NamedCase
from pipelines.stages.results import StageResult
from pipelines.stages.scheduling.registry import AWAITED, DIVIDED
from pipelines.stages.scheduling.tasks import task

PartRecord = Mapping[str, Any]  # a part as a plain dictionary


@dataclass(frozen=True)
class Deaths:
    """How often workers died with a task since it had ``committed`` so many points."""

    count: int = 0
    committed: int = 0


@dataclass
class StageRun:
    """A stage of a case that has begun.

    ``parts`` may be computed and are not; ``running`` are the names of what is. ``stale``: the plan is to be
    asked, again if something has ended since. ``ended``: parts that have ended, ``meanwhile`` those since the
    plan was asked last.
    """

    name: str
    parts: list[PartRecord] = field(default_factory=list)
    running: set[str] = field(default_factory=set)
    stale: bool = True
    ended: list[PartRecord] = field(default_factory=list)
    meanwhile: set[str] = field(default_factory=set)
    seconds: float = 0.0
    deaths: dict[str, Deaths] = field(default_factory=dict)
    failure: StageResult | None = None

    @property
    def computing(self) -> set[str]:
        """The groups of the parts that are being computed."""
        return self.running - {self.name}


@dataclass
class Chain:
    """The ``stages`` of a case that have not ended, in order, and those of them that have ``begun``."""

    named: NamedCase
    stages: list[str]
    begun: dict[str, StageRun] = field(default_factory=dict)

    def may_begin(self, stage: str) -> bool:
        """Whether no stage has to end before this one."""
        earlier = self.stages[: self.stages.index(stage)]
        return stage not in self.begun and not AWAITED.get(stage, frozenset(earlier)).intersection(earlier)


@dataclass(frozen=True)
class Work:
    """A ``part`` of a stage; without one the question for its plan, or all of a stage that has no parts."""

    chain: Chain
    stage: StageRun
    part: PartRecord | None = None

    @property
    def name(self) -> str:
        """Distinguishes it from all other work of its stage."""
        return self.stage.name if self.part is None else str(self.part["group"])

    def message(self, store: Path) -> dict[str, Any]:
        """The work as plain values."""
        common = task(self.stage.name, self.chain.named, store)
        if self.part is not None:
            return common | {"part": dict(self.part)}
        if self.stage.name not in DIVIDED:
            return common
        settled = self.chain.stages[0] == self.stage.name
        return common | {"settled": settled, "alone": not self.stage.computing}


@dataclass
class Agenda:
    """The chains of all cases whose stages have not ended."""

    chains: list[Chain]

    def begin_next(self) -> Work | None:
        """The most urgent work; None if everything that may begin is running.

        First the plans, from which more may follow; then parts that are certainly needed, first those of
        stages that have begun; then parts that may turn out not to be needed.
        """
        work = next(self._choices(), None)
        if work is None:
            return None
        stage = work.stage
        work.chain.begun[stage.name] = stage
        if work.part is None:
            stage.stale = False
            stage.meanwhile.clear()
            # while a plan finds that a stage has ended, nothing of it must begin
            stage.parts = [part for part in stage.parts if not part["doubtful"]]
        else:
            stage.parts.remove(work.part)
        stage.running.add(work.name)
        return work

    def _choices(self) -> Iterator[Work]:
        begun = [(chain, stage) for chain in self.chains for stage in chain.begun.values()]
        for chain, stage in begun:
            if stage.stale and stage.name not in stage.running and stage.failure is None:
                yield Work(chain, stage)
        for chain, stage in begun:
            yield from (Work(chain, stage, part) for part in stage.parts if not part["doubtful"])
        for chain in self.chains:
            yield from (Work(chain, StageRun(name)) for name in chain.stages if chain.may_begin(name))
        for chain, stage in begun:
            yield from (Work(chain, stage, part) for part in stage.parts)

    def end(self, work: Work, answer: Mapping[str, Any]) -> Iterator[tuple[str, StageResult]]:
        """Note how a piece of work ended; yields the results of stages that have ended with it.

        An empty ``answer``: it was asked to stop before it began.
        """
        stage = work.stage
        stage.running.discard(work.name)
        stage.seconds += answer.get("seconds", 0.0)
        if not answer:
            return
        result = None if answer["result"] is None else StageResult.from_dict(answer["result"])
        if work.part is None and result is not None:
            yield from self._close(work.chain, stage, result)
        elif work.part is None:
            self._take_parts(work.chain.named.case_id, stage, answer["parts"])
        else:
            stage.stale = True
            stage.meanwhile.add(work.name)
            stage.failure = stage.failure or result
            if not answer["stopped"]:
                stage.ended.append(work.part)
        if stage.failure is not None:
            yield from self._close_failed(work.chain, stage)

    def again(self, work: Work) -> None:
        """Put work back that did not end."""
        work.stage.running.discard(work.name)
        if work.part is None:
            work.stage.stale = True
        else:
            work.stage.parts.insert(0, work.part)

    def give_up(self, work: Work, result: StageResult) -> Iterator[tuple[str, StageResult]]:
        """Fail a stage that cannot be computed, and the stages after it; yields their results.

        Those of which parts are being computed have theirs when these have ended.
        """
        chain, stage = work.chain, work.stage
        stage.running.discard(work.name)
        stage.failure = result
        reason = f"not computed: {stage.name} did not end"
        for name in chain.stages[chain.stages.index(stage.name) + 1 :]:
            later = chain.begun.setdefault(name, StageRun(name))
            later.failure = StageResult(chain.named.case_id, False, reason, "run the command again to retry")
        for name in list(chain.stages):
            if name in chain.begun and chain.begun[name].failure is not None:
                yield from self._close_failed(chain, chain.begun[name])

    def _take_parts(self, case_id: str, stage: StageRun, parts: list[PartRecord]) -> None:
        stage.parts = [part for part in parts if part["group"] not in stage.running | stage.meanwhile]
        again = [part["group"] for part in stage.parts if part in stage.ended]
        if again:
            reason = f"{again[0]} has been computed and is asked for again"
            stage.failure = StageResult(
                case_id, False, reason, "this is a bug: please report it", failed_by="bug"
            )

    def _close_failed(self, chain: Chain, stage: StageRun) -> Iterator[tuple[str, StageResult]]:
        """End a failed stage as soon as nothing of it is being computed."""
        stage.parts = []
        if not stage.running and stage.failure is not None:
            yield from self._close(chain, stage, stage.failure)

    def _close(self, chain: Chain, stage: StageRun, result: StageResult) -> Iterator[tuple[str, StageResult]]:
        chain.stages.remove(stage.name)
        del chain.begun[stage.name]
        for later in chain.begun.values():  # it may have waited for this one
            later.stale = True
        if not chain.stages:
            self.chains.remove(chain)
        yield stage.name, replace(result, seconds=stage.seconds)
