"""Curves of one kind through every bifurcation of a store that is on none of them yet.

Where a curve can start: at the bifurcations of all branches of cycles, and where it joins a stored curve of
another kind (period doubling and Neimark-Sacker at R2, fold and Neimark-Sacker at R1).  Starts are taken in
the order of their groups; each is compared with the curves traced before it, so that the curves of a case do
not depend on interruptions, and a store with more branches gets more curves, never others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np

from pipelines.bifurcations.codimension_two import resonant_end
from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveResult,
    CurveStart,
    CurveState,
    CurveStop,
    SpecialPoint,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.bifurcations.switching import curve_from_event, joined_curve
from pipelines.bifurcations.traced import TracedCurve
from pipelines.case.models import PARAMETERS
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, has_ended, open_branch
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import parameter_vector
from pipelines.stages.branch_run import turned
from pipelines.stages.curve_rows import (
    CONTAINERS,
    SPECIAL_NAMES,
    TRACED,
    CurveRecorder,
    curve_sizes,
    resumed_state,
    stored_special,
    traced,
)
from pipelines.stages.cycle_problem import NORMAL_FORM, cycle_problem, smooth_maps
from pipelines.stages.cycle_rows import EVENT_NAMES, coordinates, stored_event
from pipelines.stages.job import Job, Origin
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
WANTING_POINTS = CurveStop.MAXIMUM_POINTS.name.lower()
BOTH_WAYS = (1, -1)
JOINS = {
    EventKind.PERIOD_DOUBLING: (EventKind.NEIMARK_SACKER,),
    EventKind.NEIMARK_SACKER: (EventKind.PERIOD_DOUBLING, EventKind.FOLD),
    EventKind.FOLD: (EventKind.NEIMARK_SACKER,),
}


@dataclass(frozen=True)
class Start:
    """Where a curve may start, and for cycles of how many excitation periods."""

    origin: Origin
    problem: CurveProblem
    guess: CurveStart
    turns: int


def track_curves(
    kind: EventKind, case: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Fill the groups ``pd/c000``, ``ns/c000`` or ``folds/c000``, ... of a case; resumes behind the last
    point.
    """
    stage = {"pd": "track-pd", "ns": "track-ns", "folds": "track-folds"}[CONTAINERS[kind]]
    job = Job.of(stage, case, store_path, report, should_stop)
    return curves_result(job, kind, trace_all(job, (kind,)))


@dataclass(frozen=True)
class Untraced:
    """How many starts gave no curve: outside the plane, beyond the largest number of curves."""

    outside: int = 0
    refused: int = 0


def trace_all(job: Job, kinds: Sequence[EventKind]) -> Untraced:
    """Trace every curve of some kinds that the store's bifurcations start.

    One curve after the other: what comes next follows from the store alone, so that a search that was
    interrupted goes on as if it had not been.
    """
    fates: dict[tuple[EventKind, Origin], _Fate] = {}
    while not job.should_stop() and (found := _next_start(job, kinds, fates)) is not None:
        _trace_both_ways(job, *found)
    told = list(fates.values())
    return Untraced(told.count(_Fate.OUTSIDE), told.count(_Fate.REFUSED))


class _Fate(Enum):
    """What a start comes to that has no curve of its own."""

    OUTSIDE = 1
    KNOWN = 2
    REFUSED = 3


def _next_start(
    job: Job, kinds: Sequence[EventKind], fates: dict[tuple[EventKind, Origin], _Fate]
) -> tuple[EventKind, Start, list[str], int] | None:
    """A curve that was begun; else the first start, in the order of kinds and groups, on no curve yet.

    With its kind, its groups and the number of curves of its kind; None when nothing is left.  ``fates``
    remembers the starts that need not be looked at again.
    """
    fresh: tuple[EventKind, Start, list[str], int] | None = None
    for kind in kinds:
        known = _curves(job, kind)
        origins = {name: Origin.of(curve.attributes) for name, curve in known.items()}
        for start in _starts(job, kind):
            mine = [name for name in known if origins[name] == start.origin]
            if mine and not _is_finished(job, kind, start, mine):
                return kind, start, mine, len(known)
            if mine or fresh is not None or (kind, start.origin) in fates:
                continue
            fate = _fate(job, start, known)
            if fate is None:
                fresh = kind, start, mine, len(known)
            else:
                fates[kind, start.origin] = fate
    return fresh


