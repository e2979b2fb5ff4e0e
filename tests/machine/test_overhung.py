"""A rotor with overhung wheels: its condensation against an exact beam, and the masters that mend it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg, optimize

from pipelines.case.models import Case, Rotor
from pipelines.case.reading import read_cases
from pipelines.machine.condensation import condense
from pipelines.machine.condensation_error import Masters, better_masters, full_modes, mode_errors
from pipelines.machine.rotor_modes import LinearBearing, oscillating_modes, translations, whirl_directions
from pipelines.machine.shaft import assemble_rotor, cowper_shear_coefficient

MICRO_TURBINE = Path(__file__).parents[1] / "reference" / "micro_turbine.toml"
PLAIN = (0, 2, 3, 6, 9, 12)
WHEELS = (0, 12)


@pytest.fixture(scope="module")
def turbine() -> Case:
    named, *_ = read_cases(MICRO_TURBINE.read_text(), MICRO_TURBINE.name, ())
    return named.case


def end_forces(rotor: Rotor, frequency: float, speed: float) -> np.ndarray:
    """Moment and shear force at the right end by deflection and slope at the left one, (2, 2), of the free
    rotor in circular whirl. The shaft is exact, without elements:

        w' = psi + Q/kGA,  M' = -Q - omega^2 rho I (1 - 2 Omega/omega) psi
        psi' = M/EI,       Q' = -omega^2 rho A w

    and a disc adds -omega^2 (I_d - I_p Omega/omega) psi to M, -omega^2 m w to Q.
    """
    square = frequency**2
    state = np.vstack([np.eye(2), np.zeros((2, 2))])
    discs = {disc.node: disc for disc in rotor.discs}
    for node, element in enumerate((*rotor.single_elements(), None)):
        if (disc := discs.get(node)) is not None:
            inertia = disc.diametral_inertia - disc.polar_inertia * speed / frequency
            state[2] -= square * inertia * state[1]
            state[3] -= square * disc.mass * state[0]
        if element is None:
            break
        material = rotor.materials[element.material]
        outer, inner, poisson = element.outer_diameter, element.inner_diameter, material.poisson_ratio
        area, second = np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4)
        shear = cowper_shear_coefficient(poisson, inner / outer) * area
        shear *= material.young_modulus / (2 * (1 + poisson))
        tilt = square * material.density * second * (1 - 2 * speed / frequency)
        system = np.array(
            [
                [0, 1, 0, 1 / shear],
                [0, 0, 1 / (material.young_modulus * second), 0],
                [0, -tilt, 0, -1],
                [-square * material.density * area, 0, 0, 0],
            ]
        )
        state = linalg.expm(element.length * system) @ state
    return state[2:]


def exact_bending(rotor: Rotor, speed: float, count: int) -> np.ndarray:
    """The lowest frequencies [rad/s] of bending in forward whirl: roots of the determinant."""
    grid = np.linspace(3000.0, 60000.0, 400)
    values = [np.linalg.det(end_forces(rotor, frequency, speed)) for frequency in grid]
    ends = [pair for pair, (a, b) in zip(pairwise(grid), pairwise(values), strict=True) if a * b < 0]
    return np.array(
        [
            optimize.brentq(lambda f: np.linalg.det(end_forces(rotor, f, speed)), *pair, xtol=1e-6)
            for pair in ends[:count]
        ]
    )


def bending(rotor: Rotor, speed: float, count: int, masters: Masters | None = None) -> np.ndarray:
    """The same of the elements, condensed where masters are given."""
    free = rotor.model_copy(update={"rayleigh_stiffness": 0.0})
    full = assemble_rotor(free)
    model = full if masters is None else condense(full, masters.nodes, masters.slopes)
    modes = oscillating_modes(model, speed)
    # at rest the two planes have equal frequencies, and rounding decides how their shapes whirl
    forward = whirl_directions(translations(model, modes.shapes)) >= (1 if speed else -1)
    frequencies = modes.damped_frequencies[forward]
    return frequencies[frequencies > 3000.0][:count]


def test_the_elements_are_the_exact_beam(turbine):
    for speed in (0.0, 6283.0):
        exact = exact_bending(turbine.rotor, speed, 2)
        found = bending(turbine.rotor, speed, 4 if speed == 0.0 else 2)
        # at rest every frequency is there in both planes
        np.testing.assert_allclose(found[:: 2 if speed == 0.0 else 1], exact, rtol=2e-4)


@pytest.mark.parametrize(
    ("masters", "least", "most"),
    [
        (Masters(PLAIN), 0.05, 0.06),
        (Masters(tuple(range(13))), 0.03, 0.05),
        (Masters(PLAIN, WHEELS), 0.0, 1e-3),
        (Masters(tuple(range(13)), tuple(range(13))), 0.0, 2e-4),
    ],
)
def test_the_slopes_of_the_wheels_make_the_lowest_bending_mode(turbine, masters, least, most):
    """At rest; turning, the wheels' tilt counts for more."""
    exact = exact_bending(turbine.rotor, 0.0, 1)[0]
    error = bending(turbine.rotor, 0.0, 1, masters)[0] / exact - 1
    assert least <= error <= most


