"""Cycles over a plane of two parameters: the surface on which the bifurcation curves are drawn.

The cycles near a point form a surface in the space of (s, T, lambda_1, lambda_2),

    phi(s, T, lambda) - s = 0,      phase(s) = 0

and a bifurcation curve is the line on it where one test function vanishes.  With V an orthonormal basis of
the slow invariant subspace and ds = V a + q, where every q_x = Q (M q_x + x) is found by Picard sweeps as in
``pipelines.orbits.shooting``, both the Newton correction towards the surface and its two tangents solve

    | V'(M-I)V   V'(phi_j + M q_j)   V'(phi_T + M q_T) | | a    |     | V'(r + M q_r) |
    | F V        F_j + F q_j         F_T + F q_T       | | dl_j | = - | F  + F q_r    |
    | row_s V    row_j + row_s q_j   row_T + row_s q_T | | dT   |     | gap + row q_r |

with j = 1, 2 and two closing rows.  Only a derivative of the test function along each tangent is then wanted,
never its whole gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.period_map import Inhomogeneity, PeriodImage, PeriodMap, PhaseReference
from pipelines.orbits.shooting import CycleProblem, ShootingOptions, Unknowns
from pipelines.orbits.system import Matrix, Vector

RESIDUAL_TOLERANCE = 1e-3  # of the Picard part of a residual, relative to the residual
_NO_INFLUENCE = 0.1  # share of the corrector's tolerance below which a Picard change is left alone
_SHIFT = 2e-5  # central difference of M along a direction whose largest entry is one: h^2 against eps/h


class CurveFormulation(StrEnum):
    """How criticality is imposed: a test function of a bordered matrix, or eigenvectors as unknowns."""

    BORDERED = "bordered"
    EXTENDED = "extended"


@dataclass(frozen=True)
class Position:
    """A point or a direction in the space of (s, T, lambda_1, lambda_2): ``state`` (N,), ``parameters``
    (2,).
    """

    state: Vector
    period: float
    parameters: Vector

    def plus(self, other: Position, factor: float = 1.0) -> Position:
        return Position(
            self.state + factor * other.state,
            self.period + factor * other.period,
            self.parameters + factor * other.parameters,
        )

    def minus(self, other: Position) -> Position:
        return self.plus(other, -1.0)

    def scaled(self, factor: float) -> Position:
        return Position(factor * self.state, factor * self.period, factor * self.parameters)

    def dot(self, other: Position) -> float:
        return float(
            self.state @ other.state + self.period * other.period + self.parameters @ other.parameters
        )


@dataclass(frozen=True)
class PlaneMetric:
    """<u, v> = <u_s, v_s>/N + T_u T_v/(2 pi)^2 + sum_j l_j m_j/scale_j^2; T counts only when it is
    unknown.
    """

    state: float
    period: float
    parameters: Vector

    def row(self, direction: Position) -> Position:
        """The row vector w with w . v = <direction, v>."""
        return Position(
            self.state * direction.state,
            self.period * direction.period,
            self.parameters * direction.parameters,
        )

    def inner(self, left: Position, right: Position) -> float:
        return self.row(left).dot(right)

    def norm(self, direction: Position) -> float:
        return math.sqrt(self.inner(direction, direction))

    def unit(self, direction: Position) -> Position:
        return direction.scaled(1.0 / self.norm(direction))


@dataclass(frozen=True)
class CurveProblem:
    """Period doublings, Neimark-Sacker points or folds of one period map in the plane of two parameters.

    ``parameters`` (p,) holds the fixed ones, ``names`` the two free ones; ``kind``: what is followed;
    ``options``: of the corrector, whose ``multiplier_tolerance`` is also asked of the test function.
    Raises ValueError for unknown or equal names, a wrong number of parameters, a branch point as kind, or the
    extended system for folds of unknown period, where only the bordered one knows the phase condition.
    """

    period_map: PeriodMap
    kind: EventKind
    parameters: Vector
    names: tuple[str, str]
    options: ShootingOptions = field(default_factory=ShootingOptions)
    formulation: CurveFormulation = CurveFormulation.BORDERED

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
        extended = self.formulation is CurveFormulation.EXTENDED
        if extended and self.kind is EventKind.FOLD and self.period_map.autonomous:
            raise ValueError("folds of cycles of unknown period need the bordered formulation")

    @property
    def indices(self) -> tuple[int, int]:
        system = self.period_map.system
        return system.parameter_index(self.names[0]), system.parameter_index(self.names[1])

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
        """The position as seen by ``cycle_problem``."""
        return Unknowns(position.state, position.period, float(position.parameters[0]))

    def row_of_parameter(self, which: int) -> Position:
        """The row that picks one of the two parameters."""
        return Position(np.zeros(self.period_map.size), 0.0, np.eye(2)[which])


def metric_of(problem: CurveProblem, scales: tuple[float, float]) -> PlaneMetric:
    """The metric for a problem; ``scales``: change of each parameter that counts as one."""
    period = 1.0 / (2.0 * math.pi) ** 2 if problem.period_map.autonomous else 0.0
    return PlaneMetric(1.0 / problem.period_map.size, period, 1.0 / np.array(scales) ** 2)


@dataclass(frozen=True)
class MapAt:
    """The period map at one position: passes with given columns there and beside it."""

    problem: CurveProblem
    position: Position
    steps: int
    reference: PhaseReference | None

    def full_pass(self, columns: Matrix) -> PeriodImage:
        """phi(s), M columns, phi_1, phi_2, phi_T (when the period is unknown) and the phase rows."""
        period_map = self.problem.period_map
        parameters = self.problem.parameters_at(self.position)
        inhomogeneous = [period_map.parameter_column(index, parameters) for index in self.problem.indices]
        if period_map.autonomous:
            inhomogeneous.append(Inhomogeneity(period_rate=1.0))
        return self._evaluate(columns, tuple(inhomogeneous))

    def tangent(self, columns: Matrix, period_column: bool = False) -> PeriodImage:
        """M columns, and phi_T when asked for."""
        return self._evaluate(columns, (Inhomogeneity(period_rate=1.0),) if period_column else ())

    def beside(self, direction: Position, distance: float) -> MapAt:
        """The map at position + distance direction, with the period of the forcing there."""
        return replace(self, position=self.problem.consistent(self.position.plus(direction, distance)))

    def _evaluate(self, columns: Matrix, inhomogeneous: tuple[Inhomogeneity, ...]) -> PeriodImage:
        position = self.position
        return self.problem.period_map.evaluate(
            position.state,
            self.problem.parameters_at(position),
            position.period,
            self.steps,
            columns,
            inhomogeneous,
            self.reference,
        )


def map_slopes(
    at: MapAt, columns: Matrix, weights: Vector | None, directions: tuple[Position, ...]
) -> tuple[Matrix, Matrix]:
    """Derivatives of M ``columns`` (N, m) along each direction, (N, m directions), and of the phase row.

    ``weights`` (m,) adds weights_j phi_T to column j: the null vectors of a cycle of unknown period.
    One pair of passes per direction: (M(u + h d) - M(u - h d)) columns / 2h, without a column for the rest.
    """
    parts, phases = [], []
    for direction in directions:
        largest = max(
            float(np.max(np.abs(direction.state))),
            float(np.max(np.abs(direction.parameters))),
            abs(direction.period),
        )
        distance = _SHIFT * max(1.0, float(np.max(np.abs(at.position.state)))) / largest
        sides = [
            at.beside(direction, side * distance).tangent(columns, weights is not None)
            for side in (1.0, -1.0)
        ]
        images = [_weighted(image, weights) for image in sides]
        parts.append((images[0][0] - images[1][0]) / (2.0 * distance))
        phases.append((images[0][1] - images[1][1]) / (2.0 * distance))
    return np.hstack(parts), np.concatenate(phases)


def _weighted(image: PeriodImage, weights: Vector | None) -> tuple[Matrix, Vector]:
    if weights is None:
        return image.columns, image.phase_columns
    return (
        image.columns + image.inhomogeneous[:, -1:] * weights,
        image.phase_columns + image.phase_inhomogeneous[-1] * weights,
    )


@dataclass(frozen=True)
class Swept:
    """Solutions q (N, c) of q A = Q (M q + x), their images M q and phase rows F q (c,)."""

    columns: Matrix
    image: Matrix
    phase: Vector


def sweep(
    at: MapAt,
    basis: Matrix,
    sources: Matrix,
    inverse: Matrix,
    tolerance: float | Vector,
    guess: Matrix | None = None,
) -> Swept:
    """Picard sweeps q <- Q (M q + x) A^-1 outside the slow subspace; ``inverse`` (c, c) is A^-1.

    They converge like abs(mu_neglected / eigenvalue of A), until the change of every column is below its
    ``tolerance`` times the size of its source, or without influence on the corrector.
    """
    zeros = np.zeros_like(sources)
    if basis.shape[0] == basis.shape[1]:
        return Swept(zeros, zeros, np.zeros(sources.shape[1]))
    options = at.problem.options
    swept = outside(basis, sources @ inverse if guess is None else guess)
    enough = tolerance * np.linalg.norm(sources, axis=0) + _NO_INFLUENCE * options.tolerance
    image, phase = zeros, np.zeros(sources.shape[1])
    for _ in range(options.picard_sweeps):
        passed = at.tangent(swept)
        image, phase = passed.columns, passed.phase_columns
        following = outside(basis, image + sources) @ inverse
        if np.all(np.linalg.norm(following - swept, axis=0) <= enough):
            break
        swept = following
    return Swept(swept, image, phase)


def outside(basis: Matrix, columns: Matrix) -> Matrix:
    """Q x = x - V V'x."""
    return np.asarray(columns - basis @ (basis.T @ columns))


