"""The critical pair of a Neimark-Sacker curve: an invariant plane updated from point to point.

    M W = W A,    A (2, 2),    g = det A - 1 = mu_1 mu_2 - 1,    dg = tr(adj(A) L' dM W),    L'W = I

The plane and the trace 2 cos theta of A stay smooth at theta = 0 and pi, where eigenvectors do not.  With
W = W_old + V a + q, closed by W_old'(W - W_old) = 0, Newton's method for a and A is

    | H a - a A   -V'W | | a  |     | V'(M W - W A)      |
    | W_old'V      0   | | dA | = - | W_old'(W - W_old)  |
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    Critical,
    CriticalPass,
    basis_error,
)
from pipelines.orbits.floquet import Complex
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix

_PAIR_ITERATIONS = 12  # they cost no passes
_SINGULAR = 1e12  # condition of L'W beyond which the planes do not belong together
_PAIR_TOLERANCE = 1e-12  # of the last change


def invariant_pair(passed: CriticalPass, bordering: BorderingVectors) -> Critical | None:
    """The test function of a Neimark-Sacker point; None if the pair cannot be separated from the others."""
    basis = passed.linear.basis
    solved = _pair_in_basis(passed, np.column_stack([bordering.right, bordering.left]))
    if solved is None:
        return None
    vectors, matrix = solved
    projected = basis.T @ passed.linear.image.columns
    left = invariant_plane(projected.T, np.linalg.eigvals(matrix).astype(complex))
    if left is None:
        return None
    overlap = (basis.T @ vectors).T @ left
    if not np.linalg.cond(overlap) < _SINGULAR:
        return None
    left = left @ np.linalg.inv(overlap)
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
        cos_theta=0.5 * float(np.trace(matrix)),
        error=basis_error(passed, vectors),
    )


def _pair_in_basis(passed: CriticalPass, fixed: Matrix) -> tuple[Matrix, Matrix] | None:
    """W and A by Newton's method on a and A, with the Picard part fixed.

    M W is known for every W = W_old + V a + q, so that the iterations cost no passes.
    """
    basis, picard = passed.linear.basis, passed.picard
    columns = basis.shape[1]
    vectors, matrix = passed.vectors.columns + picard.columns, passed.matrix
    mapped = passed.defect + passed.vectors.columns @ matrix + picard.image
    projected = basis.T @ passed.linear.image.columns
    constraint = fixed.T @ basis
    # the columns of V a that W_old'(W - W_old) = 0 fixes
    normal = fixed.T @ passed.vectors.columns
    size = 2 * columns
    for _ in range(_PAIR_ITERATIONS):
        defect = basis.T @ (mapped - vectors @ matrix)
        # unknowns a (k, 2) and dA (2, 2), row by row: vec(H a - a A) = (H x I - I x A') vec(a)
        system = np.zeros((size + 4, size + 4))
        system[:size, :size] = np.kron(projected, np.eye(2)) - np.kron(np.eye(columns), matrix.T)
        system[:size, size:] = -np.kron(basis.T @ vectors, np.eye(2))
        system[size:, :size] = np.kron(constraint, np.eye(2))
        right = np.concatenate([-defect.ravel(), (normal - fixed.T @ vectors).ravel()])
        solution = solve_or_none(system, right)
        if solution is None:
            return None
        change = solution[:size].reshape(columns, 2)
        vectors, mapped = vectors + basis @ change, mapped + passed.linear.image.columns @ change
        matrix = matrix + solution[size:].reshape(2, 2)
        if np.max(np.abs(solution)) <= _PAIR_TOLERANCE:
            return vectors, matrix
    return None


def invariant_plane(matrix: Matrix, pair: Complex) -> Matrix | None:
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