def _fate(job: Job, start: Start, known: Mapping[str, Group]) -> _Fate | None:
    if not _is_inside(job, start):
        return _Fate.OUTSIDE
    if any(_lies_on(job, start, curve) for curve in known.values()):
        return _Fate.KNOWN
    return _Fate.REFUSED if len(known) >= job.case.case.track_curves.max_curves else None


def _is_finished(job: Job, kind: EventKind, start: Start, mine: list[str]) -> bool:
    """Whether the curve of a start has ended in both directions, and not for want of points."""
    most = job.case.case.track_curves.max_points
    for group in mine:
        curve = job.read(group, ())
        if not has_ended(curve.attributes, curve.n_points, WANTING_POINTS, most):
            return False
    return len(mine) == len(BOTH_WAYS) or _is_whole(job, kind, start, mine[0])


def _starts(job: Job, kind: EventKind) -> Iterator[Start]:
    """Every bifurcation of the kind that was located on a branch, then every special point that it joins."""
    flag = KINDS["cycles"].array("event_kind").flag(kind.name.lower())
    for group in job.groups("cycles"):
        branch = job.read(group, EVENT_NAMES)
        if branch.attributes["status"] != ENDED:  # its later bifurcations would come too late
            continue
        for index in range(branch.n_events):
            if branch["event_kind"][index] == flag and np.isfinite(branch["event_residual"][index]):
                yield _start_at_event(job, branch, Origin(group, index))
    for other in JOINS[kind]:
        for group in job.groups(CONTAINERS[other]):
            yield from _starts_on_curve(job, kind, other, group)


def _start_at_event(job: Job, branch: Group, origin: Origin) -> Start:
    table, turns = job.case.case.track_curves, int(branch.attributes.get("turns", 1))
    event = stored_event(branch, origin.event)
    cycles = turned(cycle_problem(job.machine, job.case.case), turns)
    problem, guess = curve_from_event(cycles, event, table.parameters, CurveFormulation(table.formulation))
    return Start(origin, problem, guess, turns)


def _starts_on_curve(job: Job, kind: EventKind, other: EventKind, group: str) -> Iterator[Start]:
    """Curves of `kind` through the special points of a curve of another kind."""
    curve = job.read(group, SPECIAL_NAMES)
    if curve.attributes["status"] != ENDED:
        return
    turns = int(curve.attributes["turns"])
    for index in range(curve.n_events):
        if not np.isfinite(curve["event_residual"][index]):
            continue
        special = stored_special(curve, index)
        joined = joined_curve(curve_problem(job, other, turns, special.parameters), special)
        if joined is not None and joined[0].kind is kind:
            yield Start(Origin(group, index), joined[0], joined[1], turns)


def curve_problem(job: Job, kind: EventKind, turns: int, parameters: np.ndarray) -> CurveProblem:
    """Curves of a kind over the plane of the case, the other parameters as given."""
    case = job.case.case
    cycles = turned(cycle_problem(job.machine, case), turns)
    return CurveProblem(
        cycles.period_map,
        kind,
        parameters,
        case.track_curves.parameters,
        cycles.options,
        CurveFormulation(case.track_curves.formulation),
    )


def _curves(job: Job, kind: EventKind) -> dict[str, Group]:
    """All curves of a kind, as far as `lies_on` needs them."""
    names = (*TRACED, *job.case.case.track_curves.parameters)
    return {group: job.read(group, names) for group in job.groups(CONTAINERS[kind])}


