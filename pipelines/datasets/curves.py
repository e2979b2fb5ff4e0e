"""Bifurcation curves between their stored points: cubic Hermite, from parameters, tangents and arclength.

Between two rows of a group of kind ``curve`` every parameter is the cubic of the arclength that has the
values and the slopes of the rows, so the curve is met with an error of fourth order in the step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PPoly

from pipelines.case.arrays import Array
from pipelines.datasets.records import Group
from pipelines.datasets.store import local_name

CRITICAL_MULTIPLIERS = {"period_doubling": 1, "neimark_sacker": 2, "fold": 1}
CURVE_CONTAINERS = ("pd", "ns", "folds")  # groups of a case that hold curves
# reasons after which nothing is missing
FINISHED = frozenset({"closed", "range", "resonance_1", "resonance_2", "traced", "leaves_boundary"})
UNKNOWN = "unset"
_AT_A_ROW = 1e-12  # of the extent of the curve


@dataclass(frozen=True)
class BifurcationCurve:
    """A curve in the plane of two parameters, n >= 2 points in order.

    ``arclength`` (n,), increasing; ``points`` and ``slopes`` = d points / d arclength, both (n, 2), in the
    order of ``parameters``; ``unstable`` (n,) multipliers outside the circle, critical ones left out, -1
    where unknown; ``criticality`` (n,) of "subcritical", "supercritical", "unset"; ``angle`` (n,) of the
    critical multiplier [rad]; ``special`` (e,) arclengths of the points of codimension two, increasing;
    ``clipping_width`` (n,) of the regularised clipping, 0 where a point is exact.
    """

    name: str
    bifurcation: str
    turns: int
    parameters: tuple[str, str]
    stop_reason: str
    arclength: Array
    points: Array
    slopes: Array
    unstable: NDArray[np.int64]
    criticality: NDArray[np.str_]
    angle: Array
    special: Array
    clipping_width: Array

    @property
    def critical_multipliers(self) -> int:
        """Number of multipliers that are on the unit circle along the curve."""
        return CRITICAL_MULTIPLIERS[self.bifurcation]

    @property
    def is_complete(self) -> bool:
        """Whether the curve was traced to an end beyond which none of it is wanted."""
        return self.stop_reason in FINISHED

    @cached_property
    def splines(self) -> tuple[CubicHermiteSpline, CubicHermiteSpline]:
        """Both parameters as functions of the arclength."""
        first, second = (
            CubicHermiteSpline(self.arclength, self.points[:, axis], self.slopes[:, axis]) for axis in (0, 1)
        )
        return first, second

    @cached_property
    def extrema(self) -> tuple[Array, Array]:
        """Arclengths at which each parameter is stationary, without the ends."""
        first, second = (_finite(spline.derivative().roots(extrapolate=False)) for spline in self.splines)
        return first, second

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Smallest and largest value of both parameters (2,), (2,)."""
        turning = self.at(np.concatenate(self.extrema))
        points = np.concatenate([self.points, turning])
        return points.min(axis=0), points.max(axis=0)

    def at(self, arclength: Array | float) -> Array:
        """Points of the curve (..., 2)."""
        return np.stack([spline(arclength) for spline in self.splines], axis=-1)

    def where(self, axis: int, value: float) -> Array:
        """Increasing arclengths at which parameter ``axis`` has a value: real roots of the cubics."""
        knots, (smallest, largest) = self.points[:, axis], self.extent
        slack = _AT_A_ROW * max(float(np.ptp(knots)), abs(value))
        if not smallest[axis] - slack <= value <= largest[axis] + slack:
            return np.zeros(0)
        at_rows = np.abs(knots - value) <= slack
        found = _finite(self.splines[axis].solve(value, extrapolate=False))
        between = found[~np.isin(found, self.arclength)]
        if at_rows.any():  # such a root may be missed, or found a second time beside the row
            rows = self.arclength[at_rows]
            reach = 1e-6 * float(self.arclength[-1] - self.arclength[0])
            between = between[np.abs(between[:, None] - rows).min(axis=1) > reach]
            between = np.concatenate([between, rows])
        return np.unique(between)

    def nearest_candidates(self, point: Array, scale: Array) -> Array:
        """Increasing arclengths among which the nearest point of any part of the curve is.

        With the distance d^2 = sum_i ((p_i(s) - point_i) / scale_i)^2 these are the roots of d(d^2)/ds, a
        quintic between two rows, and the ends of all parts: rows and special points.
        """
        stationary = np.zeros((6, len(self.arclength) - 1))  # coefficients, highest power first
        for axis, spline in enumerate(self.splines):
            away, slope = spline.c.copy(), spline.derivative().c
            away[-1] -= point[axis]
            for power, coefficient in enumerate(slope):
                stationary[power : power + 4] += away * coefficient / scale[axis] ** 2
        roots = _finite(PPoly(stationary, self.arclength).roots(extrapolate=False))
        return np.unique(np.concatenate([roots, self.stretches()]))

    def unstable_at(self, arclength: float) -> int:
        """Number of multipliers outside the circle besides the critical ones.

        Between two rows that differ, and without a located special point to tell where, the smaller number:
        it calls more of the curve a boundary of stability.
        """
        return min(self.possibly_unstable_at(arclength))

    def possibly_unstable_at(self, arclength: float) -> frozenset[int]:
        """The same number; two where the rows around differ and no special point tells where."""
        return frozenset(int(self.unstable[row]) for row in self._neighbours(arclength))

    def criticality_at(self, arclength: float) -> str:
        """Type of the bifurcation; "unset" where the rows on both sides differ."""
        before, behind = (str(self.criticality[row]) for row in self._neighbours(arclength))
        return before if before == behind else UNKNOWN

    def angle_at(self, arclength: float) -> float:
        """Argument of the critical multiplier [rad], linear between rows."""
        return float(np.interp(arclength, self.arclength, self.angle))

    def angles_around(self, arclength: float) -> tuple[float, float]:
        """Smaller and larger argument of the critical multiplier [rad] at the rows on both sides."""
        row = int(np.clip(np.searchsorted(self.arclength, arclength, side="right"), 1, len(self.angle) - 1))
        first, second = sorted(self.angle[row - 1 : row + 1].tolist())
        return first, second

    def _neighbours(self, arclength: float) -> tuple[int, int]:
        """The rows that apply at a position: both around it, or only one if special points lie between."""
        last = len(self.arclength) - 1
        row = int(np.clip(np.searchsorted(self.arclength, arclength, side="right") - 1, 0, last - 1))
        inside = self.special[(self.special > self.arclength[row]) & (self.special < self.arclength[row + 1])]
        if len(inside) and arclength < inside[0]:
            return row, row
        return (row + 1, row + 1) if len(inside) and arclength > inside[-1] else (row, row + 1)

    def regularised(self) -> list[tuple[float, float]]:
        """Intervals of the arclength between neighbouring rows of which one has regularised clipping."""
        smooth = self.clipping_width > 0.0
        between = np.concatenate([[False], smooth[1:] | smooth[:-1], [False]])
        starts, ends = (np.flatnonzero(np.diff(between.astype(int)) == sign) for sign in (1, -1))
        return [
            (float(self.arclength[i]), float(self.arclength[j])) for i, j in zip(starts, ends, strict=True)
        ]

    def stretches(self) -> Array:
        """Arclengths (m,) of the rows and special points; the kind is constant between two of them."""
        return np.unique(np.concatenate([self.arclength, self.special]))


