"""The fully extended systems of the paper (Eq. 20, 21) in real form, with the critical vectors as unknowns.

At phase zero, with R = v or (Re w, Im w) of shape (N, m),

    period doubling, fold     M v - sigma v = 0,             <v, v> = 1
    Neimark-Sacker            M w - exp(i theta) w = 0,      <w, w> = 1,   Im <w_0, w> = 0

Newton's step is du = d_r + beta t on the surface of cycles, as in the bordered corrector.  Eliminating the
cycle leaves, for dR, dtheta and beta and with A(theta) the real form of the multiplier,

    M dR - dR A - R A' dtheta + beta D(M R)[t] = -(M R - R A) - D(M R)[d_r]

and dR = V Y + q with q A = Q (M q + x) for each right side x.  At theta = 0 and pi the system is singular.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.critical.bordering import vectors_of
from pipelines.bifurcations.critical.correction import (
    CriticalCycle,
    CurveConstraint,
    CurveCorrection,
    History,
    following,
)
from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    Critical,
    CriticalPass,
    Vectors,
    critical_pass,
)
from pipelines.bifurcations.critical.cycle_manifold import (
    ManifoldLinearisation,
    ManifoldStep,
    PicardColumns,
    manifold_step,
    picard_iteration,
)
from pipelines.bifurcations.critical.testfunctions import critical_of
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import MapAt, PlaneMetric, map_slopes
from pipelines.orbits.shooting import NewtonStop
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix, Vector


def correct_extended(
    at: MapAt, constraint: CurveConstraint, basis: Matrix, bordering: BorderingVectors
) -> CurveCorrection:
    """Newton's method for position, critical vectors and angle together, from the bordered solution."""
    history, kind = History(), at.problem.kind
    passed = critical_pass(at, basis, vectors_of(bordering, kind))
    if passed is None:
        return history.ended(NewtonStop.NON_FINITE)
    critical = critical_of(passed, bordering)
    if critical is None:
        return history.ended(NewtonStop.SINGULAR)
    vectors, angle = _first_vectors(critical)
    reference, passed = vectors, _mapped(passed, vectors)
    warm: Matrix | None = None
    for iteration in range(at.problem.options.iterations + 1):
        if iteration > 0:
            passed = critical_pass(at, basis, Vectors(vectors), warm)
            if passed is None:
                return history.ended(NewtonStop.NON_FINITE)
        linear = passed.linear
        defect = passed.defect + vectors @ (passed.matrix - _rotation(kind, angle)[0])
        size = float(np.max(np.abs(defect)) / np.max(np.abs(vectors)))
        history = history.and_then(max(linear.residual, constraint.error(at.position)), size)
        if history.converged(at.problem, 0.0):
            critical = critical_of(passed, bordering)
            if critical is None:
                return history.ended(NewtonStop.SINGULAR)
            return history.ended(NewtonStop.CONVERGED, CriticalCycle(linear, critical, constraint.gradient))
        if history.diverged:
            return history.given_up(NewtonStop.DIVERGED, at)
        if history.stuck(at.problem):
            return history.given_up(NewtonStop.STUCK, at)
        step = manifold_step(linear, (constraint.row, constraint.across), (constraint.gap(at.position), 0.0))
        if step is None:
            return history.ended(NewtonStop.SINGULAR)
        update = _extended_step(linear, vectors, angle, defect, reference, step, constraint.metric)
        if update is None:
            return history.ended(NewtonStop.SINGULAR)
        at = at.beside(step.correction.plus(step.across, update.beta), 1.0, linear.image)
        vectors, angle = vectors + update.vectors, angle + update.angle
        basis, warm = following(basis, linear.image.columns), linear.whole
        del passed, linear  # free the factors before the next pass makes its own
    return history.given_up(NewtonStop.ITERATIONS, at)


def _mapped(opening: CriticalPass, vectors: Matrix) -> CriticalPass:
    """The opening pass with other critical vectors, for the price of their columns alone."""
    mapped = opening.linear.mapped(vectors)
    return replace(opening, vectors=Vectors(vectors), defect=mapped - vectors @ opening.matrix)


def _first_vectors(critical: Critical) -> tuple[Matrix, float]:
    """v, or (Re w, Im w) with its angle, of unit length, from the bordered solution."""
    if critical.right.shape[1] == 1:
        return critical.right / np.linalg.norm(critical.right), 0.0
    multipliers, coefficients = np.linalg.eig(critical.matrix)
    upper = int(np.argmax(multipliers.imag))
    vector = critical.right @ coefficients[:, upper]
    vector = vector / np.linalg.norm(vector)
    angle = math.atan2(multipliers[upper].imag, multipliers[upper].real)
    return np.column_stack([vector.real, vector.imag]), angle


