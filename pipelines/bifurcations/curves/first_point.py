"""The first point of a bifurcation curve: its bordering, its tangent and its sense."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pipelines.bifurcations.continuation import Rejected, period_scale
from pipelines.bifurcations.critical.bordering import first_bordering, vectors_of
from pipelines.bifurcations.critical.correction import CriticalCycle, CurveConstraint
from pipelines.bifurcations.critical.corrector import correct_critical
from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    critical_derivatives,
    critical_pass,
)
from pipelines.bifurcations.critical.cycle_manifold import manifold_tangents
from pipelines.bifurcations.critical.testfunctions import critical_of
from pipelines.bifurcations.curve import CurveOptions, CurvePoint, CurveStart, CurveState, SpecialKind
from pipelines.bifurcations.curves.codimension_two import resonant_end
from pipelines.bifurcations.curves.segment import CurveEnd, curve_end, with_normal_form
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveProblem, MapAt, PlaneMetric, Position, metric_of
from pipelines.orbits.floquet import adapted_basis
from pipelines.orbits.shooting import NewtonStop, correct, first_basis, reference_of
from pipelines.orbits.system import Matrix
from pipelines.orbits.time_steps import RequiredSteps, first_steps, required_steps_at

_TRIAL = 1e-3  # of the first step, on both sides of a resonance


def start_curve(
    problem: CurveProblem, start: CurveStart, options: CurveOptions
) -> tuple[CurvePoint, CurveState] | Rejected:
    """Correct the guess at right angles to the curve and orient the curve."""
    for name, value, interval in zip(problem.names, start.parameters, options.ranges, strict=True):
        if not interval[0] <= value <= interval[1]:
            raise ValueError(f"the start {name} = {value} lies outside the range {interval}")
    guess = problem.consistent(
        Position(np.array(start.state, dtype=float), start.period, np.array(start.parameters, dtype=float))
    )
    unknowns, cycles = problem.unknowns(guess), problem.cycle_problem(guess)
    metric = curve_metric(problem, options, guess)
    steps = first_steps(cycles, unknowns)
    if isinstance(steps, NewtonStop):
        return Rejected(steps.advice)
    opened = _open_with(problem, start, options, metric, guess, first_basis(cycles, unknowns, steps), steps)
    if isinstance(opened, CurveEnd):
        required = required_steps_of(problem, opened)
        if required.steps > steps:
            steps, basis = required.steps, opened.point.cycle.basis
            opened = _open_with(problem, start, options, metric, opened.position, basis, steps)
            if isinstance(opened, CurveEnd):
                required = required_steps_of(problem, opened)
    if isinstance(opened, str):
        return Rejected(opened)
    if resonant_end(problem.kind, opened.point.cos_theta) is not None:
        opened = _facing_inwards(problem, opened, options, metric)
    opened = with_errors(opened, required)
    opened = with_normal_form(opened, metric, options.normal_form)
    at = opened.position
    if problem.period_map.autonomous:
        opened = _measured_by(opened, curve_metric(problem, options, at))
    state = CurveState(
        index=0,
        step=options.step,
        arclength=0.0,
        previous_tests=np.full(len(SpecialKind), math.nan),
        previous_arclength=0.0,
        bend_state=np.zeros_like(at.state),
        bend_period=0.0,
        bend_parameters=np.zeros(2),
        start_state=at.state,
        start_period=at.period,
        start_parameters=at.parameters,
        **columns_of(problem, opened),
    )
    return opened.point, state


def curve_metric(problem: CurveProblem, options: CurveOptions, first: Position) -> PlaneMetric:
    """The metric of a curve with this first point."""
    period = period_scale(first.state, first.period, options.maximum_step)
    return metric_of(problem, options.parameter_scales, period)


def _measured_by(end: CurveEnd, metric: PlaneMetric) -> CurveEnd:
    """The point with orthonormal tangents in the metric that the corrected point sets."""
    tangent = metric.unit(end.tangent)
    normal = end.normal.plus(tangent, -metric.inner(tangent, end.normal))
    return replace(end, tangent=tangent, normal=metric.unit(normal))


def _open_with(
    problem: CurveProblem,
    start: CurveStart,
    options: CurveOptions,
    metric: PlaneMetric,
    guess: Position,
    basis: Matrix,
    steps: int,
) -> CurveEnd | str:
    """The first point with the given number of steps per period, or the reason why there is none."""
    reference = reference_of(problem.cycle_problem(guess), problem.unknowns(guess), steps)
    if problem.kind is not EventKind.FOLD:
        # a guess that is no cycle yet: a cycle at the same parameters first
        cycles = problem.cycle_problem(guess)
        held = cycles.fixed_parameter(float(guess.parameters[0]))
        correction = correct(cycles, problem.unknowns(guess), held, basis, steps, reference)
        if correction.cycle is not None:
            cycle = correction.cycle
            basis = cycle.basis
            guess = Position(cycle.unknowns.state, cycle.unknowns.period, guess.parameters)
    first = _first_constraint(MapAt(problem, guess, steps, reference), basis, start, options, metric)
    if isinstance(first, str):
        return first
    constraint, bordering, along = first
    corrected = correct_critical(problem, guess, constraint, basis, bordering, steps, reference)
    if corrected.point is None:
        return corrected.advice
    end = curve_end(corrected, corrected.point, constraint, along, options.normal_form, bordering)
    return "the tangent of the first point is singular" if end is None else end


def _facing_inwards(
    problem: CurveProblem, end: CurveEnd, options: CurveOptions, metric: PlaneMetric
) -> CurveEnd:
    """The first point on R1 or R2 with the tangent towards abs(cos_theta) < 1, where its pair is complex.

    The slope of cos theta is a difference of large numbers there, so trial steps to both sides decide, or
    else the slope.  With f = 1 - abs(cos theta) = c x (x + w) behind a tongue of width w, the sign of
    f(x) - f(-x) = 2 c w x is right also where a trial steps across the tongue.
    """
    row = metric.row(end.tangent)
    cycle = end.point.cycle
    reference = reference_of(problem.cycle_problem(end.position), problem.unknowns(end.position), cycle.steps)

    def inside(distance: float) -> float:
        guess = end.position.plus(end.tangent, distance)
        constraint = CurveConstraint(row, row.dot(guess), metric.row(end.normal), end.gradient, metric)
        found = correct_critical(
            problem, guess, constraint, cycle.basis, end.bordering, cycle.steps, reference
        ).point
        return math.nan if found is None else 1.0 - abs(found.critical.cos_theta)

    ahead, behind = (inside(side * _TRIAL * options.step) for side in (1.0, -1.0))
    inwards = (
        end.cos_theta_slope * end.point.cos_theta < 0.0 if math.isnan(ahead - behind) else ahead > behind
    )
    if inwards:
        return end
    return replace(end, tangent=end.tangent.scaled(-1.0), cos_theta_slope=-end.cos_theta_slope)


def _first_constraint(
    at: MapAt, basis: Matrix, start: CurveStart, options: CurveOptions, metric: PlaneMetric
) -> tuple[CurveConstraint, BorderingVectors, Position] | str:
    """The plane across the curve at the guess, the bordering there and the tangent in the wanted sense."""
    bordering = first_bordering(at, basis, start.angle)
    passed = None if bordering is None else critical_pass(at, basis, vectors_of(bordering, at.problem.kind))
    critical = None if bordering is None or passed is None else critical_of(passed, bordering)
    if bordering is None or passed is None or critical is None:
        return "the orbit of the guess leaves the domain of the equations or has no critical multipliers"
    linear = passed.linear
    first, second = manifold_tangents(linear, metric)
    derivatives = critical_derivatives(linear, critical, (first, second), metric)
    g1, g2 = derivatives.values
    size = float(np.hypot(g1, g2))
    if not size > 0.0:
        return "the test function is stationary at the guess"
    # dg vanishes along the curve
    across = first.scaled(g1 / size).plus(second, g2 / size)
    along = first.scaled(-g2 / size).plus(second, g1 / size)
    upwards = -1.0 if along.parameters[0] < 0.0 else 1.0
    along = along.scaled(upwards * options.direction)
    row, beside = metric.row(along), metric.row(across)
    return CurveConstraint(row, row.dot(at.position), beside, beside.scaled(size), metric), bordering, along


def columns_of(problem: CurveProblem, end: CurveEnd) -> dict[str, Any]:
    """The fields of CurveState that a corrected point determines."""
    columns: dict[str, Any] = {}
    for name, value in (("tangent", end.tangent), ("normal", end.normal), ("gradient", end.gradient)):
        columns[f"{name}_state"] = value.state
        columns[f"{name}_period"] = value.period
        columns[f"{name}_parameters"] = value.parameters
    cycle = end.point.cycle
    return columns | {
        "state": end.position.state,
        "period": end.position.period,
        "parameters": end.position.parameters,
        "right": end.bordering.right,
        "left": end.bordering.left,
        "right_period": end.bordering.right_period,
        "left_phase": end.bordering.left_phase,
        "cos_theta": end.bordering.cos_theta,
        "cos_theta_slope": end.cos_theta_slope,
        "tests": end.tests,
        "steps": cycle.steps,
        "step_error": end.point.step_error,
        "coarser_error": end.point.coarser_error,
        "basis": adapted_basis(cycle.basis, cycle.image.columns, problem.options.basis),
    }


def with_errors(end: CurveEnd, required: RequiredSteps) -> CurveEnd:
    """The end with what its time steps leave in the multipliers."""
    return replace(end, point=replace(end.point, step_error=required.error, coarser_error=required.coarser))


def required_steps_of(
    problem: CurveProblem, found: CriticalCycle | CurveEnd, neighbour: RequiredSteps | None = None
) -> RequiredSteps:
    """Steps per period that a corrected point asks for, and what those in use leave.

    ``neighbour`` as in ``required_steps``.
    """
    if isinstance(found, CriticalCycle):
        basis, image = found.linear.basis, found.linear.image
    else:
        basis, image = found.point.cycle.basis, found.point.cycle.image
    return required_steps_at(problem.period_map, problem.options, basis, image, neighbour)
