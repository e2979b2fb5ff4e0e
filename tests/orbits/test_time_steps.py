"""How many time steps are chosen, and that the error which they leave is not below what is told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import (
    BranchPoint,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
)
from pipelines.bifurcations.detection import Event
from pipelines.case.reading import read_cases
from pipelines.machine.assembly import build_machine
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, NewtonStop, Unknowns, correct, first_basis
from pipelines.orbits.steppers import BUTCHER6, DOPRI8, RK4, Stepper
from pipelines.orbits.system import DynamicalSystem, ode_system
from pipelines.orbits.time_steps import (
    RequiredSteps,
    first_steps,
    next_steps,
    required_steps,
    spectral_radius,
    stable_steps,
)
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.cycles.start import FirstCycle, resting_start
from tests.systems import duffing, tondl

SMOKE = (Path(__file__).resolve().parents[2] / "configs" / "smoke.toml").read_text()
REFERENCE_STEPS = 4096


def nearest(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest distance from a multiplier above 0.1 to the nearest exact one."""
    found = found[np.abs(found) > 0.1]
    return float(np.max(np.min(np.abs(found[:, None] - exact[None, :]), axis=1)))


def cycle_with(problem: CycleProblem, near: Unknowns, steps: int, basis: np.ndarray) -> Cycle:
    found = correct(problem, near, problem.fixed_parameter(near.parameter), basis, steps)
    assert found.cycle is not None, found.stop.advice
    return found.cycle


def machine_problem(*overrides: str) -> tuple[CycleProblem, Unknowns]:
    case = read_cases(SMOKE, "smoke.toml", [*overrides])[0].case
    machine = build_machine(case)
    problem = cycle_problem(machine, case)
    start = resting_start(machine, problem)
    assert isinstance(start, FirstCycle)
    return problem, problem.consistent(Unknowns(start.start.state, 0.0, start.start.parameter))