def _rotation(kind: EventKind, angle: float) -> tuple[Matrix, Matrix]:
    """A and dA/dtheta with M R = R A on the curve."""
    if kind is not EventKind.NEIMARK_SACKER:
        sigma = -1.0 if kind is EventKind.PERIOD_DOUBLING else 1.0
        return np.array([[sigma]]), np.zeros((1, 1))
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, sine], [-sine, cosine]]), np.array([[-sine, cosine], [-cosine, -sine]])


@dataclass(frozen=True)
class _ExtendedStep:
    vectors: Matrix
    angle: float
    beta: float


def _extended_step(
    linear: ManifoldLinearisation,
    vectors: Matrix,
    angle: float,
    defect: Matrix,
    reference: Matrix,
    step: ManifoldStep,
    metric: PlaneMetric,
) -> _ExtendedStep | None:
    """The Newton step of (R, theta, beta) for the system in this module's docstring, R = V Y + q."""
    at, basis, kind = linear.at, linear.basis, linear.at.problem.kind
    count, columns = vectors.shape[1], basis.shape[1]
    matrix, derivative = _rotation(kind, angle)
    directions = (step.correction, step.across)
    slopes, _ = map_slopes(at, linear.image, vectors, None, directions, linear.scale, metric)
    # sources of dR: the constant side, beta, theta
    parts = [defect + slopes[:, :count], slopes[:, count:]]
    if count == 2:
        parts.append(-vectors @ derivative)
    inverse = np.kron(np.eye(len(parts)), np.linalg.inv(matrix))
    sources = np.hstack(parts)
    picard = picard_iteration(at, linear.image, basis, sources, inverse, at.problem.options.picard_tolerance)
    solution = _solve_slow(linear, matrix, sources, picard, _normalisations(vectors, reference))
    if solution is None:
        return None
    size = count * columns
    factors = [1.0, *solution[size:]]
    slow = basis @ solution[:size].reshape(count, columns).T
    picard_parts = np.hsplit(picard.columns, len(parts))
    change = slow + sum(factor * part for factor, part in zip(factors, picard_parts, strict=True))
    turn = float(solution[size + 1]) if count == 2 else 0.0
    return _ExtendedStep(np.asarray(change), turn, float(solution[size]))


def _normalisations(vectors: Matrix, reference: Matrix) -> list[tuple[Matrix, float]]:
    """Rows and right sides of <R, dR> = (1 - <R, R>)/2 and Im <w_0, dw> = -Im <w_0, w>."""
    rows = [(vectors, 0.5 * (1.0 - float(np.sum(vectors * vectors))))]
    if vectors.shape[1] == 2:
        # Im <w_0, w> = <w_0r, w_i> - <w_0i, w_r>
        turned = np.column_stack([-reference[:, 1], reference[:, 0]])
        rows.append((turned, -float(np.sum(turned * vectors))))
    return rows


def _solve_slow(
    linear: ManifoldLinearisation,
    matrix: Matrix,
    sources: Matrix,
    picard: PicardColumns,
    rows: list[tuple[Matrix, float]],
) -> Vector | None:
    """(H Y - Y A) + V'(x_0 + M q_0) + sum_i factor_i V'(x_i + M q_i) = 0 with the normalising rows.

    Returns vec(Y), column by column, and the factors of the sources after the first.
    """
    basis, count = linear.basis, len(matrix)
    columns = basis.shape[1]
    size, blocks = count * columns, sources.shape[1] // count
    projected = basis.T @ linear.image.columns
    shares = [part.T.ravel() for part in np.hsplit(basis.T @ (sources + picard.image), blocks)]
    picard_parts = np.hsplit(picard.columns, blocks)
    system = np.zeros((size + len(rows), size + blocks - 1))
    right = np.zeros(size + len(rows))
    system[:size, :size] = np.kron(np.eye(count), projected) - np.kron(matrix.T, np.eye(columns))
    system[:size, size:] = np.column_stack(shares[1:])
    right[:size] = -shares[0]
    for i, (row, value) in enumerate(rows):
        system[size + i, :size] = (basis.T @ row).T.ravel()
        system[size + i, size:] = [float(np.sum(row * part)) for part in picard_parts[1:]]
        right[size + i] = value - float(np.sum(row * picard_parts[0]))
    return solve_or_none(system, right)
