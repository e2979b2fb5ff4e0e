"""`agfb continue-tori`: branches of tori, born at Neimark-Sacker points or driven by unbalance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.tori.events import UNDECIDED
from pipelines.bifurcations.tori.torus import TorusStop
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.records import Group
from pipelines.stages.cycles.continue_cycles import DIRECTIONS
from pipelines.stages.cycles.rows import EVENT_NAMES, stored_event
from pipelines.stages.ending import is_success
from pipelines.stages.job import Job, Origin
from pipelines.stages.results import Report, ShouldStop, StageResult
from pipelines.stages.tori.branch import trace_tori
from pipelines.stages.tori.sources import TorusSource, born_tori, unbalanced_tori

EVENTS = ("event_kind", "event_stability", "event_after_point")
LETTERS = {"neimark_sacker": "q", "unbalance": "u"}
COMPLETE = frozenset(
    {TorusStop.RANGE, TorusStop.MAXIMUM_POINTS, TorusStop.LIMIT, TorusStop.COLLAPSED, TorusStop.ROUGH}
)


def continue_tori(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill groups of a case with branches of tori; resumes after the last point.

    ``tori/q000``, ... from the Neimark-Sacker points inside the range, or ``tori/u000`` and with both
    directions ``u001`` with unbalance.
    """
    job = Job.of("continue-tori", named, store_path, report, should_stop)
    refusal = _refusal(job)
    if refusal is not None:
        return refusal
    groups: list[str] = []
    for source in _sources(job):
        if should_stop():
            break
        letter = LETTERS[named.case.continue_tori.origin]
        groups.append(f"tori/{letter}{len(groups):03d}")
        trace_tori(job, groups[-1], source)
    return _result(job, groups)


def _refusal(job: Job) -> StageResult | None:
    """Why this store gives no branch of tori to continue."""
    table = job.case.continue_tori
    if table.origin == "neimark_sacker" and table.branch not in job.groups("cycles"):
        return StageResult(
            job.case_id,
            False,
            f"the store has no branch {table.branch}",
            "run `agfb continue-cycles` with the same store first, or name another continue_tori.branch",
        )
    return None


def _sources(job: Job) -> Iterator[TorusSource]:
    """Where the branches of a case begin, in order."""
    table = job.case.continue_tori
    if table.origin == "unbalance":
        for direction in DIRECTIONS[table.direction]:
            yield unbalanced_tori(job, direction)
        return
    branch = job.read(table.branch, EVENT_NAMES)
    turns, index = int(branch.attributes.get("turns", 1)), PARAMETERS.index(table.parameter)
    located = np.isfinite(branch["event_residual"])
    for number, kind in enumerate(branch.labels("event_kind")):
        if kind != EventKind.NEIMARK_SACKER.name.lower() or not located[number]:
            continue
        event = stored_event(branch, number)
        if table.range[0] <= event.parameters[index] <= table.range[1]:
            yield born_tori(job, Origin(table.branch, number), event, turns)


def _result(job: Job, groups: list[str]) -> StageResult:
    """How the branches of a case ended; the stage succeeds if all of them do."""
    case_id, table = job.case_id, job.case.continue_tori
    if not groups and not job.should_stop():
        low, high = table.range
        where = f"{table.branch} has no Neimark-Sacker point with {table.parameter} in [{low:g}, {high:g}]"
        advice = (
            "run `agfb continue-cycles` over a continue_cycles.range that contains one, or widen "
            "continue_tori.range"
        )
        return StageResult(case_id, False, f"no tori to follow: {where}", advice)
    needed = (table.parameter, "unstable_count", *EVENTS, f"event_{table.parameter}")
    branches = [job.read(group, needed) for group in groups]
    summary: dict[str, Any] = {
        "branches": len(branches),
        "points": sum(branch.n_points for branch in branches),
    }
    counts = np.concatenate([branch["unstable_count"] for branch in branches]) if branches else np.zeros(0)
    summary["unstable points"] = int(np.sum(counts > 0))
    if undecided := int(np.sum(counts == UNDECIDED)):
        summary["undecided points"] = undecided
    if losses := [loss for branch in branches for loss in losses_of_stability(branch, table.parameter)]:
        summary["loss of stability"] = ", ".join(losses)
    reasons = [branch.attributes["stop_reason"] or "stopped on request" for branch in branches]
    advice = "; ".join(dict.fromkeys(filter(None, (b.attributes["stop_advice"] for b in branches))))
    ok = all(is_success(branch, COMPLETE) for branch in branches)
    return StageResult(case_id, ok, ", ".join(reasons) or "stopped on request", advice, summary)


def losses_of_stability(branch: Group, parameter: str) -> list[str]:
    """Where stable tori of a branch become unstable, and by which bifurcation."""
    found = []
    kinds, changes = branch.labels("event_kind"), branch.labels("event_stability")
    before = branch["unstable_count"][branch["event_after_point"]]
    for kind, change, count, value in zip(kinds, changes, before, branch[f"event_{parameter}"], strict=True):
        if change == "lost" and count == 0:
            found.append(f"{kind.replace('_', ' ')} at {parameter.replace('_', ' ')} {value:.6g}")
    return found
