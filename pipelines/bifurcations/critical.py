"""Test functions of period doubling, fold and Neimark-Sacker curves in the slow subspace, with derivatives.

With H = V'MV, the bordered (minimally augmented) condition of a period doubling (sigma = -1) or of a fold of
cycles of known period (sigma = 1) is g = 0 in

    | M - sigma I   b | | v |   | 0 |        | M' - sigma I   c | | p |   | 0 |
    | c'            0 | | g | = | 1 |        | b'             0 | | g | = | 1 |       dg = -p' dM v

b and c being the null vectors of the last point.  A fold of unknown period takes the cycle Jacobian instead,
with phi_T as a further column and the phase condition as a further row.  A Neimark-Sacker point has

    M W = W A,    A (2, 2),    g = det A - 1 = mu_1 mu_2 - 1,    dg = tr(adj(A) L' dM W),    L'W = I

for the invariant pair that follows from the last one; its trace 2 kappa stays smooth through theta = 0, pi.

V is invariant only to the accuracy of its last update, so v and W are no combinations of its columns: they
travel with V through the same pass.  What is left of the equations above, rho = M v - sigma v, is corrected
by dv = V a + q with q sigma = Q (M q + rho), in the same sweeps as the cycle,

    | H - sigma I   V'b | | a |     | V'(rho + M q) |       | H a - a A   -V'W | | a  |     | V'(rho + M q) |
    | c'V           0   | | g | = - | c'(v + q) - 1 |       | W_0'V       0    | | dA | = - | W_0'q         |

Derivatives act from the left with vectors of the whole space, whose part outside V is found without an
adjoint: p'M = A p' gives  p'x = p_V'x + sum_j A^(-j-1) p_V' M (Q M)^j Q x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from pipelines.bifurcations.detection import EventKind, nontrivial
from pipelines.bifurcations.plane import (
    RESIDUAL_TOLERANCE,
    MapAt,
    Position,
    SurfaceLinearisation,
    Swept,
    linearise,
    map_slopes,
    outside,
)
from pipelines.orbits.floquet import Complex, orthonormal
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.system import Matrix, Vector

_SHARP = 1e-10  # last term of the series for the left vectors
_PAIR_ITERATIONS = 12
_PAIR_TOLERANCE = 1e-12
_LEFT_TOLERANCE = 1e-5  # of the derivatives of a test function: they only steer


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

    ``value``: g; ``right`` (N, m): v or W; ``matrix`` (m, m): A, with M right = right A; ``left`` (k, m):
    slow part of the left vectors; ``weights`` (m, m): dg = sum(weights * (left' dM right));
    ``right_period``, ``left_phase``: parts of a fold of unknown period; ``alignment``: cosine between left
    and right null vector, which vanishes where a second multiplier joins (R1 on folds, R2 on period
    doublings); ``kappa``: half the trace of A; ``error``: estimated error of g from what the basis leaves
    out.
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
    error: float


@dataclass(frozen=True)
class Vectors:
    """Critical vectors that travel with the basis: ``columns`` (N, m) and, for a fold of unknown period, the
    ``period`` part.
    """

    columns: Matrix
    period: float = 0.0


@dataclass(frozen=True)
class CriticalPass:
    """A full pass with the critical vectors: the linearised surface, M ``vectors`` and their defect.

    ``matrix`` (m, m): A; ``defect`` (N, m): M R - R A; ``swept``: its Picard part; ``phase_defect``: of the
    phase row of a fold of unknown period.
    """

    linear: SurfaceLinearisation
    vectors: Vectors
    matrix: Matrix
    defect: Matrix
    phase_defect: float
    swept: Swept


def critical_pass(
    at: MapAt, basis: Matrix, vectors: Vectors, warm: SurfaceLinearisation | None = None
) -> CriticalPass | None:
    """One full pass with the critical vectors and the sweeps that belong to it; None when it diverges."""
    image = at.full_pass(np.hstack([basis, vectors.columns]))
    return swept_pass(at, basis, vectors, image, warm) if image.finite else None


def swept_pass(
    at: MapAt, basis: Matrix, vectors: Vectors, image: PeriodImage, warm: SurfaceLinearisation | None = None
) -> CriticalPass:
    """The sweeps that belong to a full pass with the columns [basis, vectors]; ``warm`` as in
    ``linearise``.
    """
    kind, columns = at.problem.kind, basis.shape[1]
    mapped = image.columns[:, columns:]
    phase = image.phase_columns[columns:]
    image = replace(
        image,
        columns=np.ascontiguousarray(image.columns[:, :columns]),
        phase_columns=image.phase_columns[:columns].copy(),
    )
    matrix = np.array([[_target(kind)]])
    if kind is EventKind.NEIMARK_SACKER:
        # any A will do that makes the defect small; this one makes W'rho = 0
        matrix = np.linalg.solve(vectors.columns.T @ vectors.columns, vectors.columns.T @ mapped)
    defect, phase_defect = mapped - vectors.columns @ matrix, 0.0
    if _with_period(at):
        defect = defect + image.inhomogeneous[:, -1:] * vectors.period
        phase_defect = float(phase[0] + image.phase_inhomogeneous[-1] * vectors.period)
    linear, swept = linearise(at, basis, image, defect, np.linalg.inv(matrix), warm)
    return CriticalPass(linear, vectors, matrix, defect, phase_defect, swept)


def critical_of(passed: CriticalPass, frame: Frame) -> Critical | None:
    """The test function of the problem's kind; None when its bordered matrix is singular."""
    if passed.linear.at.problem.kind is EventKind.NEIMARK_SACKER:
        return _invariant_pair(passed, frame)
    return _bordered(passed, frame)


