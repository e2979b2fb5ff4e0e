"""The end of a step along a bifurcation curve, the piece of curve before it, and the special points on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipelines.bifurcations.continuation import CubicPiece
from pipelines.bifurcations.critical.bordering import next_bordering
from pipelines.bifurcations.critical.correction import CriticalCycle, CurveConstraint, CurveCorrection
from pipelines.bifurcations.critical.corrector import correct_critical, with_converged_multipliers
from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    Critical,
    critical_derivatives,
    with_sharp_left,
)
from pipelines.bifurcations.critical.cycle_manifold import manifold_step
from pipelines.bifurcations.curve import CurvePoint, CurveState, SpecialKind, SpecialPoint
from pipelines.bifurcations.curves.codimension_two import (
    genuine,
    other_multipliers,
    resonance_tests,
    special_tests,
    with_form_test,
)
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.normal_forms.smoothed import smoothed_normal_form
from pipelines.bifurcations.plane import CurveProblem, PlaneMetric, Position
from pipelines.bifurcations.roots import Node, zero
from pipelines.orbits.floquet import FloquetSpectrum, floquet_spectrum
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import Cycle
from pipelines.orbits.system import Matrix, Vector

_RECORDED = 1e-7  # residual asked of the multipliers of an ordinary point
_RECORDED_LEFT, _SHARP_LEFT = 1e-6, 1e-10  # last term of the series for left vectors, likewise
_END_WIDTH = 1e-10  # of arclength: cos_theta changes by far less than what counts as its end
_VAGUE = 0.1  # share of what the regularisations leave undecided, to which a zero of a coefficient is located
_NOISE = 0.1  # share of the tolerance of a test function below which cos theta tells nothing


@dataclass(frozen=True)
class CurveEnd:
    """A corrected point with everything that the next step needs.

    ``tangent`` and ``normal``: orthonormal tangents of the surface of cycles, along and across the curve;
    ``gradient``: row of the test function, exact on both; ``tests`` (11,) in the order of ``SpecialKind``;
    ``cos_theta_slope``: d cos_theta/d arclength; ``found``: the critical cycle, without factors.
    """

    found: CriticalCycle
    point: CurvePoint
    position: Position
    tangent: Position
    normal: Position
    gradient: Position
    bordering: BorderingVectors
    tests: Vector
    cos_theta_slope: float


@dataclass(frozen=True)
class CurveStep:
    """An accepted step: the state it begins from, its end, its length and the special points on it."""

    begin: CurveState
    end: CurveEnd
    length: float
    found: tuple[SpecialPoint, ...]

    @property
    def point(self) -> CurvePoint:
        return self.end.point


def curve_end(
    correction: CurveCorrection,
    found: CriticalCycle,
    constraint: CurveConstraint,
    sense: Position,
    options: NormalFormOptions | None,
    bordering: BorderingVectors,
    precise: bool = False,
) -> CurveEnd | None:
    """Tangents, spectrum and tests at a corrected point; None when its tangent is singular.

    ``sense``: a direction that the tangent must not oppose; ``options``: of its normal form, for which
    ``with_normal_form`` needs sharp left vectors; ``bordering``: the one it was corrected with; ``precise``:
    multipliers and left vectors as sharp as the options ask, to locate special points.
    """
    found = _with_multipliers(found, bordering, precise)
    if precise or options is not None:
        found = _with_left(found, precise)
    directions = _directions(found, constraint, sense)
    if directions is None:
        return None
    tangent, normal, gradient, cos_theta_slope = directions
    bordering = next_bordering(found.linear.basis, found.critical)
    point = _point(correction, found)
    tests = _tests(found, point.cycle.spectrum, _fold_curvature(found, constraint.metric))
    found = found.without_factors()
    return CurveEnd(
        found, point, found.position, tangent, normal, gradient, bordering, tests, cos_theta_slope
    )


def _with_multipliers(found: CriticalCycle, bordering: BorderingVectors, precise: bool) -> CriticalCycle:
    sharp = found.linear.at.problem.options.multiplier_tolerance
    return with_converged_multipliers(found, bordering, sharp if precise else max(sharp, _RECORDED))


def _with_left(found: CriticalCycle, precise: bool) -> CriticalCycle:
    left = _SHARP_LEFT if precise else _RECORDED_LEFT
    return replace(found, critical=with_sharp_left(found.linear, found.critical, left))


def _tests(found: CriticalCycle, spectrum: FloquetSpectrum, curvature: float) -> Vector:
    """The tests of special points at a corrected point, without those of normal forms."""
    linear = found.linear
    return special_tests(
        linear.at.problem.kind,
        spectrum.multipliers,
        found.critical,
        curvature,
        linear.scale,
        linear.at.problem.period_map.autonomous,
    )


def with_normal_form(
    end: CurveEnd, metric: PlaneMetric, options: NormalFormOptions | None, sharpest: bool = False
) -> CurveEnd:
    """The end with its normal form and its test, which cost more passes than the point; unchanged without.

    ``sharpest``: without the error of its regularisation, as in ``smoothed_normal_form``.
    """
    if options is None:
        return end
    plane = metric.row(end.tangent)
    across = CurveConstraint(plane, plane.dot(end.position), metric.row(end.normal), end.gradient, metric)
    form = smoothed_normal_form(end.found, end.bordering, across, options, sharpest)
    kind, scale = end.point.kind, end.found.linear.scale
    tests = with_form_test(end.tests, kind, form, end.found.critical.alignment, scale)
    return replace(end, point=replace(end.point, normal_form=form), tests=tests)


class _Directions(NamedTuple):
    """Along and across a curve at a corrected point, as in ``CurveEnd``."""

    tangent: Position
    normal: Position
    gradient: Position
    cos_theta_slope: float


def _directions(found: CriticalCycle, constraint: CurveConstraint, sense: Position) -> _Directions | None:
    """The directions at a corrected point; None when its tangent is singular.

    With slopes g_1, g_2 of the test function along the tangents t_1, t_2 of the surface, the curve runs along
    g_2 t_1 - g_1 t_2.
    """
    slopes = _surface_slopes(found, constraint)
    if slopes is None:
        return None
    (first, second), (g1, g2), (trace1, trace2) = slopes
    size = float(np.hypot(g1, g2))
    if not (size > 0.0 and np.isfinite(size)):
        return None
    metric = constraint.metric
    tangent = first.scaled(g2 / size).plus(second, -g1 / size)
    turned = -1.0 if metric.inner(tangent, sense) < 0.0 else 1.0
    tangent = tangent.scaled(turned)
    normal = first.scaled(g1 / size).plus(second, g2 / size)
    gradient = found.gradient.plus(metric.row(tangent), -found.gradient.dot(tangent))
    gradient = gradient.plus(metric.row(normal), size - gradient.dot(normal))
    return _Directions(tangent, normal, gradient, 0.5 * turned * (g2 * trace1 - g1 * trace2) / size)


Pair = tuple[float, float]


def _surface_slopes(
    found: CriticalCycle, constraint: CurveConstraint
) -> tuple[tuple[Position, Position], Pair, Pair] | None:
    """Orthonormal tangents of the surface of cycles, and the derivatives of g and tr A along them."""
    linear, metric = found.linear, constraint.metric
    step = manifold_step(linear, (constraint.row, constraint.across), (0.0, 0.0))
    if step is None:
        return None
    first = metric.unit(step.along)
    second = metric.unit(step.across.plus(first, -metric.inner(first, step.across)))
    derivatives = critical_derivatives(linear, found.critical, (first, second), metric)
    values, traces = derivatives.values, derivatives.traces
    return (first, second), (float(values[0]), float(values[1])), (float(traces[0]), float(traces[1]))


def _fold_curvature(found: CriticalCycle, metric: PlaneMetric) -> float:
    """p.B(q, q) for p and q of unit length: zero at a cusp; not needed on other curves."""
    linear, critical = found.linear, found.critical
    if linear.at.problem.kind is not EventKind.FOLD:
        return 0.0
    period = (critical.right_period or 0.0) * linear.period_unit
    along = Position(critical.right[:, 0], period, np.zeros(2))
    slope = critical_derivatives(linear, critical, (along,), metric, sharp=True).values[0]
    return -float(slope) / _lengths(critical)


def _lengths(critical: Critical) -> float:
    """Scale that makes z'D2 phi(y, y) independent of the bordering: abs(z) abs(y)^2."""
    return float(np.linalg.norm(critical.left) * np.linalg.norm(critical.right) ** 2)


