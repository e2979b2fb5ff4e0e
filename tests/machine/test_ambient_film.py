"""The clipped force where the film lies on the ambient line: one derivative, whatever rounding does."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.bearing import FilmSettings, linearise_bearing, pack_bearing
from pipelines.machine.film import EXCITATION_FREQUENCY
from pipelines.orbits.equilibria.equilibrium import at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import LinearPoint, dynamic_stiffness, linear_point
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.steppers import steppers
from pipelines.orbits.time_runs.drive import Switching, make_drive
from pipelines.orbits.time_runs.transient import trial_end
from pipelines.orbits.time_steps import spectral_radius, stable_steps
from pipelines.stages.transients.run import driven_machine
from tests.helpers.monodromy import full_monodromy
from tests.machines import BEARING, case, symmetric_rotor

Array = NDArray[np.float64]
PARAMETERS = np.array([0.8, 0.0, 0.0, 10.0])
CONCENTRIC = np.zeros(4)


def force_gradient(settings: FilmSettings, pressure: Array) -> Array:
    """dF/dp (2, pressures) of a bearing with these pressures, the journal in the middle."""
    bearing = pack_bearing(settings)
    unknowns = np.append(pressure, np.zeros(settings.nodes))
    return linearise_bearing(bearing, unknowns, CONCENTRIC, 0.0, PARAMETERS).force[:, : pressure.size]


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("noise", [0.0, 1e-16, 1e-13, 1e-11])
def test_rounding_decides_nothing_on_the_ambient_line(periodic: bool, noise: float) -> None:
    """Half of the derivative of the unclipped force: that of pressures which are positive everywhere."""
    settings = FilmSettings(24, 2, periodic=periodic)
    size = settings.nodes * settings.axial
    rounding = noise * np.random.default_rng(1).standard_normal(size)
    half = 0.5 * force_gradient(settings, np.full(size, 1.5))
    found = force_gradient(settings, 1.0 + rounding)
    np.testing.assert_allclose(found, half, rtol=0.0, atol=1e-15)
    smooth = force_gradient(FilmSettings(24, 2, periodic=periodic, clipping="smooth"), np.ones(size))
    np.testing.assert_allclose(found, smooth, rtol=0.0, atol=1e-15)


def test_a_part_of_the_film_on_the_ambient_line() -> None:
    """Cells at p = 1 carry half, wherever they are, and the others what they carry without them."""
    settings = FilmSettings(24, 1, periodic=True)
    everywhere = force_gradient(settings, np.full(24, 1.5))
    pressure = np.ones(24)
    pressure[:8] = 1.5
    for noise in (0.0, 1e-14, -1e-14):
        pressure[8:] = 1.0 + noise
        found = force_gradient(settings, pressure)
        np.testing.assert_allclose(found[:, 2:6], everywhere[:, 2:6], rtol=1e-13)
        np.testing.assert_allclose(found[:, 12:20], 0.5 * everywhere[:, 12:20], rtol=1e-12, atol=1e-16)


def weightless(grid: tuple[int, int], clipping: str, film: str, speed: float = 0.6) -> tuple[Machine, Array]:
    bearing = {**BEARING, "clipping": clipping, "film": film}
    description = case(
        grid, bearings=(bearing, bearing), displacement=0.0, speed=speed, rotor=symmetric_rotor(gravity=0.0)
    )
    return build_machine(description), parameter_vector(description)


def half_speed_stiffness(grid: tuple[int, int], clipping: str, film: str) -> Array:
    """K of the first bearing of a weightless rotor for whirl at half of the rotating speed."""
    machine, parameters = weightless(grid, clipping, film)
    found = machine_equilibrium(machine, parameters)
    assert found.converged
    own, position = found.state[machine.film_unknowns(0)], machine.journal(found.state, 0)[:2]
    whirl = np.array([0.5j * parameters[0]])
    return dynamic_stiffness(machine.bearings[0], own, position, parameters, whirl)[0].real


def test_stiffness_of_a_weightless_rotor() -> None:
    """A periodic film: isotropic, half of the unclipped stiffness, and the same on every grid to the error of
    the grid.
    """
    found = half_speed_stiffness((24, 2), "gumbel", "periodic")
    np.testing.assert_allclose(found, [[0.0134, 0.0886], [-0.0886, 0.0134]], atol=5e-5)
    np.testing.assert_allclose(found, 0.5 * half_speed_stiffness((24, 2), "full", "periodic"), rtol=0.01)
    fine = half_speed_stiffness((48, 3), "gumbel", "periodic")
    np.testing.assert_allclose(found, fine, rtol=0.02)
    np.testing.assert_allclose(fine, 0.5 * half_speed_stiffness((48, 3), "full", "periodic"), rtol=0.0025)


@pytest.mark.parametrize("film", ["periodic", "edge"])
def test_stiffness_is_that_of_the_regularised_film(film: str) -> None:
    found, smooth = (half_speed_stiffness((24, 2), name, film) for name in ("gumbel", "smooth"))
    np.testing.assert_allclose(found, smooth, rtol=0.0, atol=1e-5)


def test_a_run_in_time_grows_as_the_eigenvalue_says() -> None:
    """From the leading eigenvector, small, over two turns of the whirl."""
    machine, parameters = weightless((24, 2), "gumbel", "periodic")
    point = linear_point(machine, parameters, 4)
    value, vector = point.eigenpairs.values[0], point.eigenpairs.vectors[:, 0]
    assert value.real == pytest.approx(0.0854, abs=1e-4)
    vector = vector / np.abs(vector).max()
    start, end = 1e-5, 4.0 * np.pi / value.imag
    drive = make_drive([0.0], [parameters[0]], end, Switching(0.0, 0.0), 0.0)
    state = trial_end(
        driven_machine(machine, ()),
        drive,
        at_rest(parameters),
        point.equilibrium.state + start * vector.real,
        400,
    )
    moved = slice(machine.rotor_start, machine.rotor_start + machine.rotor_freedoms)
    expected = start * (vector * np.exp(value * end)).real[moved]
    found = (state - point.equilibrium.state)[moved]
    assert np.linalg.norm(found - expected) < 0.01 * np.linalg.norm(expected)


@pytest.mark.parametrize("stepper", ["esdirk5", "rk4"])
@pytest.mark.parametrize("film", ["periodic", "edge"])
def test_multipliers_of_a_cycle_at_rest_are_those_of_the_equilibrium(stepper: str, film: str) -> None:
    """The tangents along a cycle on the ambient line grow by exp(lambda T)."""
    machine, parameters = weightless((16, 1), "gumbel", film)
    parameters[EXCITATION_FREQUENCY] = 2.0
    period_map = PeriodMap(machine_system(machine), stepper=steppers()[stepper])
    state = machine_equilibrium(machine, parameters).state
    period = period_map.period(parameters)
    radius = spectral_radius(period_map, np.tile(state, (period_map.samples, 1)), parameters)
    steps = 256 if stepper == "esdirk5" else stable_steps(period_map, radius, period)
    columns = full_monodromy(period_map, state, parameters, period, steps)
    multipliers = np.linalg.eigvals(columns)
    point = linear_point(machine, parameters, 6)
    assert isinstance(point, LinearPoint)
    assert point.eigenpairs.values[0].real > 0.07
    for expected in np.exp(point.eigenpairs.values[:6] * period):
        assert np.abs(multipliers - expected).min() < 1e-6
