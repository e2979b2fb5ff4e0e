"""Branches of cycles along lines of a plane, and the curves through the bifurcations that these meet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchStop, ContinuationOptions
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
from pipelines.datasets.curves import BifurcationCurve, read_curve
from pipelines.orbits.forced_cycle import ForcedCycle
from pipelines.stages.certificate.asked import Asked
from pipelines.stages.certificate.comparison import critical_rows
from pipelines.stages.curves.rows import CONTAINERS
from pipelines.stages.plane.problem import PlaneOptions, PlaneProblem, cycle_at

_FIRST = 0.02  # first arclength step of branches and curves, at most

Start = tuple[CurveProblem, CurveStart]


@dataclass(frozen=True)
class PlaneCurve:
    """One direction of a curve from its start.

    ``points`` (n >= 1) with their ``states``; ``special``: points of codimension two, each with the index of
    the point before it; ``stop``: why the curve ended.
    """

    name: str
    problem: CurveProblem
    points: tuple[CurvePoint, ...]
    states: tuple[CurveState, ...]
    special: tuple[tuple[int, SpecialPoint], ...]
    stop: CurveStop

    @property
    def kind(self) -> EventKind:
        return self.problem.kind

    @property
    def parameters(self) -> np.ndarray:
        """Both parameters of the points (n, 2)."""
        return np.array([point.parameters for point in self.points])

    @cached_property
    def known(self) -> KnownCurve:
        """The curve as others recognise it."""
        return replace(KnownCurve.of(self.states), unstable=self._unstable.astype(float))

    @cached_property
    def interpolated(self) -> BifurcationCurve | None:
        """The curve between its points, as far as cycles bifurcate on it; None below two points."""
        most = max(len(point.cycle.spectrum.multipliers) for point in self.points)
        multipliers = np.full((len(self.points), most), complex(np.nan, np.nan))
        for row, point in zip(multipliers, self.points, strict=True):
            row[: len(point.cycle.spectrum.multipliers)] = point.cycle.spectrum.multipliers
        kept = critical_rows(multipliers, self.known.angles)
        arrays = {
            "arclength": self.known.arclength,
            "parameter_tangent": self.known.tangents,
            "angle": self.known.angles,
            "unstable_count": self._unstable,
            **dict(zip(self.problem.names, self.parameters.T, strict=True)),
        }
        places = np.array([special.parameters for _, special in self.special])
        events = {"event_after_point": np.array([after for after, _ in self.special], dtype=np.intp)}
        for name, index in zip(self.problem.names, self.problem.indices, strict=True):
            events[f"event_{name}"] = places[:, index] if len(places) else np.zeros(0)
        attributes = {
            "bifurcation": self.kind.name.lower(),
            "parameters": list(self.problem.names),
            "stop_reason": self.stop.name.lower(),
        }
        return read_curve(self.name, {key: a[:kept] for key, a in arrays.items()} | events, attributes)

    @property
    def _unstable(self) -> np.ndarray:
        """Other multipliers outside the unit circle at each point (n,)."""
        return np.array(
            [
                unstable_others(point.kind, point.cycle.spectrum.multipliers, point.cos_theta, False)
                for point in self.points
            ]
        )


def trace_line(plane: PlaneProblem, options: PlaneOptions, line: Asked) -> list[Event]:
    """The bifurcations on the branch along a line, from its upper end and, if it does not arrive, the lower.

    No branch starts at an end at which no cycle is found.
    """
    which = plane.names.index(line.parameter)
    low, high = plane.ranges[which]
    events: list[Event] = []
    for end, direction in ((high, -1), (low, 1)):
        place = (end, line.fixed) if which == 0 else (line.fixed, end)
        found = cycle_at(plane, options, place)
        if not isinstance(found, ForcedCycle):
            continue
        problem = replace(plane.at(place), parameter=line.parameter)
        points: list[BranchPoint] = []

        def record(point: BranchPoint, state: object, met: tuple[Event, ...]) -> None:
            points.append(point)  # noqa: B023
            events.extend(met)

        stepping = ContinuationOptions(
            (low, high),
            direction,
            step=min(_FIRST, options.line_step),
            maximum_step=options.line_step,
            max_points=options.max_points,
            parameter_scale=plane.scales[which],
        )
        result = continue_branch(
            problem, BranchStart(found.cycle.unknowns.state, end), stepping, record
        )
        arrived = low if direction < 0 else high
        if result.stop is BranchStop.RANGE and points[-1].cycle.unknowns.parameter == arrived:
            break
    return events


def trace_curves(
    plane: PlaneProblem, options: PlaneOptions, events: Sequence[Event], known: Sequence[PlaneCurve]
) -> list[PlaneCurve]:
    """The curves through bifurcations, and all curves that meet these in special points, beside ``known``."""
    curves = list(known)
    waiting = [
        curve_from_event(plane.at((0.0, 0.0)), event, plane.names)
        for event in events
        if event.kind in plane.kinds
    ]
    while waiting:
        start = waiting.pop(0)
        if not _is_wanted(plane, start, curves):
            continue
        for curve in _both_ways(plane, options, start, curves):
            curves.append(curve)
            waiting += _joined(curve)
    return curves[len(known) :]


def _is_wanted(plane: PlaneProblem, start: Start, curves: Sequence[PlaneCurve]) -> bool:
    """Whether a start of a kind that is followed lies in the plane, and on none of its curves."""
    problem, guess = start
    return (
        problem.kind in plane.kinds
        and plane.holds(guess.parameters)
        and not any(
            curve.known.holds(guess, plane.scales) for curve in curves if curve.kind is problem.kind
        )
    )


def _joined(curve: PlaneCurve) -> Iterator[Start]:
    """The starts of other curves at the special points of a curve."""
    for _, special in curve.special:
        start = joined_curve(curve.problem, special)
        if start is not None:
            yield start


def _both_ways(
    plane: PlaneProblem, options: PlaneOptions, start: Start, curves: Sequence[PlaneCurve]
) -> Iterator[PlaneCurve]:
    """A curve in both directions from its start, in one if that is all of it."""
    problem, guess = start
    traced = {curve.name: curve.known for curve in curves if curve.kind is problem.kind}
    numbers = Counter(curve.kind for curve in curves)
    for half, direction in enumerate((1, -1)):
        name = f"{CONTAINERS[problem.kind]}/c{numbers[problem.kind] + half:03d}"
        curve = _trace(plane, options, name, start, direction, traced)
        if curve is None:
            return
        yield curve
        begin = curve.points[0]
        if curve.stop is CurveStop.CLOSED or resonant_end(problem.kind, begin.cos_theta) is not None:
            return


def _trace(
    plane: PlaneProblem,
    options: PlaneOptions,
    name: str,
    start: Start,
    direction: int,
    traced: dict[str, KnownCurve],
) -> PlaneCurve | None:
    """A curve in one direction; None if its first point was not found."""
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
    if not points:
        return None
    return PlaneCurve(name, problem, tuple(points), tuple(states), tuple(special), result.stop)
