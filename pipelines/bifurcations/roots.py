"""Zeros of functions of one variable whose every value costs several passes over the period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from scipy.interpolate import KroghInterpolator
from scipy.optimize import brentq

_NODES = 4  # of the interpolating polynomial, with their slopes
_SLOW = 0.25  # reduction of the value by an interpolated zero that asks for a bisection
_SHARE = 0.1  # of the width, by which a value may be from zero: the chords are not the slope
_MOST = 100


class Node(NamedTuple):
    """A known value of a function, and its slope where that is known too."""

    place: float
    value: float
    slope: float | None = None


def zero(
    function: Callable[[float], float], low: Node, high: Node, width: float, enough: float = 0.0
) -> float:
    """A zero of a function with values of opposite signs at ``low`` and ``high``, one of which may be zero.

    The next place is the zero of the polynomial through the last values and known slopes, between two of
    opposite signs; the middle of these where that does not get on.  The search ends where the value is no
    larger than ``enough``, or far below ``width`` times the smaller slope to its two neighbours, which
    no kink deceives, and when the signs change within ``width``.  The returned place is ``low``, ``high`` or
    one at which the function was asked.
    """
    if low.value == 0.0 or high.value == 0.0:
        return low.place if low.value == 0.0 else high.place
    nodes, halve = [low, high], False
    for _ in range(_MOST):
        best = min(low, high, key=lambda node: abs(node.value))
        if high.place - low.place <= width or abs(best.value) <= _SHARE * width * _least_slope(nodes, best):
            return best.place
        place = 0.5 * (low.place + high.place) if halve else _interpolated(nodes, low, high)
        node = Node(place, function(place))
        if abs(node.value) <= enough:
            return place
        halve = not halve and abs(node.value) > _SLOW * abs(best.value)
        nodes.append(node)
        low, high = (node, high) if node.value * high.value < 0.0 else (low, node)
    return best.place


def _least_slope(nodes: Sequence[Node], at: Node) -> float:
    """The smaller slope, in modulus, of the chords from a node to its neighbours; zero at either end."""
    below = [node for node in nodes if node.place < at.place]
    above = [node for node in nodes if node.place > at.place]
    if not (below and above):
        return 0.0
    neighbours = max(below, key=lambda node: node.place), min(above, key=lambda node: node.place)
    return min(abs((node.value - at.value) / (node.place - at.place)) for node in neighbours)


def _interpolated(nodes: Sequence[Node], low: Node, high: Node) -> float:
    """The zero between ``low`` and ``high`` of the polynomial through them and the newest other nodes."""
    others = [node for node in reversed(nodes) if node not in (low, high)]
    polynomial = _through([low, high, *others[: _NODES - 2]])
    if polynomial(low.place) * polynomial(high.place) < 0.0:
        return float(brentq(polynomial, low.place, high.place, xtol=1e-15))
    return low.place - low.value * (high.place - low.place) / (high.value - low.value)


def _through(nodes: Sequence[Node]) -> KroghInterpolator:
    """The polynomial with the values and the known slopes of the nodes; a place that is repeated has both."""
    known = [
        (node.place, number) for node in nodes for number in (node.value, node.slope) if number is not None
    ]
    return KroghInterpolator(*zip(*known, strict=True))
