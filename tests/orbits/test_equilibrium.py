"""Equilibria: forces balance, the ring's mean deformation shifts them, and a failure says why."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.equilibria import equilibrium
from pipelines.orbits.equilibria.equilibrium import (
    MEAN_PHASE,
    Equilibrium,
    at_rest,
    equilibrium_along,
    machine_equilibrium,
)
from pipelines.orbits.equilibria.linear import at_speed
from tests.helpers.rotors import HEAVY_ON_SOFT_FOILS, random_rotor
from tests.machines import BEARING, OTHER_BEARING, case, symmetric_rotor

Solved = tuple[Machine, NDArray[np.float64], Equilibrium]


def solved(**changes: object) -> Solved:
    description = case((24, 2), **changes)  # type: ignore[arg-type]
    machine, parameters = build_machine(description), parameter_vector(description)
    return machine, parameters, machine_equilibrium(machine, parameters)


def newtons(
    machine: Machine, parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Film forces on the two journals, shape (2, 2) [N]."""
    return np.array(
        [
            machine.film(index, MEAN_PHASE, state, at_rest(parameters)).force * own.force
            for index, own in enumerate(machine.scales.bearings)
        ]
    )


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"displacement": 0.0},
        {"bearings": (BEARING, OTHER_BEARING)},
        {"bearings": (OTHER_BEARING, {**BEARING, "film": "periodic", "clipping": "full"})},
        {"speed": 0.2},
        {"speed": 3.0},
    ],
    ids=["active", "passive", "unequal", "unequal films", "slow", "fast"],
)
def test_films_carry_the_rotor(changes: dict[str, object]) -> None:
    """The residual vanishes; vertical forces add up to the weight, horizontal ones to nothing."""
    machine, parameters, equilibrium = solved(**changes)
    assert equilibrium.converged, equilibrium.reason
    residual = machine.rates(MEAN_PHASE, equilibrium.state, at_rest(parameters))
    assert np.abs(residual).max() <= 1e-11
    assert equilibrium.residual == np.abs(residual).max()
    # 360 mm of 17.6 mm shaft of 7850 kg/m3 and two discs of 79 g; what hangs on the masters is all of it.
    weight = 9.81 * (7850.0 * np.pi * 0.0176**2 / 4.0 * 0.360 + 2 * 0.079)
    total = newtons(machine, parameters, equilibrium.state).sum(axis=0)
    np.testing.assert_allclose(total, [0.0, weight], rtol=0.0, atol=1e-8 * weight)
    assert machine.minimum_film(MEAN_PHASE, equilibrium.state, at_rest(parameters)).min() > 0.0


def test_symmetric_machine_shares_the_load() -> None:
    machine, parameters, equilibrium = solved()
    forces = newtons(machine, parameters, equilibrium.state)
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        machine.journal(equilibrium.state, 0), machine.journal(equilibrium.state, 1), atol=1e-10
    )


def test_journal_moves_along_the_load_as_speed_falls() -> None:
    """Slower films are weaker: the journal sinks, and the film at its thinnest gets thinner."""
    heights, films = [], []
    for speed in (0.2, 0.5, 1.0, 2.0):
        machine, parameters, equilibrium = solved(speed=speed, displacement=0.0)
        heights.append(machine.journal(equilibrium.state, 0)[1])
        films.append(machine.minimum_film(MEAN_PHASE, equilibrium.state, parameters)[0])
    assert (np.diff(heights) > 0.0).all()
    assert (np.diff(films) > 0.0).all()


def test_mean_deformation_of_the_ring_lifts_the_journal() -> None:
    """In its mean position the ring is delta/2 flatter: the lower half of the foil rises by about that."""
    machine, _, passive = solved(displacement=0.0)
    _, parameters, active = solved(displacement=0.2)
    shift = machine.journal(active.state, 0)[1] - machine.journal(passive.state, 0)[1]
    assert 0.5 * 0.1 < shift < 1.5 * 0.1
    # It is the ring at rest: the excitation frequency has no part in it.
    parameters[1] = 2.3
    again = machine_equilibrium(machine, parameters)
    np.testing.assert_allclose(again.state, active.state, rtol=0.0, atol=1e-9)


def test_a_guess_saves_iterations_and_changes_nothing() -> None:
    machine, parameters, equilibrium = solved()
    near = parameters.copy()
    near[0] *= 1.01
    followed = machine_equilibrium(machine, near, equilibrium.state)
    scratch = machine_equilibrium(machine, near)
    assert followed.iterations < scratch.iterations
    np.testing.assert_allclose(followed.state, scratch.state, rtol=0.0, atol=1e-9)


def test_bad_guess_is_no_obstacle() -> None:
    machine, parameters, equilibrium = solved()
    closed = equilibrium.state.copy()
    closed[machine.rotor_start : machine.rotor_start + machine.rotor_freedoms] = 7.0
    result = machine_equilibrium(machine, parameters, closed)
    assert result.converged
    np.testing.assert_allclose(result.state, equilibrium.state, rtol=0.0, atol=1e-9)


