"""Special points that a curve passes twice within one step, so that the tests have equal signs at its ends.

cos theta is known with its slope at both ends of a step, and a cubic shows where it may leave [-1, 1]. There
a Neimark-Sacker curve ends unless the error of the multipliers hides the passage (``tongues``), so that
shallow ones must be found too.  Of the other tests the parabola through their last three values tells where
they may dip through zero.
"""

from __future__ import annotations

import numpy as np

from pipelines.bifurcations.continuation import hermite_weights
from pipelines.bifurcations.curve import SpecialKind
from pipelines.bifurcations.curves.segment import Bracket, CurveSegment, NotConvergedError, SegmentPoints
from pipelines.bifurcations.cycles.double_crossings import lowest_beyond, lowest_inside
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.roots import Node, zero

_DIP = 0.5  # share of the nearer end below which a minimum of 1 -+ cos_theta inside a segment is looked at
_ARRIVED = 1e-9  # distance of cos_theta from 1 or -1 at which a segment ends just on the second passage
_LOWEST = 1e-4  # of the segment: beside its minimum cos theta changes by the square of that
_LOOKS = 3  # places at which a dip is looked for, each the lowest one of a better parabola


def dip_through(
    points: SegmentPoints,
    special: SpecialKind,
    values: tuple[float, float, float],
    before: float,
    options: NormalFormOptions | None,
) -> tuple[Bracket, ...]:
    """The two brackets of the zeros of a test that has equal signs at both ends of a segment.

    Empty where the test does not reach zero, or a point fails.  ``values`` at ``before`` the start of the
    segment, at its start and at its end.
    """
    if not np.all(np.isfinite(values)):
        return ()
    (_, start, end), side = values, values[2] or values[1]
    lowest = lowest_inside(np.array(values), before, points.segment.length)
    try:
        for _ in range(_LOOKS):
            if lowest is None:
                return ()
            value = points.test(special, lowest, options)
            if value * side < 0.0:
                into = Bracket(special, (0.0, lowest), (start, value))
                out = Bracket(special, (lowest, 1.0), (value, end))
                return (out,) if start == 0.0 else (into, out)
            lowest = lowest_beyond((0.0, lowest, 1.0), (start, value, end), side)
    except NotConvergedError:
        pass
    return ()


def dip_beyond(
    points: SegmentPoints, special: SpecialKind, start: tuple[float, float]
) -> tuple[float, float] | None:
    """Where cos theta is farthest beyond 1 (R1) or -1 (R2) inside a Neimark-Sacker segment, at neither end.

    ``start``: cos theta and its slope at the start.  The cubic through both ends shows whether cos theta may
    leave [-1, 1]; then the zero of the slope is found.  Returns its fraction and abs(cos theta) - 1 there,
    which is negative where cos theta turns back before; None when the cubic stays far inside or a point
    fails.
    """
    segment, sign = points.segment, 1.0 if special is SpecialKind.R1 else -1.0
    before = 1.0 - sign * start[0]
    if not _may_dip(segment, sign, before, start[1]):
        return None
    ends = Node(0.0, start[1]), Node(1.0, segment.end.cos_theta_slope)

    def slope(fraction: float) -> float:
        value = points.end(fraction, None, False).cos_theta_slope
        if not np.isfinite(value):
            raise NotConvergedError
        return value

    try:
        lowest = zero(slope, *ends, _LOWEST)
        beyond = sign * points.critical(lowest).cos_theta - 1.0
    except NotConvergedError:
        return None
    return lowest, beyond


def _may_dip(segment: CurveSegment, sign: float, before: float, start_slope: float) -> bool:
    """Whether the cubic of 1 -+ cos theta through both ends comes near enough to zero between them."""
    end = segment.end
    after = 1.0 - sign * end.point.cos_theta
    if abs(after) < _ARRIVED:
        after = 0.0
    falling, rising = -sign * start_slope, -sign * end.cos_theta_slope
    if not (before > 0.0 and after >= 0.0 and falling < 0.0 < rising):
        return False
    weights = [hermite_weights(fraction, segment.length) for fraction in np.linspace(0.0, 1.0, 101)]
    lowest = np.min(np.array(weights) @ [before, falling, after, rising])
    return bool(lowest <= _DIP * min(before, after))
