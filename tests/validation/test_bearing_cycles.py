"""The whole chain on the bearing: film, rotor, period map, corrector, multipliers, continuation, events.

Coarse grids: what is compared here is the same discrete machine, computed in two independent ways.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import (
    BranchPoint,
    BranchResult,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
)
from pipelines.bifurcations.curve import CurveOptions, CurvePoint, CurveState, CurveStop
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import DetectionOptions, Event, EventKind, unstable_count
from pipelines.bifurcations.switching import curve_from_event
from pipelines.case.models import Case
from pipelines.case.reading import read_cases
from pipelines.case.scales import PARAMETERS
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine
from pipelines.orbits.equilibria.equilibrium import Equilibrium, at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import Instability, at_speed, linear_point, locate_instability
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, Unknowns, correct, first_basis, reference_of
from pipelines.orbits.steppers import DOPRI8, ESDIRK5
from pipelines.orbits.time_steps import first_steps, required_steps
from pipelines.stages.cycles.problem import cycle_problem
from tests.helpers.monodromy import full_monodromy
from tests.machines import BEARING, FOIL, case

ROOT = Path(__file__).resolve().parents[2]
SMOKE = (ROOT / "configs" / "smoke.toml").read_text()
COARSE = ("numerics.circumferential=16", "numerics.axial=1")
Recorded = list[tuple[BranchPoint, BranchState, tuple[Event, ...]]]

# Ring displacements, the second half of the first, for which the next term of the expansion is small.
DISPLACEMENTS = (0.005, 0.0025)


def problem_of(one: Case, **options: Any) -> CycleProblem:
    """The problem which the stage builds, with other options of the corrector."""
    problem = cycle_problem(build_machine(one), one)
    return replace(problem, options=replace(problem.options, **options))


def equilibrium_of(machine: Machine, parameters: np.ndarray) -> np.ndarray:
    equilibrium = machine_equilibrium(machine, parameters)
    assert equilibrium.converged, equilibrium.reason
    return equilibrium.state


def cycle_at(
    problem: CycleProblem, state: np.ndarray, steps: int | None = None, period: float | None = None
) -> Cycle:
    """The cycle near a state of the machine at the problem's own parameters."""
    period = 2.0 * math.pi / problem.parameters[film.EXCITATION_FREQUENCY] if period is None else period
    value = float(problem.parameters[problem.index])
    guess = problem.consistent(Unknowns(problem.period_map.extend(state), period, value))
    steps = first_steps(problem, guess) if steps is None else steps
    correction = correct(
        problem,
        guess,
        problem.fixed_parameter(value),
        first_basis(problem, guess, steps),
        steps,
        reference_of(problem, guess, steps),
    )
    assert correction.cycle is not None, correction.stop.advice
    return correction.cycle


def traced(
    problem: CycleProblem, state: np.ndarray, value: float, options: ContinuationOptions
) -> tuple[BranchResult, Recorded]:
    """The branch from a guess, and what it recorded."""
    recorded: Recorded = []
    result = continue_branch(problem, BranchStart(state, value), options, lambda *row: recorded.append(row))
    return result, recorded


def nearest(values: np.ndarray, wanted: complex) -> float:
    """Distance of the nearest value."""
    return float(np.min(np.abs(values - wanted)))


def folded(angle: float) -> float:
    """An angle modulo 2 pi, folded to [0, pi]."""
    return abs(math.remainder(angle, 2.0 * math.pi))


# --- As the excitation vanishes -------------------------------------------------------------------


@cache
def hopf(displacement: float) -> Instability:
    """Hopf point of the machine with its rings at rest in their mean position."""
    machine = build_machine(case((16, 2), displacement=displacement))
    parameters = np.array([1.0, 0.7, displacement, 10.0])
    low, high = (linear_point(machine, at_speed(parameters, speed), 6) for speed in (1.0, 1.2))
    assert not isinstance(low, Equilibrium)
    assert not isinstance(high, Equilibrium)
    return locate_instability(machine, parameters, low, high)


