"""Sparse Jacobian, its action on blocks, and differences of the right-hand side are the same derivative."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.rates import machine_tangent
from tests.machines import BEARING, OTHER_BEARING, case, symmetric_rotor

Array = NDArray[np.float64]

SWITCHES = {
    "scheme": ("central", "backward", "fourth_order"),
    "axial_scheme": ("chebyshev", "uniform"),
    "film": ("edge", "periodic"),
    "clipping": ("gumbel", "smooth", "full"),
    "damping": ("proportional", "loss_factor"),
    "pressure": ("gauge", "absolute"),
}


def apply_jacobian(machine: Machine, phase: float, state: Array, block: Array, parameters: Array) -> Array:
    """J @ block for a block (N, columns), by the compiled action."""
    out = np.empty_like(block)
    work = np.empty(machine.work_size)
    machine_tangent(phase, state, block, parameters, machine.constants, machine.layout, work, out)
    return out


def unequal_machine(switches: dict[str, str]) -> tuple[Machine, NDArray[np.float64]]:
    """A machine with two different bearings on a small grid, and its parameters."""
    foil = {key: switches[key] for key in ("damping", "pressure")}
    first, second = (
        {
            **bearing,
            "film": switches["film"],
            "clipping": switches["clipping"],
            "edge_angle": angle,
            "smoothing": 0.05,
            "foil": {**bearing["foil"], **foil},
        }
        for bearing, angle in ((BEARING, 0.0), (OTHER_BEARING, 1.1))
    )
    description = case(
        (11, 2),
        bearings=(first, second),
        numerics={key: switches[key] for key in ("scheme", "axial_scheme")},
        excitation={"amplitudes": (1.0, 0.6), "phases": (0.3, -1.2)},
    )
    return build_machine(description), parameter_vector(description)


def random_state(machine: Machine, seed: int) -> NDArray[np.float64]:
    """Pressures about ambient on both sides, foils and rotor moved, velocities not small."""
    generator = np.random.default_rng(seed)
    state = 0.1 * generator.standard_normal(machine.size)
    for index, bearing in enumerate(machine.bearings):
        unknowns = machine.film_unknowns(index)
        pressures = bearing.settings.nodes * bearing.settings.axial
        state[unknowns][:pressures] += 1.0
    return state


def differences(
    machine: Machine, phase: float, state: NDArray[Any], block: NDArray[Any], parameters: NDArray[Any]
) -> NDArray[np.float64]:
    """Central differences with a step whose truncation and rounding are both near 1e-10."""
    step = 1e-5
    columns = [
        (
            machine.rates(phase, state + step * column, parameters)
            - machine.rates(phase, state - step * column, parameters)
        )
        / (2.0 * step)
        for column in block.T
    ]
    return np.stack(columns, axis=1)


def assert_same_derivative(switches: dict[str, str], seed: int, phase: float, columns: int) -> None:
    machine, parameters = unequal_machine(switches)
    state = random_state(machine, seed)
    block = np.random.default_rng(seed + 1).standard_normal((machine.size, columns))
    exact = machine.jacobian(phase, state, parameters) @ block
    applied = apply_jacobian(machine, phase, state, block, parameters)
    compared = differences(machine, phase, state, block, parameters)
    # Rows differ by orders of magnitude (films, rotor): each is compared with its own size.
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(applied - exact) <= 1e-12 * size).all()
    assert (np.abs(compared - exact) <= 1e-7 * size).all()


@pytest.mark.parametrize("choice", list(product(*SWITCHES.values())), ids="-".join)
def test_every_switch(choice: tuple[str, ...]) -> None:
    assert_same_derivative(dict(zip(SWITCHES, choice, strict=True)), seed=3, phase=0.7, columns=3)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**20),
    phase=st.floats(0.0, 2.0 * np.pi),
    columns=st.integers(1, 40),
    clipping=st.sampled_from(SWITCHES["clipping"]),
    film=st.sampled_from(SWITCHES["film"]),
)
def test_random_states(seed: int, phase: float, columns: int, clipping: str, film: str) -> None:
    """Numbers of columns on both sides of the width of a chunk, too."""
    switches = {key: values[0] for key, values in SWITCHES.items()} | {"clipping": clipping, "film": film}
    assert_same_derivative(switches, seed, phase, columns)


@pytest.mark.parametrize("columns", [1, 15, 16, 17, 32, 33])
def test_columns_do_not_feel_each_other(columns: int) -> None:
    machine, parameters = unequal_machine({key: values[0] for key, values in SWITCHES.items()})
    state = random_state(machine, 5)
    block = np.random.default_rng(6).standard_normal((machine.size, columns))
    together = apply_jacobian(machine, 0.2, state, block, parameters)
    for column in range(columns):
        alone = apply_jacobian(machine, 0.2, state, np.ascontiguousarray(block[:, [column]]), parameters)
        np.testing.assert_allclose(together[:, column], alone[:, 0], rtol=1e-12, atol=1e-12)


def test_slopes_kept() -> None:
    """Wheels and one journal keep their slopes: the blocks of the rotor are larger, the films' as before."""
    masters = ({"node": 0, "slopes": True}, {"node": 2, "slopes": True}, 7, 12, 14)
    rotor = symmetric_rotor(masters=masters)
    description = case((11, 2), bearings=(BEARING, OTHER_BEARING), rotor=rotor)
    machine, parameters = build_machine(description), parameter_vector(description)
    state, block = random_state(machine, 4), np.eye(machine.size)
    exact = machine.jacobian(0.7, state, parameters).toarray()
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(apply_jacobian(machine, 0.7, state, block, parameters) - exact) <= 1e-12 * size).all()
    assert (np.abs(differences(machine, 0.7, state, block, parameters) - exact) <= 1e-7 * size).all()


