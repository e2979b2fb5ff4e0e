"""Test functions of the kinds of curves: eigenvalue -1 or 1 in the slow subspace, or a critical pair.

With H = V'MV, the bordered (minimally augmented) condition of a period doubling (sigma = -1) or of a fold of
cycles of known period (sigma = 1) is g = 0 in

    | M - sigma I   b | | v |   | 0 |        | M' - sigma I   c | | p |   | 0 |
    | c'            0 | | g | = | 1 |        | b'             0 | | g | = | 1 |       dg = -p' dM v

b and c being the null vectors of the last point.  What the travelling v leaves, rho = M v - sigma v, is
corrected by dv = V a + q with q sigma = Q (M q + rho), in the same sweeps as the cycle:

    | H - sigma I   V'b | | a |     | V'(rho + M q) |
    | c'V           0   | | g | = - | c'(v + q) - 1 |

A fold of unknown period takes the cycle Jacobian instead, with phi_T as a further column and the phase
condition as a further row.
"""

from __future__ import annotations

import math

import numpy as np

from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    Critical,
    CriticalPass,
    basis_error,
    target_multiplier,
    with_period,
)
from pipelines.bifurcations.critical.critical_pair import invariant_pair
from pipelines.bifurcations.critical.cycle_manifold import ManifoldLinearisation
from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix


def critical_of(passed: CriticalPass, bordering: BorderingVectors) -> Critical | None:
    """The test function of the problem's kind; None when its bordered matrix is singular."""
    if passed.linear.at.problem.kind is EventKind.NEIMARK_SACKER:
        return invariant_pair(passed, bordering)
    return _bordered(passed, bordering)


def _bordered(passed: CriticalPass, bordering: BorderingVectors) -> Critical | None:
    linear, picard = passed.linear, passed.picard
    matrix, basis = critical_matrix(linear), linear.basis
    size, columns = len(matrix), basis.shape[1]
    border = np.append(basis.T @ bordering.left, bordering.left_phase)[:size]
    constraint = np.append(basis.T @ bordering.right, bordering.right_period)[:size]
    system = np.block([[matrix, border[:, None]], [constraint[None, :], np.zeros((1, 1))]])
    old = passed.vectors
    rest = np.append(basis.T @ (passed.defect + picard.image), passed.phase_defect + picard.phase[0])[:size]
    gap = bordering.right @ (old.columns + picard.columns)[:, 0] + bordering.right_period * old.period - 1.0
    update = solve_or_none(system, -np.append(rest, gap))
    left = solve_or_none(system.T, np.append(np.zeros(size), 1.0))
    if update is None or left is None:
        return None
    vector = old.columns[:, 0] + basis @ update[:columns] + picard.columns[:, 0]
    period = None
    if size > columns:
        period = old.period + float(update[columns])
        vector = vector + linear.picard.columns[:, -1] * linear.period_unit * update[columns]
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
        cos_theta=float(passed.matrix[0, 0]),
        error=basis_error(passed, vector[:, None]),
    )


def critical_matrix(linear: ManifoldLinearisation) -> Matrix:
    """H - sigma I, bordered by phi_T and the phase condition for a fold of unknown period."""
    basis, image, picard = linear.basis, linear.image, linear.picard
    matrix = basis.T @ image.columns - target_multiplier(linear.at.problem.kind) * np.eye(basis.shape[1])
    if not with_period(linear.at):
        return np.asarray(matrix)
    column = linear.period_unit * (basis.T @ (linear.sources[:, -1] + picard.image[:, -1]))
    corner = linear.period_unit * (image.phase_inhomogeneous[-1] + picard.phase[-1])
    return np.block([[matrix, column[:, None]], [image.phase_columns[None, :], np.array([[corner]])]])
