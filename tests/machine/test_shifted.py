"""The shifted equations of the machine: (I - shift J) x = b against the dense matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipelines.case.models import Case
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.lanes import LANES
from pipelines.machine.rates import JOURNAL, ROTOR_STATE, are_twins
from pipelines.orbits.machine_cycles import machine_system
from tests.machines import BEARING, FOIL, OTHER_BEARING, case, symmetric_rotor

PHASE = 0.7


def states(description: Case) -> tuple[Any, np.ndarray, np.ndarray]:
    """The system, a state away from any equilibrium with pressures on both sides of ambient, the
    parameters.
    """
    machine = build_machine(description)
    state = 0.02 * np.random.default_rng(3).standard_normal(machine.size)
    for bearing in range(2):
        machine.pressures(state, bearing)[:] += 1.0
    return machine_system(machine), state, parameter_vector(description)


def solved(
    system: Any, state: np.ndarray, parameters: np.ndarray, shift: float, right: np.ndarray
) -> np.ndarray:
    factors, work = np.zeros(system.shifted.factors_size), np.zeros(system.work_size)
    system.shifted.factorise(PHASE, state, parameters, shift, system.constants, system.layout, work, factors)
    lines = right.copy().ravel()
    system.shifted.solve(factors, system.constants, system.layout, work, lines)
    return lines.reshape(right.shape)


def check_solution(system: Any, state: np.ndarray, parameters: np.ndarray, shift: float) -> None:
    """Against the dense matrix; 1e-11 because the condition number reaches 1e4."""
    right = np.random.default_rng(4).standard_normal((system.size, LANES))
    jacobian = system.tangent_at(PHASE, state, np.eye(system.size), parameters)
    expected = np.linalg.solve(np.eye(system.size) - shift * jacobian, right)
    found = solved(system, state, parameters, shift, right)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def pair(
    first: dict[str, Any], second: dict[str, Any], **changes: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    return {**first, **changes}, {**second, **changes}


@pytest.mark.parametrize("shift", [1e-3, 0.05, 1.0])
@pytest.mark.parametrize("film", ["edge", "periodic"])
@pytest.mark.parametrize("scheme", ["central", "fourth_order"])
@pytest.mark.parametrize("grid", [(8, 1), (12, 2), (16, 3), (12, 4), (9, 6)])
def test_solution_of_the_dense_system(grid: tuple[int, int], scheme: str, film: str, shift: float) -> None:
    """Two bearings that differ in every length."""
    bearings, numerics = pair(BEARING, OTHER_BEARING, film=film), {"scheme": scheme}
    system, state, parameters = states(case(grid, bearings=bearings, numerics=numerics))
    check_solution(system, state, parameters, shift)


def test_solution_with_slopes_kept() -> None:
    """More freedoms at some masters, at a journal's too: the journals are still found."""
    masters = (0, {"node": 2, "slopes": True}, 7, 12, {"node": 14, "slopes": True})
    rotor = symmetric_rotor(masters=masters)
    system, state, parameters = states(case((12, 2), bearings=(BEARING, OTHER_BEARING), rotor=rotor))
    assert system.size == 2 * 11 * 3 + 2 * 14
    check_solution(system, state, parameters, 0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"foil": {"rigid": True}},
        {"foil": {**FOIL, "damping": "loss_factor"}},
        {"clipping": "full"},
        {"clipping": "smooth"},
    ],
    ids=str,
)
def test_variants_of_the_bearing(changes: dict[str, Any]) -> None:
    description = case((12, 2), bearings=pair(BEARING, OTHER_BEARING, **changes))
    system, state, parameters = states(description)
    check_solution(system, state, parameters, 0.05)


def twins(description: Case) -> tuple[Any, np.ndarray, np.ndarray]:
    """The system, a state with both films and journals alike, the parameters."""
    system, state, parameters = states(description)
    machine = build_machine(description)
    first, second = machine.bearings
    films = first.settings.unknowns
    state[films : 2 * films] = state[:films]
    rotor = state[2 * films :].reshape(2, -1)
    at, beside = system.layout[JOURNAL], system.layout[JOURNAL + 1]
    rotor[:, beside : beside + 2] = rotor[:, at : at + 2]
    assert first.settings.unknowns == second.settings.unknowns
    return system, state, parameters


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-8])
@pytest.mark.parametrize("where", ["pressure", "foil", "journal"])
def test_twin_bearings(apart: float, where: str) -> None:
    """Films that are nearly alike share their factors; the solution is still that of the dense matrix."""
    system, state, parameters = twins(case((12, 4), numerics={"scheme": "fourth_order"}))
    journal = system.layout[ROTOR_STATE] + system.layout[JOURNAL]
    state[{"pressure": 3, "foil": 11 * 4 + 5, "journal": journal}[where]] += apart
    assert are_twins(state, system.constants, system.layout) == (apart < 1e-10)
    check_solution(system, state, parameters, 0.05)


@pytest.mark.parametrize(
    "change", [{"clearance": 22e-6}, {"foil": {**FOIL, "loss_factor": 0.3}}, {"clipping": "smooth"}]
)
def test_bearings_that_differ_are_no_twins(change: dict[str, Any]) -> None:
    """In any constant, however alike their films are."""
    system, state, _ = twins(case((8, 2), bearings=(BEARING, {**BEARING, "node": 12, **change})))
    assert not are_twins(state, system.constants, system.layout)


def test_factors_follow_the_speed() -> None:
    """The rotor's matrices are kept between calls with the same shift and speed, and renewed with another."""
    system, state, parameters = states(case((8, 1)))
    right = np.random.default_rng(4).standard_normal((system.size, LANES))
    factors, work = np.zeros(system.shifted.factors_size), np.zeros(system.work_size)
    for speed, shift in ((1.0, 0.1), (1.5, 0.1), (1.5, 0.2)):
        parameters[0] = speed
        system.shifted.factorise(
            PHASE, state, parameters, shift, system.constants, system.layout, work, factors
        )
        lines = right.copy().ravel()
        system.shifted.solve(factors, system.constants, system.layout, work, lines)
        np.testing.assert_array_equal(
            lines.reshape(right.shape), solved(system, state, parameters, shift, right)
        )


def test_a_state_without_a_film_gives_no_numbers() -> None:
    """Newton may step out of the domain of the equations; that ends a step, not the program."""
    system, state, parameters = states(case((8, 1)))
    right = np.ones((system.size, LANES))
    for broken in (np.nan, np.inf, 1e200):
        beyond = np.full_like(state, broken)
        assert not np.all(np.isfinite(solved(system, beyond, parameters, 0.05, right)))
    assert np.all(np.isfinite(solved(system, state, parameters, 0.05, right)))
