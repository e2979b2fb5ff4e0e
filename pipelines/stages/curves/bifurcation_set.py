"""The search of `agfb run` for every bifurcation curve of a case in the plane excitation frequency x speed.

Branches of cycles cross the plane along lines of constant excitation frequency and of constant speed.  Every
bifurcation on them that lies on no curve yet starts one; so does every codimension-two point at which another
curve meets one of these.  Further rounds of lines between the old ones follow, until a whole round finds no
new curve.  With ``bifurcation_set.certify`` the curves are then compared with a survey of the plane
(`pipelines.stages.certificate`), and lines through the places that disagree follow.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.bifurcations.branch import BranchStop
from pipelines.bifurcations.detection import EventKind
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.branch import write_group
from pipelines.datasets.schema import KINDS
from pipelines.machine import film
from pipelines.machine.assembly import parameter_vector
from pipelines.stages import step_errors
from pipelines.stages.certificate.asked import Asked
from pipelines.stages.certificate.certify import CONTAINER as CERTIFICATES
from pipelines.stages.certificate.certify import Request, certify, checksum, stored_curves, stored_lines
from pipelines.stages.certificate.summary import Summary
from pipelines.stages.curves.lines import (
    FREQUENCY,
    LINES,
    SPEED,
    Line,
    line_groups,
    line_request,
    lines_of_round,
    lowest_speed,
    plane_range,
)
from pipelines.stages.curves.open_ends import OpenEnd, caution, open_ends
from pipelines.stages.curves.outlook import outlook
from pipelines.stages.curves.parts import compute_curve, curve_is_needed, curve_parts
from pipelines.stages.curves.rows import CONTAINERS
from pipelines.stages.curves.starts import StartQueue
from pipelines.stages.curves.track_curves import curves_result
from pipelines.stages.cycles.branch import is_traced, trace_branch
from pipelines.stages.cycles.start import first_hopf
from pipelines.stages.job import Job, Origin
from pipelines.stages.parts import AHEAD, Part, Plan, compute_alone, discard_all, has_group
from pipelines.stages.pass_counts import PASSES_PER_CYCLE, passes_per_curve_point
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult, StopRequested
from pipelines.stages.survey.onsets import GROUP as SURVEY
from pipelines.stages.survey.survey import SurveyPlan

GROUP = "bifurcation_set"
EVERY_KIND = (EventKind.PERIOD_DOUBLING, EventKind.NEIMARK_SACKER, EventKind.FOLD)


def bifurcation_set(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Fill ``cycles/s000``, ..., ``pd``, ``ns``, ``folds`` and ``bifurcation_set`` of a case.

    An interrupted search resumes after the last stored point.
    """
    return compute_alone(plan_bifurcation_set(named, store_path, report, should_stop))