def neimark_sacker(frequency: float, displacement: float) -> Event:
    """The NS point of the stroboscopic map on the branch of small forced cycles about the Hopf point."""
    one = case((16, 2), displacement=displacement, excitation={"frequency": frequency})
    problem, start = cycle_problem(build_machine(one), one), hopf(displacement)
    width = 6.0 * displacement**2
    result, recorded = traced(
        problem,
        start.equilibrium.state,
        start.speed - width,
        ContinuationOptions((start.speed - width, start.speed + width), step=2.0, maximum_step=2.0),
    )
    assert result.stop is BranchStop.RANGE
    (event,) = [event for row in recorded for event in row[2]]
    assert event.kind is EventKind.NEIMARK_SACKER
    return event


def orders(errors: list[float]) -> list[float]:
    """Observed orders between errors at halved parameters."""
    return [math.log2(coarse / fine) for coarse, fine in pairwise(errors)]


@pytest.mark.parametrize("frequency", [0.5, 0.7, 1.1])
def test_neimark_sacker_tends_to_the_hopf_point(frequency: float) -> None:
    """NS speed -> Hopf speed, angle -> omega_H T mod 2 pi.

    The ring oscillates about a mean deflection of -delta/2: against the Hopf point of the machine with rings
    undeformed both errors are of first order, against that with the rings in their mean position of second.
    """
    events = [neimark_sacker(frequency, displacement) for displacement in DISPLACEMENTS]
    mean = [hopf(displacement) for displacement in DISPLACEMENTS]
    passive, period = hopf(0.0), 2.0 * math.pi / frequency
    speeds = [event.parameters[film.SPEED] for event in events]
    to_passive = [abs(speed - passive.speed) for speed in speeds]
    to_mean = [abs(speed - at.speed) for speed, at in zip(speeds, mean, strict=True)]
    turn = [abs(e.angle - folded(at.frequency * period)) for e, at in zip(events, mean, strict=True)]
    turn_to_passive = [abs(event.angle - folded(passive.frequency * period)) for event in events]
    # what is left of the order is the next term, a few percent of the first
    assert orders(to_mean)[0] == pytest.approx(2.0, abs=0.15)
    assert orders(turn)[0] == pytest.approx(2.0, abs=0.15)
    assert orders(to_passive)[0] == pytest.approx(1.0, abs=0.15)
    assert orders(turn_to_passive)[0] == pytest.approx(1.0, abs=0.15)
    assert to_passive[1] < 2e-3
    assert to_mean[1] < 5e-5


def _keep(states: list[CurveState], point: CurvePoint, state: CurveState, specials: object) -> None:
    states.append(state)


@pytest.mark.slow
def test_the_neimark_sacker_curve_tends_to_the_line_at_the_hopf_speed() -> None:
    """Over the excitation frequency it leaves the Hopf speed by the square of the displacement."""
    distances = []
    for displacement in DISPLACEMENTS:
        one = case((16, 2), displacement=displacement, excitation={"frequency": 0.7})
        problem = cycle_problem(build_machine(one), one)
        event, still = neimark_sacker(0.7, displacement), hopf(displacement).speed
        curves, start = curve_from_event(problem, event, ("excitation_frequency", "speed"))
        states: list[CurveState] = []
        options = CurveOptions(((0.6, 0.7), (still - 0.01, still + 0.01)), direction=-1, normal_form=None)
        record = partial(_keep, states)
        assert continue_curve(curves, start, options, record).stop is CurveStop.RANGE
        frequencies, speeds = np.array([state.parameters for state in states]).T
        assert frequencies[-1] == 0.6
        distances.append(np.max(np.abs(speeds - still)))
    assert distances[1] < 1e-3
    assert math.log2(distances[0] / distances[1]) == pytest.approx(2.0, abs=0.2)


