"""`agfb continue-cycles`: branches of limit cycles with Floquet multipliers and bifurcations.

Also the branches of period-doubled cycles that leave them.  Every point is committed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.bifurcations.branch import BranchStop
from pipelines.case.fields import MEASURES, SI_UNITS
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.units import Scale, rounded
from pipelines.datasets.schema import KINDS
from pipelines.stages import step_errors
from pipelines.stages.cycles.branch import BranchRequest, is_traced, trace_branch
from pipelines.stages.cycles.problem import is_self_excited
from pipelines.stages.ending import is_success
from pipelines.stages.job import Job, Origin
from pipelines.stages.parts import (
    Part,
    Plan,
    compute_alone,
    discard_all,
    group_ahead,
    has_group,
    has_status_ended,
    take_turn,
)
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
    return compute_alone(plan_continue_cycles(named, store_path, report, should_stop))


def plan_continue_cycles(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> BranchesPlan:
    """The branches of a case, each a part."""
    return BranchesPlan(Job.of("continue-cycles", named, store_path, report, should_stop))


@dataclass(frozen=True)
class BranchesPlan(Plan):
    """One branch in each direction; then the period-doubled branches, level by level.

    A doubled branch is not traced if one before it ends at its period doubling.
    """

    job: Job

    def parts(self, settled: bool = True) -> Iterator[Part]:
        """The branches that are missing."""
        requests = _requests(self.job)
        missing = [request for request in requests if not is_traced(self.job, request)]
        yield from (Part(request.group, {"direction": request.direction}) for request in missing)
        if not missing:
            yield from self._doubled_parts([request.group for request in requests])

    def compute(self, part: Part, job: Job) -> None:
        """Trace one branch."""
        if "direction" in part.arguments:
            trace_branch(job, BranchRequest(part.group, job.case, part.arguments["direction"]))
            return
        origin = Origin(*part.arguments["origin"])
        trace_branch(job, _doubled_request(job, part.group, part.arguments["level"], origin))

    def result(self) -> StageResult:
        """How the branches ended."""
        job = self.job
        groups = [request.group for request in _requests(job) if has_group(job, request.group)]
        doubled = [group for group in job.groups("cycles") if group.startswith("cycles/d")]
        if not job.should_stop():
            discard_all(job)
        return _result(job, groups, doubled)

    def _doubled_parts(self, parents: Sequence[str]) -> Iterator[Part]:
        groups: list[str] = []
        for level in range(self.job.case.continue_cycles.doublings):
            found, missing = [], False
            for origin in _period_doublings(self.job, parents):
                if _ends_at(self.job, groups, origin):
                    continue
                part = self._doubled_part(level, origin, None if missing else f"cycles/d{len(groups):03d}")
                if part is not None:
                    missing = True
                    yield part
                elif not missing:
                    groups.append(f"cycles/d{len(groups):03d}")
                    found.append(groups[-1])
            if missing:
                return
            parents = found

    def _doubled_part(self, level: int, origin: Origin, group: str | None) -> Part | None:
        """What is missing of a doubled branch; ``group`` is None while others before it are missing."""
        job, ahead = self.job, group_ahead("cycles", origin)
        arguments = {"origin": [origin.group, origin.event], "level": level}
        if group is None:
            return None if has_status_ended(job, ahead) else Part(ahead, arguments, doubtful=True)
        if not has_group(job, group) and has_group(job, ahead):
            if not has_status_ended(job, ahead):
                return Part(ahead, arguments)
            take_turn(job, ahead, group)
        traced = is_traced(job, _doubled_request(job, group, level, origin))
        return None if traced else Part(group, arguments)


def _requests(job: Job) -> list[BranchRequest]:
    return [
        BranchRequest(f"cycles/b{number:03d}", job.case, direction)
        for number, direction in enumerate(directions(job.case))
    ]


def _doubled_request(job: Job, group: str, level: int, origin: Origin) -> BranchRequest:
    return BranchRequest(group, job.case, turns=2 ** (level + 1), origin=origin)


def directions(case: Case) -> tuple[int, ...]:
    """Directions of the branches; a self-excited branch leaves its Hopf point on the side where it exists."""
    table = case.continue_cycles
    if is_self_excited(case) and table.parameter == "speed":
        return (1,)
    return DIRECTIONS[table.direction]


def _period_doublings(job: Job, groups: Sequence[str]) -> Iterator[Origin]:
    """Located period doublings of the groups, in order."""
    for group in groups:
        arrays = job.read(group, ("event_kind", "event_residual")).arrays
        for index, (kind, residual) in enumerate(
            zip(arrays["event_kind"], arrays["event_residual"], strict=True)
        ):
            if kind == PERIOD_DOUBLING and residual == residual:
                yield Origin(group, index)


def _ends_at(job: Job, groups: Sequence[str], origin: Origin) -> bool:
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
    names = ("event_kind", f"event_{parameter}", "unstable_count", step_errors.STEP_ERROR)
    branches, trees = (
        [job.read(group, names) for group in groups],
        [job.read(group, names) for group in doubled],
    )
    summary: dict[str, Any] = {"points": sum(branch.n_points for branch in branches)}
    if any((branch["unstable_count"][:1] > 0).any() for branch in branches):
        summary["unstable at the start"] = True  # then the first bifurcation met is not the onset
    if trees:
        summary["doubled branches"] = len(trees)
    scale = job.case.scales.si_per_unit
    for branch in branches + trees:
        summary |= _events_summary(branch.arrays, parameter, summary, scale)
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


def _events_summary(
    arrays: Mapping[str, Any], parameter: str, known: Mapping[str, Any], scale: Scale
) -> dict[str, str]:
    """Locations of the bifurcations by kind: 'neimark sacker' -> '1.0391, 1.2012', also in SI units."""
    meanings = KINDS["cycles"].array("event_kind").flags
    measure = MEASURES[parameter]
    found: dict[str, str] = {}
    for kind, value in zip(arrays["event_kind"], arrays[f"event_{parameter}"], strict=True):
        name = meanings[int(kind)].replace("_", " ")
        unit = SI_UNITS[measure]
        in_units = rounded(float(value) * scale[measure])
        for key, number in ((name, f"{value:.8g}"), (f"{name} [{unit}]", in_units)):
            before = found.get(key, known.get(key))
            found[key] = number if before is None else f"{before}, {number}"
    return found
