"""Problem, positions, metric and passes for cycles over a plane of two parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.period_map import Inhomogeneity, OrbitStart, PeriodImage, PeriodMap, PhaseReference
from pipelines.orbits.shooting import CycleProblem, ShootingOptions, Unknowns
from pipelines.orbits.system import Matrix, Vector
from pipelines.orbits.vectors import Combination, Metric

_SHIFT = 1e-6  # difference of M, in units of the largest entry on the orbit: h against eps/h
_CENTRAL_SHIFT = 2e-5  # of a central one: h^2 against eps/h


class CurveFormulation(StrEnum):
    """How criticality is imposed: a test function of a bordered matrix, or eigenvectors as unknowns."""

    BORDERED = "bordered"
    EXTENDED = "extended"


@dataclass(frozen=True)
class Position(Combination):
    """A point or a direction in the space of (s, T, lambda_1, lambda_2).

    ``state`` (N,), ``parameters`` (2,).
    """

    state: Vector
    period: float
    parameters: Vector


PlaneMetric = Metric[Position]


@dataclass(frozen=True)
class Kinks:
    """How the kinks of a map that is only piecewise smooth are passed.

    ``regularised(width)``: the map with its pieces joined over a half width; ``widths``: those that a curve
    tries, increasing; ``distance(orbit, parameters)``: how far an orbit (samples, N) is from grazing, that is
    from touching the border between two pieces without crossing it, in the unit of the widths.
    Raises ValueError for widths that are not positive and increasing.
    """

    regularised: Callable[[float], PeriodMap]
    widths: tuple[float, ...]
    distance: Callable[[Matrix, Vector], float]

    def __post_init__(self) -> None:
        if list(self.widths) != sorted(set(self.widths)) or any(not width > 0.0 for width in self.widths):
            raise ValueError(f"widths are {self.widths}; they must be positive and increasing")


@dataclass(frozen=True)
class CurveProblem:
    """Period doublings, Neimark-Sacker points or folds of one period map in the plane of two parameters.

    ``parameters`` (p,) holds the fixed ones, ``names`` the two free ones; ``kind``: what is followed;
    ``options``: of the corrector, whose ``multiplier_tolerance`` is also asked of the test function;
    ``smooth_maps``: regularised maps for the normal forms of a map that is only piecewise smooth, the
    sharpest first; the others tell how much its coefficient depends on the regularisation; ``kinks``: how a
    curve passes the kinks of such a map, None where it must not.
    Raises ValueError for unknown or equal names, a wrong number of parameters, a branch point as kind, a
    smooth map with other unknowns, or the extended system for folds of unknown period, where only the
    bordered one knows the phase condition.
    """

    period_map: PeriodMap
    kind: EventKind
    parameters: Vector
    names: tuple[str, str]
    options: ShootingOptions = field(default_factory=ShootingOptions)
    formulation: CurveFormulation = CurveFormulation.BORDERED
    smooth_maps: tuple[PeriodMap, ...] = ()
    kinks: Kinks | None = None

    def __post_init__(self) -> None:
        known = self.period_map.system.parameter_names
        if len(self.parameters) != len(known):
            raise ValueError(f"{len(self.parameters)} parameters given for {', '.join(known)}")
        if len(set(self.names)) != 2:
            raise ValueError(f"names are {self.names}; two different parameters are needed")
        for name in self.names:
            self.period_map.system.parameter_index(name)
        if self.kind is EventKind.BRANCH_POINT:
            raise ValueError("branch points do not form curves in two parameters")
        for smooth in self.smooth_maps:
            same = (smooth.size, smooth.autonomous, smooth.system.parameter_names)
            if same != (self.period_map.size, self.period_map.autonomous, known):
                raise ValueError("a smooth map must have the unknowns and parameters of the period map")
        extended = self.formulation is CurveFormulation.EXTENDED
        if extended and self.kind is EventKind.FOLD and self.period_map.autonomous:
            raise ValueError("folds of cycles of unknown period need the bordered formulation")

    @property
    def indices(self) -> tuple[int, int]:
        system = self.period_map.system
        return system.parameter_index(self.names[0]), system.parameter_index(self.names[1])

    def with_width(self, width: float) -> CurveProblem:
        """The same curves of the map regularised over a half width; of the exact map for zero."""
        if width == 0.0:
            return self
        if self.kinks is None:
            raise ValueError("the problem has no regularised maps")
        return replace(self, period_map=self.kinks.regularised(width))

    def parameters_at(self, position: Position) -> Vector:
        """The parameter vector with the two free ones set."""
        parameters = np.array(self.parameters, dtype=float)
        parameters[list(self.indices)] = position.parameters
        return parameters

    def consistent(self, position: Position) -> Position:
        """The position with the period of the forcing; unchanged when T is unknown."""
        if self.period_map.autonomous:
            return position
        return replace(position, period=self.period_map.period(self.parameters_at(position)))

    def cycle_problem(self, position: Position) -> CycleProblem:
        """The cycles through ``position`` along the first of the two parameters."""
        return CycleProblem(self.period_map, self.parameters_at(position), self.names[0], self.options)

    def unknowns(self, position: Position) -> Unknowns:
        """The position in the unknowns of ``cycle_problem``."""
        return Unknowns(position.state, position.period, float(position.parameters[0]))

    def row_of_parameter(self, which: int) -> Position:
        """The row that selects one of the two parameters."""
        return Position(np.zeros(self.period_map.size), 0.0, np.eye(2)[which])


def metric_of(
    problem: CurveProblem, scales: tuple[float, float], period_scale: float = 2.0 * math.pi
) -> PlaneMetric:
    """The metric for a problem.

    The scales are changes of each parameter and of the period that count as one.
    """
    period = 1.0 / period_scale**2 if problem.period_map.autonomous else 0.0
    return Metric(period, 1.0 / np.array(scales) ** 2)


@dataclass(frozen=True)
class MapAt:
    """The period map at one position: passes with given columns, there and at nearby positions.

    ``near``: a pass at a nearby position, with which these are faster.
    """

    problem: CurveProblem
    position: Position
    steps: int
    reference: PhaseReference | None
    near: PeriodImage | None = field(default=None, kw_only=True)

    @property
    def orbit_start(self) -> OrbitStart:
        """What the orbit depends on."""
        at = self.position
        return OrbitStart(at.state, self.problem.parameters_at(at), at.period, self.steps)

    def full_pass(self, columns: Matrix) -> PeriodImage:
        """One pass with all derivatives and the factors for further columns.

        phi(s), M columns, phi_1, phi_2, phi_T (when the period is unknown) and the phase rows.
        """
        period_map = self.problem.period_map
        parameters = self.problem.parameters_at(self.position)
        inhomogeneous = [period_map.parameter_column(index, parameters) for index in self.problem.indices]
        if period_map.autonomous:
            inhomogeneous.append(Inhomogeneity(period_rate=1.0))
        return self._evaluate(columns, tuple(inhomogeneous), keep_factors=True)

    def tangent(self, columns: Matrix, period_column: bool = False) -> PeriodImage:
        """M columns, and phi_T when asked for."""
        return self._evaluate(columns, (Inhomogeneity(period_rate=1.0),) if period_column else ())

    def with_columns(self, image: PeriodImage, columns: Matrix) -> PeriodImage:
        """The image of a pass at this position with M columns, as in ``PeriodMap.with_columns``."""
        return self.problem.period_map.with_columns(image, columns, self.reference)

    def beside(self, direction: Position, distance: float, image: PeriodImage) -> MapAt:
        """The map at position + distance direction, with the period of the forcing there.

        ``image``: a pass at this position.
        """
        position = self.problem.consistent(self.position.plus(direction, distance))
        return replace(self, position=position, near=image.without_factors())

    def length(self, columns: Matrix) -> float:
        """The norm in which critical vectors have unit length.

        Of one column, or of both parts of a complex one.
        """
        return float(np.linalg.norm(columns))

    def _evaluate(
        self, columns: Matrix, inhomogeneous: tuple[Inhomogeneity, ...], keep_factors: bool = False
    ) -> PeriodImage:
        return self.problem.period_map.evaluate(
            *self.orbit_start, columns, inhomogeneous, self.reference, keep_factors, self.near
        )


def map_slopes(
    at: MapAt,
    image: PeriodImage,
    columns: Matrix,
    weights: Vector | None,
    directions: tuple[Position, ...],
    scale: float,
    metric: PlaneMetric,
    sharp: bool = False,
) -> tuple[Matrix, Matrix]:
    """Derivatives of M ``columns`` (N, m) along each direction, (N, m directions), and of the phase row.

    ``image``: a pass at the position, with phi_T last if the period is unknown; ``scale``: the largest entry
    on the orbit.  ``weights`` (m,) adds weights_j phi_T to column j: the null vectors of a cycle of unknown
    period.  One pass per direction: (M(u + h d) - M(u)) columns / h, without a column for the rest.  Where
    the period is unknown two, (M(u + h d) - M(u - h d)) columns / 2h: the phase along the cycle amplifies
    rounding.  Two likewise where a ``sharp`` derivative is asked for, which has 20 times less rounding.
    """
    central, own = sharp or at.problem.period_map.autonomous, image
    if not central:  # a pass that would make factors here holds those of two orbits
        known = image.factors is not None
        own = at.with_columns(image, columns) if known else at.tangent(columns, weights is not None)
    parts, phases = [], []

    def beside(direction: Position, distance: float) -> PeriodImage:
        return at.beside(direction, distance, image).tangent(columns, weights is not None)

    for direction in directions:
        distance = (_CENTRAL_SHIFT if central else _SHIFT) * scale / metric.largest(direction)
        ahead, behind = beside(direction, distance), beside(direction, -distance) if central else own
        (there, row), (here, other) = _weighted(ahead, weights), _weighted(behind, weights)
        width = 2.0 * distance if central else distance
        parts.append((there - here) / width)
        phases.append((row - other) / width)
    return np.hstack(parts), np.concatenate(phases)


def _weighted(image: PeriodImage, weights: Vector | None) -> tuple[Matrix, Vector]:
    if weights is None:
        return image.columns, image.phase_columns
    return (
        image.columns + image.inhomogeneous[:, -1:] * weights,
        image.phase_columns + image.phase_inhomogeneous[-1] * weights,
    )