def test_without_excitation_the_multipliers_are_those_of_the_equilibrium() -> None:
    """With rings at rest the fixed point is the equilibrium and M = R(hJ)^n, R the stability function of the
    stepper: its multipliers are R(h lambda)^n, which is exp(lambda T) up to the error of the stepper.
    """
    one = case((16, 2), displacement=0.0)
    problem, machine = problem_of(one, multiplier_tolerance=1e-11), build_machine(one)
    state = equilibrium_of(machine, problem.parameters)
    away = state + 1e-3 * np.cos(np.arange(machine.size))  # the corrector has to find it
    cycle = cycle_at(problem, away, steps=64)
    assert np.max(np.abs(cycle.unknowns.state - state)) < 1e-9
    period, h = cycle.unknowns.period, cycle.unknowns.period / cycle.steps
    exponents = np.linalg.eigvals(machine.jacobian(0.0, state, at_rest(problem.parameters)).toarray())
    discrete = np.array([ESDIRK5.stability(h * exponent) for exponent in exponents]) ** cycle.steps
    slow = np.abs(discrete) > 0.1
    assert np.sum(slow) >= 4
    assert np.sum(np.abs(cycle.spectrum.multipliers) > 0.1) == np.sum(slow)
    for exponent, expected in zip(exponents[slow], discrete[slow], strict=True):
        assert nearest(cycle.spectrum.multipliers, expected) < 1e-9
        assert nearest(cycle.spectrum.multipliers, np.exp(exponent * period)) < problem.options.step_tolerance
    required = required_steps(problem, cycle)
    largest = max(nearest(cycle.spectrum.multipliers, value) for value in np.exp(exponents[slow] * period))
    assert required.error == pytest.approx(largest, rel=0.2)  # the next order of the stepper


# --- Both formulations ----------------------------------------------------------------------------


def in_both_formulations(frequency: float, steps: int | None) -> list[tuple[CycleProblem, Cycle]]:
    """The same cycle from the period map of the forced machine, and from Eq. 17-19 with its unknown period
    started 0.1 % off.  The phase is fixed by the first, so that both start at the same point.
    """
    one = case((12, 1), excitation={"frequency": frequency}, numerics={"steps_per_period": steps})
    problem = problem_of(one, tolerance=1e-12, multiplier_tolerance=1e-11)
    extended = replace(problem, period_map=replace(problem.period_map, formulation=Formulation.AUTONOMOUS))
    forced = cycle_at(problem, equilibrium_of(build_machine(one), problem.parameters))
    value, period = forced.unknowns.parameter, forced.unknowns.period
    exact = Unknowns(extended.period_map.extend(forced.unknowns.state), period, value)
    guess = replace(exact, state=exact.state * (1.0 + 1e-3), period=period * (1.0 + 1e-3))
    correction = correct(
        extended,
        guess,
        extended.fixed_parameter(value),
        first_basis(extended, guess, forced.steps),
        forced.steps,
        reference_of(extended, exact, forced.steps),
    )
    assert correction.cycle is not None, correction.stop.advice
    return [(problem, forced), (extended, correction.cycle)]


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [0.7, 2.0])
def test_both_formulations_agree(frequency: float) -> None:
    """Every multiplier above the cut to 1e-8; the oscillator of Eq. 17 adds 1 and exp(-2T), nothing else.

    With 640 steps the stepper itself leaves less than 1e-9 in the period (see the next test).
    """
    (problem, forced), (extended, free) = in_both_formulations(frequency, 640)
    period = 2.0 * math.pi / frequency
    assert free.steps == forced.steps == 640
    assert free.unknowns.period == pytest.approx(period, abs=1e-9)
    assert np.max(np.abs(free.unknowns.state - extended.period_map.extend(forced.unknowns.state))) < 1e-8
    # all of them, from the whole monodromy matrices
    cut = problem.options.basis.multiplier_cut
    whole = [
        np.linalg.eigvals(
            full_monodromy(one.period_map, at.unknowns.state, at.parameters, at.unknowns.period, at.steps)
        )
        for one, at in ((problem, forced), (extended, free))
    ]
    expected, found = np.append(whole[0], [1.0, math.exp(-2.0 * period)]), whole[1]
    expected, found = expected[np.abs(expected) > cut], found[np.abs(found) > cut]
    assert len(found) == len(expected) > 12
    assert max(nearest(found, value) for value in expected) < 1e-8
    # those which a branch stores, from the slow subspaces
    stored = [at.spectrum.multipliers[np.abs(at.spectrum.multipliers) > 0.1] for at in (forced, free)]
    assert len(stored[1]) == len(stored[0]) + 1
    assert max(nearest(stored[1], value) for value in (*stored[0], 1.0)) < 1e-8


