"""Locate a bifurcation on a segment of a branch on which ``detection`` has found it.

It is the zero of a test function, sought on corrected cycles.  A point at which the branch was born is sought
on the cycles of the other branch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from itertools import pairwise

import numpy as np

from pipelines.bifurcations.cycles.branch_points import cycle_at_branch_point
from pipelines.bifurcations.cycles.crossing_cycles import own_doubling, own_pitchfork
from pipelines.bifurcations.cycles.segment import Segment
from pipelines.bifurcations.detection import (
    DetectionOptions,
    Event,
    EventKind,
    Resonance,
    critical_multiplier,
    evaluate_tests,
    strong_resonance,
)
from pipelines.bifurcations.roots import Node, zero
from pipelines.orbits.floquet import Complex, nontrivial
from pipelines.orbits.shooting import Cycle, Unknowns, tangent_at

_JUMP = 0.01  # share of its distance at the ends that a multiplier may be from critical where it is located
_DIFFERENCE_FRACTION = 0.05  # of the segment, for the derivative of the modulus


class LocationStop(Enum):
    """How the location of a bifurcation ended."""

    LOCATED = "located"
    NEUTRAL_SADDLE = "a real pair with product one: no bifurcation"
    NOT_CONVERGED = "a cycle inside the bracket did not converge: use smaller steps"
    JUMPS = "a multiplier jumps across the unit circle inside the step, from one branch to another"


def locate(segment: Segment, kind: EventKind, options: DetectionOptions) -> tuple[LocationStop, Event | None]:
    """Find the zero of the test function of ``kind`` on a segment whose ends have opposite signs.

    Every evaluation is a corrected cycle in the plane of its fraction, so the root is as sharp as the
    corrector.
    """
    turned = segment.start_tangent.parameter * segment.end_tangent.parameter < 0.0
    if kind is EventKind.OWN_PERIOD_DOUBLING or (kind is EventKind.BRANCH_POINT and turned):
        return _locate_birth(segment, kind)
    autonomous = segment.problem.period_map.autonomous
    cycles: dict[float, Cycle] = {}

    def cycle_at(fraction: float) -> Cycle:
        if fraction not in cycles:
            cycle = segment.correct_at(fraction).cycle
            if cycle is None:
                raise _NotConvergedError
            cycles[fraction] = cycle
        return cycles[fraction]

    try:
        fraction = _root(segment, kind, cycle_at, options.event_tolerance / segment.length)
        cycle = cycle_at(fraction)
    except _NotConvergedError:
        beside = _beside_branch_point(segment, cycles) if kind is EventKind.BRANCH_POINT else None
        if beside is None:
            return LocationStop.NOT_CONVERGED, None
        fraction, cycle = beside
    critical = critical_multiplier(kind, cycle.spectrum.multipliers, autonomous)
    if critical is None:
        return LocationStop.NEUTRAL_SADDLE, None
    if _distance(kind, critical) > _JUMP * _largest_distance(segment, kind):
        return LocationStop.JUMPS, None
    angle = abs(math.atan2(critical.imag, critical.real))
    resonance = Resonance.NONE
    if kind is EventKind.NEIMARK_SACKER:
        resonance = strong_resonance(angle, options.resonance_distance)
    return LocationStop.LOCATED, Event(
        kind=kind,
        parameters=cycle.parameters,
        state=cycle.unknowns.state,
        period=cycle.unknowns.period,
        multipliers=cycle.spectrum.multipliers,
        critical=critical,
        angle=angle,
        transversality=_transversality(segment, kind, fraction, critical),
        resonance=resonance,
        residual=_distance(kind, critical),
        fraction=fraction,
        steps=cycle.steps,
        direction=segment.direction(fraction),
    )


def _beside_branch_point(segment: Segment, cycles: dict[float, Cycle]) -> tuple[float, Cycle] | None:
    """The branch point of a segment, from cycles at some distance; ``cycles``: some known ones."""
    autonomous = segment.problem.period_map.autonomous

    def beyond_one(multipliers: Complex) -> float:
        critical = critical_multiplier(EventKind.BRANCH_POINT, multipliers, autonomous)
        assert critical is not None
        return critical.real - 1.0

    values = {0.0: beyond_one(segment.start_multipliers), 1.0: beyond_one(segment.end.spectrum.multipliers)}
    values |= {fraction: beyond_one(cycle.spectrum.multipliers) for fraction, cycle in cycles.items()}
    known = sorted(values.items())
    for low, high in pairwise(known):
        if low[1] * high[1] < 0.0:
            return cycle_at_branch_point(
                segment, lambda cycle: beyond_one(cycle.spectrum.multipliers), (low, high)
            )
    return None


def _locate_birth(segment: Segment, kind: EventKind) -> tuple[LocationStop, Event | None]:
    """The point at which a branch was born, located on the cycles of the other branch.

    The multipliers of a doubled cycle are the squares of those of the simple cycle.
    """
    doubled = kind is EventKind.OWN_PERIOD_DOUBLING
    find, multiple = (own_doubling, 2) if doubled else (own_pitchfork, 1)
    crossing = find(segment)
    if crossing is None:
        return LocationStop.NOT_CONVERGED, None
    multipliers = crossing.spectrum.multipliers**multiple
    critical = critical_multiplier(kind, multipliers, segment.problem.period_map.autonomous)
    assert critical is not None
    return LocationStop.LOCATED, Event(
        kind=kind,
        parameters=crossing.parameters,
        state=crossing.unknowns.state,
        period=multiple * crossing.unknowns.period,
        multipliers=multipliers,
        critical=critical,
        angle=0.0,
        transversality=math.nan,
        resonance=Resonance.NONE,
        residual=_distance(kind, critical),
        fraction=0.5,
        steps=multiple * crossing.steps,
        direction=segment.direction(0.5),
    )


def _largest_distance(segment: Segment, kind: EventKind) -> float:
    """The larger of the distances of the critical multiplier at both ends from its critical value."""
    autonomous = segment.problem.period_map.autonomous
    ends = (segment.start_multipliers, segment.end.spectrum.multipliers)
    critical = (critical_multiplier(kind, multipliers, autonomous) for multipliers in ends)
    return max((_distance(kind, value) for value in critical if value is not None), default=math.inf)


class _NotConvergedError(Exception):
    """A cycle inside the bracket did not converge."""


def _root(segment: Segment, kind: EventKind, cycle_at: Callable[[float], Cycle], width: float) -> float:
    """Zero of the test function in (0, 1); the known end values are not recomputed."""
    ends = (
        Node(0.0, _end_value(segment, kind, segment.start_multipliers, segment.start_tangent)),
        Node(1.0, _end_value(segment, kind, segment.end.spectrum.multipliers, segment.end_tangent)),
    )

    def psi(fraction: float) -> float:
        cycle = cycle_at(fraction)
        if kind is not EventKind.FOLD:
            return _test_value(kind, cycle.spectrum.multipliers, segment.problem.period_map.autonomous)
        tangent = tangent_at(segment.problem, cycle, segment.metric.row(segment.chord), segment.reference)
        if tangent is None:
            raise _NotConvergedError
        return tangent.parameter

    return zero(psi, *ends, max(width, 1e-14))


def _end_value(segment: Segment, kind: EventKind, multipliers: Complex, tangent: Unknowns) -> float:
    if kind is EventKind.FOLD:
        return tangent.parameter
    return _test_value(kind, multipliers, segment.problem.period_map.autonomous)


def _test_value(kind: EventKind, multipliers: Complex, autonomous: bool) -> float:
    values = evaluate_tests(multipliers, autonomous)
    if kind is EventKind.PERIOD_DOUBLING:
        return values.period_doubling
    return values.neimark_sacker if kind is EventKind.NEIMARK_SACKER else values.fold


def _distance(kind: EventKind, critical: complex) -> float:
    if kind is EventKind.PERIOD_DOUBLING:
        return abs(critical + 1.0)
    return abs(abs(critical) - 1.0) if kind is EventKind.NEIMARK_SACKER else abs(critical - 1.0)


def _transversality(segment: Segment, kind: EventKind, fraction: float, critical: complex) -> float:
    """Central difference of the modulus of the critical multiplier along the branch."""
    moduli, places = [], []
    for side in (-_DIFFERENCE_FRACTION, _DIFFERENCE_FRACTION):
        cycle = segment.correct_at(fraction + side).cycle
        if cycle is None:
            return math.nan
        mu = nontrivial(cycle.spectrum.multipliers, segment.problem.period_map.autonomous)
        moduli.append(float(np.abs(mu[np.argmin(np.abs(mu - critical))])))
        arclength = (fraction + side) * segment.length
        places.append(arclength if kind is EventKind.FOLD else cycle.unknowns.parameter)
    return (moduli[1] - moduli[0]) / (places[1] - places[0])