def curves_of_plane(groups: Iterable[Group], parameters: Sequence[str]) -> tuple[BifurcationCurve, ...]:
    """The curves over two parameters among ``groups``, of cycles of the excitation period alone."""
    read = [
        read_curve(local_name(group.name), group.labelled(), group.attributes)
        for group in groups
        if list(group.attributes["parameters"]) == list(parameters)
    ]
    return tuple(curve for curve in read if curve is not None and curve.turns == 1)


def read_curve(
    name: str, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]
) -> BifurcationCurve | None:
    """The curve of a group of kind ``curve`` (flags as their meanings); None below two points.

    Where tangents or arclength are missing, central differences along the chords take their place.
    """
    names: Sequence[str] = attributes["parameters"]
    points = np.column_stack([np.asarray(arrays[key], dtype=np.float64) for key in names])
    count = len(points)
    if count < 2:
        return None
    arclength = np.asarray(arrays.get("arclength", np.full(count, np.nan)), dtype=np.float64)
    slopes = np.asarray(arrays.get("parameter_tangent", np.full((count, 2), np.nan)), dtype=np.float64)
    if not np.all(np.diff(arclength) > 0.0):
        chords = np.hypot(*np.diff(points, axis=0).T)
        arclength, slopes = (
            np.concatenate([[0.0], np.cumsum(np.maximum(chords, 1e-15))]),
            np.full((count, 2), np.nan),
        )
    along = np.gradient(points, arclength, axis=0)
    slopes = np.where(np.isfinite(slopes), slopes, along)
    curve = BifurcationCurve(
        name=name,
        bifurcation=str(attributes["bifurcation"]),
        turns=int(attributes.get("turns", 1)),
        parameters=(str(names[0]), str(names[1])),
        stop_reason=str(attributes.get("stop_reason", "")),
        arclength=arclength,
        points=points,
        slopes=slopes,
        unstable=np.asarray(arrays.get("unstable_count", np.full(count, -1)), dtype=np.int64),
        criticality=np.asarray(arrays.get("criticality", np.full(count, UNKNOWN)), dtype=np.str_),
        angle=np.asarray(arrays.get("angle", np.full(count, np.nan)), dtype=np.float64),
        special=_special(arrays, names, arclength, points),
        clipping_width=np.asarray(arrays.get("clipping_width", np.zeros(count)), dtype=np.float64),
    )
    return curve


def _special(
    arrays: Mapping[str, NDArray[Any]], names: Sequence[str], arclength: Array, points: Array
) -> Array:
    """Arclengths of the special points, from their positions along the chord of their segment."""
    if "event_after_point" not in arrays:
        return np.zeros(0)
    after = np.clip(np.asarray(arrays["event_after_point"], dtype=np.intp), 0, len(points) - 2)
    there = np.column_stack([np.asarray(arrays[f"event_{key}"], dtype=np.float64) for key in names])
    chord = points[after + 1] - points[after]
    squared = np.sum(chord**2, axis=1)
    share = np.sum((there - points[after]) * chord, axis=1) / np.where(squared > 0.0, squared, 1.0)
    found = arclength[after] + np.clip(share, 0.0, 1.0) * (arclength[after + 1] - arclength[after])
    return np.unique(found)


def _finite(values: Array) -> Array:
    """Roots without the NaN that follows the start of a segment whose cubic vanishes."""
    roots = np.asarray(values, dtype=np.float64)
    return np.unique(roots[np.isfinite(roots)])
