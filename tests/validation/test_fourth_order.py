"""The scheme of fourth order along theta: its order in every quantity, and the multipliers of cycles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.bearing import FilmSettings, film_state, pack_bearing
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.shooting import Unknowns, correct, first_basis, reference_of
from pipelines.orbits.time_steps import first_steps
from pipelines.stages.cycles.problem import cycle_problem
from tests.machines import case

from .error_table import coefficients, eccentric_threshold
from .films import concentric_stiffness, film, observed_order, reference_table, relative

SCHEME = "fourth_order"
FINE_AXIAL = 6


def order(errors: list[float], counts: tuple[int, ...]) -> float:
    return observed_order(errors, [1.0 / count for count in counts])


def test_order_of_the_concentric_film() -> None:
    """Film and foil in series against the closed form."""
    exact, counts = concentric_stiffness(1.0, 2.0, 1.2j, 3.0, 0.3), (10, 20, 40)
    common = {"slenderness": 1.0, "speed": 2.0, "foil_stiffness": 3.0, "loss_factor": 0.3, "scheme": SCHEME}
    errors = [
        relative(film((count, FINE_AXIAL), **common).dynamic_stiffness((0.0, 0.0), [0.6])[0], exact)
        for count in counts
    ]
    assert order(errors, counts) == pytest.approx(4.0, abs=0.2)
    assert errors[-1] < 2e-5


@pytest.mark.parametrize("clipping", ["full", "gumbel", "smooth"])
@pytest.mark.parametrize("periodic", [True, False])
def test_order_of_the_force(periodic: bool, clipping: str) -> None:
    """At eps = 0.6 against the scheme's own value on 288.

    Near an edge the order is approached from above; clipping scatters it with the place of zero in its cell.
    """

    def force(count: int) -> NDArray[np.float64]:
        bearing = film(
            (count, 3), slenderness=1.0, speed=1.0, foil_stiffness=10.0, periodic=periodic, clipping=clipping,
            smoothing=0.1, scheme=SCHEME,
        )  # fmt: skip
        return bearing.force((0.3, -0.5))

    counts, finest = (24, 48, 96), force(288)
    errors = [relative(force(count), finest) for count in counts]
    assert 3.8 < order(errors, counts) < 5.0
    assert errors[1] < 5e-5


def test_order_of_stiffness_and_damping() -> None:
    """Rigid bearing, Lambda = 1, eps = 0.4, against its own value on 160."""
    row = next(
        r for r in reference_table("dynamic_coefficients") if (r["Lambda"], r["kf_bar"]) == ("1.0", "inf")
    )
    finest, counts = coefficients((160, 4), row, SCHEME), (20, 40)
    for index in range(2):
        errors = [relative(coefficients((n, 4), row, SCHEME)[index][0], finest[index][0]) for n in counts]
        assert order(errors, counts) == pytest.approx(4.0, abs=0.2)


def test_order_of_the_threshold_mass() -> None:
    row = reference_table("threshold_mass_eccentric")[1]
    finest, counts = eccentric_threshold((160, 4), row, SCHEME).mass, (20, 40)
    errors = [abs(eccentric_threshold((count, 4), row, SCHEME).mass / finest - 1.0) for count in counts]
    assert order(errors, counts) == pytest.approx(4.0, abs=0.2)
    assert finest == pytest.approx(float(row["Mcrit_bar_per_bearing"]), rel=5e-4)


def mass_rate(scheme: str) -> float:
    """Sum of d(p h)/dtau over a periodic film with one station, a large axial length and any pressures."""
    bearing = pack_bearing(FilmSettings(12, 1, scheme=scheme, periodic=True, kappa=0.0))
    unknowns = np.random.default_rng(2).uniform(0.5, 1.5, 24)
    unknowns[12:] *= 0.1
    journal, parameters = np.array([0.3, -0.2, 0.1, 0.4]), np.array([1.3, 0.0, 0.0, 5.0])
    state = film_state(bearing, unknowns, journal, 0.0, parameters)
    h, pressure = state.thickness[1:-1], unknowns[:12]
    return float(np.sum(state.rates[:12] * h + pressure * state.thickness_rate))


@pytest.mark.parametrize("scheme", ["central", "backward", SCHEME])
def test_gas_is_conserved(scheme: str) -> None:
    """What leaves a cell enters the next."""
    assert abs(mass_rate(scheme)) < 1e-12


def multipliers(grid: tuple[int, int], scheme: str, film: str) -> NDArray[np.complex128]:
    """The six largest multipliers of the forced cycle."""
    numerics: dict[str, Any] = {"scheme": scheme, "multiplier_tolerance": 1e-6}
    bearings = case().model_dump()["bearings"]
    for bearing in bearings:
        bearing["film"] = film
    plain = case(grid, displacement=0.1, numerics=numerics).model_dump() | {"bearings": bearings}
    description = type(case()).model_validate(plain)
    machine, parameters = build_machine(description), parameter_vector(description)
    problem = cycle_problem(machine, description)
    guess = problem.consistent(Unknowns(machine_equilibrium(machine, parameters).state, 0.0, parameters[0]))
    steps = first_steps(problem, guess)
    fixed, basis = problem.fixed_parameter(parameters[0]), first_basis(problem, guess, steps)
    found = correct(problem, guess, fixed, basis, steps, reference_of(problem, guess, steps))
    assert found.cycle is not None
    return found.cycle.spectrum.multipliers[:6]


@pytest.mark.parametrize("film", ["edge", "periodic"])
def test_multipliers_of_a_fine_grid_of_second_order(film: str) -> None:
    """On 32 the multipliers are as near to those on 160 as these are converged, and second order is not."""
    fine = multipliers((160, 2), "central", film)

    def error(grid: tuple[int, int], scheme: str) -> float:
        return max(float(np.abs(fine - one).min()) for one in multipliers(grid, scheme, film))

    assert error((32, 2), SCHEME) < min(1e-3, 0.5 * error((32, 2), "central"))
