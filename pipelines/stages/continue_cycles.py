"""`agfb continue-cycles`: branches of limit cycles with their Floquet multipliers and bifurcations, point by
point.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchResult, BranchStart, BranchState, BranchStop
from pipelines.bifurcations.detection import Event
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, open_for_writing
from pipelines.machine.assembly import Machine, build_machine
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.cycle_problem import continuation_options, cycle_problem, is_self_excited
from pipelines.stages.cycle_rows import BranchRecorder, branch_sizes, resumed_state, static_arrays
from pipelines.stages.cycle_start import NoStart, Watch, first_cycles
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult

DIRECTIONS = {"up": (1,), "down": (-1,), "both": (1, -1)}
COMPLETE = frozenset({BranchStop.RANGE, BranchStop.CLOSED, BranchStop.MAXIMUM_POINTS, BranchStop.LIMIT})
NO_START = "no_start"


def continue_cycles(
    case: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Fill the groups ``cycles/b000``, ... of a case, one branch per direction; resumes behind the last
    point.
    """
    store = open_for_writing(store_path)
    machine = build_machine(case.case)
    problem = cycle_problem(machine, case.case)
    groups = []
    for number, direction in enumerate(directions(case.case)):
        if should_stop():
            break
        group = f"cases/{case.case_id}/cycles/b{number:03d}"
        groups.append(group)
        with _open(store, group, machine, case, problem) as branch:
            if not _is_complete(branch, case.case.continue_cycles.max_points):
                _follow(store, group, branch, machine, case, problem, direction, report, should_stop)
    return _result(case, store, groups)


def directions(case: Case) -> tuple[int, ...]:
    """Directions of the branches; a self-excited one leaves its Hopf point on the side where it exists."""
    table = case.continue_cycles
    if is_self_excited(case) and table.parameter == "speed":
        return (1,)
    return DIRECTIONS[table.direction]


def _open(store: Store, group: str, machine: Machine, case: NamedCase, problem: CycleProblem) -> BranchWriter:
    table = case.case.continue_cycles
    # More points may be asked for later; everything else must stay as it was.
    request = table.model_dump(mode="json", exclude={"max_points"})
    attributes = {"parameter": table.parameter, "formulation": table.formulation, "request": request}
    sizes, static = branch_sizes(machine, case.case, problem), static_arrays(machine, case.case)
    return open_branch(store, group, "cycles", sizes, static, attributes)


def _is_complete(branch: BranchWriter, max_points: int) -> bool:
    """Whether an earlier run has ended the branch for good."""
    newest = branch.resume_row()
    if branch.status != ENDED or newest is None:
        return False
    return newest.stop_reason != BranchStop.MAXIMUM_POINTS.name.lower() or newest.n_points >= max_points


def _follow(
    store: Store,
    group: str,
    branch: BranchWriter,
    machine: Machine,
    case: NamedCase,
    problem: CycleProblem,
    direction: int,
    report: Report,
    should_stop: ShouldStop,
) -> None:
    """Trace one branch into its group, from its first cycle or from the last committed point."""
    table = case.case.continue_cycles

    def told(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        message = (
            f"{table.parameter} {state.parameter:.5g}, largest multiplier {abs(state.multipliers[0]):.4f}"
        )
        message += f", {state.steps} steps per period"
        message += "".join(f", {event.kind.name.lower().replace('_', ' ')}" for event in events)
        report(Progress("continue-cycles", case.case_id, state.index + 1, table.max_points, message))

    recorder = BranchRecorder(machine, branch, table.minimum_film, told)

    def run(start: BranchStart | BranchState, towards: int) -> BranchResult:
        options = continuation_options(case.case, towards)
        return continue_branch(problem, start, options, recorder.record, recorder.limit, should_stop)

    newest = branch.resume_row()
    if newest is not None:
        first = read_group(store, group, ("state", "period", table.parameter)).arrays
        _end(branch, run(resumed_state(newest, first, table.parameter), direction))
        return
    report(Progress("continue-cycles", case.case_id, 0, table.max_points, "looking for the first cycle"))
    failure = NoStart("no cycle was found", "")
    for found in first_cycles(machine, case.case, problem, Watch(recorder.limit, should_stop)):
        if should_stop():
            return
        if isinstance(found, NoStart):
            failure = found
            continue
        result = run(found.start, found.direction or direction)
        if result.stop is not BranchStop.START_FAILED:
            _end(branch, result)
            return
        failure = NoStart(f"the first cycle did not converge: {result.message}", result.stop.advice)
    branch.finish(NO_START, f"{failure.reason}: {failure.advice}")


def _end(branch: BranchWriter, result: BranchResult) -> None:
    """Store why the branch ended; an interrupted one stays open."""
    if result.stop is not BranchStop.INTERRUPTED:
        # the limit is this stage's own, and its message says all
        parts = [result.message, "" if result.stop is BranchStop.LIMIT else result.stop.advice]
        branch.finish(result.stop.name.lower(), "; ".join(filter(None, parts)))


def _result(case: NamedCase, store: Store, groups: list[str]) -> StageResult:
    """How the branches of a case ended: the case is well when all of them are."""
    points, reasons, advice = 0, [], []
    summary: dict[str, str] = {}
    complete = {stop.name.lower() for stop in COMPLETE}
    ok = True
    for group in groups:
        content = read_group(store, group, ("event_kind", f"event_{case.case.continue_cycles.parameter}"))
        attributes = content.attributes
        points += attributes["n_points"]
        reasons.append(attributes["stop_reason"] or "stopped on request")
        advice.append(attributes["stop_advice"])
        ended = attributes["status"] == ENDED
        # a branch without a single point is a failure, whatever ended it
        ok = ok and (not ended or (attributes["stop_reason"] in complete and attributes["n_points"] > 0))
        summary |= _events_summary(content.arrays, case.case.continue_cycles.parameter, summary)
    told = {"points": points} | summary
    # two branches that end alike say so once
    sentences = "; ".join(dict.fromkeys(filter(None, advice)))
    return StageResult(case.case_id, ok, ", ".join(reasons), sentences, told)


def _events_summary(arrays: Mapping[str, Any], parameter: str, known: Mapping[str, Any]) -> dict[str, str]:
    """Where the bifurcations lie, by kind: 'neimark sacker' -> '1.0391, 1.2012'."""
    meanings = KINDS["cycles"].array("event_kind").flags
    found: dict[str, str] = {}
    for kind, value in zip(arrays["event_kind"], arrays[f"event_{parameter}"], strict=True):
        name = meanings[int(kind)].replace("_", " ")
        before = found.get(name, known.get(name))
        found[name] = f"{value:.8g}" if before is None else f"{before}, {value:.8g}"
    return found
