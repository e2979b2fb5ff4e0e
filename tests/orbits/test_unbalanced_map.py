"""The map over one excitation period with unbalance: periodicity in the angle, and its derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.unbalance import UnbalanceMass
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.steppers import ESDIRK5
from tests.helpers.unbalanced_map import UnbalancedMap, unbalanced_map
from tests.machines import case

MASSES = (UnbalanceMass(2, 3e-6), UnbalanceMass(9, 1e-6, 1.0))
ANGLE, STEPS = 0.7, 40


@pytest.fixture(scope="module")
def turning() -> tuple[UnbalancedMap, np.ndarray]:
    description = case((16, 1), displacement=0.1, speed=0.8)
    machine, parameters = build_machine(description), parameter_vector(description)
    return unbalanced_map(machine, MASSES, parameters, STEPS), machine_equilibrium(machine, parameters).state


def test_without_unbalance_it_is_the_map_of_the_machine(turning):
    unbalanced, state = turning
    description = case((16, 1), displacement=0.1, speed=0.8)
    plain = PeriodMap(machine_system(build_machine(description)), stepper=ESDIRK5)
    parameters = unbalanced.parameters
    expected = plain.evaluate(state, parameters, plain.period(parameters), STEPS).state
    balanced = UnbalancedMap(unbalanced.period_map, parameters, STEPS, unbalance=0.0)
    np.testing.assert_allclose(balanced.evaluate(state, ANGLE).state, expected, rtol=0.0, atol=1e-11)
    assert np.abs(unbalanced.evaluate(state, ANGLE).state - expected).max() > 1e-3


def test_it_repeats_after_a_turn(turning):
    unbalanced, state = turning
    first, second = (unbalanced.evaluate(state, angle).state for angle in (ANGLE, ANGLE + 2.0 * math.pi))
    np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-12)
    assert unbalanced.rotation == pytest.approx(2.0 * math.pi * 0.8 / 0.7, rel=1e-14)


def central(function, h: float) -> np.ndarray:
    """Derivative at zero: differences of fourth order."""
    weights = ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0))
    return sum(w * function(k * h) for k, w in weights) / (12.0 * h)


def test_columns_are_the_derivative_of_the_discrete_map(turning):
    unbalanced, state = turning
    columns = deterministic_block(state.size, 3)
    image = unbalanced.evaluate(state, ANGLE, columns)
    for j in range(3):
        expected = central(lambda t, j=j: unbalanced.evaluate(state + t * columns[:, j], ANGLE).state, 1e-4)
        np.testing.assert_allclose(image.columns[:, j], expected, rtol=0.0, atol=1e-7)


def test_derivative_by_the_angle(turning):
    unbalanced, state = turning
    image = unbalanced.evaluate(state, ANGLE)
    expected = central(lambda t: unbalanced.evaluate(state, ANGLE + t).state, 1e-3)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(image.by_angle, expected, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize(
    ("name", "index"), [("speed", 0), ("excitation_frequency", 1), ("displacement", 2), ("unbalance", None)]
)
def test_derivative_by_a_parameter(turning, name, index):
    unbalanced, state = turning

    def moved(t: float) -> np.ndarray:
        parameters = unbalanced.parameters.copy()
        if index is not None:
            parameters[index] += t
        factor = 1.0 + (t if index is None else 0.0)
        return UnbalancedMap(unbalanced.period_map, parameters, STEPS, factor).evaluate(state, ANGLE).state

    image = unbalanced.evaluate(state, ANGLE, parameter=name)
    assert image.by_parameter is not None
    expected = central(moved, 1e-4)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(image.by_parameter, expected, rtol=0.0, atol=1e-6)