def _point(correction: CurveCorrection, found: CriticalCycle) -> CurvePoint:
    linear, critical = found.linear, found.critical
    problem = linear.at.problem
    cycle = Cycle(
        problem.unknowns(found.position),
        problem.parameters_at(found.position),
        found.basis,
        linear.image.without_factors(),
        floquet_spectrum(found.basis, linear.image.columns),
        correction.residual_norms[-1],
        found.steps,
    )
    return CurvePoint(
        problem.kind,
        cycle,
        found.position.parameters,
        critical.cos_theta,
        critical.alignment,
        critical.right,
        None,
        correction.residual_norms,
        correction.test_values,
    )


class NotConvergedError(Exception):
    """A point inside a segment did not converge."""


@dataclass(frozen=True)
class Anchor:
    """A corrected point at a ``fraction`` of a segment, from which its neighbours are corrected."""

    fraction: float
    position: Position
    basis: Matrix
    bordering: BorderingVectors
    gradient: Position


@dataclass(frozen=True)
class CurveSegment(CubicPiece[Position]):
    """The curve between two corrected points with their unit tangents, both discretised with ``steps``.

    ``basis``, ``bordering``, ``across``, ``gradient``, ``reference``: with these the points between them are
    corrected.  A fraction in [0, 1] names the point in the plane <chord, u - u_0> = fraction <chord, chord>.
    """

    problem: CurveProblem
    metric: PlaneMetric
    start: Position
    start_tangent: Position
    end: CurveEnd
    basis: Matrix
    bordering: BorderingVectors
    across: Position
    gradient: Position
    steps: int
    reference: PhaseReference | None

    def ends(self) -> tuple[Position, Position, Position, Position]:
        """Start, unit tangent there, end, unit tangent there."""
        return self.start, self.start_tangent, self.end.position, self.end.tangent

    @property
    def anchors(self) -> tuple[Anchor, Anchor]:
        """Both ends."""
        end = self.end
        return (
            Anchor(0.0, self.start, self.basis, self.bordering, self.gradient),
            Anchor(1.0, end.position, end.point.cycle.basis, end.bordering, end.gradient),
        )

    def constraint_at(self, fraction: float, anchor: Anchor) -> CurveConstraint:
        """The plane across the segment at a fraction."""
        row = self.metric.row(self.chord)
        value = row.dot(self.start) + fraction * row.dot(self.chord)
        return CurveConstraint(row, value, self.across, anchor.gradient, self.metric)

    def correct_at(self, fraction: float, anchor: Anchor) -> CurveCorrection:
        """The point at a fraction of the segment, guessed from the cubic and the anchor's deviation."""
        wrong = anchor.position.minus(self.guess(anchor.fraction))
        guess = self.guess(fraction).plus(wrong)
        return self.correct_on(guess, self.constraint_at(fraction, anchor), anchor)

    def missed_at(self, fraction: float) -> float | None:
        """Distance of the point at a fraction from the cubic; None when it does not converge."""
        point = self.correct_at(fraction, self.anchors[0]).point
        return None if point is None else self.metric.norm(point.position.minus(self.guess(fraction)))

    def correct_on(self, guess: Position, constraint: CurveConstraint, anchor: Anchor) -> CurveCorrection:
        """The point near ``guess`` on another closing row."""
        return correct_critical(
            self.problem, guess, constraint, anchor.basis, anchor.bordering, self.steps, self.reference
        )