def _target(kind: EventKind) -> float:
    return -1.0 if kind is EventKind.PERIOD_DOUBLING else 1.0


def _with_period(at: MapAt) -> bool:
    return at.problem.kind is EventKind.FOLD and at.problem.period_map.autonomous


def _critical_matrix(linear: SurfaceLinearisation) -> Matrix:
    """H - sigma I, bordered by phi_T and the phase condition for a fold of unknown period."""
    basis, image, swept = linear.basis, linear.image, linear.swept
    matrix = basis.T @ image.columns - _target(linear.at.problem.kind) * np.eye(basis.shape[1])
    if not _with_period(linear.at):
        return np.asarray(matrix)
    column = basis.T @ (linear.sources[:, -1] + swept.image[:, -1])
    corner = image.phase_inhomogeneous[-1] + swept.phase[-1]
    return np.block([[matrix, column[:, None]], [image.phase_columns[None, :], np.array([[corner]])]])


def _bordered(passed: CriticalPass, frame: Frame) -> Critical | None:
    linear, swept = passed.linear, passed.swept
    matrix, basis = _critical_matrix(linear), linear.basis
    size, columns = len(matrix), basis.shape[1]
    border = np.append(basis.T @ frame.left, frame.left_phase)[:size]
    closing = np.append(basis.T @ frame.right, frame.right_period)[:size]
    system = np.block([[matrix, border[:, None]], [closing[None, :], np.zeros((1, 1))]])
    old = passed.vectors
    rest = np.append(basis.T @ (passed.defect + swept.image), passed.phase_defect + swept.phase[0])[:size]
    gap = frame.right @ (old.columns + swept.columns)[:, 0] + frame.right_period * old.period - 1.0
    try:
        update = np.linalg.solve(system, -np.append(rest, gap))
        left = np.linalg.solve(system.T, np.append(np.zeros(size), 1.0))
    except np.linalg.LinAlgError:
        return None
    if not (np.all(np.isfinite(update)) and np.all(np.isfinite(left))):
        return None
    vector = old.columns[:, 0] + basis @ update[:columns] + swept.columns[:, 0]
    period = None
    if size > columns:
        period = old.period + float(update[columns])
        vector = vector + linear.swept.columns[:, -1] * update[columns]
    slow = np.append(basis.T @ vector, period or 0.0)[:size]
    lengths = math.hypot(float(np.linalg.norm(vector)), period or 0.0) * np.linalg.norm(left[:size])
    return Critical(
        value=float(update[-1]),
        right=vector[:, None],
        matrix=passed.matrix,
        left=left[:columns, None],
        weights=np.array([[-1.0]]),
        right_period=period,
        left_phase=float(left[columns]) if size > columns else 0.0,
        alignment=float(slow @ left[:size] / lengths),
        kappa=float(passed.matrix[0, 0]),
        error=_error(passed, vector[:, None]),
    )


def _error(passed: CriticalPass, vectors: Matrix) -> float:
    """The correction of the vectors is wrong by what V is not invariant and what the last sweep left."""
    linear = passed.linear
    slow = linear.basis.T @ vectors
    leak = np.linalg.norm(outside(linear.basis, linear.image.columns @ slow)) / np.linalg.norm(slow)
    sweeps = 0.0 if slow.shape[0] == vectors.shape[0] else RESIDUAL_TOLERANCE
    return float(np.linalg.norm(passed.defect) / np.linalg.norm(vectors) * (leak + sweeps))


