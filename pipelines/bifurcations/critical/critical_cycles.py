"""Criticality of a cycle: its test function, the critical vectors and their derivatives.

The critical vectors R (N, m), M R = R A, travel with the slow basis V through every pass, because V is
invariant only to the accuracy of its last update.  Derivatives of a test function act from the left with
vectors of the whole space, whose part outside V is found without an adjoint: p'M = A p' gives

    p'x = p_V' V'x + sum_j A^(-j-1) p_V' V'M (Q M)^j Q x
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.critical.cycle_manifold import (
    RESIDUAL_TOLERANCE,
    ManifoldLinearisation,
    PicardColumns,
    linearise,
    period_unit,
    project_out,
)
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import MapAt, PlaneMetric, Position, map_slopes
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.system import Matrix, Vector

_LEFT_TOLERANCE = 1e-5  # of the derivatives of a test function: they only steer


@dataclass(frozen=True)
class BorderingVectors:
    """What the test function takes over from the last point of a curve.

    ``right``, ``left`` (N,): unit null vectors, the bordering of the next point, with the parts
    ``right_period`` and ``left_phase`` of a cycle of unknown period; a Neimark-Sacker curve keeps an
    orthonormal basis of the invariant plane in them, and ``cos_theta``.  Period parts are in units of
    ``cycle_manifold.period_unit``.
    """

    right: Vector
    left: Vector
    right_period: float = 0.0
    left_phase: float = 0.0
    cos_theta: float = 0.0


@dataclass(frozen=True)
class Critical:
    """The test function at one position and the vectors that carry its derivatives.

    ``value``: g; ``right`` (N, m): v or W; ``matrix`` (m, m): A, with M right = right A; ``left`` (k, m):
    slow part of the left vectors; ``weights`` (m, m): dg = sum(weights * (left' dM right));
    ``right_period``, ``left_phase``: parts of a fold of unknown period; ``alignment``: cosine between left
    and right null vector, which vanishes where a second multiplier joins (R1 on folds, R2 on period
    doublings); ``cos_theta``: half the trace of A; ``error``: estimated error of g from what the basis leaves
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
    cos_theta: float
    error: float


@dataclass(frozen=True)
class Vectors:
    """Critical vectors that are updated with the basis.

    ``columns`` (N, m) and, for a fold of unknown period, the ``period`` part.
    """

    columns: Matrix
    period: float = 0.0


@dataclass(frozen=True)
class CriticalPass:
    """A full pass with the critical vectors: the linearised surface, M ``vectors`` and their defect.

    ``matrix`` (m, m): A; ``defect`` (N, m): M R - R A; ``picard``: its Picard part; ``phase_defect``: of the
    phase row of a fold of unknown period.
    """

    linear: ManifoldLinearisation
    vectors: Vectors
    matrix: Matrix
    defect: Matrix
    phase_defect: float
    picard: PicardColumns


def critical_pass(
    at: MapAt, basis: Matrix, vectors: Vectors, warm: Matrix | None = None
) -> CriticalPass | None:
    """One full pass with the critical vectors and the sweeps that belong to it; None when it diverges."""
    image = at.full_pass(np.hstack([basis, vectors.columns]))
    return picard_pass(at, basis, vectors, image, warm) if image.finite else None


def picard_pass(
    at: MapAt, basis: Matrix, vectors: Vectors, image: PeriodImage, warm: Matrix | None = None
) -> CriticalPass:
    """The Picard sweeps for a full pass with the columns [basis, vectors]; ``warm`` as in ``linearise``."""
    kind, columns = at.problem.kind, basis.shape[1]
    mapped = image.columns[:, columns:]
    phase = image.phase_columns[columns:]
    image = replace(
        image,
        columns=np.ascontiguousarray(image.columns[:, :columns]),
        phase_columns=image.phase_columns[:columns].copy(),
    )
    matrix = np.array([[target_multiplier(kind)]])
    if kind is EventKind.NEIMARK_SACKER:
        # any A will do that makes the defect small; this one makes W'rho = 0
        matrix = np.linalg.solve(vectors.columns.T @ vectors.columns, vectors.columns.T @ mapped)
    defect, phase_defect = mapped - vectors.columns @ matrix, 0.0
    if with_period(at):
        period = vectors.period * period_unit(at, image)
        defect = defect + image.inhomogeneous[:, -1:] * period
        phase_defect = float(phase[0] + image.phase_inhomogeneous[-1] * period)
    linear, picard = linearise(at, basis, image, defect, np.linalg.inv(matrix), warm)
    return CriticalPass(linear, vectors, matrix, defect, phase_defect, picard)


def target_multiplier(kind: EventKind) -> float:
    """sigma: -1 for period doublings, 1 for folds."""
    return -1.0 if kind is EventKind.PERIOD_DOUBLING else 1.0


def with_period(at: MapAt) -> bool:
    """Whether the critical vectors have a part in the period: folds of cycles of unknown period."""
    return at.problem.kind is EventKind.FOLD and at.problem.period_map.autonomous


def basis_error(passed: CriticalPass, vectors: Matrix) -> float:
    """The error of the vectors because V is not invariant and the last sweep left a remainder."""
    linear = passed.linear
    slow = linear.basis.T @ vectors
    leak = np.linalg.norm(project_out(linear.basis, linear.image.columns @ slow)) / np.linalg.norm(slow)
    sweeps = 0.0 if slow.shape[0] == vectors.shape[0] else RESIDUAL_TOLERANCE
    return float(np.linalg.norm(passed.defect) / np.linalg.norm(vectors) * (leak + sweeps))


@dataclass(frozen=True)
class CriticalDerivatives:
    """Derivatives of g (``values``) and of the trace of A (``traces``), one number per direction."""

    values: Vector
    traces: Vector


def critical_derivatives(
    linear: ManifoldLinearisation,
    critical: Critical,
    directions: tuple[Position, ...],
    metric: PlaneMetric,
    sharp: bool = False,
) -> CriticalDerivatives:
    """dg and d tr A along each direction.

    From one pass with the m critical columns per direction, two if the period is unknown or it must be
    ``sharp``.
    """
    count = critical.right.shape[1]
    weights = None
    if critical.right_period is not None:
        weights = np.array([critical.right_period * linear.period_unit])
    slopes, phases = map_slopes(
        linear.at, linear.image, critical.right, weights, directions, linear.scale, metric, sharp
    )
    left = left_products(linear, critical, slopes, phases, _LEFT_TOLERANCE)
    parts = [left[:, count * i : count * (i + 1)] for i in range(len(directions))]
    return CriticalDerivatives(
        np.array([np.sum(critical.weights * part) for part in parts]),
        np.array([np.trace(part) for part in parts]),
    )


def left_products(
    linear: ManifoldLinearisation, critical: Critical, columns: Matrix, phases: Vector, tolerance: float
) -> Matrix:
    """p'x for all ``columns`` x (N, c) with their phase rows (c,): (m, c); relative ``tolerance``."""
    at, basis, passed = linear.at, linear.basis, linear.image
    total = critical.left.T @ (basis.T @ columns) + critical.left_phase * phases
    if basis.shape[0] == basis.shape[1]:
        return np.asarray(total)
    inverse = np.linalg.inv(critical.matrix)
    power, rest = inverse, project_out(basis, columns)
    for _ in range(at.problem.options.picard_sweeps):
        passed = at.with_columns(passed, rest)
        term = critical.left.T @ (basis.T @ passed.columns) + critical.left_phase * passed.phase_columns
        total = total + power @ term
        if np.max(np.abs(power @ term)) <= tolerance * np.max(np.abs(total)):
            break
        power, rest = inverse @ power, project_out(basis, passed.columns)
    return np.asarray(total)


def with_sharp_left(linear: ManifoldLinearisation, critical: Critical, tolerance: float) -> Critical:
    """The criticality with left vectors that do not inherit the error of the basis V.

    With R = Q M V, eliminating the part of L outside V from L'M = A L' leaves for Y = L'V, of shape (m, k),

        Y H + A^-1 Y V'M R + A^-2 Y V'M Q M R + ... = A Y

    for the price of all columns once more per term, down to ``tolerance``; Y V'W = 1 (or the old length of
    Y) makes it unique, and the pair may be complex, real or double.  A fold of unknown period is returned as
    it is.
    """
    basis, columns = linear.basis, linear.basis.shape[1]
    if basis.shape[0] == columns or critical.right_period is not None:
        return critical
    count, inverse = len(critical.matrix), np.linalg.inv(critical.matrix)
    projected = basis.T @ linear.image.columns
    system = np.kron(np.eye(count), projected.T) - np.kron(critical.matrix, np.eye(columns))
    rest, power, passed = project_out(basis, linear.image.columns), inverse, linear.image
    for _ in range(linear.at.problem.options.multiplier_sweeps):
        passed = linear.at.with_columns(passed, rest)
        term = basis.T @ passed.columns
        system += np.kron(power, term.T)
        if np.max(np.abs(term)) <= tolerance:
            break
        rest, power = project_out(basis, passed.columns), inverse @ power
    slow = basis.T @ critical.right
    across = critical.left if count == 1 else slow
    wanted = across.T @ across if count == 1 else np.eye(count)
    constraint = np.kron(np.eye(count), across.T)
    sides = np.concatenate([np.zeros(len(system)), wanted.ravel()])
    solution = np.linalg.lstsq(np.vstack([system, constraint]), sides)[0].reshape(count, columns)
    left = np.ascontiguousarray(solution.T)
    if count == 2:
        return replace(critical, left=left)
    lengths = float(np.linalg.norm(critical.right) * np.linalg.norm(left))
    return replace(critical, left=left, alignment=float(slow[:, 0] @ left[:, 0]) / lengths)
