"""One branch of cycles in its group of the store: start, continue point by point, resume, end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchResult, BranchStart, BranchState, BranchStop
from pipelines.bifurcations.detection import Event
from pipelines.bifurcations.switching import doubled_branch, with_multiplied_period
from pipelines.case.models import Case
from pipelines.datasets.branch import BranchWriter, has_ended, open_branch
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.cycles.problem import continuation_options, cycle_problem
from pipelines.stages.cycles.rows import (
    EVENT_NAMES,
    RESUMED,
    BranchRecorder,
    cycle_sizes,
    resumed_state,
    static_arrays,
    stored_event,
)
from pipelines.stages.cycles.start import FirstCycle, Guard, NoStart, first_cycles
from pipelines.stages.ending import store_end
from pipelines.stages.job import Job, Origin

NO_START = "no_start"
WANTING_POINTS = BranchStop.MAXIMUM_POINTS.name.lower()
NOT_ASKED = {"max_points", "doublings"}  # of the table: more of them may be asked for later
DOUBLED_AMPLITUDES = (1.0, 0.25, 4.0)  # of the first doubled cycle, in units of continue_cycles.amplitude


@dataclass(frozen=True)
class BranchRequest:
    """One branch of cycles to be computed.

    Its `group` (cycles/b000), the `case` with the [continue_cycles] table that it uses, the `direction`
    of the parameter, and the other parameters that differ from the case's own (`fixed`).

    A period-doubled branch has `turns` 2, 4, 8 excitation periods and starts from a period doubling, its
    `origin`.
    """

    group: str
    case: Case
    direction: int = 1
    fixed: Mapping[str, float] = field(default_factory=dict)
    turns: int = 1
    origin: Origin | None = None

    def attributes(self) -> dict[str, Any]:
        """The request as attributes of its group."""
        table = self.case.continue_cycles
        attributes: dict[str, Any] = {
            "parameter": table.parameter,
            "formulation": table.formulation,
            "request": table.model_dump(mode="json", exclude=NOT_ASKED),
        }
        if self.fixed:
            attributes["fixed"] = dict(self.fixed)
        if self.origin is not None:
            attributes |= {"turns": self.turns, "origin": self.origin.as_dict()}
        return attributes


def request_problem(job: Job, request: BranchRequest) -> CycleProblem:
    """The cycles of a request."""
    problem = cycle_problem(job.machine, request.case, request.fixed)
    return with_multiplied_period(problem, request.turns)


def is_traced(job: Job, request: BranchRequest) -> bool:
    """Whether the branch of a request is in the store and has ended for good."""
    if not job.store.has_group(job.path(request.group)):
        return False
    branch = job.read(request.group, ())
    if any(branch.attributes.get(name) != value for name, value in request.attributes().items()):
        return False  # tracing refuses it, or makes it anew
    return has_ended(
        branch.attributes, branch.n_points, WANTING_POINTS, request.case.continue_cycles.max_points
    )


def trace_branch(job: Job, request: BranchRequest) -> None:
    """Trace a branch from its first cycle, or from its last committed point, until it ends or is stopped.

    A branch that cannot start is an ended group without points, whose attributes say why.

    Raises what `open_branch` raises.
    """
    problem = request_problem(job, request)
    sizes = cycle_sizes(job.machine, request.case, problem)
    static = static_arrays(job.machine, request.case, problem)
    with open_branch(
        job.store, job.path(request.group), "cycles", sizes, static, request.attributes()
    ) as branch:
        if not branch.is_complete(WANTING_POINTS, request.case.continue_cycles.max_points):
            _follow(job, request, branch, problem)


def _follow(job: Job, request: BranchRequest, branch: BranchWriter, problem: CycleProblem) -> None:
    """Trace one branch into its group, from its first cycle or from the last committed point."""
    table = request.case.continue_cycles
    newest = branch.resume_row()
    resumed = None if newest is None else job.read(request.group, ("event_kind",))
    recorder = BranchRecorder(
        job.machine, branch, request.case, _progress_callback(job, request), request.turns, resumed
    )

    def run(start: BranchStart | BranchState, towards: int) -> BranchResult:
        options = continuation_options(request.case, towards)
        return continue_branch(problem, start, options, recorder.record, recorder.limit, job.should_stop)

    if newest is not None:
        rows = job.read(request.group, (*RESUMED, table.parameter)).arrays
        store_end(branch, run(resumed_state(newest, rows, table.parameter), request.direction))
        return
    job.report_progress(0, table.max_points, f"{request.group}: looking for the first cycle")
    failure = NoStart("no cycle was found", "")
    for found in _first_cycles(job, request, problem, Guard(recorder.limit, job.should_stop)):
        if job.should_stop():
            return
        if isinstance(found, NoStart):
            failure = found
            continue
        result = run(found.start, found.direction or request.direction)
        if result.stop is BranchStop.START_FAILED:
            failure = NoStart(f"the first cycle did not converge: {result.message}", result.stop.advice)
        elif request.turns > 1 and result.state is None:  # another amplitude may do
            failure = NoStart(result.message, "set another continue_cycles.amplitude")
        else:
            store_end(branch, result)
            return
    branch.finish(NO_START, f"{failure.reason}: {failure.advice}")


def _progress_callback(
    job: Job, request: BranchRequest
) -> Callable[[BranchPoint, BranchState, tuple[Event, ...]], None]:
    """The report of every recorded point."""
    table = request.case.continue_cycles

    def report_point(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        message = job.place(table.parameter, state.parameter)
        message += f", largest multiplier {abs(state.multipliers[0]):.4f}"
        message += f", {state.steps} steps per period"
        message += "".join(f", {event.kind.name.lower().replace('_', ' ')}" for event in events)
        job.report_progress(state.index + 1, table.max_points, f"{request.group}: {message}")

    return report_point


def _first_cycles(
    job: Job, request: BranchRequest, problem: CycleProblem, watch: Guard
) -> Iterator[FirstCycle | NoStart]:
    """Guesses of the first cycle; for a doubled branch beside its period doubling."""
    if request.origin is None:
        yield from first_cycles(job.machine, request.case, problem, watch)
        return
    cycles = cycle_problem(job.machine, request.case, request.fixed)
    simple = with_multiplied_period(cycles, request.turns // 2)
    event = stored_event(job.read(request.origin.group, EVENT_NAMES), request.origin.event)
    amplitude = request.case.continue_cycles.amplitude
    for factor in DOUBLED_AMPLITUDES:
        found = doubled_branch(simple, event, factor * amplitude)
        if found is not None:
            yield FirstCycle(found.start, found.direction)
        else:
            yield NoStart(
                "no cycle of twice the period was found beside the period doubling",
                "set another continue_cycles.amplitude",
            )
