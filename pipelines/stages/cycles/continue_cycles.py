"""`agfb continue-cycles`: branches of limit cycles with Floquet multipliers and bifurcations.

Also the branches of period-doubled cycles that leave them.  Every point is committed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipelines.bifurcations.branch import BranchStop
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.schema import KINDS
from pipelines.stages import step_errors
from pipelines.stages.cycles.branch import BranchRequest, trace_branch
from pipelines.stages.cycles.problem import is_self_excited
from pipelines.stages.ending import is_success
from pipelines.stages.job import Job, Origin
from pipelines.stages.results import Report, ShouldStop, StageResult

DIRECTIONS = {"up": (1,), "down": (-1,), "both": (1, -1)}
COMPLETE = frozenset({BranchStop.RANGE, BranchStop.CLOSED, BranchStop.MAXIMUM_POINTS, BranchStop.LIMIT})
PERIOD_DOUBLING = KINDS["cycles"].array("event_kind").flag("period_doubling")


def continue_cycles(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Fill the groups ``cycles/b000``, ... of a case, one branch per direction.

    Period-doubled branches fill ``cycles/d000``, ...; resumes after the last point.
    """
    job = Job.of("continue-cycles", named, store_path, report, should_stop)
    groups = []
    for number, direction in enumerate(directions(named.case)):
        if should_stop():
            break
        groups.append(f"cycles/b{number:03d}")
        trace_branch(job, BranchRequest(groups[-1], named.case, direction))
    doubled = _trace_doubled(job, groups)
    return _result(job, groups, doubled)


def directions(case: Case) -> tuple[int, ...]:
    """Directions of the branches; a self-excited branch leaves its Hopf point on the side where it exists."""
    table = case.continue_cycles
    if is_self_excited(case) and table.parameter == "speed":
        return (1,)
    return DIRECTIONS[table.direction]


def _trace_doubled(job: Job, parents: list[str]) -> list[str]:
    """Branches of twice, four times, ... the period, each from a period doubling of the previous level."""
    groups: list[str] = []
    for level in range(job.case.continue_cycles.doublings):
        found: list[str] = []
        for origin in _period_doublings(job, parents):
            if job.should_stop():
                return groups
            if _ends_at(job, groups, origin):
                continue
            groups.append(f"cycles/d{len(groups):03d}")
            found.append(groups[-1])
            trace_branch(job, BranchRequest(groups[-1], job.case, turns=2 ** (level + 1), origin=origin))
        parents = found
    return groups


def _period_doublings(job: Job, groups: list[str]) -> Iterator[Origin]:
    """Located period doublings of the groups, in order."""
    for group in groups:
        arrays = job.read(group, ("event_kind", "event_residual")).arrays
        for index, (kind, residual) in enumerate(
            zip(arrays["event_kind"], arrays["event_residual"], strict=True)
        ):
            if kind == PERIOD_DOUBLING and residual == residual:
                yield Origin(group, index)


def _ends_at(job: Job, groups: list[str], origin: Origin) -> bool:
    """Whether one of the doubled branches has returned to this period doubling.

    It then lies within the last step of that branch.
    """
    parameter = job.case.continue_cycles.parameter
    there = float(job.read(origin.group, (f"event_{parameter}",))[f"event_{parameter}"][origin.event])
    for group in groups:
        branch = job.read(group, (parameter, "arclength"))
        start = Origin.of(branch.attributes)
        if branch.attributes["stop_reason"] != BranchStop.LIMIT.name.lower() or branch.n_points < 2:
            continue
        last, step = branch[parameter][-1], branch["arclength"][-1] - branch["arclength"][-2]
        if start is not None and start.group == origin.group and abs(there - last) <= 2.0 * step:
            return start.event != origin.event
    return False


def _result(job: Job, groups: list[str], doubled: list[str]) -> StageResult:
    """How the branches of a case ended; the stage succeeds if all of them do."""
    parameter = job.case.continue_cycles.parameter
    names = ("event_kind", f"event_{parameter}", step_errors.STEP_ERROR)
    branches, trees = (
        [job.read(group, names) for group in groups],
        [job.read(group, names) for group in doubled],
    )
    summary: dict[str, Any] = {"points": sum(branch.n_points for branch in branches)}
    if trees:
        summary["doubled branches"] = len(trees)
    for branch in branches + trees:
        summary |= _events_summary(branch.arrays, parameter, summary)
    unknown = step_errors.count(branches + trees)
    if where := step_errors.in_words(unknown):
        summary[step_errors.NAME] = where
    reasons = [branch.attributes["stop_reason"] or "stopped on request" for branch in branches]
    advice = [branch.attributes["stop_advice"] for branch in branches + trees]
    ok = all(is_success(branch, COMPLETE) for branch in branches + trees)
    # two branches that end alike say so once
    sentences = "; ".join(dict.fromkeys(filter(None, advice)))
    doubt = step_errors.caution(unknown)
    return StageResult(job.case_id, ok, ", ".join(reasons), sentences, summary, caution=doubt)


def _events_summary(arrays: Mapping[str, Any], parameter: str, known: Mapping[str, Any]) -> dict[str, str]:
    """Locations of the bifurcations by kind: 'neimark sacker' -> '1.0391, 1.2012'."""
    meanings = KINDS["cycles"].array("event_kind").flags
    found: dict[str, str] = {}
    for kind, value in zip(arrays["event_kind"], arrays[f"event_{parameter}"], strict=True):
        name = meanings[int(kind)].replace("_", " ")
        before = found.get(name, known.get(name))
        found[name] = f"{value:.8g}" if before is None else f"{before}, {value:.8g}"
    return found