def _invariant_pair(passed: CriticalPass, frame: Frame) -> Critical | None:
    basis = passed.linear.basis
    solved = _pair_in_basis(passed, np.column_stack([frame.right, frame.left]))
    if solved is None:
        return None
    vectors, matrix = solved
    projected = basis.T @ passed.linear.image.columns
    left = _invariant_plane(projected.T, np.linalg.eigvals(matrix).astype(complex))
    if left is None:
        return None
    left = left @ np.linalg.inv((basis.T @ vectors).T @ left)
    adjugate = np.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]])
    return Critical(
        value=float(np.linalg.det(matrix)) - 1.0,
        right=vectors,
        matrix=matrix,
        left=left,
        weights=adjugate.T,
        right_period=None,
        left_phase=0.0,
        alignment=1.0,
        kappa=0.5 * float(np.trace(matrix)),
        error=_error(passed, vectors),
    )


def _pair_in_basis(passed: CriticalPass, fixed: Matrix) -> tuple[Matrix, Matrix] | None:
    """W and A by Newton on a and A with the Picard part as it is: M W is known for every W = W_old + V a + q,
    so that the iterations cost no passes.
    """
    basis, swept = passed.linear.basis, passed.swept
    columns = basis.shape[1]
    vectors, matrix = passed.vectors.columns + swept.columns, passed.matrix
    mapped = passed.defect + passed.vectors.columns @ matrix + swept.image
    projected = basis.T @ passed.linear.image.columns
    closing = fixed.T @ basis
    # the columns of V a that W_old'(W - W_old) = 0 fixes
    normal = fixed.T @ passed.vectors.columns
    size = 2 * columns
    for _ in range(_PAIR_ITERATIONS):
        defect = basis.T @ (mapped - vectors @ matrix)
        # unknowns a (k, 2) and dA (2, 2), row by row: vec(H a - a A) = (H x I - I x A') vec(a)
        system = np.zeros((size + 4, size + 4))
        system[:size, :size] = np.kron(projected, np.eye(2)) - np.kron(np.eye(columns), matrix.T)
        system[:size, size:] = -np.kron(basis.T @ vectors, np.eye(2))
        system[size:, :size] = np.kron(closing, np.eye(2))
        right = np.concatenate([-defect.ravel(), (normal - fixed.T @ vectors).ravel()])
        try:
            solution = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(solution)):
            return None
        change = solution[:size].reshape(columns, 2)
        vectors, mapped = vectors + basis @ change, mapped + passed.linear.image.columns @ change
        matrix = matrix + solution[size:].reshape(2, 2)
        if np.max(np.abs(solution)) <= _PAIR_TOLERANCE:
            return vectors, matrix
    return None


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
    left = left_products(at, basis, critical, slopes, phases, _LEFT_TOLERANCE)
    parts = [left[:, count * i : count * (i + 1)] for i in range(len(directions))]
    return CriticalDerivatives(
        np.array([np.sum(critical.weights * part) for part in parts]),
        np.array([np.trace(part) for part in parts]),
    )


def left_products(
    at: MapAt, basis: Matrix, critical: Critical, columns: Matrix, phases: Vector, tolerance: float
) -> Matrix:
    """p'x for all ``columns`` x (N, c) with their phase rows (c,): (m, c); relative ``tolerance``."""
    total = critical.left.T @ (basis.T @ columns) + critical.left_phase * phases
    if basis.shape[0] == basis.shape[1]:
        return np.asarray(total)
    inverse = np.linalg.inv(critical.matrix)
    power, rest = inverse, outside(basis, columns)
    for _ in range(at.problem.options.picard_sweeps):
        passed = at.tangent(rest)
        term = critical.left.T @ (basis.T @ passed.columns) + critical.left_phase * passed.phase_columns
        total = total + power @ term
        if np.max(np.abs(power @ term)) <= tolerance * np.max(np.abs(total)):
            break
        power, rest = inverse @ power, outside(basis, passed.columns)
    return np.asarray(total)