@dataclass(frozen=True)
class SurfaceLinearisation:
    """The map and its derivatives at a position near the surface of cycles.

    ``sources`` (N, 3 or 4): r, phi_1, phi_2 and phi_T; ``swept``: their Picard parts.
    """

    at: MapAt
    basis: Matrix
    image: PeriodImage
    sources: Matrix
    swept: Swept

    @property
    def residual(self) -> float:
        """Largest entry of phi(s) - s, relative to max(1, largest entry of s), or of the phase."""
        scale = max(1.0, float(np.max(np.abs(self.at.position.state))))
        return max(float(np.max(np.abs(self.sources[:, 0]))) / scale, abs(self.image.phase))


def linearise(
    at: MapAt,
    basis: Matrix,
    image: PeriodImage,
    defect: Matrix,
    inverse: Matrix,
    warm: SurfaceLinearisation | None = None,
) -> tuple[SurfaceLinearisation, Swept]:
    """The Picard parts that belong to a full pass, and in the same sweeps those of a ``defect`` (N, m) of
    critical vectors: q A = Q (M q + defect), with ``inverse`` (m, m) = A^-1.

    ``warm``: the last linearisation, whose q_j are first guesses.  The residual and the defect are swept less
    sharply than the derivatives: what is left of them is corrected in the next iteration.
    """
    sources = np.column_stack([image.state - at.position.state, image.inhomogeneous])
    count, riders = sources.shape[1], defect.shape[1]
    both = np.eye(count + riders)
    both[count:, count:] = inverse
    tolerances = np.full(count + riders, RESIDUAL_TOLERANCE)
    tolerances[1:count] = at.problem.options.picard_tolerance
    together = np.hstack([sources, defect])
    guess = None
    if warm is not None:
        guess = together @ both
        guess[:, 1:count] = warm.swept.columns[:, 1:]
    swept = sweep(at, basis, together, both, tolerances, guess)
    surface = Swept(swept.columns[:, :count], swept.image[:, :count], swept.phase[:count])
    rest = Swept(swept.columns[:, count:], swept.image[:, count:], swept.phase[count:])
    return SurfaceLinearisation(at, basis, image, sources, surface), rest