SENTENCE = r"the films carry only (\d+\.\d) % of the rotor's weight at this speed \([^)]+\)"
LIGHTER = r"; raise the speed, the bearing area or the viscosity, or lighten the rotor"
FINER = (
    r", on (48 x 3|96 x 4) all of it with a smallest film of 0\.\d+ clearances; "
    r"raise numerics.circumferential or lighten the rotor"
)


@pytest.mark.slow
def test_rotor_too_heavy_to_float() -> None:
    """No exception but the share that the films carry, and it is the same load for every weight."""
    loads = []
    for gravity, advice in ((60.0, FINER), (150.0, FINER), (900.0, LIGHTER)):
        _, _, result = solved(speed=0.05, displacement=0.0, rotor=symmetric_rotor(gravity=gravity))
        assert not result.converged
        found = re.search(SENTENCE + advice + "$", result.reason)
        assert found is not None, result.reason
        assert found[0].count("(converged)") == 0
        loads.append(float(found[1]) / 100.0 * gravity)
    # The ramp stops within 1/1000 of the weight, and the share is rounded to as much.
    np.testing.assert_allclose(loads, loads[0], rtol=0.0, atol=2.5e-3 * 900.0)
    assert loads[0] > 9.81


def test_capacity_is_what_the_rotor_can_weigh() -> None:
    """A rotor somewhat lighter than the reported capacity floats, one somewhat heavier does not."""
    _, _, result = solved(speed=0.05, displacement=0.0, rotor=symmetric_rotor(gravity=60.0))
    capacity = 60.0 * float(re.search(SENTENCE, result.reason)[1]) / 100.0  # type: ignore[index]
    for factor, floats in ((0.97, True), (1.05, False)):
        _, _, other = solved(speed=0.05, displacement=0.0, rotor=symmetric_rotor(gravity=factor * capacity))
        assert other.converged is floats


def heavy(grid: tuple[int, int]) -> tuple[Machine, NDArray[np.float64]]:
    description = HEAVY_ON_SOFT_FOILS.case(grid)
    return build_machine(description), parameter_vector(description)


def test_a_grid_that_is_too_coarse_is_told_from_a_rotor_that_is_too_heavy() -> None:
    """The film of 24 x 2 closes at one station; on 40 x 3 the rotor floats."""
    coarse, fine = (
        machine_equilibrium(machine, at_speed(parameters, 0.1475))
        for machine, parameters in (heavy((24, 2)), heavy((40, 3)))
    )
    assert fine.converged
    assert not coarse.converged
    found = re.fullmatch("on the grid 24 x 2 " + SENTENCE + FINER, coarse.reason)
    assert found is not None, coarse.reason
    assert found[1] == "78.1"


def test_an_equilibrium_is_sought_from_both_neighbouring_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where neither the guess nor the weight's ramp succeeds, either neighbour leads to the same state."""
    machine, parameters = heavy((40, 3))
    speeds = np.array([0.24, 0.25, 0.26])
    expected = machine_equilibrium(machine, at_speed(parameters, 0.25)).state
    failed, search = Equilibrium(np.zeros(0), 1.0, 0, False, "lost"), equilibrium._from_guesses

    def lost_at_one_speed(machine: Machine, still: NDArray[np.float64], *rest: Any) -> Equilibrium:
        return failed if still[0] == 0.25 else search(machine, still, *rest)

    monkeypatch.setattr(equilibrium, "machine_equilibrium", lambda *_: failed)
    monkeypatch.setattr(equilibrium, "_from_guesses", lost_at_one_speed)
    for few in (slice(0, 2), slice(1, 3)):
        index = int(np.flatnonzero(speeds[few] == 0.25)[0])
        result = equilibrium_along(machine, parameters, speeds[few], index)
        assert result.converged
        np.testing.assert_allclose(result.state, expected, rtol=0.0, atol=1e-9)
    assert equilibrium_along(machine, parameters, np.array([0.25]), 0) is failed


def test_a_false_equilibrium_of_a_coarse_grid_is_not_taken() -> None:
    """From a distant speed Newton's method finds a state in which one station of 16 carries on a film of
    0.01; the true film there is 0.2 thick.
    """
    description = random_rotor(196).case((16, 2))
    machine, parameters = build_machine(description), parameter_vector(description)
    speeds = np.linspace(0.15, 1.5, 8)[:3]
    distant = equilibrium_along(machine, parameters, speeds, 0)
    at = at_rest(at_speed(parameters, speeds[1]))
    false = machine_equilibrium(machine, at, distant.state)
    assert false.converged
    assert machine.minimum_film(MEAN_PHASE, false.state, at).min() < 0.02
    found = equilibrium_along(machine, parameters, speeds, 1, distant.state)
    assert found.converged
    assert machine.minimum_film(MEAN_PHASE, found.state, at).min() == pytest.approx(0.2096, abs=1e-4)
