"""Stiffness, damping and stability thresholds of eccentric bearings against an independent spectral solver.

Grids stated: coefficients on 64 x 4, threshold masses on 96 x 4.  Tolerance 0.5 %, half of what is asked for.
"""

from __future__ import annotations

import numpy as np
import pytest

from .error_table import coefficients, eccentric_film, eccentric_threshold
from .films import film, observed_order, reference_table, relative, threshold_masses

COEFFICIENTS = reference_table("dynamic_coefficients")
THRESHOLDS = reference_table("threshold_mass_eccentric")


@pytest.mark.parametrize("row", COEFFICIENTS)
def test_stiffness_and_damping(row: dict[str, str]) -> None:
    """K and C in the Frobenius norm, and every entry relative to the largest of its matrix."""
    for computed, expected in coefficients((64, 4), row):
        assert relative(computed, expected) <= 0.005
        assert abs(computed - expected).max() <= 0.005 * abs(expected).max()


@pytest.mark.parametrize("row", COEFFICIENTS[::4])
def test_force_of_the_same_rows(row: dict[str, str]) -> None:
    case, position = eccentric_film((64, 4), row)
    assert relative(case.force(position), np.array([float(row["Fx_bar"]), float(row["Fy_bar"])])) <= 0.003


def test_coefficients_are_of_second_order_in_theta() -> None:
    """Rigid bearing, Lambda = 1, eps = 0.4, against its own value on 320 x 6."""
    row = next(r for r in COEFFICIENTS if (r["Lambda"], r["kf_bar"]) == ("1.0", "inf"))
    finest = coefficients((320, 6), row)
    counts = [20, 40, 80]
    for index in range(2):
        errors = [relative(coefficients((count, 6), row)[index][0], finest[index][0]) for count in counts]
        assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(2.0, abs=0.1)


def test_three_stations_stagnate_where_the_film_is_steepest() -> None:
    """Damping at Lambda = 5, eps = 0.6, rigid: stations 4 and 5 each cut the axial error to a third."""
    row = next(
        r for r in COEFFICIENTS if (r["Lambda"], r["kf_bar"], r["X(=eps,Y=0)"]) == ("5.0", "inf", "0.6")
    )
    damping = [coefficients((96, axial), row)[1][0] for axial in (3, 4, 5, 8)]
    errors = [relative(value, damping[-1]) for value in damping[:-1]]
    assert errors[0] > 0.002
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


@pytest.mark.parametrize("row", THRESHOLDS)
def test_threshold_mass(row: dict[str, str]) -> None:
    """Mass, whirl ratio, and the load and attitude of the journal."""
    found = eccentric_threshold((96, 4), row)
    assert found.mass == pytest.approx(float(row["Mcrit_bar_per_bearing"]), rel=0.005)
    assert found.whirl_ratio == pytest.approx(float(row["whirl_ratio"]), rel=0.002)
    case, position = eccentric_film((96, 4), row)
    force = case.force(position)
    assert np.linalg.norm(force) == pytest.approx(float(row["W_bar=F/(p0RL)"]), rel=0.002)
    assert np.degrees(np.arctan2(force[1], -force[0])) == pytest.approx(float(row["attitude_deg"]), abs=0.1)


def test_threshold_mass_converges_with_second_order() -> None:
    """The row with the largest error on the default grid: Lambda = 0.5, eps = 0.6, k_f = 10."""
    row = THRESHOLDS[1]
    finest = eccentric_threshold((320, 5), row).mass
    counts = [40, 80, 160]
    errors = [abs(eccentric_threshold((count, 5), row).mass - finest) for count in counts]
    # The reference grid itself still carries 1/16 to 1/64 of these errors.
    assert observed_order(errors, [1.0 / count for count in counts]) == pytest.approx(2.1, abs=0.15)
    assert finest == pytest.approx(float(row["Mcrit_bar_per_bearing"]), rel=0.001)


def test_threshold_is_where_a_rigid_rotor_whirls_undamped() -> None:
    """det(M sigma^2 + Z(sigma)) = 0 at sigma = i omega, and the root crosses the axis as the mass grows."""
    case = film((40, 3), slenderness=1.0, speed=1.0)
    position = (0.4, 0.0)
    threshold = max(
        threshold_masses(case, position, np.linspace(0.35, 0.55, 6)), key=lambda one: one.whirl_ratio
    )

    def determinant(mass: float, growth: float) -> complex:
        """At sigma = (i + growth) omega, in units of the stiffness."""
        ratio = threshold.whirl_ratio * (1.0 - 1j * growth)
        sigma = 1j * case.speed * ratio
        matrix = mass * sigma**2 * np.eye(2) + case.dynamic_stiffness(position, [ratio])[0]
        return complex(np.linalg.det(matrix)) / threshold.stiffness**2

    assert abs(determinant(threshold.mass, 0.0)) < 1e-8
    # d sigma / d M = -(d det / d M) / (d det / d sigma), by differences: a heavier rotor is less stable.
    step = 1e-5
    by_mass = determinant(threshold.mass * (1 + step), 0.0) - determinant(threshold.mass * (1 - step), 0.0)
    by_growth = determinant(threshold.mass, step) - determinant(threshold.mass, -step)
    assert (-by_mass / by_growth).real > 0.0