def surface_rows(linear: SurfaceLinearisation) -> tuple[Matrix, Vector]:
    """Matrix and right side of the periodicity (and phase) rows; unknowns (a, dl_1, dl_2[, dT])."""
    basis, image, swept = linear.basis, linear.image, linear.swept
    # V'(M - I)V a + V'(phi_j + M q_j) dl_j + V'(phi_T + M q_T) dT = -V'(r + M q_r)
    reduced = basis.T @ (linear.sources + swept.image)
    matrix = np.hstack([basis.T @ image.columns - np.eye(basis.shape[1]), reduced[:, 1:]])
    right = -reduced[:, 0]
    if linear.at.problem.period_map.autonomous:
        # F V a + (F_j + F q_j) dl_j + (F_T + F q_T) dT = -(F + F q_r)
        row = np.concatenate([image.phase_columns, image.phase_inhomogeneous + swept.phase[1:]])
        matrix = np.vstack([matrix, row])
        right = np.append(right, -image.phase - swept.phase[0])
    return matrix, right


def position_of(linear: SurfaceLinearisation, solution: Vector, with_residual: bool) -> Position:
    """ds = V a + sum_j q_j dl_j + q_T dT (+ q_r) as a direction."""
    columns = linear.basis.shape[1]
    weights = np.concatenate([[1.0 if with_residual else 0.0], solution[columns:]])
    period = float(solution[columns + 2]) if linear.at.problem.period_map.autonomous else 0.0
    state = linear.basis @ solution[:columns] + linear.swept.columns @ weights
    return Position(state, period, solution[columns : columns + 2].copy())


