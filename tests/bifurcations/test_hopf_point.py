"""Hopf points of autonomous systems, and cycles from them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.hopf_point import cycles_from_hopf, hopf_point
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import ode_system
from tests.bifurcations.autonomous_flows import lorenz, roessler
from tests.systems import duffing


def free(system, parameters: tuple[float, ...], name: str) -> CycleProblem:  # type: ignore[no-untyped-def]
    return CycleProblem(PeriodMap(system, DOPRI8, Formulation.AUTONOMOUS), np.array(parameters), name)


def test_lorenz() -> None:
    """rho = sigma (sigma + b + 3)/(sigma - b - 1), omega^2 = b (sigma + rho)."""
    found = hopf_point(free(lorenz(), (0.0,), "rho"), (20.0, 30.0), np.array([8.0, 8.0, 24.0]))
    rho = 10.0 * (10.0 + 8.0 / 3.0 + 3.0) / (10.0 - 8.0 / 3.0 - 1.0)
    side = math.sqrt(8.0 / 3.0 * (rho - 1.0))
    assert found.parameter == pytest.approx(rho, abs=1e-9)
    assert found.frequency == pytest.approx(math.sqrt(8.0 / 3.0 * (10.0 + rho)), abs=1e-9)
    assert found.equilibrium == pytest.approx(np.array([side, side, rho - 1.0]), abs=1e-9)


def test_cycles_of_roessler_from_the_hopf_point() -> None:
    problem = free(roessler(), (0.1, 0.2, 2.0), "a")
    found = hopf_point(problem, (0.01, 0.1), np.zeros(3))
    jacobian = problem.period_map.system.tangent_at(
        0.0, found.equilibrium, np.eye(3), problem.parameters_at(found.parameter)
    )
    assert np.allclose(jacobian @ found.eigenvector, 1j * found.frequency * found.eigenvector, atol=1e-9)
    first = cycles_from_hopf(problem, found, 0.01)
    assert first is not None
    assert first.parameter == pytest.approx(found.parameter, abs=1e-5)
    assert first.period == pytest.approx(2 * math.pi / found.frequency, abs=1e-4)
    hasty = replace(problem, options=replace(problem.options, iterations=1))
    assert cycles_from_hopf(hasty, found, 1.0) is None


def test_what_is_no_hopf_point() -> None:
    with pytest.raises(ValueError, match="forced"):
        hopf_point(CycleProblem(PeriodMap(duffing()), np.ones(2), "load"), (0.0, 1.0), np.zeros(2))
    with pytest.raises(ValueError, match="no pair"):
        hopf_point(free(roessler(), (0.1, 0.2, 2.0), "a"), (0.05, 0.1), np.zeros(3))
    saddle = ode_system(
        lambda phase, s, p: [s[0], p[0] * s[1]], lambda phase, s, p: [[1, 0], [0, p[0]]], 2, ("a",)
    )
    with pytest.raises(ValueError, match="two real"):
        hopf_point(free(saddle, (0.0,), "a"), (-2.0, -0.3), np.zeros(2))
    # x' = a + x^2 has no equilibrium for a > 0
    gone = ode_system(
        lambda phase, s, p: [p[0] + s[0] ** 2, s[0] - s[1]],
        lambda phase, s, p: [[2 * s[0], 0], [1, -1]],
        2,
        ("a",),
    )
    with pytest.raises(ValueError, match="no equilibrium"):
        hopf_point(free(gone, (0.0,), "a"), (-1.0, 1.0), np.array([-1.0, -1.0]))