COARSE = ("numerics.circumferential=16", "numerics.axial=1")


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        ("rotor.gravity=0",),  # the film is near the ambient pressure everywhere
        ("rotor.gravity=0", "excitation.displacement=0.05"),
        ("rotor.gravity=1", "excitation.displacement=0.4"),
        ("rotor.gravity=9.81",),
        ("rotor.gravity=9.81", "excitation.frequency=1.5"),
    ],
)
def test_the_error_is_not_above_twice_what_is_told(overrides: tuple[str, ...]) -> None:
    """For the steps of every tolerance, and for others; else the error is unknown, which is rare."""
    problem, guess = machine_problem(*overrides, *COARSE)
    rough = cycle_with(problem, guess, 100, first_basis(problem, guess, 100))
    exact = replace(problem, period_map=replace(problem.period_map, stepper=BUTCHER6))
    reference, other = (
        cycle_with(exact, rough.unknowns, steps, rough.basis).spectrum.multipliers
        for steps in (REFERENCE_STEPS, 3 * REFERENCE_STEPS // 4)
    )
    doubt = nearest(reference, other)  # kinks slow down the reference too
    assert doubt < 1e-5
    told = 0
    counts = [16, 20, 25, 32, 40, 50, 64, 80, 100, 128, 160, 200, 256, 320, 400]
    for steps in counts:
        cycle = cycle_with(problem, rough.unknowns, steps, rough.basis)
        error, true = required_steps(problem, cycle).error, nearest(cycle.spectrum.multipliers, reference)
        if math.isnan(error):
            continue
        told += 1
        assert true - doubt <= 2.0 * error, (steps, true, error)
        assert error <= 30.0 * (true + doubt), (steps, true, error)
    assert told >= 12


@pytest.mark.parametrize(
    ("error", "coarser", "expected"),
    [
        (4e-4, 9e-4, 143),  # kinks rule the error: half as many and a margin, rounded, are enough
        (4e-4, 2e-3, 258),  # half as many are not
        (4e-4, math.nan, 258),
        (math.nan, 1e-5, 258),
        (1e-6, 3.2e-5, 73),  # smooth: what its order predicts, 1.1 258 (1e-3)^(1/5), is fewer still
    ],
)
def test_fewer_steps_follow_where_half_as_many_were_enough(
    error: float, coarser: float, expected: int
) -> None:
    problem, _ = machine_problem("numerics.multiplier_tolerance=1e-3", *COARSE)
    assert next_steps(problem, RequiredSteps(258, error, coarser)) == expected


def test_the_error_of_half_as_many_steps() -> None:
    """Told from the pass with half as many, it is nearly what those steps tell of themselves."""
    problem, guess = machine_problem("excitation.displacement=0.05", *COARSE)
    told = {}
    for steps in (24, 48):
        cycle = cycle_with(problem, guess, steps, first_basis(problem, guess, steps))
        told[steps] = required_steps(problem, cycle)
    assert told[48].coarser == pytest.approx(told[24].error, rel=0.5)
    assert told[48].coarser == pytest.approx(32.0 * told[48].error, rel=1e-12)


def test_the_row_of_the_weightless_machine() -> None:
    """4.0e-7 was told with 400 steps where the multipliers are wrong by 8.8e-6."""
    problem, guess = machine_problem("rotor.gravity=0")
    rough = cycle_with(problem, guess, 400, first_basis(problem, guess, 400))
    assert 4.4e-6 < required_steps(problem, rough).error < 1e-4


def test_a_smooth_orbit_keeps_the_estimate_of_its_order() -> None:
    """What a pass with half the steps tells, to the bit, so that stores of smooth machines do not change."""
    problem, guess = machine_problem("excitation.displacement=0.05", *COARSE)
    cycle = cycle_with(problem, guess, 50, first_basis(problem, guess, 50))
    at = cycle.unknowns
    coarse = problem.period_map.evaluate(at.state, cycle.parameters, at.period, 25, cycle.basis)
    spectra = [np.linalg.eigvals(cycle.basis.T @ image.columns) for image in (cycle.image, coarse)]
    assert required_steps(problem, cycle).error == nearest(*spectra) / 31.0


def test_a_neighbour_with_nearly_the_same_error_spares_the_finer_pass(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not one with another number of steps, another error or an unknown one."""
    problem, guess = machine_problem("excitation.displacement=0.05", *COARSE)
    cycle = cycle_with(problem, guess, 50, first_basis(problem, guess, 50))
    alone, steps = required_steps(problem, cycle), []
    evaluate = PeriodMap.evaluate

    def counted(self, state, parameters, period, count, *others, **options):  # type: ignore[no-untyped-def]
        steps.append(count)
        return evaluate(self, state, parameters, period, count, *others, **options)

    monkeypatch.setattr(PeriodMap, "evaluate", counted)
    passes = {(50, 1.1): [25], (50, 1.4): [25, 75], (50, math.nan): [25, 75], (51, 1.0): [25, 75]}
    for (count, factor), expected in passes.items():
        steps.clear()
        found = required_steps(problem, cycle, RequiredSteps(count, factor * alone.error))
        assert steps == expected
        assert found == alone


# --- Explicit steppers ----------------------------------------------------------------------------


def bilinear() -> DynamicalSystem:
    """A forced oscillator whose spring is twice as stiff on one side: a kink at every passage of zero."""

    def stiffness(x: float) -> float:
        return 2.0 if x > 0.0 else 1.0

    return ode_system(
        lambda phase, s, p: [s[1], -0.2 * s[1] - stiffness(s[0]) * s[0] + p[1] * np.cos(phase)],
        lambda phase, s, p: [[0.0, 1.0], [-stiffness(s[0]), -0.2]],
        2,
        ("omega", "load"),
        "omega",
    )


SMALL = {
    "duffing": (duffing, np.array([0.9, 0.3]), "load", np.zeros(2)),
    "tondl": (tondl, np.array([0.05, 1.45]), "c1", np.array([0.33, 0.05, 0.0, 0.0])),
    "bilinear": (bilinear, np.array([0.8, 1.0]), "load", np.zeros(2)),
}


@pytest.mark.parametrize("name", list(SMALL))
@pytest.mark.parametrize("stepper", [RK4, BUTCHER6])
def test_explicit_steppers_tell_their_error(name: str, stepper: Stepper) -> None:
    make, parameters, parameter, state = SMALL[name]
    problem = CycleProblem(PeriodMap(make(), stepper, samples=16), parameters, parameter)
    guess = problem.consistent(Unknowns(state, 0.0, float(parameters[problem.index])))
    exact = replace(problem, period_map=replace(problem.period_map, stepper=DOPRI8))
    size = len(state)
    rough = cycle_with(exact, guess, 512, np.eye(size))
    reference = cycle_with(exact, rough.unknowns, 4096, np.eye(size)).spectrum.multipliers
    for steps in (16, 32, 48, 64, 96, 128, 192):
        cycle = cycle_with(problem, rough.unknowns, steps, np.eye(size))
        error, true = required_steps(problem, cycle).error, nearest(cycle.spectrum.multipliers, reference)
        assert math.isnan(error) or true <= 2.0 * error + 1e-10, (steps, true, error)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_the_tolerance_decides_for_an_explicit_stepper_too(tolerance: float) -> None:
    problem = CycleProblem(PeriodMap(tondl(), RK4), np.array([0.05, 1.45]), "c1")
    problem = replace(problem, options=replace(problem.options, step_tolerance=tolerance))
    errors: list[float] = []
    steps: list[int] = []

    def record(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        errors.append(point.step_error)
        steps.append(state.steps)

    start = BranchStart(np.array([0.33, 0.05, 0.0, 0.0]), 0.05)
    result = continue_branch(problem, start, ContinuationOptions((0.0, 0.08)), record)
    assert result.stop is BranchStop.RANGE
    assert all(0.0 < error <= 3.0 * tolerance for error in errors)
    assert min(steps) >= (256 if tolerance < 1e-6 else 128)


def wall(strength: float) -> CycleProblem:
    """x' = cos - d - strength d^7/7, d = x - sin(phase): the cycle x = sin(phase), on which J = -1."""

    def apart(phase: float, x: float) -> float:
        return x - math.sin(phase)

    system = ode_system(
        lambda phase, s, p: [
            math.cos(phase) * p[0] - apart(phase, s[0]) - strength * apart(phase, s[0]) ** 7 / 7.0
        ],
        lambda phase, s, p: [[-1.0 - strength * apart(phase, s[0]) ** 6]],
        1,
        ("omega",),
        "omega",
    )
    return CycleProblem(PeriodMap(system, DOPRI8), np.array([1.0]), "omega")


def test_steps_follow_from_the_orbit_not_from_its_start_held_fixed() -> None:
    problem = wall(1e6)
    for start in (0.0, 0.05):
        assert first_steps(problem, problem.consistent(Unknowns(np.array([start]), 0.0, 1.0))) == 128


def decay(rate: float) -> CycleProblem:
    system = ode_system(
        lambda phase, s, p: [-rate * (s[0] - math.sin(phase))], lambda phase, s, p: [[-rate]], 1, ("w",), "w"
    )
    return CycleProblem(PeriodMap(system, RK4), np.array([1.0]), "w")


def test_spectral_radius_and_steps() -> None:
    """A stiff linear system with a known spectrum; the steps chosen are stable and two thirds of them are
    not.
    """
    rates = -np.linspace(1.0, 900.0, 40)
    system = ode_system(
        lambda phase, s, p: rates * s + np.cos(phase),
        None,
        40,
        ("omega",),
        "omega",
        action=lambda phase, s, block, p: rates[:, None] * block,
    )
    period_map = PeriodMap(system, RK4, samples=16, minimum_steps=16)
    orbit, parameters = np.zeros((16, 40)), np.array([2.0])
    radius = spectral_radius(period_map, orbit, parameters)
    assert 0.9 * 900.0 < radius <= 900.0 * (1 + 1e-12)
    assert radius == spectral_radius(period_map, orbit, parameters)
    steps, period = stable_steps(period_map, radius, math.pi), math.pi
    assert steps % 16 == 0
    assert period_map.evaluate(np.ones(40), parameters, period, steps).finite
    assert np.max(np.abs(period_map.evaluate(np.ones(40), parameters, period, steps).state)) < 1.0
    unstable = period_map.evaluate(np.ones(40), parameters, period, 16 * (2 * steps // 48))
    assert not unstable.finite or np.max(np.abs(unstable.state)) > 1e3
    assert stable_steps(replace(period_map, steps_per_period=100), radius, period) == 112


def test_stability_is_a_lower_bound_and_has_a_cap() -> None:
    guess = Unknowns(np.zeros(1), 2.0 * math.pi, 1.0)
    problem = decay(1000.0)
    steps = first_steps(problem, guess)
    assert steps == stable_steps(problem.period_map, 1000.0, 2.0 * math.pi)
    cycle = cycle_with(problem, guess, steps, np.eye(1))
    assert required_steps(problem, cycle).steps == steps
    assert next_steps(problem, RequiredSteps(steps, 1e-30, 1e-30)) == steps
    stiff = decay(1e7)
    assert first_steps(stiff, guess) is NewtonStop.TOO_STIFF
    result = continue_branch(stiff, BranchStart(np.zeros(1), 1.0), ContinuationOptions((0.5, 2.0)), print)
    assert result.stop is BranchStop.START_FAILED
    assert "implicit" in result.message
    insisting = replace(stiff, period_map=replace(stiff.period_map, steps_per_period=64))
    assert first_steps(insisting, guess) == 64