def test_rigid_bearings() -> None:
    """Without a foil its displacement stays where it is, and the derivative is still exact."""
    rigid = {**BEARING, "foil": {"rigid": True}}
    description = case((11, 2), bearings=(rigid, BEARING))
    machine, parameters = build_machine(description), parameter_vector(description)
    state = random_state(machine, 8)
    foil = machine.film_unknowns(0).start + 2 * machine.bearings[0].settings.nodes
    state[foil : machine.film_unknowns(0).stop] = 0.0
    parameters[2] = 0.0  # the ring at rest
    block = np.eye(machine.size)
    exact = machine.jacobian(0.0, state, parameters).toarray()
    np.testing.assert_array_equal(
        machine.rates(0.0, state, parameters)[foil : machine.film_unknowns(0).stop], 0.0
    )
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(apply_jacobian(machine, 0.0, state, block, parameters) - exact) <= 1e-12 * size).all()
    assert (np.abs(differences(machine, 0.0, state, block, parameters) - exact) <= 1e-7 * size).all()


def test_right_hand_side_in_its_parameters() -> None:
    """What the parameter derivatives of a period rest on.

    With c_f = eta k_f, f is affine in the speed, in the excitation frequency at a fixed phase, and in 1/k_f.
    """
    machine, parameters = unequal_machine({key: values[0] for key, values in SWITCHES.items()})
    state = random_state(machine, 9)

    def rates(index: int, value: float) -> NDArray[np.float64]:
        changed = parameters.copy()
        changed[index] = value
        return machine.rates(0.7, state, changed)

    for index, low, middle, high in [(0, 0.5, 1.0, 2.0), (1, 0.3, 0.7, 1.5), (3, 2.0, 5.0, 20.0)]:
        power = -1.0 if index == 3 else 1.0
        share = (middle**power - low**power) / (high**power - low**power)
        first, second, third = (rates(index, value) for value in (low, middle, high))
        assert np.abs(third - first).max() > 1e-3
        np.testing.assert_allclose(second, first + share * (third - first), rtol=1e-9, atol=1e-9)


def test_differences_in_the_displacement_converge() -> None:
    """f is smooth in delta: two difference quotients agree to the square of their step."""
    machine, parameters = unequal_machine({key: values[0] for key, values in SWITCHES.items()})
    state = random_state(machine, 10)

    def quotient(step: float) -> NDArray[np.float64]:
        up, down = parameters.copy(), parameters.copy()
        up[2] += step
        down[2] -= step
        return (machine.rates(0.7, state, up) - machine.rates(0.7, state, down)) / (2.0 * step)

    fine = quotient(1e-3)
    assert np.abs(fine).max() > 1e-2
    np.testing.assert_allclose(quotient(4e-3), fine, rtol=0.0, atol=1e-6 * np.abs(fine).max())
