"""Whether a bifurcation point lies on a known curve."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.bifurcations.continuation import hermite_slopes, hermite_weights
from pipelines.bifurcations.curve import CurveStart, CurveState
from pipelines.orbits.system import Matrix, Vector, size_of

_PROJECTIONS = 4  # of the point onto the cubic; the chord's foot is already near
_OVERHANG = 0.05  # part of a segment by which the foot may lie beyond its ends
_ANGLE = 0.2  # rad, between the critical multipliers of the same curve
_DISTANCE = 0.02  # from the curve, in lengths of its segment
_PARALLEL = 0.98  # cosine between the tangents of the same curve
_NOISE = 1e-6  # distance in the scaled parameters that different time steps may cause


@dataclass(frozen=True)
class KnownCurve:
    """A bifurcation curve: n points in order, interpolated by cubics.

    ``parameters`` and ``tangents`` = d parameters / d arclength, both (n, 2); ``arclength`` (n,); ``states``
    (n, N); ``angles`` (n,) of the critical multiplier in [0, pi]; ``unstable`` (n,): numbers of the other
    multipliers outside the unit circle, NaN where they are not known.

    Curves of a symmetric and an antisymmetric mode of one family of cycles may be closer to each other than
    any distance tells. On either of them the other multiplier is on another side of the circle.
    """

    parameters: Matrix
    tangents: Matrix
    arclength: Vector
    states: Matrix
    angles: Vector
    unstable: Vector

    @classmethod
    def of(cls, states: Sequence[CurveState]) -> KnownCurve:
        """The curve through recorded states."""
        cos_theta = np.array([state.cos_theta for state in states])
        return cls(
            np.array([state.parameters for state in states]),
            np.array([state.tangent_parameters for state in states]),
            np.array([state.arclength for state in states]),
            np.array([state.state for state in states]),
            np.arccos(np.clip(cos_theta, -1.0, 1.0)),
            np.full(len(states), np.nan),
        )

    def with_point(self, state: CurveState) -> KnownCurve:
        """The curve with one more point."""
        newest = KnownCurve.of([state])
        pairs = zip(vars(self).values(), vars(newest).values(), strict=True)
        return KnownCurve(*(np.concatenate(pair) for pair in pairs))

    def without_last(self, count: int) -> KnownCurve:
        """The curve without its last points."""
        kept = max(0, len(self.arclength) - count)
        return KnownCurve(*(part[:kept] for part in vars(self).values()))

    def holds(self, start: CurveStart, scales: tuple[float, float] = (1.0, 1.0)) -> bool:
        """Whether a bifurcation point of the same kind lies on the curve.

        Its parameters, divided by ``scales``, must be within a small part of the length of a segment of the
        cubic through that segment's ends.  The state must be near too, and so must the angle, because two
        curves may cross in the parameters.
        """
        return next(self._slopes_there(start, scales), None) is not None

    def runs_along(
        self,
        point: CurveStart,
        tangent: Vector,
        scales: tuple[float, float] = (1.0, 1.0),
        same_sense: bool = False,
    ) -> bool:
        """Whether another curve of this kind coincides with this one at a point.

        ``tangent`` is its d parameters / d arclength there: two curves that cross share the point,
        but not the tangent.

        ``same_sense``: the other curve must run forwards along this one.
        """
        other = tangent / np.array(scales)
        for slope in self._slopes_there(point, scales):
            along = float(slope @ other)
            along = along if same_sense else abs(along)
            if along > _PARALLEL * float(np.linalg.norm(slope) * np.linalg.norm(other)):
                return True
        return False

    def _slopes_there(self, start: CurveStart, scales: tuple[float, float]) -> Iterator[Vector]:
        """Scaled slopes of the segments on which a point lies."""
        target, points = np.array(start.parameters) / scales, self.parameters / scales
        lengths, steepest = np.diff(self.arclength), np.abs(self.tangents / scales).max(axis=1)
        extents = np.linalg.norm(np.diff(points, axis=0), axis=1)
        sizes = extents + lengths * np.maximum(steepest[:-1], steepest[1:])
        apart = np.linalg.norm(points[:-1] - target, axis=1)
        for first in np.flatnonzero((lengths > 0.0) & (apart <= 2.0 * sizes + _NOISE)):
            distance = _DISTANCE * float(sizes[first]) + _NOISE
            slope = self._slope_at(int(first), start, target, np.array(scales), distance)
            if slope is not None:
                yield slope

    def _slope_at(
        self, first: int, start: CurveStart, target: Vector, scales: Vector, distance: float
    ) -> Vector | None:
        ends, slopes = (part[first : first + 2] / scales for part in (self.parameters, self.tangents))
        length = float(self.arclength[first + 1] - self.arclength[first])
        chord = ends[1] - ends[0]
        squared = float(chord @ chord)
        along = 0.5 if squared == 0.0 else float((target - ends[0]) @ chord) / squared
        for _ in range(_PROJECTIONS):
            there, slope = _cubic(ends, slopes, length, along)
            squared = float(slope @ slope)
            along += 0.0 if squared == 0.0 else float((target - there) @ slope) / squared
            along = min(1.0 + 2.0 * _OVERHANG, max(-2.0 * _OVERHANG, along))
        if not -_OVERHANG <= along <= 1.0 + _OVERHANG:
            return None
        there, slope = _cubic(ends, slopes, length, along)
        if float(np.linalg.norm(target - there)) > distance:
            return None
        if not self._same_cycle(first, along, start):
            return None
        return slope

    def _same_cycle(self, first: int, along: float, start: CurveStart) -> bool:
        old, new = self.states[first], self.states[first + 1]
        guess = old + along * (new - old)
        spread = float(np.max(np.abs(new - old)))
        apart = float(np.max(np.abs(start.state - guess)))
        if apart > max(spread, 1e-6 * size_of(guess)):
            return False
        counts = self.unstable[first : first + 2]
        if start.unstable is not None and np.all(np.isfinite(counts)) and start.unstable not in counts:
            return False
        angle = self.angles[first] + along * (self.angles[first + 1] - self.angles[first])
        return start.angle is None or math.isnan(start.angle) or abs(start.angle - angle) <= _ANGLE


def _cubic(ends: Matrix, slopes: Matrix, length: float, at: float) -> tuple[Vector, Vector]:
    """Point and derivative by the fraction of the Hermite cubic of a segment."""
    nodes = np.array([ends[0], slopes[0], ends[1], slopes[1]])
    return hermite_weights(at, length) @ nodes, length * (hermite_slopes(at, length) @ nodes)