def plan_bifurcation_set(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> SearchPlan:
    """The search of a case; each line and each direction of a curve is a part."""
    job = Job.of("bifurcation-set", named, store_path, report, should_stop)
    kinds, boundaries = _kinds(named.case), named.case.bifurcation_set.boundaries
    goes_on = named.case.bifurcation_set.continue_boundaries
    others = tuple(kind for kind in EVERY_KIND if kind not in kinds) if goes_on else ()
    return SearchPlan(job, StartQueue(job, kinds, boundaries, others))


@dataclass
class SearchPlan(Plan):
    """Round by round: all lines of a round, then all curves that start from what is stored.

    ``lines`` of the rounds whose curves are traced, and whether the search is ``complete``; ``certificate``:
    the group of the newest certificate, if one is asked for.
    """

    job: Job
    queue: StartQueue
    lines: list[Line] = field(default_factory=list)
    complete: bool = False
    certificate: str | None = None

    @cached_property
    def lowest(self) -> float | None:
        """The lowest speed of the lines; None if there is nothing to search."""
        return None if nothing_to_search(self.job.case) is not None else lowest_speed(self.job)

    @cached_property
    def survey(self) -> SurveyPlan:
        """The survey with which the curves are compared."""
        return SurveyPlan(self.job)

    def parts(self, settled: bool = True) -> Generator[Part]:
        """The missing lines of a round, or the missing curves; then what a certificate needs.

        Lines do not wait for what starts curves; the second round always follows the first.  Lines of the
        survey wait for nothing and are behind everything else.
        """
        self.lines, self.complete, self.certificate = [], False, None
        if self.lowest is None:
            return
        ended = yield from self._rounds(self.lowest, settled)
        if not self.job.case.bifurcation_set.certify:
            return
        surveying = False
        for part in self.survey.parts():
            surveying = True
            yield part
        if ended and not surveying:
            yield from self._certified(self.lowest)

    def _rounds(self, lowest: float, settled: bool) -> Generator[Part, None, bool]:
        """What is missing of the rounds of lines; returns whether nothing is."""
        rounds = self.job.case.bifurcation_set.max_rounds
        for number in range(rounds):
            fresh = lines_of_round(self.job, number, lowest)
            missing = self._missing_lines(fresh, lowest)
            if number > 0:
                if not settled or (yield from self._missing_curves()):
                    yield from missing if number == 1 else ()
                    return False
                self.complete = number > 1 and self._last_round_was_in_vain()
                if self.complete:
                    return True
            if missing:
                yield from missing
                if number == 0 and rounds > 1:
                    self.lines += fresh
                    yield from self._missing_lines(lines_of_round(self.job, 1, lowest), lowest)
                return False
            self.lines += fresh
        if not settled or (yield from self._missing_curves()):
            return False
        self.complete = rounds > 1 and self._last_round_was_in_vain()
        return True

    def _certified(self, lowest: float) -> Generator[Part]:
        """Certificates, and after each the lines that it asks for with their curves, until one asks for none.

        At most ``bifurcation_set.max_rounds`` times.  The last one is about the curves that there are: in a
        store that was searched on, another one follows.
        """
        rounds = self.job.case.bifurcation_set.max_rounds
        for number in range(rounds + 1):
            before, group, behind = (f"{CERTIFICATES}/r{each:03d}" for each in range(number - 1, number + 2))
            if not has_group(self.job, group):
                arguments = {"lowest": lowest, "lines": [astuple(line) for line in self.lines]}
                yield Part(group, arguments | {"before": before if number else None})
                return
            self.certificate = group
            asked = self.job.read(group, ("asked_parameter", "asked_fixed"))
            is_newest = asked.attributes["curves_checksum"] == checksum(stored_curves(self.job))
            self.complete = is_newest and bool(asked.attributes["certified"])
            fresh = [self._asked_line(line) for line in stored_lines(asked)]
            if number == rounds or not (fresh or has_group(self.job, behind) or not is_newest):
                return
            if missing := self._missing_lines(fresh, lowest):
                yield from missing
                return
            self.lines += fresh
            if (yield from self._missing_curves()):
                return

    def _asked_line(self, asked: Asked) -> Line:
        """A line that a certificate asks for, in the round after the last one."""
        parameter = SPEED if asked.parameter == SPEED else FREQUENCY
        return Line(parameter, asked.fixed, self.lines[-1].round + 1, asked=True)

    def _missing_lines(self, fresh: list[Line], lowest: float) -> list[Part]:
        """Parts for those of some lines after `lines` that are missing."""
        missing = []
        names = line_groups([*self.lines, *fresh])[len(self.lines) :]
        for line, name in zip(fresh, names, strict=True):
            request = line_request(self.job, line, name, lowest)
            if not is_traced(self.job, request):
                missing.append(Part(request.group, {"line": astuple(line), "lowest": lowest}))
        return missing

    def compute(self, part: Part, job: Job) -> None:
        """Trace one line, or one curve in one direction; compute a line of the survey, or a certificate."""
        job = self._telling(job, part)
        if part.group.startswith(CERTIFICATES):
            self._certify(part, job)
            return
        if part.group.startswith((SURVEY, f"{AHEAD}/{SURVEY}")):
            self.survey.compute(part, job)
            return
        if "line" not in part.arguments:
            compute_curve(job, part)
            return
        line = Line(*part.arguments["line"])
        trace_branch(job, line_request(job, line, part.group, part.arguments["lowest"]))

    def _telling(self, job: Job, part: Part) -> Job:
        """The job of a part whose reports say how much of the whole search is left."""
        names = self.job.groups("cycles", "criticals", SURVEY, *CONTAINERS.values())
        groups = {name: self.job.read(name, ()).attributes for name in names}
        ahead, before = outlook(job.case, groups), int(groups.get(part.group, {}).get("n_points", 0))
        each = passes_per_curve_point(job.case) if "half" in part.arguments else float(PASSES_PER_CYCLE)

        def report(progress: Progress) -> None:
            now = ahead
            if part.group.split("/")[0] not in (SURVEY, AHEAD, CERTIFICATES):
                now = ahead.after(each * max(0, progress.done - before))
            job.report(replace(progress, work=(now.done, now.least, now.most)))

        return replace(job, report=report)

    def _certify(self, part: Part, job: Job) -> None:
        lines = [Line(*line) for line in part.arguments["lines"]]
        request = Request(
            part.arguments["lowest"],
            tuple(kind.name.lower() for kind in _kinds(job.case)),
            job.case.bifurcation_set.boundaries,
            [Asked(line.parameter, line.fixed) for line in lines],
        )
        with suppress(StopRequested):
            certify(job, part.group, request, part.arguments["before"])

    def is_needed(self, part: Part) -> bool:
        """Whether a curve that is traced ahead still may be needed."""
        return curve_is_needed(self.job, part)

    def result(self) -> StageResult:
        """How the search ended, and how it covered the plane."""
        job = self.job
        if (reason := nothing_to_search(job.case)) is not None:
            return StageResult(job.case_id, True, reason)
        if self.lowest is None:
            return StageResult(
                job.case_id, False, f"no equilibrium of the plane leaves a film of "
                f"{job.case.bifurcation_set.smallest_film:g} of the clearance",
                "raise the upper end of track_curves.ranges, or lower bifurcation_set.smallest_film",
            )  # fmt: skip
        if not self.lines or job.should_stop():
            return StageResult(job.case_id, True, "stopped on request", "", _summary(self, _results(self)))
        discard_all(job)
        sentence, ends = _sentence(self), open_ends(job.store, job.case_id)
        _write(self, self.lowest, sentence, ends)
        return _result(self, sentence, ends)

    def _missing_curves(self) -> Generator[Part, None, bool]:
        """The curves from all `lines` that are missing; returns whether there are any."""
        lines = set(line_groups(self.lines))
        self.queue.without = frozenset(
            group for group in self.job.groups("cycles") if group.startswith(LINES) and group not in lines
        )
        found = False
        for part in curve_parts(self.queue):
            found = True
            yield part
        return found

    def _last_round_was_in_vain(self) -> bool:
        last = max((line.round for line in self.lines), default=0)
        return not any(
            _new_curves(self.job, group)
            for group, line in zip(line_groups(self.lines), self.lines, strict=True)
            if line.round == last
        )


def nothing_to_search(case: Case) -> str | None:
    """Why a case has no set in the plane of excitation frequency and speed; None when it has one."""
    if set(case.track_curves.parameters) != {SPEED, FREQUENCY}:
        return "the search covers the plane of excitation_frequency and speed only"
    if parameter_vector(case)[film.DISPLACEMENT] == 0.0:
        return "without displacement of the rings nothing depends on the excitation frequency"
    return None


def _kinds(case: Case) -> tuple[EventKind, ...]:
    """The kinds of curves that the search follows, always in the same order."""
    return tuple(kind for kind in EVERY_KIND if kind.name.lower() in case.bifurcation_set.kinds)


def _new_curves(job: Job, group: str) -> int:
    """Number of curves that start from bifurcations on a line."""
    found = 0
    for name in job.groups(*CONTAINERS.values()):
        attributes = job.read(name, ()).attributes
        origin = Origin.of(attributes)
        found += int(origin is not None and origin.group == group and attributes["half"] == 0)
    return found


def _write(plan: SearchPlan, lowest: float, sentence: str, ends: Sequence[OpenEnd]) -> None:
    """Write the group that records how the plane was searched."""
    job, lines, case, spec = plan.job, plan.lines, plan.job.case, KINDS[GROUP]
    groups = line_groups(lines)
    branches = [
        job.read(group, (line.parameter, "event_kind")) for group, line in zip(groups, lines, strict=True)
    ]
    reached = [
        (float(branch[line.parameter].min()), float(branch[line.parameter].max()))
        if branch.n_points
        else (np.nan, np.nan)
        for line, branch in zip(lines, branches, strict=True)
    ]
    whole = {BranchStop.RANGE.name.lower(), BranchStop.LIMIT.name.lower()}
    arrays: dict[str, Any] = {
        "line_parameter": np.array([spec.array("line_parameter").flag(line.parameter) for line in lines]),
        "line_fixed": np.array([line.fixed for line in lines]),
        "line_low": np.array([low for low, _ in reached]),
        "line_high": np.array([high for _, high in reached]),
        "line_round": np.array([line.round for line in lines]),
        "line_events": np.array([branch.n_events for branch in branches]),
        "line_new_curves": np.array([_new_curves(job, group) for group in groups]),
        "line_complete": np.array(
            [int(branch.attributes["stop_reason"] in whole and branch.n_points > 0) for branch in branches]
        ),
    }
    passive = first_hopf(job.machine, _at_rest(case), *plane_range(case, SPEED))
    attributes = {
        "parameters": list(case.track_curves.parameters),
        "ranges": [list(interval) for interval in case.track_curves.ranges],
        "rounds": max(line.round for line in lines if not line.asked) + 1,
        "covered": sentence,
        "kinds": [kind.name.lower() for kind in _kinds(case)],
        "boundaries": case.bifurcation_set.boundaries,
        "continue_boundaries": case.bifurcation_set.continue_boundaries,
        "complete": plan.complete,
        "open_ends": [end.as_dict() for end in ends],
        "passive_instability_speed": None if passive is None else passive.speed,
        "lowest_speed": lowest,
    }
    if plan.certificate is not None:
        resolution = job.read(plan.certificate, ()).attributes["resolution"]
        attributes |= {"certificate": plan.certificate, "resolution": resolution}
    write_group(job.store, job.path(GROUP), GROUP, arrays, attributes)


def _at_rest(case: Case) -> np.ndarray:
    """The parameters of the passive machine, its rings undeformed."""
    parameters = parameter_vector(case)
    parameters[PARAMETERS.index("displacement")] = 0.0
    return parameters


def covered(lines: list[Line], complete: bool) -> str:
    """A sentence that says how the plane was searched."""
    last = sum(line.round == lines[-1].round for line in lines)
    met = (
        f"the last {last} of them met no new curve"
        if complete
        else "the last round still met new curves: raise bifurcation_set.max_rounds"
    )
    return f"{_rounds_in_words(lines)}; {met}"


def _rounds_in_words(lines: list[Line]) -> str:
    along_speed = sum(line.parameter == SPEED for line in lines)
    return (
        f"{along_speed} branches along the speed and {len(lines) - along_speed} along the excitation "
        f"frequency in {lines[-1].round + 1} rounds"
    )


def _sentence(plan: SearchPlan) -> str:
    """How the plane was searched, and what the certificate says."""
    if plan.certificate is None:
        return covered(plan.lines, plan.complete)
    told = Summary.stored(plan.job.read(plan.certificate)).sentence()
    return f"{_rounds_in_words(plan.lines)}; {told}"


def _result(plan: SearchPlan, sentence: str, ends: Sequence[OpenEnd]) -> StageResult:
    """The result of a search that has ended: a success if every curve is complete."""
    job, results = plan.job, _results(plan)
    ok = all(result.ok for result in results.values())
    doubt = step_errors.caution(step_errors.count_in(job.store, map(job.path, job.groups(*results))))
    advice = "; ".join(result.advice for result in results.values() if not result.ok and result.advice)
    doubts = "; ".join(filter(None, (doubt, caution(ends))))
    return StageResult(job.case_id, ok, sentence, advice, _summary(plan, results), caution=doubts)


def _results(plan: SearchPlan) -> dict[str, StageResult]:
    """The results of the curves of each kind that there is, by the name of their folder."""
    job, kinds = plan.job, _kinds(plan.job.case)
    traced = [kind for kind in EVERY_KIND if kind in kinds or job.groups(CONTAINERS[kind])]
    return {CONTAINERS[kind]: curves_result(job, kind) for kind in traced}


def _summary(plan: SearchPlan, results: Mapping[str, StageResult]) -> dict[str, Any]:
    curves = {f"{name} curves": result.summary["curves"] for name, result in results.items()}
    return {"lines": len(plan.lines)} | curves