class SegmentPoints:
    """Points of a segment, each corrected once, from its nearest neighbour."""

    def __init__(self, segment: CurveSegment) -> None:
        self.segment = segment
        self._anchors = list(segment.anchors)
        self._corrected: dict[float, tuple[CurveCorrection, CriticalCycle, Anchor]] = {}
        self._ends: dict[tuple[float, bool, bool], CurveEnd] = {}

    def critical(self, fraction: float) -> Critical:
        """The criticality at a fraction; raises when the corrector does not converge."""
        return self._at(fraction)[1].critical

    def end(self, fraction: float, options: NormalFormOptions | None, precise: bool) -> CurveEnd:
        """The point at a fraction with its tests; raises when it does not converge."""
        key = fraction, options is not None, precise
        if key not in self._ends:
            correction, point, anchor = self._at(fraction)
            constraint, chord = self.segment.constraint_at(fraction, anchor), self.segment.chord
            end = curve_end(correction, point, constraint, chord, options, anchor.bordering, precise)
            if end is None:
                raise NotConvergedError
            self._ends[key] = with_normal_form(end, constraint.metric, options, sharpest=True)
        return self._ends[key]

    def test(self, special: SpecialKind, fraction: float, options: NormalFormOptions | None) -> float:
        """The test of a special point at a fraction; raises when it does not converge or is not defined."""
        if _from_pair(self, special):
            value = resonance_tests(self.critical(fraction).cos_theta)[special]
        elif (form := _form_for(special, options)) is not None:
            value = float(self.end(fraction, form, True).tests[special - 1])
        else:
            value = float(self._tests(fraction, special)[special - 1])
        if not np.isfinite(value):
            raise NotConvergedError
        return value

    def test_at_end(self, special: SpecialKind) -> float:
        """The test of a strong resonance at the end of the segment, on a Neimark-Sacker curve."""
        return resonance_tests(self.segment.end.point.cos_theta)[special]

    def _tests(self, fraction: float, special: SpecialKind) -> Vector:
        """The tests at a fraction, of which that of ``special`` is sharp: it needs no tangents."""
        correction, point, anchor = self._at(fraction)
        point = _with_multipliers(point, anchor.bordering, True)
        if special in (SpecialKind.R1, SpecialKind.R2):
            point = _with_left(point, True)
        self._corrected[fraction] = correction, point, anchor
        curvature = _fold_curvature(point, self.segment.metric) if special is SpecialKind.CUSP else np.nan
        return _tests(point, floquet_spectrum(point.basis, point.linear.image.columns), curvature)

    def _at(self, fraction: float) -> tuple[CurveCorrection, CriticalCycle, Anchor]:
        if fraction not in self._corrected:
            self._corrected = {  # free the factors of the last point before the next one makes its own
                known: (history, point.without_factors(), anchor)
                for known, (history, point, anchor) in self._corrected.items()
            }
            anchor = min(self._anchors, key=lambda known: abs(known.fraction - fraction))
            correction = self.segment.correct_at(fraction, anchor)
            point = correction.point
            if point is None:
                raise NotConvergedError
            self._corrected[fraction] = replace(correction, point=None), point, anchor
            bordering = next_bordering(point.basis, point.critical)
            self._anchors.append(Anchor(fraction, point.position, point.basis, bordering, point.gradient))
        return self._corrected[fraction]