def test_unknown_period_carries_the_error_of_the_stepper() -> None:
    """The stepper turns the oscillator of Eq. 17 a little too fast or too slowly; the period makes up for
    it.
    """
    errors = []
    for steps in (32, 64):
        (_, forced), (_, free) = in_both_formulations(2.0, steps)
        errors.append(abs(free.unknowns.period / forced.unknowns.period - 1.0))
    assert errors[0] < 1e-6
    assert math.log2(errors[0] / errors[1]) == pytest.approx(ESDIRK5.order, abs=0.2)


# --- Self-excited whirl ---------------------------------------------------------------------------


def test_self_excited_whirl_is_born_at_the_hopf_point() -> None:
    """Speed and period leave the Hopf point with the square of the amplitude; the trivial multiplier is 1
    and the other near 1 is exp(-2 T Re lambda'(Omega) (Omega - Omega_H)) (Hopf normal form).
    """
    one = case((16, 2), displacement=0.0, continue_cycles={"formulation": "autonomous"})
    problem, start = problem_of(one, multiplier_tolerance=1e-10), hopf(0.0)
    speeds, periods, ratios = [], [], []
    for amplitude in (0.04, 0.02, 0.01):
        correction = start_at_hopf(
            problem, start.equilibrium.state, start.eigenvector, start.frequency, start.speed, amplitude
        )
        assert correction.cycle is not None, correction.stop.advice
        found, multipliers = correction.cycle.unknowns, correction.cycle.spectrum.multipliers
        trivial = int(np.argmin(np.abs(multipliers - 1.0)))
        # A discrete map of a smooth flow keeps it to far below the residual; kinks of the clipped force in
        # the second derivative leave more, as does the residual asked of a multiplier (1e-10).
        assert abs(multipliers[trivial] - 1.0) < 1e-9
        rest = np.delete(multipliers, trivial)
        exponent = float(np.log(rest[np.argmin(np.abs(rest - 1.0))].real)) / found.period
        speeds.append(found.parameter - start.speed)
        periods.append(found.period - 2.0 * math.pi / start.frequency)
        ratios.append(exponent / (-2.0 * start.growth_slope * speeds[-1]))
        # stable whirl beyond the Hopf point, or unstable whirl before it
        assert unstable_count(multipliers, True) == (0 if speeds[-1] > 0.0 else 1)
    assert orders(np.abs(speeds).tolist())[1] == pytest.approx(2.0, abs=0.02)
    assert orders(np.abs(periods).tolist())[1] == pytest.approx(2.0, abs=0.02)
    assert abs(speeds[2]) < 2e-4
    assert abs(ratios[2] - 1.0) < 5e-3
    assert abs(ratios[2] - 1.0) < abs(ratios[0] - 1.0)


# --- Slow subspace against everything -------------------------------------------------------------


def assert_complete(problem: CycleProblem, cycle: Cycle) -> np.ndarray:
    """The slow multipliers are those of the full monodromy matrix, all of them; returns the full spectrum."""
    full = np.linalg.eigvals(
        full_monodromy(
            problem.period_map, cycle.unknowns.state, cycle.parameters, cycle.unknowns.period, cycle.steps
        )
    )
    slow = full[np.abs(full) > 0.1]
    assert len(slow) >= 8
    assert len(slow) == np.sum(np.abs(cycle.spectrum.multipliers) > 0.1)
    assert max(nearest(cycle.spectrum.multipliers, value) for value in slow) < 1e-9
    return full