@dataclass(frozen=True)
class SurfaceStep:
    """The Newton correction towards the surface and its tangents with row_i . tangent_j = 1 for i = j, else
    0.
    """

    correction: Position
    along: Position
    across: Position


def surface_step(
    linear: SurfaceLinearisation, rows: tuple[Position, Position], gaps: tuple[float, float]
) -> SurfaceStep | None:
    """Solve the system drawn at the head of this module for its three right sides; None when it is
    singular.
    """
    matrix, right = surface_rows(linear)
    basis, swept = linear.basis, linear.swept.columns
    given = len(right)
    closing = np.zeros((2, matrix.shape[1]))
    sides = np.zeros((given + 2, 3))
    sides[:given, 0] = right
    for i, row in enumerate(rows):
        # row_s (V a + q) + row_j dl_j + row_T dT = -gap
        direct = np.append(row.parameters, row.period)[: swept.shape[1] - 1]
        closing[i] = np.concatenate([row.state @ basis, direct + row.state @ swept[:, 1:]])
        sides[given + i, 0] = -gaps[i] - row.state @ swept[:, 0]
        sides[given + i, 1 + i] = 1.0
    try:
        solution = np.asarray(np.linalg.solve(np.vstack([matrix, closing]), sides), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(solution)):
        return None
    return SurfaceStep(
        position_of(linear, solution[:, 0], True),
        position_of(linear, solution[:, 1], False),
        position_of(linear, solution[:, 2], False),
    )


def surface_tangents(linear: SurfaceLinearisation, metric: PlaneMetric) -> tuple[Position, Position]:
    """Two orthonormal tangents of the surface without any closing row: the null space of its rows."""
    matrix, _ = surface_rows(linear)
    _, _, right = np.linalg.svd(matrix)
    first, second = (position_of(linear, vector, False) for vector in right[-2:])
    first = metric.unit(first)
    return first, metric.unit(second.plus(first, -metric.inner(first, second)))
