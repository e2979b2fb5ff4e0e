"""Cycles found alone: multipliers against closed forms and verified points, Newton's method where needed."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.orbits import forced_cycle as module
from pipelines.orbits.forced_cycle import ForcedCycle, ForcedCycleOptions, Method, forced_cycle
from pipelines.orbits.harmonic_balance import RestingSystem
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, NewtonStop, ShootingOptions, correct
from pipelines.orbits.steppers import DOPRI8, RK4
from pipelines.orbits.system import DynamicalSystem, ode_system
from pipelines.orbits.time_steps import halved_change
from tests.systems import duffing, tondl

TABLE = Path(__file__).parents[1] / "reference" / "tondl_verified_points.csv"
ROWS = list(csv.DictReader(TABLE.read_text().splitlines()))


def resting(problem: CycleProblem, state: np.ndarray) -> RestingSystem:
    system = problem.period_map.system
    return RestingSystem.of(state, system.tangent_at(0.0, state, np.eye(system.size), problem.parameters))


def forced_hopf() -> DynamicalSystem:
    """z' = (mu + i) z - z abs(z)^2 + load e^(i phase): in the frame of the load it is autonomous."""

    def rates(phase: float, s: np.ndarray, p: np.ndarray) -> list[float]:
        z = complex(s[0], s[1])
        slope = (p[1] + 1j) * z - z * abs(z) ** 2 + p[2] * np.exp(1j * phase)
        return [slope.real, slope.imag]

    def jacobian(phase: float, s: np.ndarray, p: np.ndarray) -> np.ndarray:
        x, y = s
        growth = (p[1] - x * x - y * y) * np.eye(2) - 2.0 * np.outer(s, s)
        return np.asarray(growth + np.array([[0.0, -1.0], [1.0, 0.0]]))

    return ode_system(rates, jacobian, 2, ("omega", "mu", "load"), "omega")


@pytest.mark.parametrize(("omega", "mu", "load"), [(1.3, -0.2, 0.15), (0.8, 0.05, 0.3)])
def test_the_multipliers_of_a_forced_hopf_point(omega: float, mu: float, load: float) -> None:
    """w = z e^(-i phase) rests where (mu + i (1 - omega) - abs(w)^2) w = -load: an autonomous point."""
    problem = CycleProblem(
        PeriodMap(forced_hopf(), DOPRI8, samples=16, minimum_steps=32), np.array([omega, mu, load]), "mu"
    )
    found = forced_cycle(problem, resting(problem, np.zeros(2)), ForcedCycleOptions(tolerance=1e-6))
    assert isinstance(found, ForcedCycle)
    assert found.method is Method.HARMONIC_BALANCE
    radii = np.roots([1.0, -2.0 * mu, mu**2 + (1.0 - omega) ** 2, -(load**2)])  # of the square of abs(w)
    (square,) = radii[np.abs(radii.imag) < 1e-9].real
    w = -load / (mu + 1j * (1.0 - omega) - square)
    np.testing.assert_allclose(found.cycle.unknowns.state, [w.real, w.imag], atol=1e-5)
    # d/dt (dw, dw*) : trace and determinant of the linearisation in the frame of the load
    trace, determinant = 2.0 * mu - 4.0 * square, (mu - 2.0 * square) ** 2 + (1.0 - omega) ** 2 - square**2
    rates = np.roots([1.0, -trace, determinant])
    expected = np.exp(rates * found.cycle.unknowns.period)
    for one in expected:
        assert np.min(np.abs(found.cycle.spectrum.multipliers - one)) < 1e-5


@pytest.mark.parametrize("row", ROWS[::2], ids=lambda row: f"{row['kind']}-{row['eta']}")
def test_verified_bifurcations_have_a_multiplier_on_the_circle(row: dict[str, str]) -> None:
    parameters = np.array([float(row["c1"]), float(row["eta"])])
    problem = CycleProblem(PeriodMap(tondl(), RK4), parameters, "c1")
    options = ForcedCycleOptions(6, 20, 1e-4)
    found = forced_cycle(problem, resting(problem, np.array([0.33, 0.05, 0.0, 0.0])), options)
    assert isinstance(found, ForcedCycle)
    for text in row["multipliers_forced_system"].split(";"):
        assert np.min(np.abs(found.cycle.spectrum.multipliers - complex(text))) < 2e-4
    assert found.cycle.residual <= 1e-4


