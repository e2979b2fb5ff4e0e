"""Where curves can start, and which of these starts comes next.

Curves start at the bifurcations of all completed branches of cycles, and at the codimension-two points of
stored curves where another curve meets them.  At the resonances R1 and R2 a Neimark-Sacker curve ends on the
stored one, and goes on from the far side of a tongue; at the others a second bifurcation happens at the same
parameters.  Starts are taken in the order of their groups; each is compared with the curves traced before it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipelines.bifurcations.curve import CurveStart, CurveStop, SpecialKind
from pipelines.bifurcations.curves.codimension_two import resonant_end, second_bifurcation, unstable_others
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import EventKind, unstable_count
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.bifurcations.switching import curve_from_event, curve_of_second, with_multiplied_period
from pipelines.datasets.branch import BranchWriter, has_ended
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.schema import KINDS
from pipelines.stages.curves.rows import CONTAINERS, SPECIAL_NAMES, TRACED, stored_special, traced
from pipelines.stages.cycles.problem import cycle_problem, parameter_scale
from pipelines.stages.cycles.rows import EVENT_NAMES, stored_event
from pipelines.stages.job import Job, Origin

WANTING_POINTS = CurveStop.MAXIMUM_POINTS.name.lower()
BOTH_WAYS = (1, -1)


@dataclass(frozen=True)
class Start:
    """A bifurcation at which a curve may start.

    ``turns``: number of excitation periods in the cycles; ``bounds``: whether the curve bounds stable cycles
    there, since all multipliers but the critical ones lie inside the unit circle; ``continues``: whether it
    goes on where a Neimark-Sacker curve ends at R1 or R2.
    """

    origin: Origin
    problem: CurveProblem
    guess: CurveStart
    turns: int
    bounds: bool
    continues: bool = False


@dataclass(frozen=True)
class PendingCurve:
    """A start whose curve is to be traced: the groups that it already has, and all curves of its kind.

    ``boundary``: whether it is traced only where it bounds stable cycles.
    """

    start: Start
    groups: tuple[str, ...]
    known: Mapping[str, Group]
    boundary: bool

    @property
    def traced_before(self) -> list[str]:
        """The names of the complete curves of the same kind and period that come before this one."""
        return [
            name
            for name, curve in self.known.items()
            if not (self.groups and name >= self.groups[0])
            and curve.attributes["status"] == ENDED
            and curve.n_points > 1
            and curve.attributes["turns"] == self.start.turns
        ]


@dataclass
class StartQueue:
    """The starts of a case's curves in the order of kinds and groups, read from the store at every call.

    ``boundaries``: only starts that bound stable cycles.  ``continued``: further kinds, of which curves are
    followed only where they continue the boundary of stable cycles at the end of a Neimark-Sacker curve.
    ``without``: branches whose bifurcations are not
    taken into account yet.  ``settled``: starts that need no curve, whatever
    curves follow.  Of these, ``outside`` lie outside the plane, ``refused`` exceed the largest number of
    curves, and the others lie on a curve.
    """

    job: Job
    kinds: Sequence[EventKind]
    boundaries: bool = False
    continued: Sequence[EventKind] = ()
    without: frozenset[str] = frozenset()
    settled: set[tuple[EventKind, Origin]] = field(default_factory=set)
    outside: int = 0
    refused: int = 0

    def pending(self) -> Iterator[PendingCurve]:
        """An unfinished curve if there is one; then the starts that are on no curve yet, in their order."""
        candidates: list[PendingCurve] = []
        for kind in (*self.kinds, *self.continued):
            known = curves_of(self.job, kind)
            origins = {name: Origin.of(curve.attributes) for name, curve in known.items()}
            for start in starts_of(self.job, kind, self.without):
                if kind in self.continued and not (start.continues and start.bounds):
                    continue
                mine = tuple(name for name in known if origins[name] == start.origin)
                pending = PendingCurve(start, mine, known, kind in self.continued)
                if mine and not _is_finished(self.job, pending):
                    yield pending
                elif not mine and (start.bounds or not self.boundaries):
                    candidates.append(pending)
        for each in candidates:
            settled = (each.start.problem.kind, each.start.origin) in self.settled
            if not settled and self._needs_curve(each.start, each.known):
                yield each

    def next(self) -> PendingCurve | None:
        """The first of `pending`; None if nothing is left."""
        return next(self.pending(), None)

    def _needs_curve(self, start: Start, known: Mapping[str, Group]) -> bool:
        # a double Neimark-Sacker point lies on the curve that it was found on, and starts another one
        others = (curve for name, curve in known.items() if name != start.origin.group)
        if not _is_inside(self.job, start):
            self.outside += 1
        elif not any(lies_on(self.job, start, curve) for curve in others):
            if len(known) < self.job.case.track_curves.max_curves:
                return True
            self.refused += 1
        self.settled.add((start.problem.kind, start.origin))
        return False


def _is_finished(job: Job, pending: PendingCurve) -> bool:
    """Whether the curve of a start has ended for good in both directions."""
    halves = [pending.known[name] for name in pending.groups]
    ended = all(has_ended_for_good(job, half, pending.boundary) for half in halves)
    return ended and (len(halves) == len(BOTH_WAYS) or is_whole(pending.start, halves[0]))


def has_ended_for_good(job: Job, curve: Group | BranchWriter, boundary: bool) -> bool:
    """Whether a curve has ended, not at the largest number of points, nor because it leaves a boundary.

    Where only the ``boundary`` is wanted, it has ended also there.
    """
    left = curve.attributes["stop_reason"] == CurveStop.LEAVES_BOUNDARY.name.lower()
    if left and not boundary:
        return False
    most = job.case.track_curves.max_points
    return has_ended(curve.attributes, curve.n_points, WANTING_POINTS, most)


def is_whole(start: Start, curve: Group) -> bool:
    """Whether nothing is left to trace in the other direction; ``curve`` must have the array ``angle``.

    So it is if the curve is closed, could not be started, or is a Neimark-Sacker curve that starts at a
    resonance, where it ends.
    """
    closed = curve.attributes["stop_reason"] == CurveStop.CLOSED.name.lower()
    if closed or curve.n_points == 0:
        return True
    return resonant_end(start.problem.kind, float(np.cos(curve["angle"][0]))) is not None


def starts_of(job: Job, kind: EventKind, without: Collection[str] = ()) -> Iterator[Start]:
    """All starts of curves of a kind, in the order in which they are taken.

    First every bifurcation of the kind located on a branch, then every codimension-two point at which a
    curve of the kind meets a stored one.  ``without``: branches that are left out.
    """
    flag = KINDS["cycles"].array("event_kind").flag(kind.name.lower())
    for group in job.groups("cycles"):
        if group in without:
            continue
        branch = job.read(group, EVENT_NAMES)
        if branch.attributes["status"] != ENDED:  # bifurcations found later would change the order
            continue
        for index in range(branch.n_events):
            if branch["event_kind"][index] == flag and np.isfinite(branch["event_residual"][index]):
                yield _start_at_event(job, branch, Origin(group, index))
    for other, container in CONTAINERS.items():
        for group in job.groups(container):
            yield from _starts_on_curve(job, kind, other, group)


def start_at(job: Job, kind: EventKind, origin: Origin) -> Start:
    """The start of a curve of a kind at its origin. Raises LookupError if none starts there."""
    if origin.group.startswith("cycles/"):
        return _start_at_event(job, job.read(origin.group, EVENT_NAMES), origin)
    other = next(each for each, container in CONTAINERS.items() if origin.group.startswith(f"{container}/"))
    for start in _starts_on_curve(job, kind, other, origin.group):
        if start.origin == origin:
            return start
    raise LookupError(f"no curve starts at event {origin.event} of {origin.group}")


def known_curves(job: Job, names: Sequence[str]) -> dict[str, KnownCurve]:
    """Stored curves by name, as `continue_curve` takes them."""
    free = job.case.track_curves.parameters
    return {name: traced(job.read(name, (*TRACED, *free)), free) for name in names}


def _start_at_event(job: Job, branch: Group, origin: Origin) -> Start:
    table, turns = job.case.track_curves, int(branch.attributes.get("turns", 1))
    event = stored_event(branch, origin.event)
    cycles = with_multiplied_period(cycle_problem(job.machine, job.case), turns)
    problem, guess = curve_from_event(cycles, event, table.parameters, CurveFormulation(table.formulation))
    unstable = unstable_others(
        event.kind, event.multipliers, float(np.cos(event.angle)), cycles.period_map.autonomous
    )
    return Start(origin, problem, replace(guess, unstable=unstable), turns, unstable == 0)


def _starts_on_curve(job: Job, kind: EventKind, other: EventKind, group: str) -> Iterator[Start]:
    """Starts of curves of ``kind`` at the codimension-two points of a curve of kind ``other``."""
    attributes = job.read(group, ()).attributes
    if attributes["status"] != ENDED:
        return
    curve = job.read(group, SPECIAL_NAMES)
    turns = int(curve.attributes["turns"])
    for index in range(curve.n_events):
        if not np.isfinite(curve["event_residual"][index]):
            continue
        special = stored_special(curve, index)
        problem = curve_problem(job, other, turns, special.parameters)
        second = second_bifurcation(other, special, problem.period_map.autonomous)
        if second is not None and second.kind is kind:
            joined, guess = curve_of_second(problem, special, second)
            bounds = unstable_count(second.others, False) == 0
            ends = other is EventKind.NEIMARK_SACKER and special.kind in (SpecialKind.R1, SpecialKind.R2)
            yield Start(Origin(group, index), joined, guess, turns, bounds, ends and kind is not other)


def curve_problem(job: Job, kind: EventKind, turns: int, parameters: np.ndarray) -> CurveProblem:
    """The problem of curves of a kind in the plane of the case, in the bordered formulation.

    The parameters that are not free keep their values in ``parameters``.
    """
    case = job.case
    cycles = with_multiplied_period(cycle_problem(job.machine, case), turns)
    return CurveProblem(cycles.period_map, kind, parameters, case.track_curves.parameters, cycles.options)


def curves_of(job: Job, kind: EventKind) -> dict[str, Group]:
    """All curves of a kind, with the arrays that ``lies_on`` and ``traced`` need."""
    names = (*TRACED, *job.case.track_curves.parameters)
    return {group: job.read(group, names) for group in job.groups(CONTAINERS[kind])}


def _is_inside(job: Job, start: Start) -> bool:
    ranges = job.case.track_curves.ranges
    return all(
        low <= value <= high for value, (low, high) in zip(start.guess.parameters, ranges, strict=True)
    )


def lies_on(job: Job, start: Start, curve: Group) -> bool:
    """Whether a start is on a stored curve of the same kind and period.

    A cycle over several excitation periods may be stored from the beginning of any of them: all are tried.
    """
    if curve.attributes["turns"] != start.turns or curve.n_points < 2:
        return False
    line = traced(curve, start.problem.names)
    return any(line.holds(guess, parameter_scales(job)) for guess in _samplings(start))


def _samplings(start: Start) -> Iterator[CurveStart]:
    """The start, with its state taken at the beginning of each excitation period of the cycle."""
    yield start.guess
    if start.turns == 1:
        return
    period_map = start.problem.period_map
    parameters = start.problem.parameters.copy()
    parameters[list(start.problem.indices)] = start.guess.parameters
    period = start.guess.period
    steps = period_map.minimum_steps if period_map.steps_per_period is None else period_map.steps_per_period
    steps = period_map.rounded_steps(4 * steps)
    orbit = period_map.evaluate(start.guess.state, parameters, period, steps).orbit
    for turn in range(1, start.turns):
        yield replace(start.guess, state=orbit[turn * len(orbit) // start.turns])


def parameter_scales(job: Job) -> tuple[float, float]:
    """Changes of the two free parameters that count as one."""
    first, second = job.case.track_curves.parameters
    return parameter_scale(job.case, first), parameter_scale(job.case, second)
