"""Test functions of period doubling, fold and Neimark-Sacker curves in the slow subspace, with derivatives.

With H = V'MV, the bordered (minimally augmented) condition of a period doubling (sigma = -1) or of a fold of
cycles of known period (sigma = 1) is g = 0 in

    | H - sigma I   b | | y |   | 0 |        | H' - sigma I   c | | z |   | 0 |
    | c'            0 | | g | = | 1 |        | b'             0 | | g | = | 1 |       dg = -z' dH y

b and c being the null vectors of the last point.  A fold of unknown period takes the cycle Jacobian instead,
with phi_T as a further column and the phase condition as a further row.  A Neimark-Sacker point has

    H W = W A,    A (2, 2),    g = det A - 1 = mu_1 mu_2 - 1,    dg = tr(adj(A) L' dH W),    L'W = I

for the invariant pair nearest to the last one; its trace 2 kappa stays smooth through theta = 0 and pi.

Derivatives act from the left with vectors of the whole space, whose part outside V is found without an
adjoint: p'M = A p' gives  p'x = p_V'x + sum_j A^(-j-1) p_V' M (Q M)^j Q x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pipelines.bifurcations.detection import EventKind, nontrivial
from pipelines.bifurcations.plane import MapAt, Position, SurfaceLinearisation, map_slopes, outside
from pipelines.orbits.floquet import Complex
from pipelines.orbits.system import Matrix, Vector

_LEFT_TOLERANCE = 1e-7  # of the derivatives of a test function: they only steer


@dataclass(frozen=True)
class Frame:
    """What the test function inherits from the last point of a curve.

    ``right``, ``left`` (N,): unit null vectors, the bordering of the next point, with the parts
    ``right_period`` and ``left_phase`` of a cycle of unknown period; a Neimark-Sacker curve keeps an
    orthonormal basis of the invariant plane in them and ``kappa`` = cos theta.
    """

    right: Vector
    left: Vector
    right_period: float = 0.0
    left_phase: float = 0.0
    kappa: float = 0.0


@dataclass(frozen=True)
class Critical:
    """The test function at one position and the vectors that carry its derivatives.

    ``value``: g; ``right`` (N, m): y or W; ``matrix`` (m, m): A, with M right = right A; ``left`` (k, m): slow
    part of the left vectors; ``weights`` (m, m): dg = sum(weights * (left' dM right)); ``right_period``,
    ``left_phase``: parts of a fold of unknown period; ``alignment``: cosine between left and right null
    vector, which vanishes where a second multiplier joins (R1 on folds, R2 on period doublings);
    ``kappa``: half the trace of A; ``residual``: of the invariance M right = right A.
    """

    value: float
    right: Matrix
    matrix: Matrix
    left: Matrix
    weights: Matrix
    right_period: float | None
    left_phase: float
    alignment: float
    kappa: float
    residual: float


def critical_of(linear: SurfaceLinearisation, frame: Frame) -> Critical | None:
    """The test function of the problem's kind; None when its bordered matrix is singular."""
    if linear.at.problem.kind is EventKind.NEIMARK_SACKER:
        return _invariant_pair(linear, frame)
    return _bordered(linear, frame)


def _target(kind: EventKind) -> float:
    return -1.0 if kind is EventKind.PERIOD_DOUBLING else 1.0


def _critical_matrix(linear: SurfaceLinearisation) -> Matrix:
    """H - sigma I, bordered by phi_T and the phase condition for a fold of unknown period."""
    basis, image, swept, kind = linear.basis, linear.image, linear.swept, linear.at.problem.kind
    matrix = basis.T @ image.columns - _target(kind) * np.eye(basis.shape[1])
    if not (kind is EventKind.FOLD and linear.at.problem.period_map.autonomous):
        return np.asarray(matrix)
    column = basis.T @ (linear.sources[:, -1] + swept.image[:, -1])
    corner = image.phase_inhomogeneous[-1] + swept.phase[-1]
    return np.block([[matrix, column[:, None]], [image.phase_columns[None, :], np.array([[corner]])]])


def _bordered(linear: SurfaceLinearisation, frame: Frame) -> Critical | None:
    matrix, basis = _critical_matrix(linear), linear.basis
    size, columns = len(matrix), basis.shape[1]
    periodic = size > columns
    border = np.append(basis.T @ frame.left, frame.left_phase)[:size]
    closing = np.append(basis.T @ frame.right, frame.right_period)[:size]
    system = np.block([[matrix, border[:, None]], [closing[None, :], np.zeros((1, 1))]])
    unit = np.append(np.zeros(size), 1.0)
    try:
        right, left = np.linalg.solve(system, unit), np.linalg.solve(system.T, unit)
    except np.linalg.LinAlgError:
        return None
    if not (np.all(np.isfinite(right)) and np.all(np.isfinite(left))):
        return None
    y, z = right[:columns], left[:columns]
    vector, period = basis @ y, None
    mapped = linear.image.columns @ y
    if periodic:
        period = float(right[columns])
        vector = vector + linear.swept.columns[:, -1] * period
        mapped = mapped + (linear.swept.image[:, -1] + linear.sources[:, -1]) * period
    sigma = _target(linear.at.problem.kind)
    defect = outside(basis, (mapped - sigma * vector)[:, None])
    lengths = np.linalg.norm(right[:size]) * np.linalg.norm(left[:size])
    return Critical(
        value=float(right[-1]),
        right=vector[:, None],
        matrix=np.array([[sigma]]),
        left=z[:, None],
        weights=np.array([[-1.0]]),
        right_period=period,
        left_phase=float(left[columns]) if periodic else 0.0,
        alignment=float(right[:size] @ left[:size] / lengths),
        kappa=sigma,
        residual=float(np.linalg.norm(defect) / np.linalg.norm(vector)),
    )


def _invariant_pair(linear: SurfaceLinearisation, frame: Frame) -> Critical | None:
    projected = linear.basis.T @ linear.image.columns
    pair = _nearest_pair(np.linalg.eigvals(projected), 2.0 * frame.kappa)
    if pair is None:
        return None
    right, left = _invariant_plane(projected, pair), _invariant_plane(projected.T, pair)
    if right is None or left is None:
        return None
    left = left @ np.linalg.inv(right.T @ left)
    matrix = right.T @ projected @ right
    adjugate = np.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]])
    defect = outside(linear.basis, linear.image.columns @ right)
    return Critical(
        value=float(np.linalg.det(matrix)) - 1.0,
        right=linear.basis @ right,
        matrix=matrix,
        left=left,
        weights=adjugate.T,
        right_period=None,
        left_phase=0.0,
        alignment=1.0,
        kappa=0.5 * float(np.trace(matrix)),
        residual=float(np.linalg.norm(defect)),
    )