def _from_pair(points: SegmentPoints, special: SpecialKind) -> bool:
    """Whether the test is a function of cos theta, which is sharp on every corrected point."""
    return points.segment.problem.kind is EventKind.NEIMARK_SACKER and special <= SpecialKind.R4


def _form_for(special: SpecialKind, options: NormalFormOptions | None) -> NormalFormOptions | None:
    """The differences that the test of a special point needs."""
    return options if special in (SpecialKind.GENERALISED_FLIP, SpecialKind.CHENCINER) else None


@dataclass(frozen=True)
class Bracket:
    """Two fractions of a segment between which a test changes sign, with its values.

    ``touching``: at the second one the test is at its minimum -b, and sqrt(test + b) linear in the fraction.
    ``slopes``: its derivatives by the fraction, where they are known.
    """

    special: SpecialKind
    fractions: tuple[float, float]
    tests: tuple[float, float]
    touching: bool = False
    slopes: tuple[float, float] | None = None

    def seen(self, test: float) -> float:
        """The function of the test that is nearly linear in the fraction."""
        if not self.touching:
            return test
        lowest = -self.tests[1]
        return float(np.sqrt(max(0.0, test + lowest)) - np.sqrt(lowest))

    def ends(self) -> tuple[Node, Node]:
        """Both fractions with what is known there."""
        low, high = (
            Node(fraction, self.seen(test), None if self.slopes is None else self.slopes[i])
            for i, (fraction, test) in enumerate(zip(self.fractions, self.tests, strict=True))
        )
        return low, high