@pytest.mark.parametrize(("grid", "speed"), [((16, 2), 1.0), ((24, 2), 1.1)])
def test_slow_multipliers_are_those_of_the_full_monodromy_matrix(grid: tuple[int, int], speed: float) -> None:
    one = case(grid, speed=speed)
    problem, machine = problem_of(one), build_machine(one)
    cycle = cycle_at(problem, equilibrium_of(machine, problem.parameters))
    assert cycle.basis.shape[1] < machine.size / 4
    assert_complete(problem, cycle)


@pytest.mark.slow
def test_a_cluster_of_foil_multipliers_is_left_to_the_picard_sweeps() -> None:
    """eta = 1 at Omega_ex = 2: the 2 (N_theta - 1) foil modes gather near exp(-T/eta) = exp(-pi)."""
    bearing = {**BEARING, "foil": {**FOIL, "loss_factor": 1.0}}
    one = case((24, 2), bearings=(bearing, bearing), excitation={"frequency": 2.0})
    problem, machine = problem_of(one), build_machine(one)
    state = equilibrium_of(machine, problem.parameters)
    full = assert_complete(problem, cycle_at(problem, state))
    assert np.sum(np.abs(np.log(np.abs(full)) + math.pi) < 0.15) == 46
    result, recorded = traced(problem, state, 1.0, ContinuationOptions((0.9, 1.3), max_points=3))
    assert result.stop is BranchStop.MAXIMUM_POINTS
    assert len(recorded) == 3
    # the columns of the basis never grow towards the cluster
    assert max(state.basis.shape[1] for _, state, _ in recorded) <= problem.options.basis.initial_columns + 4


def test_liouville() -> None:
    """log det M = integral of tr J over one period of the excitation.

    M is far below the smallest double, so its determinant is the product over many short pieces; they are
    possible in the autonomous formulation, where the phase is part of the state.
    """
    one = case((8, 1))
    machine, problem = build_machine(one), problem_of(one)
    parameters, pieces = problem.parameters, 128
    cycle = cycle_at(problem, equilibrium_of(machine, parameters))
    period_map = PeriodMap(machine_system(machine), DOPRI8, Formulation.AUTONOMOUS, samples=2)
    period = cycle.unknowns.period

    def trace(s: np.ndarray) -> float:
        phase, own = math.atan2(s[-2], s[-1]), np.ascontiguousarray(s[:-2])
        # the oscillator of Eq. 17 has the trace 2 - 4 (s1^2 + s2^2)
        return float(machine.jacobian(phase, own, parameters).trace()) + 2.0 - 4.0 * float(s[-2:] @ s[-2:])

    state, logarithm, integral = period_map.extend(cycle.unknowns.state), 0.0, 0.0
    for _ in range(pieces):
        image = period_map.evaluate(state, parameters, period / pieces, 16, np.eye(period_map.size))
        # Simpson's rule on the two halves of the piece
        integral += period / pieces / 6.0 * (trace(state) + 4.0 * trace(image.orbit[1]) + trace(image.state))
        sign, value = np.linalg.slogdet(image.columns)
        assert sign == 1.0
        logarithm, state = logarithm + float(value), image.state
    assert integral < -1000.0
    assert logarithm == pytest.approx(integral, rel=1e-10)


# --- Derivatives of the discrete map --------------------------------------------------------------


