"""The first bifurcation above the lowest speed, at any value of the other parameter of a plane.

Along a line of constant excitation frequency the stability of the base cycle changes only where a curve of
period doublings, Neimark-Sacker points or folds is crossed.  With u multipliers outside the circle beside
the m critical ones, such a crossing takes the cycle from u unstable multipliers to u + m or back.  So the
number known at one stored cycle can be carried along any path through the plane, and a crossing with u > 0
bounds no stable cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.datasets.curves import BifurcationCurve

NO_BIFURCATION = "none"
UNSET = "unset"
GRID = 201  # values of the other parameter at which the boundary is sought, beside those where it turns
SLIVER = 1e-6  # of the width: parts narrower than this are gaps between curves that end in one point
GAP = 1e-3  # of the width: narrower gaps between two lower parts are no range to operate in
RESOLUTION = 1e-9  # of the width of the plane, to which the places are found where one boundary takes over
SAMPLES_TRIED = 12  # stored cycles, nearest first, from which the stability elsewhere is carried


@dataclass(frozen=True)
class Crossing:
    """Where a line through the plane meets a curve: ``position`` on the line, ``arclength`` on the curve.

    ``strand`` numbers the parts of the curve between its turning points in the other parameter.
    """

    position: float
    curve: int
    strand: int
    arclength: float
    unstable: int


@dataclass(frozen=True)
class Boundary:
    """The end of the bifurcation-free speed range at one value of the other parameter.

    ``speed`` is that of the bifurcation; the highest of the plane where none is met, the lowest where the
    cycle is unstable there.  ``base``: "stable" or "unstable" at the lowest speed, "unset" where no stored
    cycle tells (then taken as stable).
    """

    abscissa: float
    speed: float
    base: str
    bifurcation: str = NO_BIFURCATION
    criticality: str = UNSET
    angle: float = float("nan")
    curve: int = -1
    strand: int = -1

    @property
    def is_open(self) -> bool:
        """Whether no bifurcation bounds the range inside the plane."""
        return self.bifurcation == NO_BIFURCATION and self.base != "unstable"

    @property
    def identity(self) -> tuple[str, int, int]:
        """Equal for neighbours on one part of the boundary."""
        return self.base, self.curve, self.strand


@dataclass(frozen=True)
class SpeedPlane:
    """Curves over another parameter (the abscissa) and the speed.

    ``axis``: index of the abscissa among the parameters of the curves; ``samples`` (n, 2) places of stored
    cycles (abscissa, speed) and ``unstable`` (n,) their multipliers outside the circle.
    """

    curves: Sequence[BifurcationCurve]
    axis: int
    abscissae: tuple[float, float]
    speeds: tuple[float, float]
    samples: Array
    unstable: NDArray[np.int64]

    def crossings(self, axis: int, value: float, start: float, stop: float) -> list[Crossing]:
        """Crossings of the line "parameter ``axis`` = value", in order from ``start`` to ``stop``."""
        low, high = min(start, stop), max(start, stop)
        found = []
        for number, curve in enumerate(self.curves):
            smallest, largest = curve.extent
            if largest[1 - axis] < low or smallest[1 - axis] > high:
                continue
            for arclength in curve.where(axis, value):
                position = float(curve.at(arclength)[1 - axis])
                if low < position <= high:
                    strand = int(np.searchsorted(curve.extrema[self.axis], arclength))
                    outside = curve.unstable_at(arclength)
                    found.append(Crossing(position, number, strand, float(arclength), outside))
        return sorted(found, key=lambda crossing: abs(crossing.position - start))

    def boundary(self, abscissa: float) -> Boundary:
        """The first bifurcation of the stable cycle above the lowest speed."""
        lowest, highest = self.speeds
        count = self.unstable_at_lowest(abscissa)
        if count:
            return Boundary(abscissa, lowest, "unstable")
        base = UNSET if count is None else "stable"
        from_speed = lowest - RESOLUTION * (highest - lowest)  # a curve that ends at the lowest speed counts
        for crossing in self.crossings(self.axis, abscissa, from_speed, highest):
            if crossing.unstable <= 0:  # -1: not known, so it may be one
                return self._bounded(abscissa, base, crossing)
        return Boundary(abscissa, highest, base)

    def _bounded(self, abscissa: float, base: str, crossing: Crossing) -> Boundary:
        curve = self.curves[crossing.curve]
        return Boundary(
            abscissa,
            crossing.position,
            base,
            curve.bifurcation,
            curve.criticality_at(crossing.arclength),
            curve.angle_at(crossing.arclength),
            crossing.curve,
            crossing.strand,
        )

    def unstable_at_lowest(self, abscissa: float) -> int | None:
        """Unstable multipliers of the base cycle at the lowest speed."""
        return self.unstable_at(abscissa, self.speeds[0])

    def unstable_at(self, abscissa: float, speed: float) -> int | None:
        """Unstable multipliers of the base cycle at a place, inferred from a stored cycle.

        The path leads along the cycle's speed to the abscissa, then up or down; None where no path is
        consistent with the curves.
        """
        if not len(self.samples):
            return None
        width, height = np.ptp(self.abscissae), np.ptp(self.speeds)
        distance = np.abs(self.samples - [abscissa, speed]) @ [1.0 / width, 1.0 / height]
        for row in np.argsort(distance, kind="stable")[:SAMPLES_TRIED]:
            (from_abscissa, from_speed), count = self.samples[row], int(self.unstable[row])
            across = self.crossings(1 - self.axis, from_speed, from_abscissa, abscissa)
            along = self.crossings(self.axis, abscissa, from_speed, speed)
            carried = self._carried(count, across + along)
            if carried is not None:
                return carried
        return None

    def _carried(self, count: int, crossings: Sequence[Crossing]) -> int | None:
        """Unstable multipliers after a sequence of crossings; None if the numbers do not match."""
        for crossing in crossings:
            critical = self.curves[crossing.curve].critical_multipliers
            within = crossing.unstable
            if within < 0 or count not in (within, within + critical):
                return None
            count = within + critical if count == within else within
        return count

    def marked_abscissae(self, *speeds: float) -> Array:
        """Abscissae where the boundary may turn, end or cross one of the speeds, and neighbours.

        Neighbours lie on both sides.
        """
        low, high = self.abscissae
        found: list[float] = []
        for curve in self.curves:
            places = [curve.arclength[[0, -1]], *curve.extrema]
            places += [curve.where(1 - self.axis, speed) for speed in speeds]
            found += curve.at(np.concatenate(places))[:, self.axis].tolist()
        beside = RESOLUTION * (high - low)
        marked = np.concatenate([np.array(found) + offset for offset in (-beside, 0.0, beside)])
        return marked[(marked >= low) & (marked <= high)]


def lower_envelope(plane: SpeedPlane, grid: int = GRID, speeds: Sequence[float] = ()) -> list[Boundary]:
    """The first boundary over the whole width of the plane, by increasing abscissa.

    Besides ``grid`` equally spaced abscissae it holds those at which a curve turns or crosses one of the
    ``speeds``, and, to `RESOLUTION`, both sides of every place where another boundary takes over.
    """
    low, high = plane.abscissae
    marked = plane.marked_abscissae(plane.speeds[0], *speeds)
    values = np.unique(np.concatenate([np.linspace(low, high, grid), marked]))
    found = [plane.boundary(float(value)) for value in values]
    apart = 4.0 * RESOLUTION * (high - low)
    envelope = found[:1]
    for right in found[1:]:
        envelope += [*_between(plane, envelope[-1], right, apart), right]
    return _without_slivers(envelope, high - low)


def _without_slivers(envelope: Sequence[Boundary], width: float) -> list[Boundary]:
    """The boundaries of all parts that are wide enough.

    Curves that meet in one point are stored with a gap there, the wider the coarser their time steps.  A
    low part is kept however narrow it is.
    """
    parts = [list(part) for _, part in groupby(envelope, key=lambda boundary: boundary.identity)]
    kept = []
    for number, part in enumerate(parts):
        beside = [parts[n] for n in (number - 1, number + 1) if 0 <= n < len(parts)]
        is_gap = len(beside) == 2 and all(_highest(part) > _highest(other) for other in beside)
        if part[-1].abscissa - part[0].abscissa > (GAP if is_gap else SLIVER) * width:
            kept += part
    return kept


def _highest(part: Sequence[Boundary]) -> float:
    return max(boundary.speed for boundary in part)


def _between(plane: SpeedPlane, left: Boundary, right: Boundary, apart: float) -> list[Boundary]:
    """Boundaries between two neighbours that belong to different parts, by bisection."""
    if left.identity == right.identity or right.abscissa - left.abscissa <= apart:
        return []
    middle = plane.boundary(0.5 * (left.abscissa + right.abscissa))
    return [*_between(plane, left, middle, apart), middle, *_between(plane, middle, right, apart)]
