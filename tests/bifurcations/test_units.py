"""No unit of state or time matters: the same system in units 1, 1e3 and 1e6 gives the same points in as many
iterations.

The user scales what he gives: states, periods, frequencies, lengths of steps (in the unit of the state) and
parameter scales (changes of a parameter that count as one unit of the state).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numba import njit

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, BranchState, BranchStop, ContinuationOptions
from pipelines.bifurcations.curve import CurveOptions, CurveStart, CurveStop
from pipelines.bifurcations.detection import DetectionOptions, EventKind
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import DynamicalSystem
from tests.bifurcations.curve_runs import FLIP, FOLD, NS, Run, trace
from tests.bifurcations.polar_cycles import polar_cycles
from tests.systems import tondl

UNITS = [(1e3, 1.0), (1e6, 1.0), (1.0, 1e3), (1.0, 1e6), (1e-6, 1.0), (1e3, 1e-6)]


def measured(system: DynamicalSystem) -> DynamicalSystem:
    """A compiled system without constants whose numbers are K times the states and c times the times, K and
    c being its constants.
    """
    rates, tangent = system.rates, system.tangent

    @njit(RATES)
    def scaled_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
        rates(phase, s / constants[0], p, constants, layout, work, out)
        for i in range(out.shape[0]):
            out[i] *= constants[0] / constants[1]

    @njit(TANGENT)
    def scaled_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
        tangent(phase, s / constants[0], block, p, constants, layout, work, out)
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] /= constants[1]

    return replace(system, rates=scaled_rates, tangent=scaled_tangent)


POLAR, TONDL = measured(polar_cycles()), measured(tondl())


def autonomous(units: tuple[float, float]) -> PeriodMap:
    system = replace(POLAR, constants=np.array(units))
    return PeriodMap(system, DOPRI8, Formulation.AUTONOMOUS, samples=32, minimum_steps=64)


def forced(units: tuple[float, float]) -> PeriodMap:
    return PeriodMap(replace(TONDL, constants=np.array(units)), DOPRI8)


def branch(problem: CycleProblem, start: BranchStart, options: ContinuationOptions) -> list[tuple[Any, ...]]:
    rows: list[tuple[Any, ...]] = []
    result = continue_branch(problem, start, options, lambda *row: rows.append(row))
    assert result.stop is BranchStop.RANGE
    return rows


def walk(interval: tuple[float, float], size: float) -> ContinuationOptions:
    return ContinuationOptions(
        interval,
        step=0.02 * size,
        maximum_step=0.05 * size,
        minimum_step=1e-5 * size,
        parameter_scale=1.0 / size,
        detection=DetectionOptions(event_tolerance=1e-10 * size),
    )


def polar_branch(units: tuple[float, float]) -> list[tuple[Any, ...]]:
    """Cycles whose period varies, through two folds."""
    size, time = units
    e, n = -0.5, 0.48
    parameters = np.array([e**3 - n * e, n, -0.2, 0.35, 0.4])
    problem = CycleProblem(autonomous(units), parameters, "m")
    period = 2.0 * math.pi / (1.0 + 0.4 * e) * time
    start = BranchStart(size * np.array([math.sqrt(1.0 + e), 0, 0, 0]), parameters[0], period)
    return branch(problem, start, walk((-0.5, 0.3), size))


def tondl_branch(units: tuple[float, float]) -> list[tuple[Any, ...]]:
    size, time = units
    problem = CycleProblem(forced(units), np.array([0.0, 1.45 / time]), "c1")
    return branch(problem, BranchStart(size * np.array([0.33, 0.05, 0.0, 0.0]), 0.0), walk((0.0, 0.12), size))


def same_branches(rows: list[tuple[Any, ...]], others: list[tuple[Any, ...]], size: float) -> None:
    assert [row[0].iterations for row in rows] == [row[0].iterations for row in others]
    assert [row[1].steps for row in rows] == [row[1].steps for row in others]
    for (_, one, _), (_, other, _) in zip(rows, others, strict=True):
        assert one.parameter == pytest.approx(other.parameter, abs=1e-8)
        assert one.state == pytest.approx(other.state / size, abs=1e-7)
    events, found = ([event for row in all_rows for event in row[2]] for all_rows in (rows, others))
    assert [event.kind for event in events] == [event.kind for event in found]
    for event, other in zip(events, found, strict=True):
        assert event.parameters[0] == pytest.approx(other.parameters[0], abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("trace_branch", [polar_branch, tondl_branch])
def test_branches_of_cycles(trace_branch: Any) -> None:
    rows = trace_branch((1.0, 1.0))
    kinds = {event.kind for row in rows for event in row[2]}
    assert kinds == ({EventKind.FOLD} if trace_branch is polar_branch else {EventKind.NEIMARK_SACKER})
    for units in UNITS:
        same_branches(rows, trace_branch(units), units[0])


def test_restart_in_other_units_gives_the_same_bits() -> None:
    """The metric of an unknown period follows from the state alone."""
    size, time = 1e3, 1e6
    whole = polar_branch((size, time))
    middle = BranchState.from_arrays(whole[3][1].arrays())
    problem = CycleProblem(autonomous((size, time)), whole[0][0].cycle.parameters, "m")
    rest: list[tuple[Any, ...]] = []
    continue_branch(problem, middle, walk((-0.5, 0.3), size), lambda *row: rest.append(row))
    assert len(rest) == len(whole) - 4
    for (_, old, _), (_, new, _) in zip(whole[4:], rest, strict=True):
        for name, value in old.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(new.arrays()[name]).tobytes(), name


def polar_curve(units: tuple[float, float], kind: EventKind, formulation: CurveFormulation) -> Run:
    """Folds through their cusp, or Neimark-Sacker points through R3 and R4."""
    size, time = units
    e, n = (0.3, 0.27) if kind is FOLD else (-0.1, -0.5)
    values = (0, 0, -0.2, 0.35, 0.4) if kind is FOLD else (e**3 - n * e, n, 0, 0, 0.4)
    names, at = (("m", "n"), (-2 * e**3, n)) if kind is FOLD else (("omega", "delta"), (0.35, 0.0))
    ranges = ((-0.2, 0.2), (-1.0, 0.5)) if kind is FOLD else ((0.2, 0.4), (-1.0, 1.0))
    options = ShootingOptions(tolerance=1e-11, multiplier_tolerance=1e-10)
    problem = CurveProblem(autonomous(units), kind, np.array(values), names, options, formulation)
    start = CurveStart(
        size * np.array([math.sqrt(1 + e), 0, 0, 0]), at, 2 * math.pi / (1 + 0.4 * e) * time, None
    )
    run = trace(problem, start, lengths(ranges, size, (1.0 / size, 1.0 / size), 1 if kind is FOLD else -1))
    assert run.result.stop is CurveStop.RANGE
    return run


def lengths(
    ranges: tuple[tuple[float, float], ...], size: float, scales: tuple[float, float], direction: int = 1
) -> CurveOptions:
    return CurveOptions(
        ranges,  # type: ignore[arg-type]
        direction=direction,
        step=0.02 * size,
        maximum_step=0.1 * size,
        minimum_step=1e-7 * size,
        event_tolerance=1e-11 * size,
        parameter_scales=scales,
    )


FLIP_STATE, FLIP_AT = np.array([0.32, 0.046, 0.06, -0.1]), (0.017, 2.4)  # near a verified point


def tondl_curve(units: tuple[float, float], kind: EventKind, formulation: CurveFormulation) -> Run:
    """A closed curve of period doublings with generalised ones, whose test has the unit of 1/state^2."""
    size, time = units
    options = ShootingOptions(tolerance=1e-11, multiplier_tolerance=1e-10)
    problem = CurveProblem(forced(units), kind, np.zeros(2), ("c1", "eta"), options, formulation)
    start = CurveStart(size * FLIP_STATE, (FLIP_AT[0], FLIP_AT[1] / time))
    scales = (0.05 / size, 0.5 / size / time)
    run = trace(problem, start, lengths(((-0.1, 0.2), (2.0 / time, 2.6 / time)), size, scales))
    assert run.result.stop is CurveStop.CLOSED
    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trace_curve", "kind", "formulation"),
    [
        (polar_curve, FOLD, CurveFormulation.BORDERED),
        (polar_curve, NS, CurveFormulation.BORDERED),
        (polar_curve, NS, CurveFormulation.EXTENDED),
        (tondl_curve, FLIP, CurveFormulation.BORDERED),
        (tondl_curve, FLIP, CurveFormulation.EXTENDED),
    ],
)
def test_curves(trace_curve: Any, kind: EventKind, formulation: CurveFormulation) -> None:
    run = trace_curve((1.0, 1.0), kind, formulation)
    assert run.specials
    # a curve of Tondl's system takes seconds
    for size, time in UNITS if trace_curve is polar_curve else UNITS[-1:]:
        other = trace_curve((size, time), kind, formulation)
        assert [p.iterations for p in run.points] == [p.iterations for p in other.points]
        unit = np.array([1.0, time]) if trace_curve is tondl_curve else 1.0
        assert np.allclose(run.parameters, other.parameters * unit, rtol=0, atol=1e-8)
        assert [s.kind for s in run.specials] == [s.kind for s in other.specials]
        for special, found in zip(run.specials, other.specials, strict=True):
            assert found.state / size == pytest.approx(special.state, abs=1e-7)
        coefficients, found = (
            np.array([p.normal_form.coefficient for p in points if p.normal_form is not None])
            for points in (run.points, other.points)
        )
        order = 1 if kind is FOLD else 2  # a belongs to a square, b and d to a cube
        assert np.allclose(coefficients, found * size**order, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("tolerance", ["tolerance", "multiplier_tolerance"])
@pytest.mark.parametrize("formulation", list(CurveFormulation))
def test_rounding_ends_a_curve_with_advice(tolerance: str, formulation: CurveFormulation) -> None:
    options = ShootingOptions(**{tolerance: 1e-17})  # type: ignore[arg-type]
    problem = CurveProblem(PeriodMap(tondl(), DOPRI8), FLIP, np.zeros(2), ("c1", "eta"), options, formulation)
    steps = lengths(((-0.1, 0.2), (2.0, 2.6)), 1.0, (0.05, 0.5))
    run = trace(problem, CurveStart(FLIP_STATE, FLIP_AT), steps)
    assert run.result.stop is CurveStop.START_FAILED
    assert "rounding keeps the residual above the tolerance" in run.result.message