def _nearest_pair(multipliers: Complex, trace: float) -> Complex | None:
    """The conjugate or real pair with product nearest to one and sum nearest to the last."""
    first, second = np.triu_indices(len(multipliers), k=1)
    total, product = multipliers[first] + multipliers[second], multipliers[first] * multipliers[second]
    real = np.abs(total.imag) + np.abs(product.imag) <= 1e-10 * (1.0 + np.abs(total))
    if not np.any(real):
        return None
    distance = np.where(real, np.abs(product - 1.0) + np.abs(total - trace), np.inf)
    best = int(np.argmin(distance))
    return np.array([multipliers[first[best]], multipliers[second[best]]])


def _invariant_plane(matrix: Matrix, pair: Complex) -> Matrix | None:
    """Orthonormal basis (k, 2) of the invariant plane of two eigenvalues, smooth where they collide."""
    others = np.linalg.eigvals(matrix)
    for value in pair:
        others = np.delete(others, int(np.argmin(np.abs(others - value))))

    def belongs(real: float, imaginary: float = 0.0) -> bool:
        value = complex(real, imaginary)
        nearest = min(abs(value - pair[0]), abs(value - pair[1]))
        return bool(len(others) == 0 or nearest < np.min(np.abs(others - value)))

    _, vectors, count = scipy.linalg.schur(matrix, sort=belongs)
    return np.asarray(vectors[:, :2]) if count == 2 else None


