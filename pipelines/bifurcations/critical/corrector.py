"""The corrector of a bifurcation curve: cycle, criticality and closing row are solved together.

It moves on the surface of cycles of ``pipelines.bifurcations.critical.cycle_manifold``: a step is the Newton
correction towards the surface plus beta times the tangent ``across`` that leaves the closing row alone,

    du = d_r + beta t,      row . t = 0

The bordered corrector finds beta from the test function g.  Its gradient row gamma is known on the two
tangents of the last point and learnt elsewhere by Broyden updates, which costs no passes, and measured only
where that does not get on:

    beta = -(g + gamma d_r)/(gamma t),      gamma += (dg - gamma du)/<w, du> <w, .>

with w the part of the first step at right angles to t where the last point of the curve has told gamma t, and
w = du else.

The extended one is in ``pipelines.bifurcations.critical.extended_system``.
"""

from __future__ import annotations

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
    Vectors,
    critical_derivatives,
    critical_pass,
    picard_pass,
)
from pipelines.bifurcations.critical.cycle_manifold import (
    ManifoldLinearisation,
    ManifoldStep,
    manifold_step,
    refined_step,
)
from pipelines.bifurcations.critical.extended_system import correct_extended
from pipelines.bifurcations.critical.testfunctions import critical_of
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem, MapAt, PlaneMetric, Position
from pipelines.orbits.floquet import floquet_spectrum
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import NewtonStop
from pipelines.orbits.system import Matrix

_BROYDEN_NOISE = 0.1  # share of a change of g that the settling of the basis may explain
_BESIDE = 0.2  # share of a step beside a tangent below which it tells nothing about gamma there


def correct_critical(
    problem: CurveProblem,
    guess: Position,
    constraint: CurveConstraint,
    basis: Matrix,
    bordering: BorderingVectors,
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
        return correct_extended(at, constraint, basis, bordering)
    return _correct_bordered(at, constraint, basis, bordering)


def with_converged_multipliers(
    found: CriticalCycle, bordering: BorderingVectors, tolerance: float
) -> CriticalCycle:
    """The point after as many subspace iterations as its multipliers and left vectors need.

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
        image = at.with_columns(image, np.hstack([basis, vectors.columns]))
    if basis is found.basis:
        return found
    passed = picard_pass(at, basis, vectors, image, found.linear.whole)
    critical = critical_of(passed, bordering)
    return found if critical is None else CriticalCycle(passed.linear, critical, found.gradient)


def _correct_bordered(
    at: MapAt, constraint: CurveConstraint, basis: Matrix, bordering: BorderingVectors
) -> CurveCorrection:
    history, vectors = History(), vectors_of(bordering, at.problem.kind)
    gradient, last, metric = constraint.gradient, 0.0, constraint.metric
    moved: Position | None = None
    wrong: Position | None = None
    warm: Matrix | None = None
    for _ in range(at.problem.options.iterations + 1):
        passed = critical_pass(at, basis, vectors, warm)
        if passed is None:
            return history.ended(NewtonStop.NON_FINITE)
        critical = critical_of(passed, bordering)
        if critical is None:
            return history.ended(NewtonStop.SINGULAR)
        linear = passed.linear
        if moved is not None and wrong is not None:
            change = critical.value - last
            gradient = _learnt(gradient, moved, wrong, change, critical.error, metric)
        history = history.and_then(max(linear.residual, constraint.error(at.position)), critical.value)
        if history.converged(at.problem, critical.error):
            return history.ended(NewtonStop.CONVERGED, CriticalCycle(linear, critical, gradient))
        if history.diverged:
            return history.given_up(NewtonStop.DIVERGED, at)
        if history.stuck(at.problem):
            return history.given_up(NewtonStop.STUCK, at)
        rows = constraint.row, constraint.across
        step = manifold_step(linear, rows, (constraint.gap(at.position), 0.0))
        if step is None:
            return history.ended(NewtonStop.SINGULAR)
        if history.stalls(constraint.follows):
            gradient = _measured(linear, critical, gradient, step, constraint.metric)
        slope = gradient.dot(step.across)
        if slope == 0.0:
            return history.ended(NewtonStop.SINGULAR)
        # beta = -(g + gamma d_r)/(gamma t)
        beta = -(critical.value + gradient.dot(step.correction)) / slope
        first, last = moved is None and constraint.follows, critical.value
        moved = refined_step(linear, rows, step, beta)
        if moved is None:
            return history.ended(NewtonStop.SINGULAR)
        # in the first step gamma is wrong beside the tangent, along which the last point has told it
        wrong = _beside(moved, step.across, metric) if first else moved
        at, basis = at.beside(moved, 1.0, linear.image), following(basis, linear.image.columns)
        vectors = Vectors(critical.right, critical.right_period or 0.0)
        warm = linear.whole
        del passed, linear  # free the factors before the next pass makes its own
    return history.given_up(NewtonStop.ITERATIONS, at)


def _beside(moved: Position, across: Position, metric: PlaneMetric) -> Position | None:
    """The part of a step at right angles to the tangent ``across``; None where it is short."""
    rest = moved.plus(across, -metric.inner(across, moved) / metric.inner(across, across))
    return rest if metric.norm(rest) > _BESIDE * metric.norm(moved) else None


def _learnt(
    gradient: Position, moved: Position, along: Position, change: float, noise: float, metric: PlaneMetric
) -> Position:
    """Broyden: gamma += (dg - gamma du)/<w, du> <w, .>, unless dg is only the basis settling.

    ``along``: w, the part of a step du along which gamma was wrong.
    """
    size = metric.inner(along, moved)
    if size == 0.0 or noise > _BROYDEN_NOISE * abs(change):
        return gradient
    return gradient.plus(metric.row(along), (change - gradient.dot(moved)) / size)


def _measured(
    linear: ManifoldLinearisation,
    critical: Critical,
    gradient: Position,
    step: ManifoldStep,
    metric: PlaneMetric,
) -> Position:
    """The gradient row made exact along both parts of the step, at the cost of three passes."""
    across = metric.unit(step.across)
    rest = step.correction.plus(across, -metric.inner(across, step.correction))
    size = metric.norm(rest)
    directions = (across,) if size == 0.0 else (across, rest.scaled(1.0 / size))
    slopes = critical_derivatives(linear, critical, directions, metric).values
    for direction, slope in zip(directions, slopes, strict=True):
        gradient = gradient.plus(metric.row(direction), float(slope) - gradient.dot(direction))
    return gradient
