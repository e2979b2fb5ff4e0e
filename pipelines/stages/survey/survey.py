"""`agfb survey`: growth rates over a grid of the plane, without continuation.

Every line of the grid is one row of the group ``survey``, committed as soon as it is computed. A row depends
on the case alone, so that an interrupted survey goes on with the same bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import parameter_vector
from pipelines.stages.job import Job
from pipelines.stages.parameter_columns import parameter_attributes
from pipelines.stages.parts import Row, RowPlan, compute_alone, discard_all, has_group
from pipelines.stages.results import Report, ShouldStop, StageResult
from pipelines.stages.survey.line import SurveyProblem, compute_line, survey_problem
from pipelines.stages.survey.onsets import GROUP, onsets

ALL_COMPUTED = "all lines are computed"
STOPPED = "stopped on request"
NOTHING_FOUND = "no cell has a cycle"
SUCCESSFUL = frozenset({ALL_COMPUTED})
ADVICE = {
    "no_equilibrium": "have no equilibrium (agfb linearize says why)",
    "no_cycle": "have no cycle that Newton's method finds (narrow survey.ranges, or raise survey.points or "
    "numerics.circumferential)",
    "thin_film": "have a film thinner than continue_cycles.minimum_film",
    "below_vacuum": "have a pressure below vacuum (raise numerics.circumferential)",
}


def survey(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the group ``survey`` of a case, line by line; resumes after the last line."""
    return compute_alone(plan_survey(named, store_path, report, should_stop))


def plan_survey(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> SurveyPlan:
    """The lines of a case; each is a part."""
    return SurveyPlan(Job.of(GROUP, named, store_path, report, should_stop))


@dataclass(frozen=True)
class SurveyPlan(RowPlan):
    """One row for each line."""

    job: Job
    group = GROUP

    @cached_property
    def problem(self) -> SurveyProblem:
        """What all lines have in common."""
        return survey_problem(self.job.machine, self.job.case, parameter_vector(self.job.case))

    def missing(self) -> tuple[int, list[Row]]:
        """The lines without a row, from the first one."""
        lines = self.problem.across.points
        known = self.job.read(GROUP, ()).n_points if has_group(self.job, GROUP) else 0
        return lines, [Row(f"{line:04d}", {"line": line}) for line in range(known, lines)]

    def open(self, group: str, rows: int) -> BranchWriter:
        """Open the group for so many lines."""
        sizes = {"line": rows, "cell": self.problem.along.points}
        static = {"along": self.problem.abscissae}
        request = request_of(self.problem)
        return open_branch(self.job.store, self.job.path(group), "survey", sizes, static, request, wait=True)

    def row(self, job: Job, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        """Compute one line."""
        line = int(arguments["line"])
        place = self.job.place(self.problem.across.parameter, self.problem.ordinates[line])
        return compute_line(self.problem, line), place

    def finish(self, branch: BranchWriter) -> None:
        """Store how many cells have no cycle, or one that cannot be."""
        group = read_group(self.job.store, branch.group, ("status",))
        counted = Counter(group.labels("status").ravel().tolist())
        cells = group["status"].size
        notes = [f"{counted[name]} of {cells} cells {ADVICE[name]}" for name in ADVICE if counted[name]]
        branch.finish(ALL_COMPUTED if counted["found"] > 0 else NOTHING_FOUND, "; ".join(notes))

    def result(self) -> StageResult:
        """Stable and unstable cells."""
        if not self.job.should_stop():
            discard_all(self.job)
        if not has_group(self.job, GROUP):
            return StageResult(self.job.case_id, True, STOPPED)
        return _result(self.job, read_group(self.job.store, self.job.path(GROUP)))


def request_of(problem: SurveyProblem) -> dict[str, Any]:
    """What a survey was asked for, as attributes of its group."""
    axes = (problem.along, problem.across)
    return {
        "request": problem.case.survey.model_dump(mode="json"),
        "parameters": [axis.parameter for axis in axes],
        "ranges": [[axis.low, axis.high] for axis in axes],
        "constants": {
            name: value
            for name, value in parameter_attributes(problem.case, problem.cycles.parameters).items()
            if name not in {axis.parameter for axis in axes}
        },
    }


def _result(job: Job, group: Group) -> StageResult:
    """Stable and unstable cells, cells without a cycle, and the lowest onset."""
    case_id = job.case_id
    if group.attributes["status"] != ENDED:
        return StageResult(case_id, True, STOPPED)
    found = group.labels("status") == "found"
    summary: dict[str, Any] = {
        "cells": int(found.size),
        "unstable": int(np.sum(found & (group["unstable_count"] > 0))),
    }
    for name in KINDS["survey"].array("status").flags[1:]:
        if number := int(np.sum(group.labels("status") == name)):
            summary[name.replace("_", " ")] = number
    if rising := onsets(group):
        lowest = min(rising, key=lambda onset: onset.across)
        place = lowest.place(group.attributes["parameters"], job.case.scales.si_per_unit)
        summary["lowest onset"] = f"{lowest.kind} at {place}"
    reason = group.attributes["stop_reason"]
    return StageResult(case_id, reason in SUCCESSFUL, reason, group.attributes["stop_advice"], summary)