def with_sharp_left(linear: SurfaceLinearisation, critical: Critical) -> Critical:
    """The same with left vectors that do not suffer from what V lacks to be invariant.

    With R = Q M V, eliminating the part of p outside V from p'M = mu p' leaves the small matrix

        p_V' (H + V'M R / mu + V'M Q M R / mu^2 + ... - mu I) = 0

    for the price of a pass with all columns per term.  A fold of unknown period is returned as it is.
    """
    basis, columns = linear.basis, linear.basis.shape[1]
    if basis.shape[0] == columns or critical.right_period is not None:
        return critical
    multipliers = np.linalg.eigvals(critical.matrix).astype(complex)
    mu = complex(multipliers[np.argmax(multipliers.imag)])
    reduced = (basis.T @ linear.image.columns).astype(complex)
    rest, power = outside(basis, linear.image.columns), 1.0 / mu
    for _ in range(linear.at.problem.options.multiplier_sweeps):
        passed = linear.at.tangent(rest).columns
        term = power * (basis.T @ passed)
        reduced += term
        if np.max(np.abs(term)) <= _SHARP:
            break
        rest, power = outside(basis, passed), power / mu
    null = np.linalg.svd((reduced - mu * np.eye(columns)).T)[2][-1].conj()
    if critical.right.shape[1] == 1:
        vector = null.real if np.linalg.norm(null.real) > np.linalg.norm(null.imag) else null.imag
        old = critical.left[:, 0]
        left = vector * (float(vector @ old) / float(vector @ vector))
        right = basis.T @ critical.right[:, 0]
        aligned = float(right @ left) / float(np.linalg.norm(critical.right) * np.linalg.norm(left))
        return replace(critical, left=left[:, None], alignment=aligned)
    pair = np.column_stack([null.real, null.imag])
    return replace(critical, left=pair @ np.linalg.inv((basis.T @ critical.right).T @ pair))


def following_frame(basis: Matrix, critical: Critical) -> Frame:
    """The frame that a point hands to the next one."""
    if critical.right.shape[1] == 2:
        plane = orthonormal(critical.right)
        return Frame(plane[:, 0].copy(), plane[:, 1].copy(), kappa=critical.kappa)
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


def vectors_of(frame: Frame, kind: EventKind) -> Vectors:
    """The critical vectors of the last point, as a first guess for those of the next."""
    if kind is EventKind.NEIMARK_SACKER:
        return Vectors(np.column_stack([frame.right, frame.left]))
    return Vectors(frame.right[:, None].copy(), frame.right_period)


def first_frame(at: MapAt, basis: Matrix, angle: float | None = None) -> Frame | None:
    """A frame from nothing: singular vectors of the critical matrix, or the invariant plane of the complex
    pair nearest to the unit circle (nearest to exp(i angle) when the angle is given).  None when the pass
    diverges or there is no pair.
    """
    image = at.full_pass(basis)
    if not image.finite:
        return None
    nothing = np.zeros((basis.shape[0], 0))
    linear, _ = linearise(at, basis, image, nothing, np.zeros((0, 0)))
    columns = basis.shape[1]
    if at.problem.kind is not EventKind.NEIMARK_SACKER:
        left, _, right = np.linalg.svd(_critical_matrix(linear))
        tail_right, tail_left = (float(vector[columns:].sum()) for vector in (right[-1], left[:, -1]))
        vector = basis @ right[-1][:columns]
        if _with_period(at):
            vector = vector + linear.swept.columns[:, -1] * tail_right
        return Frame(vector, basis @ left[:columns, -1], tail_right, tail_left, _target(at.problem.kind))
    projected = basis.T @ image.columns
    pair = _starting_pair(projected, angle, at.problem.period_map.autonomous)
    plane = None if pair is None else _invariant_plane(projected, pair)
    if pair is None or plane is None:
        return None
    vectors = basis @ plane
    return Frame(vectors[:, 0].copy(), vectors[:, 1].copy(), kappa=0.5 * float(np.sum(pair).real))


def _starting_pair(projected: Matrix, angle: float | None, autonomous: bool) -> Complex | None:
    multipliers = nontrivial(np.linalg.eigvals(projected).astype(complex), autonomous)
    first, second = np.triu_indices(len(multipliers), k=1)
    total, product = multipliers[first] + multipliers[second], multipliers[first] * multipliers[second]
    real = np.abs(total.imag) + np.abs(product.imag) <= 1e-9 * (1.0 + np.abs(total))
    complex_pair = real & (np.abs(multipliers[first].imag) > 0.0)
    if angle is None:
        distance = np.where(complex_pair, np.abs(product - 1.0), np.inf)
    else:
        distance = np.where(real, np.abs(product - 1.0) + np.abs(total - 2.0 * math.cos(angle)), np.inf)
    if not np.any(np.isfinite(distance)):
        return None
    best = int(np.argmin(distance))
    return np.array([multipliers[first[best]], multipliers[second[best]]])
