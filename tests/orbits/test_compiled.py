"""Compiled systems of Python functions: the same as the interpreted ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from pipelines.machine.lanes import LANES
from pipelines.orbits.compiled import compiled_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.steppers import BUTCHER6, DOPRI8, ESDIRK5
from pipelines.orbits.system import DynamicalSystem
from tests.systems import duffing


def rates(phase, s, p, out):  # type: ignore[no-untyped-def]
    out[0] = s[1]
    out[1] = -0.1 * s[1] - s[0] - s[0] ** 3 + p[1] * np.cos(phase)


def jacobian(phase, s, p, out):  # type: ignore[no-untyped-def]
    out[0, 1] = 1.0
    out[1, 0] = -1.0 - 3.0 * s[0] ** 2
    out[1, 1] = -0.1


@pytest.fixture(scope="module")
def compiled() -> DynamicalSystem:
    return compiled_system(rates, njit(jacobian), 2, ("omega", "load"), "omega")


@pytest.mark.parametrize(("stepper", "accuracy"), [(BUTCHER6, 1e-14), (DOPRI8, 1e-14), (ESDIRK5, 1e-6)])
def test_the_same_period_map(compiled: DynamicalSystem, stepper, accuracy: float) -> None:  # type: ignore[no-untyped-def]
    state, parameters, period = np.array([0.3, -0.2]), np.array([1.1, 0.4]), 2.0 * math.pi / 1.1
    reference = stepper if stepper is not ESDIRK5 else DOPRI8
    own = PeriodMap(compiled, stepper).evaluate(state, parameters, period, 256, np.eye(2))
    known = PeriodMap(duffing(), reference).evaluate(state, parameters, period, 256, np.eye(2))
    assert own.state == pytest.approx(known.state, abs=accuracy)
    assert own.columns == pytest.approx(known.columns, abs=accuracy)


@pytest.mark.slow
def test_the_shifted_equations_are_solved_with_pivots() -> None:
    """I - shift J with a zero on its diagonal."""
    matrix = np.array([[1.0, 2.0, 0.5], [-1.0, 0.3, 4.0], [0.2, -0.7, -2.0]])

    def linear(phase, s, p, out):  # type: ignore[no-untyped-def]
        out[:] = matrix @ s

    def constant(phase, s, p, out):  # type: ignore[no-untyped-def]
        out[:] = matrix

    system = compiled_system(linear, constant, 3, ("omega",), "omega")
    assert system.shifted is not None
    work, factors = np.zeros(system.work_size), np.zeros(system.shifted.factors_size)
    common = (system.constants, system.layout, work)
    system.shifted.factorise(0.0, np.ones(3), np.ones(1), 1.0, *common, factors)
    lines = np.arange(3.0 * LANES)
    right = lines.reshape(3, LANES).copy()
    system.shifted.solve(factors, *common, lines)
    assert np.allclose((np.eye(3) - matrix) @ lines.reshape(3, LANES), right, rtol=0, atol=1e-12)


def test_an_unknown_forcing_is_refused() -> None:
    with pytest.raises(ValueError, match="forcing"):
        compiled_system(rates, jacobian, 2, ("omega", "load"), "speed")
