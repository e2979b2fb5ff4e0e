"""The curves of a case as parts of a stage: each start of a curve is two parts, one in each direction.

Curves are taken in the order of their starts, and each start is compared with the curves before it.  The
first start without a curve is always needed.  Its second direction is not if the first one closes, and the
starts behind it are not if the curve passes through them: these are traced ahead.  What was traced ahead is
what its turn would give unless it runs along a curve that came before it: then it is traced again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from pipelines.bifurcations.curve_continuation import would_end_on
from pipelines.bifurcations.detection import EventKind
from pipelines.datasets.records import ENDED, Group
from pipelines.stages.curves.rows import CONTAINERS, TRACED
from pipelines.stages.curves.starts import (
    BOTH_WAYS,
    PendingCurve,
    Start,
    StartQueue,
    curves_of,
    has_ended_for_good,
    is_whole,
    known_curves,
    lies_on,
    parameter_scales,
    start_at,
)
from pipelines.stages.curves.tracing import trace_curve
from pipelines.stages.job import Job, Origin
from pipelines.stages.parts import Part, discard, group_ahead, has_group, has_status_ended, take_turn


def curve_parts(queue: StartQueue) -> Iterator[Part]:
    """The curves of a queue that may be traced now; nothing when every start is on a curve."""
    job = queue.job
    while True:
        waiting = queue.pending()
        first = next(waiting, None)
        if first is None:
            return
        if not _takes_turn(job, first):
            break
    in_turn = _parts_in_turn(job, first)
    yield next(in_turn)
    ranked = [(1, part) for part in in_turn] + list(_ranked_ahead(job, first, waiting))
    yield from (part for _, part in sorted(ranked, key=lambda each: each[0]))


def compute_curve(job: Job, part: Part) -> None:
    """Trace a curve in one direction, until it ends or is stopped."""
    half = part.arguments["half"]
    known = known_curves(job, part.arguments["known"])
    trace_curve(job, _start_of(job, part), part.group, half, known, part.arguments["boundary"])


def curve_is_needed(job: Job, part: Part) -> bool:
    """Whether a curve traced ahead is needed as far as can be told.

    Not if a curve before it has come to its start, or if its other half is the whole curve.
    """
    return _is_needed(job, _start_of(job, part), part)


def _is_needed(job: Job, start: Start, part: Part) -> bool:
    known = curves_of(job, start.problem.kind)
    others = [curve for name, curve in known.items() if name != start.origin.group]
    first = [curve for curve in others if Origin.of(curve.attributes) == start.origin]
    if not first:
        first = list(_existing(job, [_group_ahead(start, 0)]))
    if part.arguments["half"] == 1 and any(
        is_whole(start, half) for half in first if half.n_points or half.attributes["status"] == ENDED
    ):
        return False
    before = [curve for curve in others if Origin.of(curve.attributes) != start.origin]
    before += _existing(job, part.arguments["after"])
    return not any(lies_on(job, start, curve) for curve in before)


def _start_of(job: Job, part: Part) -> Start:
    return start_at(job, EventKind[part.arguments["kind"].upper()], Origin(*part.arguments["origin"]))


def _existing(job: Job, groups: Iterable[str]) -> Iterator[Group]:
    """Those of the groups ahead that are there."""
    names = (*TRACED, *job.case.track_curves.parameters)
    for group in groups:
        if has_group(job, group):
            yield job.read(group, names)


def _group_ahead(start: Start, half: int) -> str:
    return group_ahead(CONTAINERS[start.problem.kind], start.origin, half)


def _takes_turn(job: Job, pending: PendingCurve) -> bool:
    """Whether a half that was traced ahead has taken its turn, or is removed."""
    start, half = pending.start, len(pending.groups)
    if not all(has_ended_for_good(job, pending.known[name], pending.boundary) for name in pending.groups):
        return False
    ahead = _group_ahead(start, half)
    if not has_status_ended(job, ahead):
        return False
    traced = known_curves(job, [ahead])[ahead]
    before = known_curves(job, pending.traced_before).values()
    if would_end_on(traced, before, parameter_scales(job)):
        discard(job, ahead)
    else:
        take_turn(job, ahead, _next_group(pending))
    return True


def _next_group(pending: PendingCurve) -> str:
    return f"{CONTAINERS[pending.start.problem.kind]}/c{len(pending.known):03d}"


def _parts_in_turn(job: Job, pending: PendingCurve) -> Iterator[Part]:
    """What is missing of the first curve."""
    wanted = False
    for half in range(len(BOTH_WAYS)):
        ahead = _group_ahead(pending.start, half)
        if half < len(pending.groups):
            group = pending.groups[half]
            if not has_ended_for_good(job, pending.known[group], pending.boundary):
                wanted = True
                yield _part(pending, half, group)
        elif not wanted:
            wanted = True
            yield _part(pending, half, ahead if has_group(job, ahead) else _next_group(pending))
        else:
            yield from _part_ahead(job, pending, half, ())


def _ranked_ahead(
    job: Job, first: PendingCurve, waiting: Iterable[PendingCurve]
) -> Iterator[tuple[int, Part]]:
    """The halves of further curves, those that are most likely needed with the lowest rank.

    The first curve of another kind or period is certain, as curves of one kind do not meet those of another.
    """
    before = [_group_ahead(first.start, half) for half in range(len(BOTH_WAYS))]
    ranks = Counter([(first.start.problem.kind, first.start.turns)])
    for pending in waiting:
        start, after = pending.start, _of_kind(before, pending.start)
        if any(lies_on(job, start, curve) for curve in _existing(job, after)):
            continue
        kind = start.problem.kind, start.turns
        for half in range(len(BOTH_WAYS)):
            for part in _part_ahead(job, pending, half, after):
                yield len(BOTH_WAYS) * ranks[kind] + half, part
        ranks[kind] += 1
        before += [_group_ahead(start, half) for half in range(len(BOTH_WAYS))]


def _part_ahead(job: Job, pending: PendingCurve, half: int, after: Sequence[str]) -> Iterator[Part]:
    """A half that is traced ahead, unless it has ended or is not needed."""
    part = _part(pending, half, _group_ahead(pending.start, half), after, doubtful=True)
    if not has_status_ended(job, part.group) and _is_needed(job, pending.start, part):
        yield part


def _of_kind(groups: Sequence[str], start: Start) -> list[str]:
    beginning = _group_ahead(start, 0).split("-")[0] + "-"
    return [group for group in groups if group.startswith(beginning)]


def _part(
    pending: PendingCurve, half: int, group: str, after: Sequence[str] = (), doubtful: bool = False
) -> Part:
    """``after``: groups ahead of the starts before this one."""
    start = pending.start
    arguments = {
        "kind": start.problem.kind.name.lower(),
        "origin": [start.origin.group, start.origin.event],
        "half": half,
        "boundary": pending.boundary,
        "known": pending.traced_before,
        "after": list(after),
    }
    return Part(group, arguments, doubtful)
