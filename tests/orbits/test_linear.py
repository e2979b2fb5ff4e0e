"""Eigenvalues by shift-invert against dense ones, and the located speed of instability."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.equilibria import linear
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, Equilibrium, at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import (
    LinearPoint,
    at_speed,
    dynamic_stiffness,
    leading_eigenvalues,
    linear_point,
    locate_instability,
    whirl_shifts,
)
from tests.machines import case, symmetric_rotor, with_foil_stiffness

SPEEDS = np.linspace(0.2, 1.6, 6)


def machine_of(
    grid: tuple[int, int], stiffness: float = 10.0, **changes: object
) -> tuple[Machine, NDArray[np.float64]]:
    description = case(grid, bearings=with_foil_stiffness(stiffness), displacement=0.0, **changes)  # type: ignore[arg-type]
    return build_machine(description), parameter_vector(description)


def dense(
    machine: Machine, parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """All eigenvalues with Im >= 0, largest real part first."""
    values = np.linalg.eigvals(machine.jacobian(MEAN_PHASE, state, at_rest(parameters)).toarray())
    values = values[values.imag >= -1e-9 * np.abs(values)]
    return values[np.lexsort((values.imag, -values.real))]


@pytest.mark.parametrize("stiffness", [3.0, 10.0, 50.0])
def test_no_leading_eigenvalue_is_missed(stiffness: float) -> None:
    """N = 340, above the dense limit: every whirl mode among the leading twelve, and everything above -1."""
    machine, parameters = machine_of((40, 3), stiffness)
    assert machine.size == 340 > linear.DENSE_SIZE
    state = None
    for speed in SPEEDS:
        at = at_speed(parameters, float(speed))
        equilibrium = machine_equilibrium(machine, at, state)
        state = equilibrium.state
        jacobian = machine.jacobian(MEAN_PHASE, state, at_rest(at))
        pairs = leading_eigenvalues(jacobian, 12, whirl_shifts(machine, float(speed)))
        expected = dense(machine, at, state)[:12]
        wanted = expected[(expected.imag > 1e-6) | (expected.real > -1.0)]
        assert len(wanted) >= 9
        for value in wanted:
            assert np.abs(pairs.values - value).min() <= 1e-9 * max(1.0, abs(value)), (speed, value)
        assert (np.diff(pairs.values.real) <= 0.0).all()
        assert (pairs.residuals <= 1e-9).all()
        assert len(pairs.values) == 12


def test_small_matrices_are_solved_whole() -> None:
    """N = 166, below the dense limit: all twelve, real ones too; shift-invert finds the same leading ones."""
    machine, parameters = machine_of((24, 2))
    assert machine.size == 166 <= linear.DENSE_SIZE
    state = machine_equilibrium(machine, parameters).state
    jacobian = machine.jacobian(MEAN_PHASE, state, at_rest(parameters))
    pairs = leading_eigenvalues(jacobian, 12, whirl_shifts(machine, 1.0))
    np.testing.assert_allclose(pairs.values, dense(machine, parameters, state)[:12], rtol=0.0, atol=1e-9)
    assert (pairs.residuals <= 1e-9).all()
    for shift in whirl_shifts(machine, 1.0):
        values, _ = linear._arnoldi(jacobian, shift, 6)
        for value in values:
            upper = value if value.imag >= 0.0 else np.conj(value)
            assert np.abs(dense(machine, parameters, state) - upper).min() <= 1e-9 * max(1.0, abs(value))


def test_eigenvalues_do_not_depend_on_the_run() -> None:
    machine, parameters = machine_of((40, 3))
    state = machine_equilibrium(machine, parameters).state
    jacobian = machine.jacobian(MEAN_PHASE, state, at_rest(parameters))
    first, second = (leading_eigenvalues(jacobian, 8, whirl_shifts(machine, 1.0)) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.vectors, second.vectors)


def bracket(
    machine: Machine, parameters: NDArray[np.float64], low: float, high: float
) -> tuple[LinearPoint, LinearPoint]:
    first = linear_point(machine, at_speed(parameters, low), 6)
    assert isinstance(first, LinearPoint)
    second = linear_point(machine, at_speed(parameters, high), 6, first.equilibrium.state)
    assert isinstance(second, LinearPoint)
    return first, second


def test_instability_is_located() -> None:
    """To 1e-8: two brackets agree, the dense eigenvalue there is on the axis, the slope is right."""
    machine, parameters = machine_of((40, 3))
    found = locate_instability(machine, parameters, *bracket(machine, parameters, 1.0, 1.15))
    other = locate_instability(machine, parameters, *bracket(machine, parameters, 0.8, 1.3), tolerance=1e-6)
    assert found.speed == pytest.approx(other.speed, abs=1e-8)
    assert abs(found.growth) <= 1e-9 * abs(found.growth_slope) + 1e-11

    def growth(speed: float) -> complex:
        at = at_speed(parameters, speed)
        return complex(dense(machine, at, machine_equilibrium(machine, at, found.equilibrium.state).state)[0])

    # The distance to the dense crossing: Re lambda / slope.
    critical = growth(found.speed)
    assert abs(critical.real / found.growth_slope) <= 1e-8
    assert critical.imag == pytest.approx(found.frequency, abs=1e-9)
    step = 1e-3
    slope = (growth(found.speed + step) - growth(found.speed - step)).real / (2.0 * step)
    assert found.growth_slope == pytest.approx(slope, rel=1e-4)
    at = at_speed(parameters, found.speed)
    jacobian = machine.jacobian(MEAN_PHASE, found.equilibrium.state, at_rest(at))
    residual = jacobian @ found.eigenvector - 1j * found.frequency * found.eigenvector
    assert np.linalg.norm(residual) <= 1e-8 * np.linalg.norm(found.eigenvector)


def test_no_crossing_is_said() -> None:
    machine, parameters = machine_of((24, 2))
    points = bracket(machine, parameters, 0.4, 0.6)
    with pytest.raises(ValueError, match=r"no pair crosses the imaginary axis between 0\.4 and 0\.6"):
        locate_instability(machine, parameters, *points)


def test_point_without_equilibrium_is_returned_with_its_reason() -> None:
    machine, parameters = machine_of((24, 2), rotor=symmetric_rotor(gravity=500.0))
    result = linear_point(machine, at_speed(parameters, 0.05), 6)
    assert isinstance(result, Equilibrium)
    assert not result.converged
    assert "% of the rotor's weight" in result.reason


def test_eigenvalue_problem_is_the_dynamic_stiffness_problem() -> None:
    """An eigenvalue sigma of the machine is a root of det(rotor(sigma) + Z(sigma) at the journals).

    Two independent reductions of the same linearisation: states against transfer functions.
    """
    machine, parameters = machine_of((24, 2))
    state = machine_equilibrium(machine, parameters).state
    size = machine.rotor_freedoms
    rotor = machine.space.constant + parameters[0] * machine.space.per_speed
    sigma = dense(machine, parameters, state)[0]
    # x'' = A x + B x' + M^-1 F,  F = -Z X
    matrix = sigma**2 * np.eye(size) - rotor[size:, :size] - sigma * rotor[size:, size:]
    for index, bearing in enumerate(machine.bearings):
        first = machine.journal_freedoms[index]
        position = machine.journal(state, index)[:2]
        unknowns = state[machine.film_unknowns(index)]
        stiffness = dynamic_stiffness(bearing, unknowns, position, parameters, np.array([sigma]))[0]
        matrix[:, first : first + 2] = (
            matrix[:, first : first + 2] + machine.space.force_input[size:, first : first + 2] @ stiffness
        )
    singular = np.linalg.svd(matrix, compute_uv=False)
    assert singular[-1] <= 1e-9 * singular[0]
    assert singular[-2] > 1e-6 * singular[0]
