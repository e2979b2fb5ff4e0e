"""The stages that trace a curve through every stored bifurcation of a kind that is on no curve yet.

``pipelines.stages.curves.starts`` gives the starts, one after the other, so that the curves of a case do not
depend on interruptions. Further branches in a store add curves and do not change the existing ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveStart,
    CurveState,
    CurveStop,
    SpecialPoint,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import EventKind
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.stages import step_errors
from pipelines.stages.curves.rows import (
    CONTAINERS,
    RESUMED,
    CurveRecorder,
    curve_sizes,
    resumed_state,
    traced,
)
from pipelines.stages.curves.starts import (
    BOTH_WAYS,
    WANTING_POINTS,
    PendingCurve,
    Start,
    StartQueue,
    is_whole,
    parameter_scales,
)
from pipelines.stages.cycles.problem import EVENT_SHARE, NORMAL_FORM, smooth_maps
from pipelines.stages.ending import is_success, store_end
from pipelines.stages.job import Job, coordinates
from pipelines.stages.results import Report, ShouldStop, StageResult

COMPLETE = frozenset(
    {
        CurveStop.RANGE,
        CurveStop.CLOSED,
        CurveStop.RESONANCE_1,
        CurveStop.RESONANCE_2,
        CurveStop.MAXIMUM_POINTS,
        CurveStop.LIMIT,
        CurveStop.TRACED,
    }
)


def track_pd(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``pd/c000``, ... of a case; resumes after the last stored point."""
    job = Job.of("track-pd", named, store_path, report, should_stop)
    return _track(job, EventKind.PERIOD_DOUBLING)


def track_ns(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``ns/c000``, ... of a case; resumes after the last stored point."""
    job = Job.of("track-ns", named, store_path, report, should_stop)
    return _track(job, EventKind.NEIMARK_SACKER)


def track_folds(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``folds/c000``, ... of a case; resumes after the last stored point."""
    job = Job.of("track-folds", named, store_path, report, should_stop)
    return _track(job, EventKind.FOLD)


def _track(job: Job, kind: EventKind) -> StageResult:
    queue = StartQueue(job, (kind,))
    trace_all(queue)
    return curves_result(job, kind, queue.outside, queue.refused)


def trace_all(queue: StartQueue) -> None:
    """Trace every curve of a queue, until nothing is left or the stage is asked to stop.

    Curves are traced one after the other. The next one follows from the store alone, so that an interrupted
    search gives the curves of an undisturbed one.
    """
    while not queue.job.should_stop() and (pending := queue.next()) is not None:
        _trace_both_ways(queue.job, pending)


def _trace_both_ways(job: Job, pending: PendingCurve) -> None:
    """Trace the curve through a start: two groups, one in each direction, or one if ``is_whole``."""
    start, groups, known = pending.start, list(pending.groups), pending.traced_before
    for half, direction in enumerate(BOTH_WAYS):
        if half == len(groups):
            if half == 1 and is_whole(start, job.read(groups[0], ("angle",))):
                return
            number = len(pending.known) + len(groups) - len(pending.groups)
            groups.append(f"{CONTAINERS[start.problem.kind]}/c{number:03d}")
        trace_curve(job, start, groups[half], half, direction, known)
        if job.should_stop():
            return


def trace_curve(
    job: Job, start: Start, group: str, half: int, direction: int, known: Mapping[str, KnownCurve]
) -> None:
    """Follow a curve from its start or from its last committed point.

    It ends for a reason of its own, where it coincides with one of the ``known`` curves, or when the stage
    is asked to stop.
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
        if not curve.is_complete(WANTING_POINTS, table.max_points):
            _follow(job, start, group, curve, direction, known)


def _follow(
    job: Job, start: Start, group: str, curve: BranchWriter, direction: int, known: Mapping[str, KnownCurve]
) -> None:
    case = job.case
    problem = start.problem
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
    options = curve_options(job, direction)
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
        where = ", ".join(f"{name} {value:.5g}" for name, value in zip(names, state.parameters, strict=True))
        found = "".join(f", {special.kind.name.lower().replace('_', ' ')}" for special in specials)
        job.report_progress(state.index + 1, limit, f"{group}: {where}{found}")

    return report_point


def curves_result(job: Job, kind: EventKind, outside: int = 0, refused: int = 0) -> StageResult:
    """The result of tracing the curves of a kind: a success if all of them are complete.

    ``outside``: starts outside the plane; ``refused``: starts beyond the largest number of curves.
    """
    names = ("event_kind", step_errors.STEP_ERROR)
    curves = [job.read(group, names) for group in job.groups(CONTAINERS[kind])]
    ok = not refused and all(is_success(curve, COMPLETE) for curve in curves)
    specials: list[str] = []
    for curve in curves:
        specials += [label.replace("_", " ") for label in curve.labels("event_kind").tolist()]
    summary: dict[str, Any] = {"curves": len(curves), "points": sum(curve.n_points for curve in curves)}
    summary |= {name: specials.count(name) for name in dict.fromkeys(specials)}
    if outside:
        summary["starts outside the plane"] = outside
    unknown = step_errors.count(curves)
    if where := step_errors.in_words(unknown):
        summary[step_errors.NAME] = where
    reasons = [curve.attributes["stop_reason"] for curve in curves if curve.attributes["stop_reason"]]
    if job.should_stop():
        reasons.append("stopped on request")
    advice = [curve.attributes["stop_advice"] for curve in curves]
    if refused:
        advice.append(f"{refused} more curves were not traced: raise track_curves.max_curves")
    reason = ", ".join(dict.fromkeys(reasons)) or f"no {kind.name.lower().replace('_', ' ')} to start from"
    sentences, doubt = "; ".join(dict.fromkeys(filter(None, advice))), step_errors.caution(unknown)
    return StageResult(job.case_id, ok, reason, sentences, summary, caution=doubt)
