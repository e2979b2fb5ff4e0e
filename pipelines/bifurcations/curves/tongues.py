"""Tongues: where a Neimark-Sacker curve meets a strong resonance, its multipliers are real for a while.

The invariant plane of the critical pair stays smooth there, and with it det A = 1 and, along the curve,

    f = 1 - cos theta (R1) or 1 + cos theta (R2) = c (x - x_1)(x - x_2),      f >= -D = -c (x_2 - x_1)^2/4

Between x_1 and x_2, the near and the far side of the tongue, the pair is real, and fold or period-doubling
curves run around it.  In its middle the two multipliers are 2 sqrt((1 + D)^2 - 1), nearly 2 sqrt(2 D), apart.
A tongue is resolved if that is well above the error e of the multipliers.  Else its width is at most w,

    2 sqrt(2 D) = r e,      w = 2 sqrt(D/c)      with r = 4
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipelines.bifurcations.curve import SpecialKind, SpecialPoint, TongueSide
from pipelines.bifurcations.curves.codimension_two import resonance_tests
from pipelines.bifurcations.curves.double_passages import dip_beyond
from pipelines.bifurcations.curves.segment import (
    Bracket,
    NotConvergedError,
    SegmentPoints,
    locate_special,
    special_point,
)
from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.system import Vector

_RESOLVED = 4.0  # errors of the multipliers by which they must differ inside a tongue
_REACH = 2.0  # steps behind the near side within which the far side is looked for
_BEHIND = 0.25  # of the width of a tongue, beyond its far side: there it has ended for certain
_LOOKS = 4
_OUTSIDE = 4.0  # depths: f at the largest width from the middle of an unresolved tongue
_LOWEST = 1e-4  # of the segment: the precision of the middle
_ARRIVED = 1e-9  # f at the end of a step that ends on the near side


def dips(points: SegmentPoints, start: tuple[float, float]) -> tuple[list[Bracket], list[SpecialPoint]]:
    """The tongues that a segment of a Neimark-Sacker curve crosses.

    ``start``: cos theta and its slope at the start.  Brackets of the near sides of resolved ones, and the
    middles of the unresolved ones, also where cos theta turns back before the resonance by less than its
    error.  The segment may end in one of these: see ``ends_inside``.
    """
    resolved: list[Bracket] = []
    unresolved: list[SpecialPoint] = []
    if points.segment.problem.kind is not EventKind.NEIMARK_SACKER:
        return resolved, unresolved
    hidden = hidden_depth(points)
    for special in (SpecialKind.R1, SpecialKind.R2):
        lowest = dip_beyond(points, special, start)
        if lowest is None:
            continue
        fraction, depth = lowest
        before = resonance_tests(start[0])[special]
        if depth > hidden:
            resolved.append(Bracket(special, (0.0, fraction), (before, -depth), touching=True))
        elif depth >= -hidden:
            unresolved.append(_unresolved(points, special, fraction, before))
    return resolved, unresolved


def ends_inside(points: SegmentPoints, unresolved: SpecialPoint) -> bool:
    """Whether a segment ends within the largest width of an unresolved tongue from its middle."""
    depth = hidden_depth(points)
    return points.test_at_end(unresolved.kind) < _OUTSIDE * depth


def hidden_depth(points: SegmentPoints) -> float:
    """The largest depth D of a tongue that the error of the multipliers hides."""
    options = points.segment.problem.options
    error = float(np.fmax(options.step_tolerance, points.segment.end.point.step_error))
    return max((_RESOLVED * error) ** 2 / 8.0, options.multiplier_tolerance)


def both_sides(
    points: SegmentPoints, bracket: Bracket, near: SpecialPoint, width: float
) -> tuple[SpecialPoint, ...] | None:
    """The two sides of the tongue behind the ``near`` one; None for a tongue that is not resolved.

    Without a far side within reach the near one alone, with a guess of the width.  ``bracket``: in which it
    was located; ``width``: of the final bracket of the far side, in arclength.
    """
    side = replace(near, tongue=TongueSide.NEAR)
    if _ends_on_near_side(bracket) and _depth_by_slope(bracket) <= hidden_depth(points):
        return None
    try:
        behind, guess = _far_bracket(points, bracket, near.fraction)
        side = replace(
            side, width=(guess - near.fraction) * _distance(points, points.segment.chord.parameters)
        )
        located = None if behind is None else locate_special(points, behind, width, None)
        if located is None or located[0] is None:
            return (side,)
        far = located[0]
        depth = -points.test(near.kind, 0.5 * (near.fraction + far.fraction), None)
    except NotConvergedError:
        return (side,)
    if depth <= hidden_depth(points):
        return None
    indices = list(points.segment.problem.indices)
    apart = _distance(points, far.parameters[indices] - near.parameters[indices])
    return replace(side, width=apart), replace(far, tongue=TongueSide.FAR, width=apart)


def _far_bracket(points: SegmentPoints, bracket: Bracket, near: float) -> tuple[Bracket | None, float]:
    """Two fractions between which the tongue ends, None if that is not within reach, and a guess where.

    ``near``: where it begins.  A step that ends inside is prolonged: the parabola through the last three
    values tells how far.  The guess is NaN where it opens downwards.
    """
    special = bracket.special
    inside, value = bracket.fractions[1], bracket.tests[1]
    if bracket.touching:
        return Bracket(special, (inside, 1.0), (value, points.test_at_end(special))), 2.0 * inside - near
    if _ends_on_near_side(bracket):
        slope, bend = _slope_and_bend(bracket)
        end = near - slope / bend if slope < 0.0 < bend else np.nan
        if not end <= near + _REACH:
            return None, end
        inside = 0.5 * (near + end)
        value = points.test(special, inside, None)
    places, values = [bracket.fractions[0], near, inside], [bracket.tests[0], 0.0, value]
    end = np.nan
    for _ in range(_LOOKS):
        end = near + _second_zero(np.array(places) - near, values)
        if not inside < end <= near + _REACH:
            break
        probe = end + _BEHIND * (end - near)
        test = points.test(special, probe, None)
        if test > 0.0:
            return Bracket(special, (inside, probe), (value, test)), end
        places, values = [near, places[-1], probe], [0.0, values[-1], test]
        inside, value = probe, test
    return None, end


def _ends_on_near_side(bracket: Bracket) -> bool:
    """Whether the end of the segment is the near side of the tongue."""
    return not bracket.touching and abs(bracket.tests[1]) < _ARRIVED


def _slope_and_bend(bracket: Bracket) -> tuple[float, float]:
    """s and c of f = (x - 1)(s + c (x - 1)) for a tongue that begins at the end x = 1 of a segment.

    From the value at x = 0 and the slope at x = 1.
    """
    assert bracket.slopes is not None
    slope = bracket.slopes[1]
    return slope, bracket.tests[0] + slope


def _depth_by_slope(bracket: Bracket) -> float:
    """The depth D = s^2/4c of such a tongue."""
    slope, bend = _slope_and_bend(bracket)
    return slope**2 / (4.0 * bend) if bend > 0.0 else np.inf


def _second_zero(places: Vector, values: list[float]) -> float:
    """The larger zero of the parabola through three values; NaN unless it opens upwards."""
    bend, slope, level = np.polyfit(places, values, 2)
    inside = slope**2 - 4.0 * bend * level
    return float((-slope + np.sqrt(inside)) / (2.0 * bend)) if bend > 0.0 and inside >= 0.0 else np.nan


def _unresolved(points: SegmentPoints, special: SpecialKind, middle: float, before: float) -> SpecialPoint:
    """The middle of an unresolved tongue, with the largest width that it can have."""
    segment = points.segment
    end = points.end(middle, None, True)
    test = points.test(special, middle, None)
    # f - f_min = c (x - x_m)^2, where the side on which it rises less gives the larger width
    sides = (before, middle), (points.test_at_end(special), 1.0 - middle)
    bend = min((value - test) / max(apart, _LOWEST) ** 2 for value, apart in sides)
    share = 2.0 * float(np.sqrt(hidden_depth(points) / bend)) if bend > 0.0 else 1.0
    width = share * _distance(points, segment.chord.parameters)
    found = replace(special_point(segment, special, end, middle), residual=test)
    return replace(found, tongue=TongueSide.UNRESOLVED, width=width)


def _distance(points: SegmentPoints, parameters: Vector) -> float:
    """The length of a difference of the two parameters, scaled."""
    weights = points.segment.metric.parameters
    return float(np.sqrt(np.sum(weights * np.square(parameters))))