def locate_special(
    points: SegmentPoints, bracket: Bracket, width: float, options: NormalFormOptions | None
) -> tuple[SpecialPoint | None, CurveEnd] | None:
    """Locate the zero of one test function inside a bracket to ``width`` of arclength.

    R1 and R2 of a Neimark-Sacker curve are located more accurately, because the curve ends there; the zero of
    a coefficient of a regularised map less, because another regularisation moves it.

    Returns the point, or None in its place when it turns out to be a neutral saddle or the noise of a
    coefficient, and the corrected end there; None when a point between did not converge.  Every evaluation
    is a corrected point, so that the root is as sharp as the corrector.
    """
    segment, special = points.segment, bracket.special
    from_pair, with_form = _from_pair(points, special), _form_for(special, options)

    def test(fraction: float) -> float:
        return bracket.seen(points.test(special, fraction, options))

    try:
        if from_pair and special <= SpecialKind.R2:
            width = min(width, _END_WIDTH)
        enough = _NOISE * segment.problem.options.multiplier_tolerance if from_pair else 0.0
        if with_form is not None:
            enough = _VAGUE * _undecided(segment.end)
        fraction = zero(test, *bracket.ends(), max(width / segment.length, 1e-14), enough)
        end = segment.end if fraction == 1.0 else points.end(fraction, with_form, not from_pair)
    except NotConvergedError:
        return None
    if with_form is not None and _drowned(end, abs(bracket.tests[1] - bracket.tests[0])):
        return None, end
    return _genuine_point(segment, special, end, fraction), end


def _undecided(end: CurveEnd) -> float:
    """What the regularisations leave of the test of a normal form at an end; zero where nothing is known."""
    form = end.point.normal_form
    return 0.0 if form is None else _in_test(end, form.real_error - form.noise)


def _drowned(end: CurveEnd, change: float) -> bool:
    """Whether a zero of a normal-form coefficient is not beyond the error of its differences.

    A map that is only piecewise smooth has coefficients that jump.
    """
    form = end.point.normal_form
    return form is None or _in_test(end, form.noise) > 0.5 * change


def _in_test(end: CurveEnd, error: float) -> float:
    """An error of the real part of a coefficient as one of its test."""
    scale = end.found.linear.scale
    return scale**2 * error * abs(end.point.alignment)


def _genuine_point(
    segment: CurveSegment, special: SpecialKind, end: CurveEnd, fraction: float
) -> SpecialPoint | None:
    problem, cycle = segment.problem, end.point.cycle
    others = other_multipliers(
        problem.kind, cycle.spectrum.multipliers, end.point.cos_theta, problem.period_map.autonomous
    )
    if not genuine(special, problem.kind, others, end.point.cos_theta):
        return None
    return special_point(segment, special, end, fraction)


def special_point(
    segment: CurveSegment, special: SpecialKind, end: CurveEnd, fraction: float
) -> SpecialPoint:
    """A corrected point of a segment as a special point."""
    cycle = end.point.cycle
    return SpecialPoint(
        special,
        cycle.parameters,
        cycle.unknowns.state,
        cycle.unknowns.period,
        cycle.spectrum.multipliers,
        end.point.cos_theta,
        float(end.tests[special - 1]),
        fraction,
        cycle.steps,
    )
