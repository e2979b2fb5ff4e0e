"""`agfb survey`: growth rates over a grid of the plane, without continuation.

Every line of the grid is one row of the group ``survey``, committed as soon as it is computed. A row depends
on the case alone, so that an interrupted survey goes on with the same bytes.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import case_group, open_for_writing
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.stages.parameter_columns import parameter_attributes
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult
from pipelines.stages.survey.line import SurveyProblem, compute_line, survey_problem
from pipelines.stages.survey.onsets import GROUP, onsets

ALL_COMPUTED = "all lines are computed"
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
    store, group = open_for_writing(store_path), case_group(named.case_id, GROUP)
    problem = survey_problem(build_machine(named.case), named.case, parameter_vector(named.case))
    lines = problem.across.points
    sizes = {"line": lines, "cell": problem.along.points}
    with open_branch(
        store, group, "survey", sizes, {"along": problem.abscissae}, request_of(problem)
    ) as branch:
        while branch.n_points < lines and not should_stop():
            branch.commit(compute_line(problem, branch.n_points))
            report(Progress("survey", named.case_id, branch.n_points, lines, _message(problem, branch)))
        if branch.n_points == lines and branch.status != ENDED:
            _finish(branch, read_group(store, group, ("status",)))
    return _result(named.case_id, read_group(store, group))


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


def _message(problem: SurveyProblem, branch: BranchWriter) -> str:
    value = problem.ordinates[branch.n_points - 1]
    return f"{problem.across.parameter.replace('_', ' ')} {value:.4g}"


def _finish(branch: BranchWriter, group: Group) -> None:
    """Store how many cells have no cycle, or one that cannot be."""
    counted = Counter(group.labels("status").ravel().tolist())
    cells = group["status"].size
    notes = [f"{counted[name]} of {cells} cells {ADVICE[name]}" for name in ADVICE if counted[name]]
    some = counted["found"] > 0
    branch.finish(ALL_COMPUTED if some else NOTHING_FOUND, "; ".join(notes))


def _result(case_id: str, group: Group) -> StageResult:
    """Stable and unstable cells, cells without a cycle, and the lowest onset."""
    if group.attributes["status"] != ENDED:
        return StageResult(case_id, True, "stopped on request")
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
        along, across = (str(name).replace("_", " ") for name in group.attributes["parameters"])
        kind = lowest.bifurcation.replace("_", " ")
        summary["lowest onset"] = f"{kind} at {across} {lowest.across:.4g}, {along} {lowest.along:.4g}"
    reason = group.attributes["stop_reason"]
    return StageResult(case_id, reason in SUCCESSFUL, reason, group.attributes["stop_advice"], summary)