def references(case: Case, highest: float = 6755.0) -> list:
    """The rotor on bearings of the order of magnitude of its gas films, at two speeds."""
    rotor = assemble_rotor(case.rotor)
    bearings = [LinearBearing(b.node, np.diag([2e6, 3e6]), np.diag([100.0, 80.0])) for b in case.bearings]
    return [full_modes(rotor, speed, bearings, highest, 0.5) for speed in (1500.0, 6283.0)]


def test_the_greatest_error_below_the_highest_speed(turbine):
    rotor, compared = assemble_rotor(turbine.rotor), references(turbine)
    errors = mode_errors(rotor, Masters(PLAIN), compared)
    assert errors.full.max() <= 6755.0
    assert set(errors.speed) == {1500.0, 6283.0}
    np.testing.assert_allclose(errors.relative, np.abs(errors.condensed / errors.full - 1))
    assert errors.worst == errors.relative.max() > 0.1
    assert mode_errors(rotor, Masters(PLAIN, WHEELS), compared).worst < 1e-3
    nothing = mode_errors(rotor, Masters(tuple(range(13)), tuple(range(13))), compared)
    assert nothing.worst < 1e-10
    low = mode_errors(rotor, Masters(PLAIN), references(turbine, highest=100.0))
    assert low.worst == 0.0, "there is no mode so low"


def test_a_mode_that_the_condensed_rotor_lacks_is_wholly_wrong(turbine):
    """Two masters have four freedoms, and the full rotor five modes below the highest speed."""
    errors = mode_errors(assemble_rotor(turbine.rotor), Masters((3, 9)), references(turbine))
    assert np.isnan(errors.condensed).any()
    assert errors.worst >= 1.0


@pytest.mark.parametrize("nodes", [PLAIN, (3, 9), tuple(range(13)), (2, 3, 6, 9)])
def test_the_masters_that_are_named_do_mend_it(turbine, nodes):
    rotor, compared = assemble_rotor(turbine.rotor), references(turbine)
    better, left = better_masters(rotor, Masters(nodes), compared)
    assert left.worst < 0.01
    assert left.worst == mode_errors(rotor, better, compared).worst
    assert set(nodes) <= set(better.nodes)
    assert len(better.nodes) - len(nodes) + len(better.slopes) <= 4, "only what helps is added"


def test_good_masters_are_left_alone(turbine):
    rotor, compared = assemble_rotor(turbine.rotor), references(turbine)
    assert better_masters(rotor, Masters(PLAIN, WHEELS), compared)[0] == Masters(PLAIN, WHEELS)
