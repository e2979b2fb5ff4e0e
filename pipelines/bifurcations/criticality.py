"""Correctors of a bifurcation curve: the cycle, its criticality and the closing row together.

Both walk on the surface of cycles of ``pipelines.bifurcations.plane``: a step is the Newton correction
towards the surface plus beta times the tangent ``across`` that leaves the closing row alone,

    du = d_r + beta t,      row . t = 0

The bordered corrector finds beta from the test function g.  Its gradient row gamma is known on the two
tangents of the last point and learnt elsewhere by Broyden updates, which costs no passes, and measured only
where that does not get on:

    beta = -(g + gamma d_r)/(gamma t),      gamma += (dg - gamma du)/<du, du> <du, .>

The extended corrector has the critical vectors R (N, m) as unknowns (Eq. 20, 21 in real form at phase zero):

    period doubling, fold     M v - sigma v = 0,                  <v, v> = 1
    Neimark-Sacker            M w - exp(i theta) w = 0,           <w, w> = 1,   Im <w_0, w> = 0

Eliminating the cycle from its Newton matrix leaves, for dR, dtheta and beta,

    M dR - dR A - R A' dtheta + beta D(M R)[t] = -(M R - R A) - D(M R)[d_r]
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.critical import (
    Critical,
    CriticalPass,
    Frame,
    Vectors,
    critical_derivatives,
    critical_of,
    critical_pass,
    swept_pass,
    vectors_of,
)
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import (
    CurveFormulation,
    CurveProblem,
    MapAt,
    PlaneMetric,
    Position,
    SurfaceLinearisation,
    SurfaceStep,
    map_slopes,
    surface_step,
    sweep,
)
from pipelines.orbits.floquet import floquet_spectrum, orthonormal
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import NewtonStop
from pipelines.orbits.system import Matrix

_DIVERGENCE = 1e3  # growth of the residual over its smallest value that no Newton iteration recovers from
_BROYDEN_NOISE = 0.1  # share of a change of g that the settling of the basis may explain
_STALLED = 0.5  # reduction of g in one step that asks for its exact derivatives


@dataclass(frozen=True)
class Closing:
    """What fixes one point of a curve: row . u = value.

    ``across``: a row that tells the second tangent of the surface from the first; ``gradient``: the row
    gamma of the test function; ``metric`` measures its Broyden updates.
    """

    row: Position
    value: float
    across: Position
    gradient: Position
    metric: PlaneMetric

    def gap(self, position: Position) -> float:
        return self.row.dot(position) - self.value


@dataclass(frozen=True)
class CriticalCycle:
    """A corrected point of a curve: the map there and its criticality, both in the basis of the last pass.

    ``gradient``: the row of the test function as the corrector has learnt it.
    """

    linear: SurfaceLinearisation
    critical: Critical
    gradient: Position

    @property
    def position(self) -> Position:
        return self.linear.at.position

    @property
    def basis(self) -> Matrix:
        return self.linear.basis

    @property
    def steps(self) -> int:
        return self.linear.at.steps


@dataclass(frozen=True)
class CurveCorrection:
    """Result of a corrector: the critical cycle if it converged, else None, and both histories."""

    stop: NewtonStop
    point: CriticalCycle | None
    residual_norms: tuple[float, ...]
    test_values: tuple[float, ...]

    @property
    def iterations(self) -> int:
        return max(0, len(self.residual_norms) - 1)


def correct_critical(
    problem: CurveProblem,
    guess: Position,
    closing: Closing,
    basis: Matrix,
    frame: Frame,
    steps: int,
    reference: PhaseReference | None,
) -> CurveCorrection:
    """The point of the curve near ``guess`` on the closing row, in the formulation of the problem.

    Failure is a result: see ``CurveCorrection.stop``.  Raises ValueError when an unknown period has no phase
    reference.
    """
    if problem.period_map.autonomous and reference is None:
        raise ValueError("an unknown period needs a phase reference")
    at = MapAt(problem, problem.consistent(guess), steps, reference)
    if problem.formulation is CurveFormulation.EXTENDED:
        return _correct_extended(at, closing, basis, frame)
    return _correct_bordered(at, closing, basis, frame)


@dataclass(frozen=True)
class _History:
    """Residual norms and test values of the passes so far."""

    residual_norms: tuple[float, ...] = ()
    test_values: tuple[float, ...] = ()

    def and_then(self, residual: float, value: float) -> _History:
        return _History((*self.residual_norms, residual), (*self.test_values, value))

    def converged(self, problem: CurveProblem, invariance: float) -> bool:
        """Whether the cycle, its criticality and the critical vectors all meet their tolerances."""
        options = problem.options
        critical = max(abs(self.test_values[-1]), invariance) <= options.multiplier_tolerance
        return critical and self.residual_norms[-1] <= options.tolerance

    @property
    def stalls(self) -> bool:
        """Whether the last step did not even halve the test function."""
        values = self.test_values
        return len(values) > 1 and abs(values[-1]) > _STALLED * abs(values[-2])

    @property
    def diverged(self) -> bool:
        """Whether the sum of both grew beyond recovery."""
        sizes = [r + abs(g) for r, g in zip(self.residual_norms, self.test_values, strict=True)]
        return sizes[-1] > max(1.0, _DIVERGENCE * min(sizes))

    def ended(self, stop: NewtonStop, point: CriticalCycle | None = None) -> CurveCorrection:
        return CurveCorrection(stop, point, self.residual_norms, self.test_values)


def settled(found: CriticalCycle, frame: Frame, tolerance: float) -> CriticalCycle:
    """The same point after as many subspace iterations as its multipliers and left vectors need.

    ``tolerance``: residual asked of every multiplier above ``checked_modulus``, with at most
    ``multiplier_sweeps`` passes; the point itself does not depend on the basis.
    """
    at, options = found.linear.at, found.linear.at.problem.options
    basis, image = found.basis, found.linear.image
    vectors = Vectors(found.critical.right, found.critical.right_period or 0.0)
    for _ in range(options.multiplier_sweeps):
        spectrum = floquet_spectrum(basis, image.columns[:, : basis.shape[1]])
        if np.all(spectrum.residuals[np.abs(spectrum.multipliers) > options.checked_modulus] <= tolerance):
            break
        basis = following(basis, image.columns[:, : basis.shape[1]])
        image = at.full_pass(np.hstack([basis, vectors.columns]))
    if basis is found.basis:
        return found
    passed = swept_pass(at, basis, vectors, image, found.linear)
    critical = critical_of(passed, frame)
    return found if critical is None else CriticalCycle(passed.linear, critical, found.gradient)


def _correct_bordered(at: MapAt, closing: Closing, basis: Matrix, frame: Frame) -> CurveCorrection:
    history, vectors = _History(), vectors_of(frame, at.problem.kind)
    gradient, last = closing.gradient, 0.0
    moved: Position | None = None
    linear: SurfaceLinearisation | None = None
    for _ in range(at.problem.options.iterations + 1):
        passed = critical_pass(at, basis, vectors, linear)
        if passed is None:
            return history.ended(NewtonStop.NON_FINITE)
        critical = critical_of(passed, frame)
        if critical is None:
            return history.ended(NewtonStop.SINGULAR)
        linear = passed.linear
        if moved is not None:
            gradient = _learnt(gradient, moved, critical.value - last, critical.error, closing.metric)
        history = history.and_then(max(linear.residual, abs(closing.gap(at.position))), critical.value)
        if history.converged(at.problem, critical.error):
            return history.ended(NewtonStop.CONVERGED, CriticalCycle(linear, critical, gradient))
        if history.diverged:
            return history.ended(NewtonStop.DIVERGED)
        step = surface_step(linear, (closing.row, closing.across), (closing.gap(at.position), 0.0))
        if step is None:
            return history.ended(NewtonStop.SINGULAR)
        if history.stalls:
            gradient = _measured(linear, critical, gradient, step, closing.metric)
        slope = gradient.dot(step.across)
        if slope == 0.0:
            return history.ended(NewtonStop.SINGULAR)
        # beta = -(g + gamma d_r)/(gamma t)
        beta = -(critical.value + gradient.dot(step.correction)) / slope
        moved, last = step.correction.plus(step.across, beta), critical.value
        at, basis = at.beside(moved, 1.0), following(basis, linear.image.columns)
        vectors = Vectors(critical.right, critical.right_period or 0.0)
    return history.ended(NewtonStop.ITERATIONS)


def _learnt(
    gradient: Position, moved: Position, change: float, noise: float, metric: PlaneMetric
) -> Position:
    """Broyden: gamma += (dg - gamma du)/<du, du> <du, .>, unless dg is only the basis settling."""
    size = metric.inner(moved, moved)
    if size == 0.0 or noise > _BROYDEN_NOISE * abs(change):
        return gradient
    return gradient.plus(metric.row(moved), (change - gradient.dot(moved)) / size)


def _measured(
    linear: SurfaceLinearisation,
    critical: Critical,
    gradient: Position,
    step: SurfaceStep,
    metric: PlaneMetric,
) -> Position:
    """The gradient row made exact along both parts of the step, for the price of two pairs of passes."""
    across = metric.unit(step.across)
    rest = step.correction.plus(across, -metric.inner(across, step.correction))
    size = metric.norm(rest)
    directions = (across,) if size == 0.0 else (across, rest.scaled(1.0 / size))
    slopes = critical_derivatives(linear.at, linear.basis, critical, directions).values
    for direction, slope in zip(directions, slopes, strict=True):
        gradient = gradient.plus(metric.row(direction), float(slope) - gradient.dot(direction))
    return gradient


def _correct_extended(at: MapAt, closing: Closing, basis: Matrix, frame: Frame) -> CurveCorrection:
    history, kind = _History(), at.problem.kind
    opening = critical_pass(at, basis, vectors_of(frame, kind))
    if opening is None:
        return history.ended(NewtonStop.NON_FINITE)
    critical = critical_of(opening, frame)
    if critical is None:
        return history.ended(NewtonStop.SINGULAR)
    vectors, angle = _first_vectors(critical)
    reference, passed = vectors, opening
    for iteration in range(at.problem.options.iterations + 1):
        if iteration == 0:
            passed = _mapped(opening, vectors)
        else:
            following_pass = critical_pass(at, basis, Vectors(vectors), passed.linear)
            if following_pass is None:
                return history.ended(NewtonStop.NON_FINITE)
            passed = following_pass
        linear = passed.linear
        defect = passed.defect + vectors @ (passed.matrix - _rotation(kind, angle)[0])
        size = float(np.max(np.abs(defect)) / np.max(np.abs(vectors)))
        history = history.and_then(max(linear.residual, abs(closing.gap(at.position))), size)
        if history.converged(at.problem, 0.0):
            critical = critical_of(passed, frame)
            if critical is None:
                return history.ended(NewtonStop.SINGULAR)
            return history.ended(NewtonStop.CONVERGED, CriticalCycle(linear, critical, closing.gradient))
        if history.diverged:
            return history.ended(NewtonStop.DIVERGED)
        step = surface_step(linear, (closing.row, closing.across), (closing.gap(at.position), 0.0))
        update = None if step is None else _extended_step(linear, vectors, angle, defect, reference, step)
        if step is None or update is None:
            return history.ended(NewtonStop.SINGULAR)
        at = at.beside(step.correction.plus(step.across, update.beta), 1.0)
        vectors, angle = vectors + update.vectors, angle + update.angle
        basis = following(basis, linear.image.columns)
    return history.ended(NewtonStop.ITERATIONS)


def _mapped(opening: CriticalPass, vectors: Matrix) -> CriticalPass:
    """The opening pass with other critical vectors, for the price of their columns alone."""
    mapped = opening.linear.at.tangent(vectors).columns
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
    linear: SurfaceLinearisation,
    vectors: Matrix,
    angle: float,
    defect: Matrix,
    reference: Matrix,
    step: SurfaceStep,
) -> _ExtendedStep | None:
    """The Newton step of (R, theta, beta) drawn at the head of this module, R = V Y + q."""
    at, basis, kind = linear.at, linear.basis, linear.at.problem.kind
    count, columns = vectors.shape[1], basis.shape[1]
    matrix, derivative = _rotation(kind, angle)
    slopes, _ = map_slopes(at, vectors, None, (step.correction, step.across))
    # sources of dR: the constant side, beta, theta
    parts = [defect + slopes[:, :count], slopes[:, count:]]
    if count == 2:
        parts.append(-vectors @ derivative)
    inverse = np.kron(np.eye(len(parts)), np.linalg.inv(matrix))
    sources = np.hstack(parts)
    swept = sweep(at, basis, sources, inverse, at.problem.options.picard_tolerance)
    # (H Y - Y A) + V'(x + M q_x) = 0 for vec(Y) column by column
    projected = basis.T @ linear.image.columns
    size = count * columns
    system = np.zeros((size + len(parts) - 1, size + len(parts) - 1))
    right = np.zeros(len(system))
    system[:size, :size] = np.kron(np.eye(count), projected) - np.kron(matrix.T, np.eye(columns))
    reduced = basis.T @ (sources + swept.image)
    shares = [reduced[:, count * i : count * (i + 1)].T.ravel() for i in range(len(parts))]
    swept_parts = [swept.columns[:, count * i : count * (i + 1)] for i in range(len(parts))]
    right[:size] = -shares[0]
    for i, share in enumerate(shares[1:]):
        system[:size, size + i] = share
    rows = [(vectors, 0.5 * (1.0 - float(np.sum(vectors * vectors))))]
    if count == 2:
        # Im <w_0, w> = <w_0r, w_i> - <w_0i, w_r>
        turned = np.column_stack([-reference[:, 1], reference[:, 0]])
        rows.append((turned, -float(np.sum(turned * vectors))))
    for i, (row, value) in enumerate(rows):
        system[size + i, :size] = (basis.T @ row).T.ravel()
        system[size + i, size:] = [float(np.sum(row * part)) for part in swept_parts[1:]]
        right[size + i] = value - float(np.sum(row * swept_parts[0]))
    try:
        solution = np.linalg.solve(system, right)
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(solution)):
        return None
    factors = [1.0, *solution[size:]]
    slow = basis @ solution[:size].reshape(count, columns).T
    change = slow + sum(factor * part for factor, part in zip(factors, swept_parts, strict=True))
    turn = float(solution[size + 1]) if count == 2 else 0.0
    return _ExtendedStep(np.asarray(change), turn, float(solution[size]))


def following(basis: Matrix, image: Matrix) -> Matrix:
    """V <- orth(M V); a basis of the whole space stays the identity."""
    return basis if basis.shape[0] == basis.shape[1] else orthonormal(image)
