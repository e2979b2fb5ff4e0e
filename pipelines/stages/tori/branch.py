"""One branch of tori in its group of the store: start, continue point by point, resume, end."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.continuation import continue_torus
from pipelines.bifurcations.tori.events import TorusEvent
from pipelines.bifurcations.tori.problem import TorusProblem
from pipelines.bifurcations.tori.torus import (
    TorusOptions,
    TorusPoint,
    TorusResult,
    TorusStart,
    TorusState,
    TorusStop,
)
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.stages.cycles.branch import NO_START
from pipelines.stages.cycles.problem import parameter_scale
from pipelines.stages.cycles.start import NoStart
from pipelines.stages.ending import store_end
from pipelines.stages.job import Job
from pipelines.stages.tori.rows import TorusRecorder, resumed_state, static_arrays, torus_sizes
from pipelines.stages.tori.sources import TorusSource

WANTING_POINTS = TorusStop.MAXIMUM_POINTS.name.lower()


def trace_tori(job: Job, group: str, source: TorusSource) -> None:
    """Trace a branch of tori from its first one, or from its last committed point, until it ends.

    It also ends when asked to stop.  A branch that cannot start is an ended group without points, whose
    attributes say why.

    Raises what `open_branch` raises.
    """
    case = job.case
    table = case.continue_tori
    attributes: dict[str, Any] = {
        "parameter": table.parameter,
        # more points may be asked for later; everything else must stay as it was
        "request": table.model_dump(mode="json", exclude={"max_points"}),
        **source.attributes(),
    }
    sizes, static = torus_sizes(job.machine, case), static_arrays(case)
    with open_branch(job.store, job.path(group), "tori", sizes, static, attributes) as branch:
        if not branch.is_complete(WANTING_POINTS, table.max_points):
            _follow(job, group, source, branch)


def _follow(job: Job, group: str, source: TorusSource, branch: BranchWriter) -> None:
    table, newest = job.case.continue_tori, branch.resume_row()
    if newest is not None:
        problem = source.problem(int(newest.row["steps_per_period"]))
        state = resumed_state(newest, table.parameter)
        _end(branch, source, _run(job, group, branch, problem, state, 1))
        return
    job.report_progress(0, table.max_points, f"{group}: looking for the first torus")
    failure = NoStart("no torus was found", "")
    for found in source.starts(job):
        if job.should_stop():
            return
        if isinstance(found, NoStart):
            failure = found
            continue
        result = _run(job, group, branch, found.problem, found.start, found.direction)
        if result.stop is not TorusStop.START_FAILED:
            _end(branch, source, result)
            return
        failure = NoStart(f"the first torus did not converge: {result.message}", result.stop.advice)
    branch.finish(NO_START, f"{failure.reason}: {failure.advice}")


def _run(
    job: Job,
    group: str,
    branch: BranchWriter,
    problem: TorusProblem,
    start: TorusStart | TorusState,
    direction: int,
) -> TorusResult:
    options = torus_options(job, direction)
    low, high = options.range
    if not low <= start.parameter <= high:
        where = f"it lies at {start.parameter:.6g}, outside continue_tori.range = [{low:g}, {high:g}]"
        return TorusResult(TorusStop.START_FAILED, None, where)
    circle = problem.circle
    assert isinstance(circle, PeriodCircle)
    recorder = TorusRecorder(job.machine, circle, branch, job.case, _progress_callback(job, group))
    return continue_torus(problem, start, options, recorder.record, recorder.limit, job.should_stop)


def torus_options(job: Job, direction: int) -> TorusOptions:
    """Options of the continuation from the case's table; foil stiffnesses are relative to the case's."""
    table = job.case.continue_tori
    return TorusOptions(
        range=table.range,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scale=parameter_scale(job.case, table.parameter),
    )


def _progress_callback(
    job: Job, group: str
) -> Callable[[TorusPoint, TorusState, tuple[TorusEvent, ...]], None]:
    """The report of every recorded torus."""
    table = job.case.continue_tori

    def report_point(point: TorusPoint, state: TorusState, events: tuple[TorusEvent, ...]) -> None:
        message = job.place(table.parameter, state.parameter)
        message += f", rotation {state.rotation / (2.0 * math.pi):.5f}"
        known = "stable" if point.stable else "unstable"
        message += f", {point.torus.count} angles, {known if point.spectrum.decided else 'undecided'}"
        for event in events:
            named = event.kind.name.lower().replace("_", " ")
            message += f"; {named} at {job.place(table.parameter, event.unknowns.parameter)}"
        job.report_progress(state.index + 1, table.max_points, f"{group}: {message}")

    return report_point


def _end(branch: BranchWriter, source: TorusSource, result: TorusResult) -> None:
    """Store why the branch ended, with advice where the Fourier series of a torus decays too slowly."""
    rough = result.stop is TorusStop.ROUGH
    beyond = f"that is, raise continue_tori.max_angles or tolerance, or {source.beyond}"
    store_end(branch, result, beyond if rough else "")
