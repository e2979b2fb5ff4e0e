"""The corrector: Newton when the basis is full, Newton-Picard when it is not, typed failures, Hopf start."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import (
    Correction,
    Cycle,
    CycleProblem,
    NewtonStop,
    ShootingOptions,
    Unknowns,
    correct,
    first_basis,
    following_basis,
    reference_of,
    tangent_at,
)
from pipelines.orbits.steppers import DOPRI8, RK4
from pipelines.orbits.system import ode_system
from pipelines.orbits.time_steps import first_steps
from tests.orbits.cluster_system import cluster_system
from tests.systems import closed_form_hopf_multipliers, duffing, hopf_pair, tondl


def solve(problem: CycleProblem, state: np.ndarray, value: float, period: float = 0.0) -> Correction:
    guess = problem.consistent(Unknowns(state, period, value))
    steps = first_steps(problem, guess)
    reference = reference_of(problem, guess, steps)
    basis = first_basis(problem, guess, steps)
    return correct(problem, guess, problem.fixed_parameter(value), basis, steps, reference)


def converged(correction: Correction) -> Cycle:
    assert correction.cycle is not None, correction.stop.advice
    return correction.cycle


def test_full_basis_is_newton() -> None:
    """Quadratic convergence: each residual is bounded by a constant times the square of the one before."""
    problem = CycleProblem(
        PeriodMap(tondl(), DOPRI8), np.array([0.03, 1.45]), "c1", ShootingOptions(tolerance=1e-13)
    )
    correction = solve(problem, np.array([0.8, 0.2, 0.0, 0.0]), 0.03)
    converged(correction)
    residuals = correction.residual_norms
    ratios = [later / former**2 for former, later in itertools.pairwise(residuals[1:-1])]
    assert len(ratios) >= 2
    assert max(ratios) < 10.0
    assert len(correction.update_norms) == len(residuals) - 1


def test_python_system_gives_the_same_cycle() -> None:
    parameters = np.array([0.9, 0.3])
    python = ode_system(
        lambda phase, s, p: [s[1], -0.1 * s[1] - s[0] - s[0] ** 3 + p[1] * np.cos(phase)],
        lambda phase, s, p: [[0.0, 1.0], [-1.0 - 3.0 * s[0] ** 2, -0.1]],
        2,
        ("omega", "load"),
        "omega",
    )
    cycles = [
        converged(solve(CycleProblem(PeriodMap(system), parameters, "load"), np.zeros(2), 0.3))
        for system in (duffing(), python)
    ]
    assert np.allclose(cycles[0].unknowns.state, cycles[1].unknowns.state, rtol=0, atol=1e-11)
    assert np.allclose(cycles[0].spectrum.multipliers, cycles[1].spectrum.multipliers, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("eta", "c1"), [(0.72, 0.03), (1.45, 0.05), (2.4, 0.0)])
def test_both_formulations_agree(eta: float, c1: float) -> None:
    """Same cycle, same multipliers, apart from 1 and exp(-2T) of the oscillator."""
    parameters, start = np.array([c1, eta]), np.array([0.33, 0.05, 0.0, 0.0])
    options = ShootingOptions(tolerance=1e-12)
    forced = converged(solve(CycleProblem(PeriodMap(tondl(), DOPRI8), parameters, "c1", options), start, c1))
    period_map = PeriodMap(tondl(), DOPRI8, Formulation.AUTONOMOUS)
    period = period_map.period(parameters)
    problem = CycleProblem(period_map, parameters, "c1", options)
    free = converged(solve(problem, period_map.extend(start), c1, 1.001 * period))
    assert free.unknowns.period == pytest.approx(period, abs=1e-10)
    expected = np.concatenate([forced.spectrum.multipliers, [1.0, math.exp(-2.0 * period)]])
    for multiplier in expected:
        assert np.min(np.abs(free.spectrum.multipliers - multiplier)) < 1e-8
    for multiplier in free.spectrum.multipliers:
        assert np.min(np.abs(expected - multiplier)) < 1e-8
    # the two may start at different phases of one curve: their means over the period are equal
    means = [cycle.image.orbit[:, :4].mean(axis=0) for cycle in (forced, free)]
    assert np.allclose(means[0], means[1], rtol=0, atol=1e-10)
    assert np.allclose(np.hypot(*free.image.orbit[:, 4:].T), 1.0, rtol=0, atol=1e-10)


def cluster_problem(columns: int) -> CycleProblem:
    options = ShootingOptions(
        tolerance=1e-11,
        picard_tolerance=1e-4,
        basis=BasisOptions(initial_columns=columns, maximum_columns=max(columns, 64)),
    )
    return CycleProblem(
        PeriodMap(cluster_system(), RK4, minimum_steps=64, samples=32),
        np.array([2.0, 0.5, 1.0]),
        "load",
        options,
    )


def test_newton_picard_agrees_with_newton() -> None:
    """90 states: the slow basis finds the cycle, the slow multipliers and the branch direction of the full
    one.
    """
    slow = converged(solve(cluster_problem(16), np.zeros(90), 0.5))
    full = converged(solve(cluster_problem(90), np.zeros(90), 0.5))
    assert slow.basis.shape[1] <= 24
    assert full.basis.shape[1] == 90
    assert np.allclose(slow.unknowns.state, full.unknowns.state, rtol=0, atol=1e-9)
    count = int(np.sum(np.abs(full.spectrum.multipliers) > 0.1))
    assert count == 12
    for multiplier in full.spectrum.multipliers[:count]:
        assert np.min(np.abs(slow.spectrum.multipliers - multiplier)) < 1e-8
    assert np.all(slow.spectrum.residuals[:count] < 1e-9)
    row = Unknowns(np.zeros(90), 0.0, 1.0)
    directions = [
        tangent_at(cluster_problem(n), c, row).state
        for n, c in ((16, slow), (90, full))  # type: ignore[union-attr]
    ]
    # the Picard sweeps stop at 1e-4 of the source, and that bounds the predictor's error
    assert np.max(np.abs(directions[0] - directions[1])) < 1e-3 * np.max(np.abs(directions[1]))


def test_a_step_is_as_sharp_as_newtons_with_a_basis_that_is_not_invariant() -> None:
    """The residual falls quadratically, though the basis comes from a cycle with another load."""
    cycle = converged(solve(cluster_problem(16), np.zeros(90), 0.5))
    problem = cluster_problem(16)
    whole, slow = (
        correct(problem, cycle.unknowns, problem.fixed_parameter(0.55), basis, cycle.steps)
        for basis in (np.eye(90), cycle.basis)
    )
    assert len(whole.residual_norms) > 2
    for newton, picard in zip(whole.residual_norms, slow.residual_norms, strict=False):
        assert picard <= 5.0 * newton + problem.options.tolerance


def test_cluster_is_not_chased() -> None:
    """78 multipliers near 0.043 stay out of the basis; only the isolated ones and the buffer are in it."""
    problem = cluster_problem(16)
    cycle = converged(solve(problem, np.zeros(90), 0.5))
    following = following_basis(problem, cycle)
    assert 12 < following.shape[1] <= 12 + 3 * problem.options.basis.buffer
    assert np.allclose(following.T @ following, np.eye(following.shape[1]), atol=1e-12)
    # and with that basis the cycle is corrected again in one or two steps from a nearby guess
    guess = Unknowns(cycle.unknowns.state, 0.0, 0.51)
    again = correct(problem, guess, problem.fixed_parameter(0.51), following, cycle.steps)
    assert again.stop is NewtonStop.CONVERGED
    assert again.iterations <= 4


def test_failures_are_typed() -> None:
    cubic = ode_system(
        lambda phase, s, p: [s[0] ** 2 + p[1] + 0.1 * np.cos(phase)],
        lambda phase, s, p: [[2.0 * s[0]]],
        1,
        ("omega", "level"),
        "omega",
    )
    problem = CycleProblem(PeriodMap(cubic), np.array([1.0, 0.5]), "level")
    assert solve(problem, np.array([1.0]), 0.5).stop is NewtonStop.NON_FINITE  # escapes within the period
    # level > 0 has no cycle at all
    without = solve(problem, np.array([-1.0]), 0.02)
    assert without.cycle is None
    assert without.stop in (NewtonStop.ITERATIONS, NewtonStop.DIVERGED, NewtonStop.NON_FINITE)
    assert all(stop.advice for stop in NewtonStop)
    # a row that says nothing leaves the system singular
    guess = Unknowns(np.array([-1.0]), 0.0, -1.0)
    empty = type(problem.fixed_parameter(0.0))(Unknowns(np.zeros(1), 0.0, 0.0), 1.0)
    assert correct(problem, guess, empty, np.eye(1), 128).stop is NewtonStop.SINGULAR
    few = CycleProblem(problem.period_map, problem.parameters, "level", ShootingOptions(iterations=1))
    assert solve(few, np.array([-0.5]), -1.0).stop is NewtonStop.ITERATIONS


def test_options_and_problems_are_checked() -> None:
    with pytest.raises(ValueError, match="tolerance is 2"):
        ShootingOptions(tolerance=2.0)
    with pytest.raises(ValueError, match=r"multiplier_cut is 1\.5"):
        BasisOptions(multiplier_cut=1.5)
    with pytest.raises(ValueError, match="initial_columns"):
        BasisOptions(initial_columns=80)
    with pytest.raises(ValueError, match="3 parameters given"):
        CycleProblem(PeriodMap(duffing()), np.ones(3), "omega")
    with pytest.raises(ValueError, match="unknown parameter 'speed'"):
        CycleProblem(PeriodMap(duffing()), np.ones(2), "speed")
    autonomous = CycleProblem(PeriodMap(tondl(), formulation=Formulation.AUTONOMOUS), np.ones(2), "c1")
    guess = Unknowns(np.zeros(6), 1.0, 0.0)
    with pytest.raises(ValueError, match="phase reference"):
        correct(autonomous, guess, autonomous.fixed_parameter(0.0), np.eye(6), 128)


HOPF_DECAY, HOPF_FREQUENCY, HOPF_DRIVE, HOPF_SHIFT = -0.1, 0.4, 0.3, 0.5


def hopf_problem() -> CycleProblem:
    period_map = PeriodMap(hopf_pair(HOPF_DECAY, HOPF_FREQUENCY, HOPF_DRIVE), DOPRI8, Formulation.AUTONOMOUS)
    return CycleProblem(period_map, np.array([0.0, HOPF_SHIFT]), "mu", ShootingOptions(tolerance=1e-12))


def hopf_eigenvector() -> np.ndarray:
    """(J - i) q = 0 with z = x + i y turning once and the pair driven by x."""
    pair = np.array([[HOPF_DECAY - 1j, -HOPF_FREQUENCY], [HOPF_FREQUENCY, HOPF_DECAY - 1j]])
    return np.concatenate([[1.0, -1j], np.linalg.solve(pair, [-HOPF_DRIVE, 0.0])])


@pytest.mark.parametrize("amplitude", [1e-3, 0.05, 0.3])
def test_hopf_start(amplitude: float) -> None:
    """The corrected cycle is the closed form: radius^2 = mu, T = 2 pi/(1 + b mu), and all four
    multipliers.
    """
    correction = start_at_hopf(hopf_problem(), np.zeros(4), hopf_eigenvector(), 1.0, 0.0, amplitude)
    cycle = converged(correction)
    mu = cycle.unknowns.parameter
    assert mu == pytest.approx(amplitude**2, rel=0.05)
    assert float(cycle.unknowns.state[:2] @ cycle.unknowns.state[:2]) == pytest.approx(mu, abs=1e-10)
    assert cycle.unknowns.period == pytest.approx(2.0 * math.pi / (1.0 + HOPF_SHIFT * mu), abs=1e-9)
    expected = closed_form_hopf_multipliers(mu, HOPF_SHIFT, HOPF_DECAY, HOPF_FREQUENCY)
    assert np.allclose(np.sort_complex(cycle.spectrum.multipliers), np.sort_complex(expected), atol=1e-8)


def test_hopf_start_refuses_what_cannot_work() -> None:
    with pytest.raises(ValueError, match="amplitude is -1"):
        start_at_hopf(hopf_problem(), np.zeros(4), hopf_eigenvector(), 1.0, 0.0, -1.0)
    forced = CycleProblem(PeriodMap(duffing()), np.ones(2), "omega")
    with pytest.raises(ValueError, match="autonomous"):
        start_at_hopf(forced, np.zeros(2), np.array([1.0, 1j]), 1.0, 0.0, 0.1)


# --- Residuals are relative to what they are made of ----------------------------------------------


def offset_cycle(scale: float) -> tuple[CycleProblem, np.ndarray]:
    """x' = -x + scale (sin + cos)(phase): x = scale sin(phase), zero at the phase where the map starts."""
    system = ode_system(
        lambda phase, s, p: [-s[0] + p[1] * (np.sin(phase) + np.cos(phase))],
        lambda phase, s, p: [[-1.0]],
        1,
        ("omega", "load"),
        "omega",
    )
    return CycleProblem(PeriodMap(system, DOPRI8), np.array([1.0, scale]), "load"), 0.7 * scale * np.ones(1)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_a_residual_is_relative_to_the_orbit(scale: float) -> None:
    """Not to the state at phase zero, which may vanish."""
    problem, guess = offset_cycle(scale)
    correction = solve(problem, guess, scale)
    cycle = converged(correction)
    assert correction.iterations == 1
    assert correction.residual_norms[0] == pytest.approx(0.7 * (1.0 - math.exp(-2.0 * math.pi)), rel=0.35)
    assert correction.update_norms[0] == pytest.approx(0.7, rel=0.35)
    assert abs(cycle.unknowns.state[0]) < 1e-10 * scale