@dataclass(frozen=True)
class CriticalDerivatives:
    """Derivatives of g (``values``) and of the trace of A (``traces``), one number per direction."""

    values: Vector
    traces: Vector


def critical_derivatives(
    at: MapAt, basis: Matrix, critical: Critical, directions: tuple[Position, ...]
) -> CriticalDerivatives:
    """dg and d tr A along each direction, from one pair of passes with the m critical columns per
    direction.
    """
    count = critical.right.shape[1]
    weights = None if critical.right_period is None else np.array([critical.right_period])
    slopes, phases = map_slopes(at, critical.right, weights, directions)
    left = left_products(at, basis, critical, slopes, phases)
    parts = [left[:, count * i : count * (i + 1)] for i in range(len(directions))]
    return CriticalDerivatives(
        np.array([np.sum(critical.weights * part) for part in parts]),
        np.array([np.trace(part) for part in parts]),
    )


def left_products(at: MapAt, basis: Matrix, critical: Critical, columns: Matrix, phases: Vector) -> Matrix:
    """p'x for all ``columns`` x (N, c) with their phase rows (c,): (m, c)."""
    total = critical.left.T @ (basis.T @ columns) + critical.left_phase * phases
    if basis.shape[0] == basis.shape[1]:
        return np.asarray(total)
    inverse = np.linalg.inv(critical.matrix)
    power, rest = inverse, outside(basis, columns)
    for _ in range(at.problem.options.picard_sweeps):
        passed = at.tangent(rest)
        term = critical.left.T @ (basis.T @ passed.columns) + critical.left_phase * passed.phase_columns
        total = total + power @ term
        if np.max(np.abs(power @ term)) <= _LEFT_TOLERANCE * np.max(np.abs(total)):
            break
        power, rest = inverse @ power, outside(basis, passed.columns)
    return np.asarray(total)


def following_frame(basis: Matrix, critical: Critical) -> Frame:
    """The frame that a point hands to the next one."""
    if critical.right.shape[1] == 2:
        return Frame(critical.right[:, 0], critical.right[:, 1], kappa=critical.kappa)
    period = critical.right_period or 0.0
    size = math.hypot(float(np.linalg.norm(critical.right)), period)
    left_size = math.hypot(float(np.linalg.norm(critical.left)), critical.left_phase)
    return Frame(
        critical.right[:, 0] / size,
        basis @ critical.left[:, 0] / left_size,
        period / size,
        critical.left_phase / left_size,
        critical.kappa,
    )


def first_frame(linear: SurfaceLinearisation, angle: float | None = None) -> Frame:
    """A frame from nothing: singular vectors of the critical matrix, or the complex pair nearest to the
    unit circle (nearest to exp(i angle) when the angle is given).
    """
    basis, kind = linear.basis, linear.at.problem.kind
    if kind is not EventKind.NEIMARK_SACKER:
        left, _, right = np.linalg.svd(_critical_matrix(linear))
        columns = basis.shape[1]
        tail_right, tail_left = (vector[columns:].sum() for vector in (right[-1], left[:, -1]))
        return Frame(
            basis @ right[-1][:columns],
            basis @ left[:columns, -1],
            float(tail_right),
            float(tail_left),
            _target(kind),
        )
    multipliers = np.linalg.eigvals(basis.T @ linear.image.columns)
    if angle is None:
        angle = _angle_of_nearest(nontrivial(multipliers, linear.at.problem.period_map.autonomous))
    zeros = np.zeros(basis.shape[0])
    return Frame(zeros, zeros, kappa=math.cos(angle))


def _angle_of_nearest(multipliers: Complex) -> float:
    upper = multipliers[multipliers.imag > 0.0]
    if len(upper) == 0:
        return 0.5 * math.pi
    nearest = upper[np.argmin(np.abs(np.abs(upper) - 1.0))]
    return math.atan2(nearest.imag, nearest.real)