def test_columns_are_the_derivatives_of_the_discrete_map() -> None:
    """Every column of M and every parameter column against central differences of the map itself, also for
    the forcing frequency, with which the period changes: 1e-6 of the largest entry of a column.
    """
    one = case((12, 1))
    machine, problem = build_machine(one), problem_of(one)
    period_map, parameters = problem.period_map, problem.parameters
    cycle = cycle_at(problem, equilibrium_of(machine, parameters))
    state, period, steps = cycle.unknowns.state, cycle.unknowns.period, cycle.steps
    terms = tuple(period_map.parameter_column(index, parameters) for index in range(len(PARAMETERS)))
    image = period_map.evaluate(state, parameters, period, steps, np.eye(machine.size), terms)

    def shifted(j: int, h: float) -> np.ndarray:
        s, p = state.copy(), parameters.copy()
        if j < machine.size:
            s[j] += h
        else:
            p[j - machine.size] += h
        return period_map.evaluate(s, p, period_map.period(p), steps).state

    def central(j: int, h: float) -> np.ndarray:
        return (shifted(j, h) - shifted(j, -h)) / (2.0 * h)

    for j, column in enumerate(np.hstack([image.columns, image.inhomogeneous]).T):
        # of fourth order: truncation and rounding are below 2e-7 of a column at h = 1e-4
        difference = (4.0 * central(j, 1e-4) - central(j, 2e-4)) / 3.0
        scale = np.max(np.abs(column))
        assert scale > 1e-4
        assert np.max(np.abs(difference - column)) < 1e-6 * scale, j


# --- Continuation ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "low", "high"),
    [
        ("speed", 1.1, 1.14),
        ("excitation_frequency", 0.68, 0.7),
        ("displacement", 0.17, 0.2),
        ("foil_stiffness", 10.0, 10.5),
    ],
)
def test_continuation_in_every_parameter(parameter: str, low: float, high: float) -> None:
    """The smoke machine: the end of a branch is the cycle found there directly from the equilibrium."""
    text = [
        *COARSE,
        f"continue_cycles.parameter='{parameter}'",
        f"continue_cycles.range=[{low}, {high}]",
        f"continue_cycles.start={low}",
    ]
    (named,) = read_cases(SMOKE, "smoke.toml", text)
    machine, problem = build_machine(named.case), cycle_problem(build_machine(named.case), named.case)
    scale = low if parameter == "foil_stiffness" else 1.0
    result, recorded = traced(
        problem,
        equilibrium_of(machine, problem.parameters),
        low,
        ContinuationOptions((low, high), step=0.01, maximum_step=0.02, parameter_scale=scale),
    )
    assert result.stop is BranchStop.RANGE
    assert len(recorded) >= 3
    assert all(point.cycle.residual <= 1e-10 for point, _, _ in recorded)
    point, state, _ = recorded[-1]
    assert state.parameter == high
    there = replace(problem, parameters=problem.parameters_at(high))
    direct = cycle_at(there, equilibrium_of(machine, there.parameters), state.steps)
    assert np.max(np.abs(direct.unknowns.state - state.state)) < 1e-9
    assert nearest(direct.spectrum.multipliers, point.cycle.spectrum.multipliers[0]) < 1e-8


def test_located_speed_does_not_depend_on_the_step() -> None:
    """The Neimark-Sacker point of the smoke case, bracketed by branches of other starts and steps but with
    the same steps per period: the same speed and angle to 1e-8.
    """
    (named,) = read_cases(SMOKE, "smoke.toml", [*COARSE, "numerics.steps_per_period=64"])
    machine, problem = build_machine(named.case), cycle_problem(build_machine(named.case), named.case)
    found: list[Event] = []
    for start, step in ((1.18, 0.02), (1.16, 0.05), (1.17, 0.031)):
        at = at_speed(problem.parameters, start)
        options = ContinuationOptions(
            (start, 1.23), step=step, maximum_step=step, detection=DetectionOptions(event_tolerance=1e-10)
        )
        _, recorded = traced(problem, equilibrium_of(machine, at), start, options)
        found += [event for row in recorded for event in row[2] if event.kind is EventKind.NEIMARK_SACKER][:1]
    assert len(found) == 3
    speeds = [event.parameters[film.SPEED] for event in found]
    assert max(speeds) - min(speeds) < 1e-8
    assert max(event.angle for event in found) - min(event.angle for event in found) < 1e-8
    for event in found:
        # the distance of the multiplier from the unit circle, as an error of the speed
        assert event.residual / abs(event.transversality) < 1e-8