def test_a_solution_at_rest_is_found() -> None:
    """Nothing is relative to an orbit of zeros and rounding errors."""
    cubic = ode_system(
        lambda phase, s, p: [s[1], -(p[1] + np.cos(phase)) * s[0] - 0.2 * s[1] - s[0] ** 3],
        lambda phase, s, p: [[0.0, 1.0], [-(p[1] + np.cos(phase)) - 3.0 * s[0] ** 2, -0.2]],
        2,
        ("omega", "stiffness"),
        "omega",
    )
    problem = CycleProblem(PeriodMap(cubic, DOPRI8), np.array([1.0, 3.0]), "stiffness")
    for guess in (np.zeros(2), np.full(2, 1e-3), np.full(2, 1e-14)):
        assert np.max(np.abs(converged(solve(problem, guess, 3.0)).unknowns.state)) < 1e-12


def test_a_closing_row_is_relative_to_its_terms() -> None:
    """An exact cycle is one at any size of the parameter, and a parameter that is a little off is not."""
    for load in (1e-6, 1.0, 1e8):
        problem, _ = offset_cycle(load)
        near = problem.consistent(Unknowns(np.zeros(1), 0.0, load * (1.0 + 1e-15)))
        constraint = problem.fixed_parameter(load)
        assert constraint.error(near) <= 1e-14
        assert constraint.error(Unknowns(np.zeros(1), 0.0, load * 1.001)) == pytest.approx(1e-3, rel=0.01)
        assert correct(problem, near, constraint, np.eye(1), 128).stop is NewtonStop.CONVERGED


