"""Where straight paths through the plane meet bifurcation curves, and the unstable multipliers behind them.

With u multipliers outside the unit circle beside the m critical ones of a curve (m = 1 for period doublings
and folds, 2 for Neimark-Sacker points), a cycle that passes the curve goes from u unstable multipliers to
u + m, or back:

    n -> u + m  where n = u,        n -> u  where n = u + m,

and no cycle with another number meets the curve. So the stored u also tells the direction of a crossing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipelines.case.arrays import Array
from pipelines.datasets.curves import BifurcationCurve

UNKNOWN = -1  # unstable multipliers
Counts = frozenset[int]
_JOINED = 1e-8  # distance of ends that are one, relative to the extent or the length of a curve


@dataclass(frozen=True)
class Leg:
    """A straight path along parameter ``1 - axis`` from ``start`` to ``stop``; ``axis`` is fixed."""

    axis: int
    value: float
    start: float
    stop: float


@dataclass(frozen=True)
class Crossing:
    """Where a path meets a curve: ``position`` on its leg, ``arclength`` on the curve."""

    curve: BifurcationCurve
    arclength: float
    position: float

    @property
    def is_fold(self) -> bool:
        return self.curve.bifurcation == "fold"

    @property
    def is_end(self) -> bool:
        """Whether the curve begins or ends here."""
        ends = self.curve.arclength[[0, -1]]
        return bool(np.min(np.abs(ends - self.arclength)) <= _JOINED * (ends[1] - ends[0]))

    @property
    def place(self) -> Array:
        """Both parameters."""
        return self.curve.at(self.arclength)


@dataclass(frozen=True)
class PlaneCurves:
    """The curves of a plane, for many paths; axes count as the ``parameters`` of the curves do."""

    curves: Sequence[BifurcationCurve]
    _known: dict[tuple[int, float], list[Crossing]] = field(default_factory=dict, repr=False, compare=False)

    def crossings(self, leg: Leg) -> list[Crossing]:
        """Crossings on a leg in the order in which it meets them."""
        low, high = sorted((leg.start, leg.stop))
        inside = [each for each in self._on_line(leg.axis, leg.value) if low < each.position <= high]
        return inside if leg.start <= leg.stop else inside[::-1]

    def path(self, legs: Iterable[Leg]) -> list[Crossing]:
        """Crossings on several legs, one after the other."""
        return [crossing for leg in legs for crossing in self.crossings(leg)]

    def _on_line(self, axis: int, value: float) -> list[Crossing]:
        """All crossings of a line through the whole plane, by increasing position."""
        if (axis, value) not in self._known:
            found = [
                Crossing(curve, float(arclength), float(curve.at(arclength)[1 - axis]))
                for curve in self.curves
                for arclength in curve.where(axis, value)
            ]
            found.sort(key=lambda crossing: crossing.position)
            self._known[axis, value] = _ends_joined(found)
        return self._known[axis, value]


def _ends_joined(crossings: Sequence[Crossing]) -> list[Crossing]:
    """Crossings by increasing position, without the second of two at which curves of a kind join end to end.

    So do both directions of a curve, which begin on the line that met it, and the ends of a closed one.
    """
    kept: list[Crossing] = []
    for crossing in crossings:
        if not any(_join(each, crossing) for each in kept):
            kept.append(crossing)
    return kept


def _join(first: Crossing, second: Crossing) -> bool:
    """Whether two curves of a kind have an end at the same place."""
    if first.curve.bifurcation != second.curve.bifurcation or not (first.is_end and second.is_end):
        return False
    size = np.ptp(first.curve.extent, axis=0) + np.abs(first.place)
    return bool(np.all(np.abs(first.place - second.place) <= _JOINED * size))


Rule = Callable[[int, Crossing], Counts]
"""The numbers that a number of unstable multipliers may become behind a crossing."""


def passed(count: int, crossing: Crossing) -> Counts:
    """Unstable multipliers behind a crossing of the cycle that has ``count`` of them before it."""
    critical, behind = crossing.curve.critical_multipliers, set[int]()
    for others in crossing.curve.possibly_unstable_at(crossing.arclength):
        if others == UNKNOWN:
            behind |= {count + critical, count - critical}
        elif count == others:
            behind.add(others + critical)
        elif count == others + critical:
            behind.add(others)
    return frozenset(number for number in behind if number >= 0)


def stability_passed(count: int, crossing: Crossing) -> Counts:
    """The same where 1 stands for any number of unstable multipliers, for curves of stable cycles alone."""
    others = crossing.curve.possibly_unstable_at(crossing.arclength)
    behind = {1 - count} if min(others) <= 0 else set[int]()
    stays = max(others) > 0 or UNKNOWN in others
    return frozenset(behind | ({count} if stays else set()))


def carried(count: int, crossings: Iterable[Crossing], rule: Rule = passed) -> Counts:
    """What a number of unstable multipliers may be at the end of a path; empty if no cycle can pass it."""
    counts = frozenset({count})
    for crossing in crossings:
        counts = frozenset().union(*(rule(each, crossing) for each in counts))
    return counts
