"""Harmonic balance against closed forms and a verified cycle; its error falls spectrally."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.harmonic_balance import (
    HarmonicCycle,
    HarmonicOptions,
    RestingSystem,
    harmonic_balance,
    resting_near,
)
from pipelines.orbits.system import DynamicalSystem, ode_system
from tests.systems import hopf_pair, tondl

TABLE = Path(__file__).parents[1] / "reference" / "tondl_verified_points.csv"
ROWS = list(csv.DictReader(TABLE.read_text().splitlines()))
EXACT = 1e-13


def resting(system: DynamicalSystem, parameters: np.ndarray, state: np.ndarray) -> RestingSystem:
    """The system about a state, linearised at phase zero."""
    return RestingSystem.of(state, system.tangent_at(0.0, state, np.eye(system.size), parameters))


def balanced(
    system: DynamicalSystem, parameters: np.ndarray, state: np.ndarray, options: HarmonicOptions
) -> HarmonicCycle:
    found = harmonic_balance(system, resting(system, parameters, state), parameters, options)
    assert found.converged
    return found


def duffing_with_load(first: float, third: float) -> DynamicalSystem:
    """x'' + 0.2 x' + x + x^3 = load, with the load under which x = first cos(phase) + third cos(3 phase)."""

    def rates(phase: float, s: np.ndarray, p: np.ndarray) -> list[float]:
        x = first * np.cos(phase) + third * np.cos(3.0 * phase)
        v = -p[0] * (first * np.sin(phase) + 3.0 * third * np.sin(3.0 * phase))
        a = -(p[0] ** 2) * (first * np.cos(phase) + 9.0 * third * np.cos(3.0 * phase))
        load = a + 0.2 * v + x + x**3
        return [s[1], load - 0.2 * s[1] - s[0] - s[0] ** 3]

    def jacobian(phase: float, s: np.ndarray, p: np.ndarray) -> list[list[float]]:
        return [[0.0, 1.0], [-1.0 - 3.0 * s[0] ** 2, -0.2]]

    return ode_system(rates, jacobian, 2, ("omega",), "omega")


