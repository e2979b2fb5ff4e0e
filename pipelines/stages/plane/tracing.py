"""Branches of cycles along lines of a plane, and the curves through the bifurcations that these meet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveStart,
    CurveState,
    CurveStop,
    SpecialPoint,
    around_tongue,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.curves.codimension_two import resonant_end, unstable_others
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.plane import CurveProblem
from pipelines.bifurcations.switching import curve_from_event, joined_curve
from pipelines.datasets.curves import FINISHED, BifurcationCurve, read_curve
from pipelines.orbits.forced_cycle import ForcedCycle
from pipelines.orbits.system import Matrix
from pipelines.stages.certificate.asked import Asked
from pipelines.stages.certificate.comparison import critical_rows
from pipelines.stages.curves.rows import CONTAINERS
from pipelines.stages.plane.problem import PlaneOptions, PlaneProblem, cycle_at

_FIRST = 0.02  # first arclength step of branches and curves, at most
_ARRIVED = 1e-6  # of a range: distance of its end

Start = tuple[CurveProblem, CurveStart]


@dataclass(frozen=True)
class PlaneCurve:
    """One direction of a curve from its start.

    ``number`` among the curves of its kind; ``points`` with their ``states``, none if the start failed;
    ``special``: points of codimension two, each with the index of the point before it; ``stop``: why the
    curve ended.
    """

    number: int
    problem: CurveProblem
    points: tuple[CurvePoint, ...]
    states: tuple[CurveState, ...]
    special: tuple[tuple[int, SpecialPoint], ...]
    stop: CurveStop

    @property
    def kind(self) -> EventKind:
        """The bifurcation."""
        return self.problem.kind

    @property
    def name(self) -> str:
        """The name that the curve would have in a store."""
        return f"{CONTAINERS[self.kind]}/c{self.number:03d}"

    @property
    def parameters(self) -> Matrix:
        """Both parameters of the points (n, 2)."""
        return np.array([point.parameters for point in self.points]).reshape(-1, 2)

    @property
    def is_finished(self) -> bool:
        """Whether the curve was traced to an end beyond which none of it is wanted."""
        return self.stop.name.lower() in FINISHED

    @cached_property
    def known(self) -> KnownCurve:
        """The curve as others recognise it; there must be a point."""
        unstable = [
            unstable_others(point.kind, point.cycle.spectrum.multipliers, point.cos_theta, False)
            for point in self.points
        ]
        return replace(KnownCurve.of(self.states), unstable=np.array(unstable, dtype=float))

    @cached_property
    def interpolated(self) -> BifurcationCurve | None:
        """The curve between its points, as far as cycles bifurcate on it; None below two points."""
        if not self.points:
            return None
        known, names = self.known, self.problem.names
        kept = critical_rows([point.cycle.spectrum.multipliers for point in self.points], known.angles)
        rows = {
            "arclength": known.arclength,
            "parameter_tangent": known.tangents,
            "angle": known.angles,
            "unstable_count": known.unstable,
            **dict(zip(names, known.parameters.T, strict=True)),
        }
        places = np.array([each.parameters[list(self.problem.indices)] for _, each in self.special])
        events = {
            "event_after_point": np.array([after for after, _ in self.special]),
            **{f"event_{name}": place for name, place in zip(names, places.reshape(-1, 2).T, strict=True)},
        }
        attributes = {
            "bifurcation": self.kind.name.lower(),
            "parameters": names,
            "stop_reason": self.stop.name.lower(),
        }
        return read_curve(self.name, {name: row[:kept] for name, row in rows.items()} | events, attributes)


def trace_line(plane: PlaneProblem, options: PlaneOptions, line: Asked) -> list[Event]:
    """The bifurcations on the branch along a line, from its upper end and, if it does not arrive, the lower.

    No branch starts at an end at which no cycle is found.
    """
    events: list[Event] = []
    for direction in (-1, 1):
        if _follow(plane, options, line, direction, events):
            break
    return events


def _follow(
    plane: PlaneProblem, options: PlaneOptions, line: Asked, direction: int, events: list[Event]
) -> bool:
    """Add the ``events`` on a line from one of its ends; returns whether the other one is reached."""
    which = plane.names.index(line.parameter)
    low, high = plane.ranges[which]
    begin, end = (low, high) if direction > 0 else (high, low)
    place = (begin, line.fixed) if which == 0 else (line.fixed, begin)
    found = cycle_at(plane, options, place)
    if not isinstance(found, ForcedCycle):
        return False
    stepping = ContinuationOptions(
        (low, high),
        direction,
        step=min(_FIRST, options.line_step),
        maximum_step=options.line_step,
        max_points=options.max_points,
        parameter_scale=plane.scales[which],
    )
    problem = replace(plane.at(place), parameter=line.parameter)
    start = BranchStart(found.cycle.unknowns.state, begin)
    result = continue_branch(problem, start, stepping, lambda point, state, met: events.extend(met))
    arrived = result.state is not None and abs(result.state.parameter - end) < _ARRIVED * (high - low)
    return result.stop is BranchStop.RANGE and arrived


def trace_curves(
    plane: PlaneProblem, options: PlaneOptions, events: Sequence[Event], known: Sequence[PlaneCurve]
) -> list[PlaneCurve]:
    """The curves through bifurcations, and all curves that meet these in special points, beside ``known``."""
    curves = list(known)
    waiting = [
        curve_from_event(plane.cycles, event, plane.names) for event in events if event.kind in plane.kinds
    ]
    while waiting:
        start = waiting.pop(0)
        if not _is_wanted(plane, start, curves):
            continue
        for curve in _both_ways(plane, options, start, curves):
            waiting += _joined(curve)
            curves.append(curve)
    return curves[len(known) :]


def _is_wanted(plane: PlaneProblem, start: Start, curves: Sequence[PlaneCurve]) -> bool:
    """Whether a start of a kind that is followed lies in the plane, and on none of its curves."""
    problem, guess = start
    if problem.kind not in plane.kinds or not plane.holds(guess.parameters):
        return False
    same = [curve for curve in curves if curve.kind is problem.kind and curve.points]
    return not any(curve.known.holds(guess, plane.scales) for curve in same)


def _joined(curve: PlaneCurve) -> Iterator[Start]:
    """The starts of other curves at the special points of a curve."""
    for _, special in curve.special:
        start = joined_curve(curve.problem, special)
        if start is not None:
            yield start


def _both_ways(
    plane: PlaneProblem, options: PlaneOptions, start: Start, curves: Sequence[PlaneCurve]
) -> list[PlaneCurve]:
    """A curve in both directions from its start, in one if that is all of it."""
    kind = start[0].kind
    same = [curve for curve in curves if curve.kind is kind]
    number = 1 + max((curve.number for curve in same), default=-1)
    traced = {curve.name: curve.known for curve in same if curve.points}
    halves: list[PlaneCurve] = []
    for half, direction in enumerate((1, -1)):
        curve = _trace(plane, options, number + half, start, direction, traced)
        halves.append(curve)
        if curve.stop in (CurveStop.CLOSED, CurveStop.START_FAILED):
            break
        if resonant_end(kind, curve.points[0].cos_theta) is not None:
            break
    return halves


def _trace(
    plane: PlaneProblem,
    options: PlaneOptions,
    number: int,
    start: Start,
    direction: int,
    traced: Mapping[str, KnownCurve],
) -> PlaneCurve:
    """A curve in one direction, up to the ``traced`` ones of its kind."""
    problem, guess = start
    points: list[CurvePoint] = []
    states: list[CurveState] = []
    special: list[tuple[int, SpecialPoint]] = []

    def record(point: CurvePoint, state: CurveState, found: tuple[SpecialPoint, ...]) -> None:
        special.extend((len(points) - 1, each) for each in found)
        points.append(point)
        states.append(state)

    stepping = CurveOptions(
        plane.ranges,
        direction,
        step=min(_FIRST, options.curve_step),
        maximum_step=options.curve_step,
        max_points=options.max_points,
        parameter_scales=plane.scales,
        normal_form=None,
    )
    if problem.kind is not EventKind.NEIMARK_SACKER:
        stepping = around_tongue(stepping, guess.width)
    result = continue_curve(problem, guess, stepping, record, traced=traced)
    return PlaneCurve(number, problem, tuple(points), tuple(states), tuple(special), result.stop)
