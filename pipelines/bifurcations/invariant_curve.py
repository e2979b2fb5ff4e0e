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

from pipelines.bifurcations.circle import (
    Array,
    amplitudes,
    angles,
    applied,
    derivative,
    resampled,
    shift_matrix,
    tail,
)
from pipelines.bifurcations.slow_bases import SlowBases
from pipelines.bifurcations.torus_problem import TorusConstraint, TorusProblem, TorusUnknowns
from pipelines.orbits.shooting import NewtonStop
from pipelines.orbits.system import Matrix, Vector

_DIVERGENCE = 1e3  # growth of the residual over its smallest value that no Newton iteration recovers from


@dataclass(frozen=True)
class CirclePass:
    """One pass from every angle: ``images`` (M, N), ``columns`` (M, N, m), ``by_parameter`` (M, N)."""

    images: Matrix
    columns: Array
    by_parameter: Matrix
    finite: bool


@dataclass(frozen=True)
class Torus:
    """A corrected invariant curve.

    ``bases``: slow subspaces; ``passed``: the last pass, whose columns are M_j V_j; ``residual``:
    largest entry of Phi(X) - X, relative to max(1, largest entry of X); ``error``: what the Fourier series
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
        constraint = constraint.resampled(count)
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


def one_history(first: TorusCorrection, second: TorusCorrection) -> TorusCorrection:
    """The second correction with the history of both."""
    return replace(
        second,
        residual_norms=first.residual_norms + second.residual_norms,
        update_norms=first.update_norms + second.update_norms,
    )


def correct_on_angles(
    problem: TorusProblem,
    guess: TorusUnknowns,
    constraint: TorusConstraint,
    bases: SlowBases,
    reference: Matrix | None = None,
) -> TorusCorrection:
    """The same with exactly the angles of the guess."""
    if problem.circle.rotation(guess.parameter) is None and reference is None:
        raise ValueError("an unknown rotation needs a reference curve for its phase")
    unknowns, options = problem.consistent(guess), problem.options
    phase = None if reference is None else _PhaseRow.of(reference)
    residuals: list[float] = []
    updates: list[float] = []

    def ended(stop: NewtonStop, torus: Torus | None = None) -> TorusCorrection:
        return TorusCorrection(stop, torus, tuple(residuals), tuple(updates))

    while True:
        passed = pass_from_all(problem, unknowns, bases.columns, True)
        if not passed.finite:
            return ended(NewtonStop.NON_FINITE)
        scale = max(1.0, float(np.max(np.abs(unknowns.states))))
        defect = float(np.max(np.abs(carried(unknowns, passed.images) - unknowns.states))) / scale
        gap = 0.0 if phase is None else abs(phase.gap(unknowns.states))
        residuals.append(max(defect, abs(constraint.gap(unknowns)), gap))
        if residuals[-1] <= options.tolerance:
            error = tail(amplitudes(unknowns.states)) / scale
            return ended(NewtonStop.CONVERGED, Torus(unknowns, bases, passed, residuals[-1], error))
        if residuals[-1] > _DIVERGENCE * min(residuals):
            return ended(NewtonStop.DIVERGED)
        if len(updates) == options.iterations:
            return ended(NewtonStop.ITERATIONS)
        linear = _linearise(problem, unknowns, bases.columns, passed)
        offset = 0.0 if phase is None else phase.gap(unknowns.states)
        update = _solve_bordered(linear, phase, offset, constraint.row, constraint.gap(unknowns))
        if update is None:
            return ended(NewtonStop.SINGULAR)
        bases = bases.following(passed.columns, unknowns.rotation)
        unknowns = problem.consistent(unknowns.plus(update))
        updates.append(float(np.max(np.abs(update.states))) + abs(update.rotation) + abs(update.parameter))


def torus_tangent(
    problem: TorusProblem, torus: Torus, row: TorusUnknowns, reference: Matrix | None
) -> TorusUnknowns | None:
    """The direction (dX, drho, dl) of the family with row . direction = 1; None when it is singular.

    It solves the bordered system with r = 0 and gap = -1.
    """
    exact = replace(torus.passed, images=_preimage(torus.unknowns))
    linear = _linearise(problem, torus.unknowns, torus.bases.columns, exact)
    phase = None if reference is None else _PhaseRow.of(reference)
    direction = _solve_bordered(linear, phase, 0.0, row, -1.0)
    known = problem.circle.rotation(torus.unknowns.parameter)
    if direction is None or known is None:
        return direction
    return replace(direction, rotation=known[1] * direction.parameter)


def _preimage(unknowns: TorusUnknowns) -> Matrix:
    """The images of an exactly invariant curve."""
    return applied(shift_matrix(len(unknowns.states), unknowns.rotation)[0], unknowns.states)


def pass_from_all(
    problem: TorusProblem, unknowns: TorusUnknowns, columns: Array, with_parameter: bool
) -> CirclePass:
    """One pass of the map from every angle with its own columns (M, N, m)."""
    count, size, width = columns.shape
    images, slopes = np.empty((count, size)), np.empty((count, size))
    block, finite = np.empty((count, size, width)), True
    for j, angle in enumerate(angles(count)):
        image = problem.circle.evaluate(
            unknowns.states[j], float(angle), unknowns.parameter, columns[j], with_parameter
        )
        images[j], block[j], slopes[j] = image.state, image.columns, image.by_parameter
        finite = finite and image.finite
        if not finite:
            break
    return CirclePass(images, block, slopes, finite)


def carried(unknowns: TorusUnknowns, values: Array) -> Array:
    """S(-rho) values: what a pass brings to the angles themselves, shape (M, ...)."""
    return applied(shift_matrix(len(values), -unknowns.rotation)[0], values)


@dataclass(frozen=True)
class _PhaseRow:
    """mean_j <g_j, x_j> = offset with g = dX_ref/dtheta, divided by the mean square of g."""

    row: Matrix
    offset: float

    @classmethod
    def of(cls, reference: Matrix) -> _PhaseRow:
        slope = derivative(reference)
        size = float(np.vdot(slope, slope))
        row = slope / size if size > 0.0 else slope
        return cls(row, float(np.vdot(row, reference)))

    def gap(self, states: Matrix) -> float:
        return float(np.vdot(self.row, states)) - self.offset


@dataclass(frozen=True)
class _Linearised:
    """``reduced`` (M k, M k): V'D V; ``sources`` and ``swept``, ``swept_image`` (M, N, c): x, q_x and D q_x
    for r, Phi_l and, when rho is unknown, Phi_rho.
    """

    bases: Array
    reduced: Matrix
    sources: Array
    swept: Array
    swept_image: Array


def _linearise(
    problem: TorusProblem, unknowns: TorusUnknowns, bases: Array, passed: CirclePass
) -> _Linearised:
    count = len(bases)
    shift, slope = shift_matrix(count, -unknowns.rotation)
    by_parameter, by_rotation = applied(shift, passed.by_parameter), -applied(slope, passed.images)
    known = problem.circle.rotation(unknowns.parameter)
    residual = applied(shift, passed.images) - unknowns.states
    if known is None:
        sources = np.stack([residual, by_parameter, by_rotation], axis=2)
    else:
        sources = np.stack([residual, by_parameter + known[1] * by_rotation], axis=2)
    swept, image = _sweep(problem, unknowns, bases, shift, sources)
    return _Linearised(bases, reduced_transport(bases, passed.columns, shift), sources, swept, image)


def reduced_transport(bases: Array, columns: Array, shift: Matrix) -> Matrix:
    """V'D V: blocks S_ji V_j' M_i V_i, shape (M k, M k)."""
    count, size, width = bases.shape
    left = np.swapaxes(bases, 1, 2).reshape(count * width, size)
    right = np.moveaxis(columns, 1, 0).reshape(size, count * width)
    blocks = (left @ right).reshape(count, width, count, width)
    blocks *= shift[:, None, :, None]
    return blocks.reshape(count * width, count * width)


def _outside(bases: Array, values: Array) -> Array:
    """Q x = x - V V'x at every angle, for values (M, N, c)."""
    return np.asarray(values - bases @ (np.swapaxes(bases, 1, 2) @ values))