def test_a_cycle_of_few_harmonics_is_exact() -> None:
    """Cubes of three harmonics have nine: on twenty phases none is mistaken for another."""
    system, parameters = duffing_with_load(0.4, -0.1), np.array([1.7])
    found = balanced(system, parameters, np.zeros(2), HarmonicOptions(3, 20, EXACT, 60))
    np.testing.assert_allclose(found.state, [0.3, 0.0], atol=1e-12)
    expected = np.array([0.0, 0.2, 0.0, -0.05])  # of x: half of each amplitude
    np.testing.assert_allclose(found.harmonics[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(found.harmonics[:, 1], 1.7j * np.arange(4) * expected, atol=1e-12)


def test_a_linear_system_needs_one_iteration() -> None:
    """x_1 = (i omega - A)^-1 b; the second iteration only confirms it."""
    size, omega = 5, 0.9
    matrix = deterministic_block(size, size) - 0.8 * np.eye(size)
    load = deterministic_block(size, 1)[:, 0]
    system = ode_system(
        lambda phase, s, p: matrix @ s + load * np.cos(phase),
        lambda phase, s, p: matrix,
        size,
        ("omega",),
        "omega",
    )
    found = balanced(system, np.array([omega]), np.zeros(size), HarmonicOptions(1, 3, EXACT))
    exact = np.linalg.solve(1j * omega * np.eye(size) - matrix, 0.5 * load)
    assert found.iterations == 2
    np.testing.assert_allclose(found.harmonics[1], exact, atol=1e-13)


@pytest.mark.parametrize("row", [row for row in ROWS if row["kind"] == "NS"][:2], ids=lambda row: row["eta"])
def test_the_error_falls_spectrally_with_the_harmonics(row: dict[str, str]) -> None:
    """Against a verified cycle of Tondl's system, until the eight digits of the table are reached."""
    parameters = np.array([float(row["c1"]), float(row["eta"])])
    exact = np.array([float(row[f"u{i}_at_phase0"]) for i in range(1, 5)])
    errors = []
    for harmonics in (2, 4, 6, 12):
        options = HarmonicOptions(harmonics, 4 * harmonics + 1, EXACT, 80)
        found = balanced(tondl(), parameters, np.array([0.33, 0.05, 0.0, 0.0]), options)
        errors.append(float(np.max(np.abs(found.state - exact))))
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.1 * errors[1]
    assert errors[3] < 2e-8


def test_a_guess_saves_iterations() -> None:
    system, parameters = duffing_with_load(0.4, -0.1), np.array([1.7])
    at = resting(system, parameters, np.zeros(2))
    cold = harmonic_balance(system, at, parameters, HarmonicOptions(3, 20, 1e-8))
    warm = harmonic_balance(system, at, parameters, HarmonicOptions(6, 40, 1e-8), cold)
    assert warm.iterations < 0.5 * cold.iterations
    np.testing.assert_allclose(warm.state, cold.state, atol=1e-7)


def test_an_iteration_that_grows_is_given_up() -> None:
    """A load of ten times the size leads nowhere from the state at rest."""
    system = duffing_with_load(6.0, 0.0)
    at = resting(system, np.array([1.1]), np.zeros(2))
    found = harmonic_balance(system, at, np.array([1.1]), HarmonicOptions(iterations=500))
    assert not found.converged
    assert found.iterations < 500


def test_slow_modes_span_an_invariant_subspace() -> None:
    matrix = np.diag([-1.0, -0.1, -5.0, -0.3, -0.3, -7.0])
    matrix[3, 4], matrix[4, 3] = 2.0, -2.0
    turned = np.linalg.qr(deterministic_block(6, 6))[0]
    at = RestingSystem.of(np.zeros(6), turned @ matrix @ turned.T)
    basis = at.slow_basis(3)
    assert basis.shape == (6, 3)
    inside = basis.T @ at.matrix @ basis
    np.testing.assert_allclose(at.matrix @ basis, basis @ inside, atol=1e-12)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(inside).real), [-0.3, -0.3, -0.1], atol=1e-12)
    assert at.slow_basis(2).shape == (6, 1), "a pair is not divided"
    np.testing.assert_array_equal(at.slow_basis(6), np.eye(6))


def test_a_system_at_rest_balances_its_mean_load() -> None:
    """x'' + 0.1 x' + x + x^3 = 2 + cos(phase) rests at x = 1 with the stiffness 4; a free mass nowhere."""
    loaded = ode_system(
        lambda phase, s, p: [s[1], 2.0 + np.cos(phase) - 0.1 * s[1] - s[0] - s[0] ** 3],
        lambda phase, s, p: [[0.0, 1.0], [-1.0 - 3.0 * s[0] ** 2, -0.1]],
        2, ("omega",), "omega",
    )  # fmt: skip
    resting = resting_near(loaded, np.zeros(2), np.ones(1))
    assert resting is not None
    assert resting.state == pytest.approx([1.0, 0.0], abs=1e-12)
    assert np.allclose(resting.matrix, [[0.0, 1.0], [-4.0, -0.1]], rtol=0, atol=1e-12)
    floating = ode_system(
        lambda phase, s, p: [s[1], 1.0], lambda phase, s, p: [[0.0, 1.0], [0.0, 0.0]], 2, ("omega",), "omega"
    )
    assert resting_near(floating, np.zeros(2), np.ones(1)) is None
    never = ode_system(
        lambda phase, s, p: [1.0 + s[0] ** 2], lambda phase, s, p: [[2.0 * s[0]]], 1, ("omega",), "omega"
    )
    assert resting_near(never, np.ones(1), np.ones(1)) is None


def test_what_cannot_be_balanced() -> None:
    with pytest.raises(ValueError, match="twice as many phases"):
        HarmonicOptions(harmonics=3, phases=6)
    at = RestingSystem.of(np.zeros(4), np.eye(4))
    with pytest.raises(ValueError, match="frequency"):
        harmonic_balance(hopf_pair(), at, np.array([0.1, 0.0]), HarmonicOptions())
