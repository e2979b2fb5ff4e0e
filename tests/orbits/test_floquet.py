"""Multipliers and the basis of the slow subspace, on matrices whose spectrum is known."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pipelines.orbits.floquet import (
    BasisOptions,
    adapted_basis,
    deterministic_block,
    enlarge,
    floquet_spectrum,
    orthonormal,
    starting_basis,
    wanted_columns,
)
from pipelines.orbits.period_map import OrbitStart, PeriodMap
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import ode_system
from tests.helpers.monodromy import full_monodromy

OPTIONS = BasisOptions(initial_columns=8, maximum_columns=32)


def matrix_with(multipliers: np.ndarray, size: int = 60, seed: int = 4) -> np.ndarray:
    """A non-normal matrix with these real multipliers and zeros."""
    generator = np.random.default_rng(seed)
    diagonal = np.zeros(size)
    diagonal[: len(multipliers)] = multipliers
    frame = np.eye(size) + 0.3 * generator.standard_normal((size, size)) / math.sqrt(size)
    return frame @ np.diag(diagonal) @ np.linalg.inv(frame)


def test_subspace_iteration_converges_at_the_neglected_ratio() -> None:
    """The residual of mu falls by abs(mu_neglected/mu) per iteration."""
    matrix = matrix_with(np.array([0.9, -0.8, 0.7, 0.01, 0.005]))
    basis = orthonormal(deterministic_block(60, 3))
    residuals = []
    for _ in range(5):
        image = matrix @ basis
        residuals.append(floquet_spectrum(basis, image).residuals[2])
        basis = orthonormal(image)
    rates = [later / former for former, later in itertools.pairwise(residuals[1:])]
    assert np.allclose(rates, 0.01 / 0.7, rtol=0.3)


def test_spectrum_is_ordered_with_honest_residuals() -> None:
    matrix = matrix_with(np.array([0.5, -1.2, 0.1]))
    vectors = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(vectors[0]))[:3]
    invariant = orthonormal(vectors[1][:, order].real)
    exact = floquet_spectrum(invariant, matrix @ invariant)
    assert np.allclose(exact.multipliers, [-1.2, 0.5, 0.1], atol=1e-12)
    assert np.all(exact.residuals < 1e-12)
    tilted = orthonormal(invariant + 1e-3 * deterministic_block(60, 3))
    poor = floquet_spectrum(tilted, matrix @ tilted)
    assert np.all(poor.residuals > 1e-5)
    direct = np.linalg.norm(matrix @ poor.vectors - poor.vectors * poor.multipliers, axis=0)
    assert np.allclose(direct, poor.residuals, rtol=1e-9)
    assert np.allclose(np.linalg.norm(poor.vectors, axis=0), 1.0)


def test_orthonormal_is_deterministic_and_signed() -> None:
    block = deterministic_block(30, 5)
    q = orthonormal(block)
    assert q.tobytes() == orthonormal(block.copy()).tobytes()
    assert np.all(np.diag(q.T @ block) > 0.0)
    assert np.allclose(q.T @ q, np.eye(5), atol=1e-14)
    assert enlarge(q, 9).shape == (30, 9)
    assert np.allclose(enlarge(q, 9)[:, :5], q, atol=1e-13)


@pytest.mark.parametrize(
    ("moduli", "wanted"),
    [
        ([1.0, 0.5, 0.1, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9], 3 + 4),
        ([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3], 8 + 4),  # all isolated: grow
        ([1.0, 0.5] + [0.043] * 10, 2 + 4),  # a cluster: leave it to Picard
        ([1.0, 0.5] + [0.95 * 0.9] * 10, 12 + 4),  # too slow a cluster for Picard: resolve it
        ([1.0] * 40, 32),  # never above the cap
    ],
)
def test_wanted_columns(moduli: list[float], wanted: int) -> None:
    assert wanted_columns(np.array(moduli), 60, OPTIONS) == wanted


def test_adapted_basis_shrinks_onto_the_slow_subspace_and_grows() -> None:
    multipliers = np.array([1.1, 0.9, 0.8, 1e-5, 8e-6, 5e-6, 3e-6, 2e-6, 1e-6, 8e-7, 5e-7, 3e-7, 2e-7, 1e-7])
    matrix = matrix_with(multipliers)
    basis = orthonormal(deterministic_block(60, 14))
    for _ in range(4):
        basis = orthonormal(matrix @ basis)
    small = adapted_basis(basis, matrix @ basis, OPTIONS)
    assert small.shape == (60, 7)
    assert np.allclose(floquet_spectrum(small, matrix @ small).multipliers[:3], [1.1, 0.9, 0.8], atol=1e-10)
    two = orthonormal(deterministic_block(60, 2))
    grown = adapted_basis(two, matrix @ two, OPTIONS)
    assert grown.shape[1] == 6


def test_starting_basis_finds_all_slow_multipliers() -> None:
    """A linear system of 60 states with 20 slow ones needs more than the eight columns it starts with."""
    decay = np.concatenate([np.linspace(0.0, 0.7, 20), np.full(40, 6.0)])
    system = ode_system(
        lambda phase, s, p: -decay * s,
        None,
        60,
        ("omega",),
        "omega",
        action=lambda phase, s, block, p: -decay[:, None] * block,
    )
    period_map = PeriodMap(system, DOPRI8, samples=8, minimum_steps=16)
    orbit = OrbitStart(np.zeros(60), np.array([1.0]), 2.0 * math.pi, 16)
    basis = starting_basis(period_map, orbit, OPTIONS)
    assert 20 < basis.shape[1] <= 32
    image = period_map.evaluate(*orbit, basis).columns
    got = floquet_spectrum(basis, image).multipliers[:20]
    assert np.allclose(got, np.exp(-2.0 * math.pi * decay[:20]), atol=1e-6)
    full = full_monodromy(period_map, *orbit)
    assert np.allclose(np.diag(full)[:20], np.exp(-2.0 * math.pi * decay[:20]), atol=1e-8)
    assert np.array_equal(starting_basis(period_map, orbit, BasisOptions(initial_columns=60)), np.eye(60))
