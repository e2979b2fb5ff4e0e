"""The margin of the operating point: how far it is from the boundaries of stable cycles.

A point of a stored curve bounds stable cycles if the curve is one of cycles of the excitation period and no
multiplier beside the critical ones is outside the circle.  The distance is measured along the speed, along
the other parameter of the plane (the abscissa), and to the nearest point of all in relative coordinates,

    d^2 = ((a - a0) / a0)^2 + ((s - s0) / s0)^2,

with the operating point (a0, s0): a distance of 0.1 is a change of a parameter by a tenth.  Between its
stored points a curve is the cubic of `pipelines.datasets.curves`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.datasets.curves import BifurcationCurve
from pipelines.stages.reports.first_boundary import UNSET, SpeedPlane

SPEED = "speed"
DIRECTIONS = ("higher_speed", "lower_speed", "higher_abscissa", "lower_abscissa", "nearest")


@dataclass(frozen=True)
class BoundaryPoint:
    """A point on a boundary of stable cycles.

    ``distance`` from the operating point: of the nearest point the relative one, else along the parameter
    that changes.
    """

    abscissa: float
    speed: float
    distance: float
    bifurcation: str
    criticality: str
    curve: str


@dataclass(frozen=True)
class Margin:
    """The boundaries seen from the operating point (``abscissa``, ``speed``), None where none is met.

    ``parameter`` names the abscissa; ``base``: "stable" or "unstable" at the operating point, "unset" where
    no stored cycle tells.
    """

    parameter: str
    abscissa: float
    speed: float
    base: str
    higher_speed: BoundaryPoint | None
    lower_speed: BoundaryPoint | None
    higher_abscissa: BoundaryPoint | None
    lower_abscissa: BoundaryPoint | None
    nearest: BoundaryPoint | None

    @property
    def in_speed(self) -> BoundaryPoint | None:
        """The nearer of both boundaries along the speed."""
        return _nearer(self.higher_speed, self.lower_speed)

    @property
    def in_abscissa(self) -> BoundaryPoint | None:
        """The nearer of both boundaries along the abscissa."""
        return _nearer(self.higher_abscissa, self.lower_abscissa)

    def relative(self, point: BoundaryPoint) -> float | None:
        """Distance of a point in shares of the operating point; None along a parameter that is zero."""
        if point is self.nearest:
            return point.distance
        own = self.speed if point in (self.higher_speed, self.lower_speed) else self.abscissa
        return point.distance / abs(own) if own else None

    def as_dict(self) -> dict[str, Any]:
        """Plain data, in which the parameter has its own name."""
        named = {
            direction: None if (point := getattr(self, direction)) is None else self._point(point)
            for direction in DIRECTIONS
        }
        along = {"speed_distance": self.in_speed, f"{self.parameter}_distance": self.in_abscissa}
        return {
            self.parameter: self.abscissa,
            SPEED: self.speed,
            "base": self.base,
            **{name: None if point is None else point.distance for name, point in along.items()},
            "relative_distance": None if self.nearest is None else self.nearest.distance,
            **{name.replace("abscissa", self.parameter): point for name, point in named.items()},
        }

    def _point(self, point: BoundaryPoint) -> dict[str, Any]:
        plain = asdict(point)
        return {self.parameter: plain.pop("abscissa"), **plain}


def margin_of(plane: SpeedPlane, parameter: str, own: Mapping[str, float | None]) -> Margin | None:
    """The margin of a case whose parameters are ``own``; None where it has none, or not inside the plane."""
    abscissa, speed = own.get(parameter), own.get(SPEED)
    if abscissa is None or speed is None:
        return None
    (left, right), (lowest, highest) = plane.abscissae, plane.speeds
    if not (left <= abscissa <= right and lowest <= speed <= highest):
        return None
    count = plane.unstable_at(abscissa, speed)
    return Margin(
        parameter,
        abscissa,
        speed,
        UNSET if count is None else "unstable" if count else "stable",
        _first(plane, plane.axis, abscissa, speed, highest),
        _first(plane, plane.axis, abscissa, speed, lowest),
        _first(plane, 1 - plane.axis, speed, abscissa, right),
        _first(plane, 1 - plane.axis, speed, abscissa, left),
        _nearest(plane, abscissa, speed),
    )


def _first(plane: SpeedPlane, axis: int, value: float, start: float, stop: float) -> BoundaryPoint | None:
    """The first boundary on the line "parameter ``axis`` = value" from ``start`` to ``stop``."""
    for crossing in plane.crossings(axis, value, start, stop):
        if crossing.unstable <= 0:  # -1: not known, so it may be one
            curve = plane.curves[crossing.curve]
            return _point(plane, curve, crossing.arclength, abs(crossing.position - start))
    return None


def _nearest(plane: SpeedPlane, abscissa: float, speed: float) -> BoundaryPoint | None:
    """The boundary at the smallest relative distance."""
    place, widths = np.array([abscissa, speed]), np.ptp([plane.abscissae, plane.speeds], axis=1)
    order = [plane.axis, 1 - plane.axis]  # of abscissa and speed among the parameters of the curves
    scale = np.where(place != 0.0, np.abs(place), widths)
    best: tuple[float, float, BifurcationCurve] | None = None
    for curve in plane.curves:
        arclengths = curve.nearest_candidates(place[order], scale[order])
        bounding = np.array([curve.unstable_at(arclength) <= 0 for arclength in arclengths])
        if not bounding.any():
            continue
        away = (curve.at(arclengths[bounding])[:, order] - place) / scale
        distances = np.hypot(*away.T)
        least = int(np.argmin(distances))
        if best is None or distances[least] < best[0]:
            best = float(distances[least]), float(arclengths[bounding][least]), curve
    return None if best is None else _point(plane, best[2], best[1], best[0])


def _point(plane: SpeedPlane, curve: BifurcationCurve, arclength: float, distance: float) -> BoundaryPoint:
    place: Array = curve.at(arclength)
    return BoundaryPoint(
        float(place[plane.axis]),
        float(place[1 - plane.axis]),
        distance,
        curve.bifurcation,
        curve.criticality_at(arclength),
        curve.name,
    )


def _nearer(*points: BoundaryPoint | None) -> BoundaryPoint | None:
    known = [point for point in points if point is not None]
    return min(known, key=lambda point: point.distance, default=None)