@pytest.mark.parametrize("size", [1.0, 1e2, 1e3, 1e4, 1e6])
def test_an_exact_cycle_of_any_amplitude_is_one(size: float) -> None:
    """z' = (mu + i) z - z |z|^2/K^2 with |z| = K sqrt(mu) and T = 2 pi."""
    system = ode_system(
        lambda phase, s, p: [(p[0] - s @ s / size**2) * s[0] - s[1], (p[0] - s @ s / size**2) * s[1] + s[0]],
        lambda phase, s, p: [
            [p[0] - (3 * s[0] ** 2 + s[1] ** 2) / size**2, -1 - 2 * s[0] * s[1] / size**2],
            [1 - 2 * s[0] * s[1] / size**2, p[0] - (s[0] ** 2 + 3 * s[1] ** 2) / size**2],
        ],
        2,
        ("mu",),
    )
    problem = CycleProblem(PeriodMap(system, DOPRI8, Formulation.AUTONOMOUS), np.array([0.5]), "mu")
    exact = solve(problem, size * np.array([math.sqrt(0.5), 0.0]), 0.5, 2.0 * math.pi)
    assert converged(exact)
    assert exact.iterations == 0
    near = solve(problem, size * np.array([0.72, 0.01]), 0.5, 2.05 * math.pi)
    assert converged(near).unknowns.period == pytest.approx(2.0 * math.pi, abs=1e-9)
    assert near.iterations == 3


def test_rounding_is_told_from_a_start_too_far() -> None:
    """The first asks for another tolerance, and says which; the second for a closer start."""
    parameters, start = np.array([0.03, 1.45]), np.array([0.8, 0.2, 0.0, 0.0])

    def stopped(**options: float) -> Correction:
        settings = ShootingOptions(**options)  # type: ignore[arg-type]
        return solve(CycleProblem(PeriodMap(tondl(), DOPRI8), parameters, "c1", settings), start, 0.03)

    fine = stopped(tolerance=1e-17)
    assert fine.stop is NewtonStop.ROUNDING
    asked = float(fine.advice.split()[-1])
    assert 1e-15 < asked < 1e-12
    assert stopped(tolerance=asked).cycle is not None
    assert stopped(iterations=2).stop is NewtonStop.ITERATIONS
    assert "start closer" in stopped(iterations=2).advice
