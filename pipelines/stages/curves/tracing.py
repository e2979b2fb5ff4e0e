"""One curve in its group of the store: continue from its start or from its last point, end."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace

from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveStart,
    CurveState,
    SpecialPoint,
    around_tongue,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import EventKind
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.stages.curves.rows import RESUMED, CurveRecorder, curve_sizes, resumed_state, traced
from pipelines.stages.curves.starts import BOTH_WAYS, Start, has_ended_for_good, parameter_scales
from pipelines.stages.cycles.problem import EVENT_SHARE, NORMAL_FORM, kinks_of, smooth_maps
from pipelines.stages.ending import store_end
from pipelines.stages.job import Job, coordinates


def trace_curve(
    job: Job, start: Start, group: str, half: int, known: Mapping[str, KnownCurve], boundary: bool
) -> None:
    """Follow a curve from its start or from its last committed point, in one of both directions.

    It ends for a reason of its own, where it coincides with one of the ``known`` curves, or when the stage
    is asked to stop; also where it leaves the ``boundary`` of stable cycles if only that is wanted.
    """
    table = job.case.track_curves
    attributes = {
        "bifurcation": start.problem.kind.name.lower(),
        "parameters": list(table.parameters),
        "ranges": [list(interval) for interval in table.ranges],
        "turns": start.turns,
        "origin": start.origin.as_dict(),
        "half": half,
        # more points and more curves may be asked for later; everything else must stay as it was
        "request": table.model_dump(mode="json", exclude={"max_points", "max_curves"}),
    }
    sizes = curve_sizes(job.machine, job.case, start.problem)
    static = coordinates(job.case)
    with open_branch(job.store, job.path(group), "curve", sizes, static, attributes) as curve:
        if not has_ended_for_good(job, curve, boundary):
            options = replace(curve_options(job, BOTH_WAYS[half]), boundary=boundary)
            _follow(job, start, group, curve, options, known)


def _follow(
    job: Job,
    start: Start,
    group: str,
    curve: BranchWriter,
    options: CurveOptions,
    known: Mapping[str, KnownCurve],
) -> None:
    case = job.case
    problem = replace(start.problem, kinks=kinks_of(case, job.machine, start.problem.period_map))
    if case.track_curves.normal_forms:
        smooth = smooth_maps(case, problem.period_map, case.track_curves.normal_form_widths)
        problem = replace(problem, smooth_maps=smooth)
    recorder = CurveRecorder(job.machine, problem, curve, case, _progress_callback(job, start, group))
    newest, names = curve.resume_row(), problem.names
    begin: CurveStart | CurveState = start.guess
    own: KnownCurve | None = None
    if newest is not None:
        rows = job.read(group, (*RESUMED, *names))
        begin, own = resumed_state(newest, rows.arrays, names), traced(rows, names)
    else:
        job.report_progress(
            0, None, f"{group}: starting from {start.origin.group}, event {start.origin.event}"
        )
    if problem.kind is not EventKind.NEIMARK_SACKER:
        options = around_tongue(options, start.guess.width)
    result = continue_curve(
        problem, begin, options, recorder.record, recorder.limit, job.should_stop, known, own
    )
    store_end(curve, result)


def curve_options(job: Job, direction: int) -> CurveOptions:
    """Options of the continuation from the case's table."""
    table = job.case.track_curves
    return CurveOptions(
        ranges=table.ranges,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scales=parameter_scales(job),
        event_tolerance=EVENT_SHARE * job.case.numerics.event_tolerance,
        normal_form=NORMAL_FORM if table.normal_forms else None,
    )


def _progress_callback(
    job: Job, start: Start, group: str
) -> Callable[[CurvePoint, CurveState, tuple[SpecialPoint, ...]], None]:
    """A function that reports the progress after every recorded point."""
    limit, names = job.case.track_curves.max_points, start.problem.names

    def report_point(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        where = ", ".join(itertools.starmap(job.place, zip(names, state.parameters, strict=True)))
        found = "".join(f", {special.kind.name.lower().replace('_', ' ')}" for special in specials)
        job.report_progress(state.index + 1, limit, f"{group}: {where}{found}")

    return report_point