def _sweep(
    problem: TorusProblem, unknowns: TorusUnknowns, bases: Array, shift: Matrix, sources: Array
) -> tuple[Array, Array]:
    """q <- Q (D q + x) until a sweep moves every q by little against its x; q and D q."""
    if bases.shape[1] == bases.shape[2]:
        return np.zeros_like(sources), np.zeros_like(sources)
    swept, image = _outside(bases, sources), np.zeros_like(sources)
    sizes = np.linalg.norm(sources, axis=(0, 1))
    for _ in range(problem.options.picard_sweeps):
        passed = pass_from_all(problem, unknowns, np.ascontiguousarray(swept), False)
        image = applied(shift, passed.columns)
        following = _outside(bases, image + sources)
        moved = np.linalg.norm(following - swept, axis=(0, 1))
        if np.all(moved <= problem.options.picard_tolerance * sizes):
            break
        swept = following
    return swept, image


def _solve_bordered(
    linear: _Linearised, phase: _PhaseRow | None, offset: float, row: TorusUnknowns, gap: float
) -> TorusUnknowns | None:
    """The update (dX, drho, dl) of the system drawn at the head of this module."""
    count, _, width = linear.bases.shape
    inner, tails = count * width, linear.sources.shape[2] - 1
    matrix, right = np.empty((inner + tails, inner + tails)), np.empty(inner + tails)
    projected = np.swapaxes(linear.bases, 1, 2) @ (linear.sources + linear.swept_image)
    projected = projected.reshape(inner, tails + 1)
    # V'(D - I)V a + V'(Phi_l + D q_l) dl + V'(Phi_rho + D q_rho) drho = -V'(r + D q_r)
    matrix[:inner, :inner] = linear.reduced
    matrix[np.arange(inner), np.arange(inner)] -= 1.0
    matrix[:inner, inner:] = projected[:, 1:]
    right[:inner] = -projected[:, 0]
    # row_x (V a + q) + row_l dl + row_rho drho = -gap
    direct = np.array([row.parameter, row.rotation])[:tails]
    matrix[inner], right[inner] = _border(linear, row.states, direct, gap)
    if phase is not None and tails == 2:
        # g (V a + q) = -(g X - g X_ref)
        matrix[inner + 1], right[inner + 1] = _border(linear, phase.row, np.zeros(2), offset)
    try:
        solution = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(solution)):
        return None
    weights = np.concatenate([[1.0], solution[inner:]])
    inside = linear.bases @ solution[:inner].reshape(count, width, 1)
    states = inside[:, :, 0] + linear.swept @ weights
    rotation = float(solution[inner + 1]) if tails == 2 else 0.0
    return TorusUnknowns(np.ascontiguousarray(states), rotation, float(solution[inner]))


def _border(linear: _Linearised, row: Matrix, direct: Vector, gap: float) -> tuple[Vector, float]:
    """One closing row in the unknowns of the small system, and its right side."""
    inside = (row[:, None, :] @ linear.bases).ravel()
    swept: Vector = np.tensordot(row, linear.swept, axes=2)
    return np.concatenate([inside, direct + swept[1:]]), -gap - float(swept[0])
