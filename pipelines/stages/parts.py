"""The parts of a stage: what may be computed side by side, and in which order it counts.

A stage that consists of parts is a `Plan`. It reads the store and tells which parts may be computed now, in
the order of a single process, which takes the first again and again (`compute_alone`). Several processes take
as many as they like. So that the store has the same bytes, everything follows from the store alone:

- A part writes one group. The first part of a plan is always needed.
- Whether a later part is needed may depend on earlier ones, and so may its name: a curve through a second
  bifurcation is not traced if the first curve passes there. Such a part is computed *ahead*, into a group of
  the container ``ahead``. When its turn comes it moves to the name that it then has (`take_turn`); if it is
  not needed, or an earlier group would have changed it, it is removed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pipelines.datasets.branch import BranchWriter
from pipelines.datasets.moving import move_group, remove_container, remove_group
from pipelines.datasets.records import ENDED, with_role
from pipelines.stages.job import Job, Origin
from pipelines.stages.results import StageResult

AHEAD = "ahead"


@dataclass(frozen=True)
class Part:
    """A piece of a stage that writes ``group``.

    ``arguments`` are plain values from which any process can compute it. ``doubtful``: it is computed ahead
    of its turn and may turn out not to be needed.
    """

    group: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    doubtful: bool = False


@dataclass(frozen=True)
class Row:
    """A row of a `RowPlan`: its name among the rows, and what it is computed from."""

    name: str
    arguments: Mapping[str, Any]


class Plan(ABC):
    """The parts of one stage on one case, as far as the store shows them."""

    job: Job

    @abstractmethod
    def parts(self, settled: bool = True) -> Iterator[Part]:
        """What may be computed now, the most urgent first; nothing when the stage has ended.

        ``settled``: the stages before this one have ended. Parts that are already being computed are listed
        as well. Groups whose turn has come are moved, so that one process at a time may ask.
        """

    @abstractmethod
    def compute(self, part: Part, job: Job) -> None:
        """Compute a part until it ends, or until ``job`` is asked to stop."""

    @abstractmethod
    def result(self) -> StageResult:
        """How the stage ended; called once `parts` is empty, or after a request to stop."""

    def is_needed(self, part: Part) -> bool:
        """Whether a doubtful part still may be needed; asked by the process that computes it."""
        return True


class RowPlan(Plan):
    """A stage that fills one ``group``: each row is a part, and rows are committed in order."""

    group: ClassVar[str]

    @abstractmethod
    def missing(self) -> tuple[int, list[Row]]:
        """The number of rows that there will be, and those that are missing, in order."""

    @abstractmethod
    def open(self, group: str, rows: int) -> BranchWriter:
        """Open a group for so many rows, or make it; waits while another process commits a row."""

    @abstractmethod
    def row(self, job: Job, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        """Compute a row; returns it with a message on its progress."""

    @abstractmethod
    def finish(self, branch: BranchWriter) -> None:
        """End a group that has all of its rows."""

    def parts(self, settled: bool = True) -> Iterator[Part]:
        """The missing rows."""
        total, waiting = self.missing()
        while waiting and has_status_ended(self.job, ahead := self._ahead(waiting[0])):
            with self.open(self.group, total) as branch:
                found = self.job.read(ahead, tuple(with_role(branch.arrays, "row")))
                first = {name: values[0] for name, values in found.arrays.items()}
                _commit_as(branch, total - len(waiting), first)
            discard(self.job, ahead)
            waiting = waiting[1:]
        for number, row in enumerate(waiting, total - len(waiting)):
            ahead = self._ahead(row)
            in_turn = row is waiting[0] and not has_group(self.job, ahead)
            if in_turn or not has_status_ended(self.job, ahead):
                yield Part(self.group if in_turn else ahead, {**row.arguments, "row": number})
        if total and not waiting:
            with self.open(self.group, total) as branch:
                if branch.status != ENDED:
                    self.finish(branch)

    def compute(self, part: Part, job: Job) -> None:
        """Compute one row."""
        total, waiting = self.missing()
        in_turn = part.group == self.group
        row, message = self.row(job, part.arguments)
        with self.open(part.group, total if in_turn else 1) as branch:
            _commit_as(branch, part.arguments["row"] if in_turn else 0, row)
            if not in_turn:
                self.finish(branch)
        job.report_progress(total - len(waiting) + 1, total, message)

    def _ahead(self, row: Row) -> str:
        return f"{AHEAD}/{self.group}-{row.name}"


def _commit_as(branch: BranchWriter, number: int, row: Mapping[str, Any]) -> None:
    """Commit a row that has this number, unless another process has computed and committed it."""
    if branch.n_points == number:
        branch.commit(row)


def compute_alone(plan: Plan) -> StageResult:
    """Compute the parts of a plan one after the other in this process."""
    before: Part | None = None
    while not plan.job.should_stop() and (part := next(plan.parts(), None)) is not None:
        if part == before:
            raise RuntimeError(f"{part.group} has been computed and is asked for again")
        plan.compute(part, plan.job)
        before = part
    return plan.result()


def group_ahead(container: str, origin: Origin, half: int = 0) -> str:
    """The group for what starts at a bifurcation, while it is computed ahead of its turn."""
    return f"{AHEAD}/{container}-{origin.group.replace('/', '-')}-{origin.event}-{half}"


def has_group(job: Job, group: str) -> bool:
    """Whether the case has a group."""
    return job.store.has_group(job.path(group))


def has_status_ended(job: Job, group: str) -> bool:
    """Whether a group is there and not being computed any more."""
    return has_group(job, group) and job.read(group, ()).attributes["status"] == ENDED


def take_turn(job: Job, ahead: str, group: str) -> None:
    """Move what was computed ahead to the place that it would have been computed in."""
    move_group(job.store, job.path(ahead), job.path(group))


def discard(job: Job, ahead: str) -> None:
    """Remove what was computed ahead and differs from what its turn asks for."""
    remove_group(job.store, job.path(ahead), wait=True)


def discard_all(job: Job) -> None:
    """Remove everything that was computed ahead and is not needed. No part may be running."""
    for group in job.groups(AHEAD):
        remove_group(job.store, job.path(group))
    remove_container(job.store, job.path(AHEAD))