def near_resonance(load: float) -> CycleProblem:
    options = ShootingOptions(tolerance=1e-9)
    return CycleProblem(PeriodMap(duffing(), RK4), np.array([1.25, load]), "load", options)


def test_newton_corrects_what_misses() -> None:
    """One harmonic does not suffice near resonance; the corrected cycle is that of plain shooting."""
    problem = near_resonance(0.12)
    at = resting(problem, np.zeros(2))
    found = forced_cycle(problem, at, ForcedCycleOptions(1, 4, 1e-7))
    assert isinstance(found, ForcedCycle)
    assert found.method is Method.NEWTON
    assert found.cycle.residual <= 1e-9
    held = problem.fixed_parameter(0.12)
    plain = correct(problem, found.cycle.unknowns, held, np.eye(2), 512)
    assert plain.cycle is not None
    np.testing.assert_allclose(found.cycle.spectrum.multipliers, plain.cycle.spectrum.multipliers, atol=1e-6)


def test_a_cycle_beside_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where neither harmonic balance nor the state at rest leads to the cycle, its neighbour does."""
    problem = near_resonance(0.12)
    at = resting(problem, np.zeros(2))
    beside = forced_cycle(problem, at, ForcedCycleOptions(5, 20))
    assert isinstance(beside, ForcedCycle)
    monkeypatch.setattr(module, "_balanced", lambda *arguments: [])
    problem = near_resonance(3.0)
    nowhere = replace(at, state=np.full(2, 1e3))
    assert isinstance(forced_cycle(problem, nowhere, ForcedCycleOptions()), NewtonStop)
    found = forced_cycle(problem, nowhere, ForcedCycleOptions(), beside)
    assert isinstance(found, ForcedCycle)
    assert found.method is Method.NEWTON
    assert found.cycle.parameters[1] == 3.0
    assert found.cycle.residual <= 1e-9


def test_no_cycle_is_a_result() -> None:
    """x' = x^2 + 1 + cos(phase) / 2 has none: every solution leaves in finite time."""
    system = ode_system(
        lambda phase, s, p: [s[0] ** 2 + 1.0 + 0.5 * np.cos(phase)],
        lambda phase, s, p: [[2.0 * s[0]]],
        1,
        ("omega",),
        "omega",
    )
    problem = CycleProblem(PeriodMap(system, RK4, samples=8, minimum_steps=16), np.array([1.0]), "omega")
    assert isinstance(forced_cycle(problem, resting(problem, np.ones(1)), ForcedCycleOptions()), NewtonStop)


def test_an_unknown_period_is_refused() -> None:
    problem = near_resonance(0.1)
    unknown = replace(problem, period_map=replace(problem.period_map, formulation=Formulation.AUTONOMOUS))
    with pytest.raises(ValueError, match="stroboscopic"):
        forced_cycle(unknown, resting(problem, np.zeros(2)), ForcedCycleOptions())


@pytest.mark.parametrize(("equal", "rate"), [(4, -0.2), (12, -0.05)])
def test_half_the_steps_change_the_leading_multipliers_of_a_cluster(equal: int, rate: float) -> None:
    """exp(rate T) many times over, more often than a chunk has columns, and slower ones in the first case."""
    rates = np.concatenate([np.full(equal, rate), np.linspace(-0.3, -0.9, 4)])
    system = ode_system(
        lambda phase, s, p: rates * s + np.cos(phase),
        lambda phase, s, p: np.diag(rates),
        len(rates),
        ("omega",),
        "omega",
    )
    stepper = PeriodMap(system, RK4, samples=4, minimum_steps=8)
    problem = CycleProblem(stepper, np.array([1.0]), "omega", ShootingOptions(step_tolerance=0.5))
    found = forced_cycle(problem, resting(problem, np.zeros(len(rates))), ForcedCycleOptions(tolerance=0.05))
    assert isinstance(found, ForcedCycle)
    step = 2.0 * np.pi * rates / found.cycle.steps

    def multipliers(step: np.ndarray, steps: int) -> np.ndarray:
        return np.asarray((1.0 + step + step**2 / 2.0 + step**3 / 6.0 + step**4 / 24.0) ** steps)

    fine, half = multipliers(step, found.cycle.steps), multipliers(2.0 * step, found.cycle.steps // 2)
    leading = np.argsort(-fine)[: max(8, equal)]
    assert halved_change(problem, found.cycle) == pytest.approx(np.abs(fine - half)[leading].max(), rel=1e-6)
    assert found.step_error == pytest.approx(np.abs(fine - half)[leading].max() / 15.0, rel=1e-6)