def _is_inside(job: Job, start: Start) -> bool:
    ranges = job.case.case.track_curves.ranges
    return all(
        low <= value <= high for value, (low, high) in zip(start.guess.parameters, ranges, strict=True)
    )


def _lies_on(job: Job, start: Start, curve: Group) -> bool:
    """Whether a start is on a stored curve of the same kind and period.

    Cycles of several turns are the same whichever turn they are sampled at.
    """
    if curve.attributes["turns"] != start.turns or curve.n_points < 2:
        return False
    line = traced(curve, start.problem.names)
    return any(line.holds(guess, parameter_scales(job)) for guess in _samplings(start))


def _samplings(start: Start) -> Iterator[CurveStart]:
    """The start sampled at each of its turns."""
    yield start.guess
    if start.turns == 1:
        return
    period_map = start.problem.period_map
    parameters = start.problem.parameters.copy()
    parameters[list(start.problem.indices)] = start.guess.parameters
    period = start.guess.period
    steps = period_map.minimum_steps if period_map.steps_per_period is None else period_map.steps_per_period
    orbit = period_map.evaluate(start.guess.state, parameters, period, 4 * steps).orbit
    for turn in range(1, start.turns):
        yield replace(start.guess, state=orbit[turn * len(orbit) // start.turns])


def parameter_scales(job: Job) -> tuple[float, float]:
    """Changes of the two free parameters that count as one: of a foil stiffness the case's own value."""
    values = dict(zip(PARAMETERS, parameter_vector(job.case.case), strict=True))
    first, second = (
        float(values[name]) if name == "foil_stiffness" else 1.0
        for name in job.case.case.track_curves.parameters
    )
    return first, second


def _trace_both_ways(job: Job, kind: EventKind, start: Start, mine: list[str], known: int) -> None:
    """Trace the curve through a start: one group, or two when it is open and the start inside it."""
    groups = list(mine)
    for half, direction in enumerate(BOTH_WAYS):
        if half == len(groups):
            if half == 1 and _is_whole(job, kind, start, groups[0]):
                return
            groups.append(f"{CONTAINERS[kind]}/c{known:03d}")
            known += 1
        trace_curve(job, start, groups[half], half, direction)
        if job.should_stop():
            return


def _is_whole(job: Job, kind: EventKind, start: Start, group: str) -> bool:
    """Whether nothing is left to trace in the other direction: the curve is closed, could not be started, or
    is a Neimark-Sacker curve that leaves a resonance, where it ends.
    """
    curve = job.read(group, ("angle",))
    closed = curve.attributes["stop_reason"] == CurveStop.CLOSED.name.lower()
    if closed or curve.n_points == 0:
        return True
    return (
        kind is EventKind.NEIMARK_SACKER and resonant_end(kind, float(np.cos(curve["angle"][0]))) is not None
    )


def trace_curve(job: Job, start: Start, group: str, half: int, direction: int) -> None:
    """Follow a curve from its start, or from its last committed point, until it ends or is asked to stop."""
    table = job.case.case.track_curves
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
    sizes = curve_sizes(job.machine, job.case.case, start.problem)
    static = coordinates(job.case.case)
    with open_branch(job.store, job.path(group), "curve", sizes, static, attributes) as curve:
        if not curve.is_complete(WANTING_POINTS, table.max_points):
            _follow(job, start, group, curve, direction)


def _follow(job: Job, start: Start, group: str, curve: BranchWriter, direction: int) -> None:
    case = job.case.case
    problem = start.problem
    if case.track_curves.normal_forms:
        smooth = smooth_maps(case, problem.period_map, case.track_curves.normal_form_widths)
        problem = replace(problem, smooth_maps=smooth)
    thinnest = case.continue_cycles.minimum_film
    recorder = CurveRecorder(job.machine, problem, curve, thinnest, _teller(job, start, group))
    newest, names = curve.resume_row(), problem.names
    begin: CurveStart | CurveState = start.guess
    own: TracedCurve | None = None
    if newest is not None:
        rows = job.read(group, (*TRACED, "period", *names))
        begin, own = resumed_state(newest, rows.arrays, names), traced(rows, names)
    else:
        job.tell(0, None, f"{group}: starting from {start.origin.group}, event {start.origin.event}")
    options = curve_options(job, direction)
    known = _traced_before(job, start, group)
    result = continue_curve(
        problem, begin, options, recorder.record, recorder.limit, job.should_stop, known, own
    )
    _end(curve, result)


def _traced_before(job: Job, start: Start, group: str) -> dict[str, TracedCurve]:
    """The curves of the same kind and period traced before this one, other than its own other half."""
    curves = _curves(job, start.problem.kind)
    return {
        name: traced(curve, start.problem.names)
        for name, curve in curves.items()
        if name < group
        and curve.n_points > 1
        and curve.attributes["turns"] == start.turns
        and Origin.of(curve.attributes) != start.origin
    }


def curve_options(job: Job, direction: int) -> CurveOptions:
    """Options of the continuation from the case's table."""
    table = job.case.case.track_curves
    return CurveOptions(
        ranges=table.ranges,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scales=parameter_scales(job),
        normal_form=NORMAL_FORM if table.normal_forms else None,
    )


def _teller(
    job: Job, start: Start, group: str
) -> Callable[[CurvePoint, CurveState, tuple[SpecialPoint, ...]], None]:
    """What is told of every recorded point."""
    limit, names = job.case.case.track_curves.max_points, start.problem.names

    def told(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        where = ", ".join(f"{name} {value:.5g}" for name, value in zip(names, state.parameters, strict=True))
        found = "".join(f", {special.kind.name.lower().replace('_', ' ')}" for special in specials)
        job.tell(state.index + 1, limit, f"{group}: {where}{found}")

    return told


def _end(curve: BranchWriter, result: CurveResult) -> None:
    """Store why the curve ended; an interrupted one stays open."""
    if result.stop is not CurveStop.INTERRUPTED:
        # the limit is this stage's own, and its message says all
        parts = [result.message, "" if result.stop is CurveStop.LIMIT else result.stop.advice]
        curve.finish(result.stop.name.lower(), "; ".join(filter(None, parts)))


def curves_result(job: Job, kind: EventKind, untraced: Untraced) -> StageResult:
    """How the curves of a case ended: the case is well when all of them are complete."""
    curves = [job.read(group, ("event_kind",)) for group in job.groups(CONTAINERS[kind])]
    complete = {stop.name.lower() for stop in COMPLETE}
    ended = [curve for curve in curves if curve.attributes["status"] == ENDED]
    ok = not untraced.refused and all(
        curve.attributes["stop_reason"] in complete and curve.n_points > 0 for curve in ended
    )
    specials: list[str] = []
    for curve in curves:
        specials += [label.replace("_", " ") for label in curve.labels("event_kind").tolist()]
    summary = {"curves": len(curves), "points": sum(curve.n_points for curve in curves)}
    summary |= {name: specials.count(name) for name in dict.fromkeys(specials)}
    if untraced.outside:
        summary["starts outside the plane"] = untraced.outside
    reasons = [curve.attributes["stop_reason"] for curve in curves if curve.attributes["stop_reason"]]
    if job.should_stop():
        reasons.append("stopped on request")
    advice = [curve.attributes["stop_advice"] for curve in curves]
    if untraced.refused:
        advice.append(f"{untraced.refused} more curves were not traced: raise track_curves.max_curves")
    reason = ", ".join(dict.fromkeys(reasons)) or f"no {kind.name.lower().replace('_', ' ')} to start from"
    return StageResult(job.case.case_id, ok, reason, "; ".join(dict.fromkeys(filter(None, advice))), summary)
