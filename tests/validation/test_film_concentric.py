"""The film about a concentric journal against closed forms: Ausman, and film and foil in series."""

from __future__ import annotations

import numpy as np
import pytest

from .error_table import DEFAULT_GRID, DEFAULT_SCHEME, concentric_pair
from .films import (
    ausman_response,
    concentric_stiffness,
    film,
    observed_order,
    reference_table,
    relative,
    threshold_masses,
)

# Axial polynomials of degree 12: their error is below 1e-6 for every case here, so that theta alone is seen.
FINE_AXIAL = 6


def test_ausman_printed_values() -> None:
    """L/D = 1, Lambda = 1: F_r/eps = 0.19609400, F_t/eps = 0.69255747 in units p0 R L."""
    response = np.pi * ausman_response(1j, 1.0)
    assert response.real == pytest.approx(0.19609400, abs=5e-9)
    assert abs(response.imag) == pytest.approx(0.69255747, abs=5e-9)


@pytest.mark.parametrize("slenderness", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("speed", [0.3, 1.0, 4.0])
def test_small_eccentricity_gives_ausmans_force(slenderness: float, speed: float) -> None:
    """The nonlinear static force at eps = 1e-3, where Ausman's neglect is of order eps^2."""
    eccentricity = 1e-3
    case = film(DEFAULT_GRID, slenderness=slenderness, speed=speed, scheme=DEFAULT_SCHEME)
    force = case.force((eccentricity, 0.0)) / eccentricity
    response = np.pi * ausman_response(1j * speed, slenderness)
    assert relative(force, np.array([-response.real, abs(response.imag)])) <= 0.002


@pytest.mark.parametrize("row", reference_table("concentric_dynamic_stiffness"))
def test_closed_form_gives_the_table(row: dict[str, str]) -> None:
    """The table is the closed form printed to 8 decimals."""
    _, exact = concentric_pair((8, 1), row)
    printed = [complex(float(row[f"Re_{name}"]), float(row[f"Im_{name}"])) for name in ("Zxx", "Zxy")]
    np.testing.assert_allclose(exact[0], printed, rtol=0.0, atol=1.5e-8)


def test_default_grid_matches_dynamic_stiffness() -> None:
    """At most 0.01 %, in the norm of Z and in every entry relative to the largest."""
    for row in reference_table("concentric_dynamic_stiffness"):
        computed, exact = concentric_pair(DEFAULT_GRID, row, DEFAULT_SCHEME)
        assert relative(computed, exact) <= 1e-4, row
        assert abs(computed - exact).max() <= 1e-4 * abs(exact).max(), row
        # The film is isotropic: Z_yy = Z_xx, Z_yx = -Z_xy, on any grid.
        np.testing.assert_allclose(computed[1], [-computed[0, 1], computed[0, 0]], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("row", reference_table("concentric_dynamic_stiffness")[::5])
def test_stiffness_and_damping_of_slow_whirl(row: dict[str, str]) -> None:
    """K(0) = Z(0) and C(0) = Z'(0) of the closed form, its derivative by central differences."""
    arguments = [float(row[name]) for name in ("L_over_D", "Lambda", "kf_bar", "eta")]
    slenderness, speed, foil, loss = arguments
    case = film((160, 4), slenderness=slenderness, speed=speed, foil_stiffness=foil, loss_factor=loss)
    stiffness, damping = (each[0] for each in case.coefficients((0.0, 0.0), [0.0]))
    step = 1e-4
    low, static, high = (
        concentric_stiffness(slenderness, speed, sigma, foil, loss) for sigma in (-step, 0.0, step)
    )
    assert relative(stiffness, static.real) <= 1e-3
    assert relative(damping, (high - low).real / (2.0 * step)) <= 1e-3


def dynamic_stiffness_error(
    grid: tuple[int, int], scheme: str = "central", axial: str = "chebyshev"
) -> float:
    case = film(
        grid,
        slenderness=1.0,
        speed=2.0,
        foil_stiffness=3.0,
        loss_factor=0.3,
        scheme=scheme,
        axial_scheme=axial,
    )
    exact = concentric_stiffness(1.0, 2.0, 1.2j, 3.0, 0.3)
    return relative(case.dynamic_stiffness((0.0, 0.0), [0.6])[0], exact)


def test_central_scheme_is_of_second_order() -> None:
    counts = [24, 48, 96, 192]
    errors = [dynamic_stiffness_error((count, FINE_AXIAL)) for count in counts]
    assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(2.0, abs=0.1)


def test_backward_scheme_is_of_first_order() -> None:
    counts = [100, 200, 400]
    errors = [dynamic_stiffness_error((count, FINE_AXIAL), "backward") for count in counts]
    assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(1.0, abs=0.1)


def test_backward_scheme_is_far_coarser_at_equal_grid() -> None:
    errors = [dynamic_stiffness_error((40, 3), scheme) for scheme in ("backward", "central", "fourth_order")]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]


def axial_changes(axial: str, counts: list[int]) -> list[float]:
    """Change of Z with the axial count at a fixed circumferential grid, which carries its error along."""
    at = [
        film((40, count), slenderness=2.0, speed=2.0, axial_scheme=axial).dynamic_stiffness(
            (0.0, 0.0), [1.0]
        )[0]
        for count in counts
    ]
    return [relative(value, at[-1]) for value in at[:-1]]


def test_chebyshev_is_spectral_in_z() -> None:
    """Every further station divides the error, by a factor that grows: no power law does."""
    errors = axial_changes("chebyshev", [1, 2, 3, 4, 5, 6, 10])
    factors = np.divide(errors[:-1], errors[1:])
    assert (factors > 5.0).all()
    assert errors[5] < 1e-6
    # A method of order p gains (6/5)^p in the last step: it would take order 9 to gain 5.
    assert factors[-1] > 5.0


def test_uniform_is_of_second_order_in_z() -> None:
    counts = [4, 8, 16, 32]
    exact = film((40, 10), slenderness=2.0, speed=2.0).dynamic_stiffness((0.0, 0.0), [1.0])[0]
    errors = [
        relative(
            film((40, count), slenderness=2.0, speed=2.0, axial_scheme="uniform").dynamic_stiffness(
                (0.0, 0.0), [1.0]
            )[0],
            exact,
        )
        for count in counts
    ]
    assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(2.0, abs=0.1)


def concentric_threshold_error(grid: tuple[int, int], row: dict[str, str]) -> tuple[float, float, float]:
    """Relative errors of whirl ratio, stiffness and mass of the threshold nearest to the table's."""
    ratio = float(row["whirl_ratio"])
    case = film(
        grid,
        slenderness=float(row["L_over_D"]),
        speed=float(row["Lambda"]),
        foil_stiffness=float(row["kf_bar"]),
        loss_factor=float(row["eta(cf=eta*kf)"]),
    )
    found = threshold_masses(case, (0.0, 0.0), [0.85 * ratio, 1.15 * ratio])
    best = min(found, key=lambda threshold: abs(threshold.whirl_ratio - ratio))
    return (
        abs(best.whirl_ratio / ratio - 1.0),
        abs(best.stiffness / float(row["Keq_bar"]) - 1.0),
        abs(best.mass / float(row["Mcrit_bar_per_bearing"]) - 1.0),
    )


def test_concentric_threshold_mass() -> None:
    """On 96 x 4, Lambda up to 50: at most 1 %; the measured worst is 0.25 %."""
    errors = [
        concentric_threshold_error((96, 4), row) for row in reference_table("concentric_threshold_mass")
    ]
    assert np.max(errors) <= 0.005


def test_concentric_threshold_mass_converges_with_second_order() -> None:
    """The table's most sensitive row (nu = 0.0117), without the digits that the table cuts off."""
    row = reference_table("concentric_threshold_mass")[-1]
    counts = [40, 80, 160]
    errors = [concentric_threshold_error((count, FINE_AXIAL), row)[2] for count in counts]
    assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(2.0, abs=0.1)
