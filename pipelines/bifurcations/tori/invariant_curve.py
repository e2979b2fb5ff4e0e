"""Invariant curves of a map over a circle, by Fourier collocation and Newton-Picard.

The curve x(theta) has P(x(theta); theta) = x(theta + rho).  Its values x_j at M equally spaced angles are a
fixed point of the graph transform, with the shift S of ``circle``:

    Phi(X) = S(-rho) P(X),     Phi(X) - X = r = 0,     D = dPhi/dX = S(-rho) diag(M_j)

D v has the values of the transported field M(theta) v(theta) at the angle that it is carried to.  Strongly
contracted fields die under D, so Newton's method is wanted only on fields in the slow subspaces span V_j,
V_j (N, k) orthonormal: with dX = V a + q, Q = I - V V' at every angle and q_x = Q (D q_x + x) found by Picard
sweeps for x = r, Phi_rho and Phi_l,

    | V'(D-I)V     V'(Phi_rho + D q_rho)    V'(Phi_l + D q_l)   | | a    |     | V'(r + D q_r)   |
    | g V          g q_rho                  g q_l               | | drho | = - | g (X - X_ref)   |
    | row_x V      row_rho + row_x q_rho    row_l + row_x q_l   | | dl   |     | gap + row_x q_r |

    V'D V = [ S(-rho)_ji  V_j' M_i V_i ],     Phi_rho = -S'(-rho) P(X),     Phi_l = S(-rho) P_l

g = dX_ref/dtheta is the phase condition of an unknown rho.  With a known one its row and column are absent
and Phi_l gains Phi_rho drho/dl.

The V_j move along the curve (``slow_bases``): a basis common to all angles would have to hold the union of
the slow subspaces, and what it lacks enters the Picard sweeps to first order, because M is not normal.  After
each iteration V_j <- orth (D V)_j, whose columns the pass has brought anyway.  With k = N, V_j is the
identity and the method is Newton's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.continuation import one_history
from pipelines.bifurcations.tori.fourier import amplitudes, applied, resampled, shift_matrix, tail
from pipelines.bifurcations.tori.problem import (
    TorusConstraint,
    TorusProblem,
    TorusUnknowns,
    resampled_constraint,
)
from pipelines.bifurcations.tori.slow_bases import SlowBases
from pipelines.bifurcations.tori.system import (
    CirclePass,
    PhaseRow,
    carried,
    linearise,
    pass_from_all,
    solve_bordered,
)
from pipelines.orbits.shooting import NewtonStop
from pipelines.orbits.system import Matrix, size_of

_DIVERGENCE = 1e3  # growth of the residual over its smallest value that no Newton iteration recovers from


@dataclass(frozen=True)
class Torus:
    """A corrected invariant curve.

    ``bases``: slow subspaces; ``passed``: the last pass, whose columns are M_j V_j; ``residual``:
    largest entry of Phi(X) - X, relative to the largest entry of X; ``error``: what the Fourier series
    lacks, relative to the same.
    """

    unknowns: TorusUnknowns
    bases: SlowBases
    passed: CirclePass
    residual: float
    error: float

    @property
    def count(self) -> int:
        return len(self.unknowns.states)


@dataclass(frozen=True)
class TorusCorrection:
    """Result of the corrector: the curve if it converged, else None, and the history of both norms.

    ``rough``: it converged, but its Fourier series does not meet its tolerance with the most angles allowed.
    """

    stop: NewtonStop
    torus: Torus | None
    residual_norms: tuple[float, ...]
    update_norms: tuple[float, ...]
    rough: bool = False

    @property
    def iterations(self) -> int:
        return len(self.update_norms)


def correct_torus(
    problem: TorusProblem,
    guess: TorusUnknowns,
    constraint: TorusConstraint,
    bases: SlowBases,
    reference: Matrix | None = None,
) -> TorusCorrection:
    """Find the invariant curve near ``guess`` that satisfies ``constraint``.

    It gets as many angles as its Fourier series needs, but not fewer than the guess has.

    ``bases``: of the slow subspaces at the angles of the guess; ``reference`` (M, N): curve that fixes the
    phase of a curve with unknown rho.  Failure is a result: see ``TorusCorrection``.  Raises ValueError when
    the reference is missing.
    """
    correction = correct_on_angles(problem, guess, constraint, bases, reference)
    while correction.torus is not None and correction.torus.error > problem.fourier.tolerance:
        count = 2 * correction.torus.count + 1
        if count > problem.fourier.most:
            return replace(correction, rough=True)
        constraint = resampled_constraint(constraint, count)
        reference = None if reference is None else resampled(reference, count)
        finer = correct_on_angles(
            problem,
            correction.torus.unknowns.resampled(count),
            constraint,
            correction.torus.bases.resampled(count),
            reference,
        )
        correction = one_history(correction, finer)
    return correction


def correct_on_angles(
    problem: TorusProblem,
    guess: TorusUnknowns,
    constraint: TorusConstraint,
    bases: SlowBases,
    reference: Matrix | None = None,
) -> TorusCorrection:
    """Find the invariant curve with exactly the angles of the guess."""
    if problem.circle.rotation(guess.parameter) is None and reference is None:
        raise ValueError("an unknown rotation needs a reference curve for its phase")
    unknowns, options = problem.consistent(guess), problem.options
    phase = None if reference is None else PhaseRow.of(reference)
    residuals: list[float] = []
    updates: list[float] = []

    def ended(stop: NewtonStop, torus: Torus | None = None) -> TorusCorrection:
        return TorusCorrection(stop, torus, tuple(residuals), tuple(updates))

    while True:
        passed = pass_from_all(problem, unknowns, bases.columns, True)
        if not passed.finite:
            return ended(NewtonStop.NON_FINITE)
        scale = size_of(unknowns.states)
        defect = float(np.max(np.abs(carried(unknowns, passed.images) - unknowns.states))) / scale
        gap = 0.0 if phase is None else abs(phase.gap(unknowns.states))
        residuals.append(max(defect, constraint.error(unknowns), gap))
        if residuals[-1] <= options.tolerance:
            error = tail(amplitudes(unknowns.states)) / scale
            return ended(NewtonStop.CONVERGED, Torus(unknowns, bases, passed, residuals[-1], error))
        if residuals[-1] > _DIVERGENCE * min(residuals):
            return ended(NewtonStop.DIVERGED)
        if len(updates) == options.iterations:
            return ended(NewtonStop.ITERATIONS)
        linear = linearise(problem, unknowns, bases.columns, passed)
        offset = 0.0 if phase is None else phase.gap(unknowns.states)
        update = solve_bordered(linear, phase, offset, constraint.row, constraint.gap(unknowns))
        if update is None:
            return ended(NewtonStop.SINGULAR)
        bases = bases.following(passed.columns, unknowns.rotation)
        unknowns = problem.consistent(unknowns.plus(update))
        parameter = abs(update.parameter) / size_of(unknowns.parameter)
        updates.append(max(float(np.max(np.abs(update.states))) / scale, abs(update.rotation), parameter))


def torus_tangent(
    problem: TorusProblem, torus: Torus, row: TorusUnknowns, reference: Matrix | None
) -> TorusUnknowns | None:
    """The direction (dX, drho, dl) of the family with row . direction = 1; None when it is singular.

    It solves the bordered system with r = 0 and gap = -1.
    """
    exact = replace(torus.passed, images=_preimage(torus.unknowns))
    linear = linearise(problem, torus.unknowns, torus.bases.columns, exact)
    phase = None if reference is None else PhaseRow.of(reference)
    direction = solve_bordered(linear, phase, 0.0, row, -1.0)
    known = problem.circle.rotation(torus.unknowns.parameter)
    if direction is None or known is None:
        return direction
    return replace(direction, rotation=known[1] * direction.parameter)


def _preimage(unknowns: TorusUnknowns) -> Matrix:
    """The images of an exactly invariant curve."""
    return applied(shift_matrix(len(unknowns.states), unknowns.rotation)[0], unknowns.states)
