"""Two bifurcations within one step of a branch, so that a test function has equal signs at both ends.

The products over the slow multipliers

    prod (1 - mu_i),    prod (1 + mu_i),    prod_{i<j} (1 - mu_i mu_j)

are smooth along a branch, also where multipliers meet.  The parabola through their values at the last three
points tells where one of them may dip through zero; the cycle there decides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.cycles.segment import Segment
from pipelines.orbits.floquet import Complex, nontrivial
from pipelines.orbits.system import Vector

_NEAR = 0.5  # share of the nearer end below which the lowest point of the parabola is looked at
_ZERO = 1e-9  # share of the largest of three values below which one is zero but for rounding
_AHEAD = 1.5  # lengths of the step within which the line is followed: the product may bend towards zero
_SLIGHT = 0.05  # share of the step from an end within which a dip is hardly deeper than the end


def dips_inside(segment: Segment, previous_multipliers: Complex, previous_length: float) -> bool:
    """Whether a test function changes its sign twice on a segment whose ends have the same sign.

    ``previous_multipliers``: at the point before the start of the segment, ``previous_length`` away; without
    any (empty) the middle of the segment tells.
    """
    autonomous = segment.problem.period_map.autonomous
    first = len(previous_multipliers) == 0 or not previous_length > 0.0
    if first:
        middle = segment.correct_at(0.5).cycle
        if middle is None:
            return False
        previous_multipliers = middle.spectrum.multipliers
    for which, values in enumerate(_three_values(segment, previous_multipliers)):
        other, start, end = (float(value) for value in values)
        side = end or start
        if first:
            if start * side >= 0.0 > other * side:
                return True
            fraction = lowest_beyond((0.0, 0.5, 1.0), (start, other, end), side)
        else:
            fraction = lowest_inside(values, previous_length, segment.length)
        if fraction is None or start * side < 0.0:
            continue
        cycle = segment.correct_at(fraction).cycle
        if cycle is None:
            return True
        if _products(cycle.spectrum.multipliers, autonomous)[0][which] * side < 0.0:
            return True
    return False


def may_be_crossed(segment: Segment, previous_multipliers: Complex, previous_length: float) -> bool:
    """Whether another branch may cross inside a segment on which no multiplier crosses 1.

    A step may then have left along it: the line through the first product at the last two points reaches
    zero.
    """
    if len(previous_multipliers) == 0 or not previous_length > 0.0:
        return False
    last, start, end = _three_values(segment, previous_multipliers)[0]
    reached = start + _AHEAD * (start - last) * segment.length / previous_length
    return bool(start * end > 0.0 and start * reached <= 0.0)


def lowest_inside(values: Vector, before: float, length: float) -> float | None:
    """The fraction of a step where the parabola through three values comes nearest to zero.

    The values lie at -before, 0 and length.  None unless the minimum is inside the step and near zero.
    An end may be zero, but not on the other side.
    """
    last, start, end = (float(value) for value in values)
    side = math.copysign(1.0, end if end != 0.0 else start)
    if start * side < 0.0 or start == end == 0.0:
        return None
    slope, steeper = (end - start) / length, (start - last) / before
    bend = (slope - steeper) / (length + before)
    if bend * side <= 0.0:
        return None
    place = 0.5 * (length - slope / bend)
    lowest = start + (slope - bend * length) * place + bend * place**2
    inside = _SLIGHT * length < place < (1.0 - _SLIGHT) * length
    if not inside or lowest * side > _NEAR * min(abs(start), abs(end)):
        return None
    return place / length


def lowest_beyond(places: tuple[float, ...], values: tuple[float, ...], side: float) -> float | None:
    """Where the parabola through three values is farthest beyond zero; None where it does not cross zero."""
    bend, slope, level = np.polyfit(places, values, 2)
    if not bend * side > 0.0:
        return None
    place = float(-0.5 * slope / bend)
    beyond = (level + 0.5 * slope * place) * side < 0.0
    return place if beyond and 0.0 < place < 1.0 else None


def _three_values(segment: Segment, other_multipliers: Complex) -> list[Vector]:
    """Each product at another point and at both ends of a segment, on one scale."""
    autonomous = segment.problem.period_map.autonomous
    spectra = (other_multipliers, segment.start_multipliers, segment.end.spectrum.multipliers)
    tests = [_products(multipliers, autonomous) for multipliers in spectra]
    return [
        _on_one_scale([(signs[which], logs[which]) for signs, logs in tests])
        for which in range(len(tests[0][0]))
    ]


def _on_one_scale(pairs: list[tuple[float, float]]) -> Vector:
    largest = max(log for _, log in pairs)
    if not math.isfinite(largest):
        return np.zeros(len(pairs))
    values = np.array([sign * math.exp(log - largest) for sign, log in pairs])
    return np.where(np.abs(values) < _ZERO, 0.0, values)


def _products(multipliers: Complex, autonomous: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Signs and logarithms of the three products, which themselves may exceed the range of doubles."""
    mu = nontrivial(multipliers, autonomous)
    first, second = np.triu_indices(len(mu), k=1)
    factors = (1.0 - mu, 1.0 + mu, 1.0 - mu[first] * mu[second])
    moduli = [np.maximum(np.abs(product), np.finfo(float).tiny) for product in factors]
    signs = [np.sign(np.prod(product / size).real) for product, size in zip(factors, moduli, strict=True)]
    return np.array(signs), np.array([np.sum(np.log(size)) for size in moduli])
