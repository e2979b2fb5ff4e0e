"""Ring deformation and its rate: exact arithmetic, differences, limits, compiled functions."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from numba import njit

from pipelines.case.models import Ring
from pipelines.case.ring_statics import THIN_RING, ring_coefficients, ring_displacement_from_load
from pipelines.machine.ring import ring_axes_at, ring_displacement_at, ring_rate_at
from tests.helpers.ring import ring_deformation

ANGLES = np.linspace(0.0, 2.0 * np.pi, 33)
COSINE, SINE = np.cos(ANGLES), np.sin(ANGLES)
OPTIONS = {"displacement": 0.2, "frequency": 0.7, "ratio": 0.918, "radius_over_clearance": 686.3}


def exact_displacement(cosine, sine, horizontal, vertical, radius) -> float:
    """The paper's sqrt(...) - R in 50 digits, on the unit circle through the given direction."""
    with localcontext() as context:
        context.prec = 50
        c, s, h, v, r = (Decimal(float(value)) for value in (cosine, sine, horizontal, vertical, radius))
        norm = (c * c + s * s).sqrt()
        c, s = c / norm, s / norm
        return float((((r + h) * c) ** 2 + ((r + v) * s) ** 2).sqrt() - r)


def test_displacement_keeps_full_precision_for_a_tiny_ring_motion():
    """1e-6 of the clearance, R / c_r = 686: the printed difference keeps 7 digits, ours all."""
    horizontal, vertical, radius = 0.9e-6, -1e-6, 686.3
    q = ring_displacement_at.py_func(COSINE, SINE, horizontal, vertical, radius)
    exact = np.array(
        [exact_displacement(c, s, horizontal, vertical, radius) for c, s in zip(COSINE, SINE, strict=True)]
    )
    np.testing.assert_allclose(q, exact, rtol=1e-13, atol=1e-14 * 1e-6)
    printed = np.sqrt(((radius + horizontal) * COSINE) ** 2 + ((radius + vertical) * SINE) ** 2) - radius
    assert np.max(np.abs(printed - exact)) > 1e3 * np.max(np.abs(q - exact))


def test_axes_follow_the_load_and_carry_the_bearings_amplitude_and_phase():
    horizontal, vertical, horizontal_rate, vertical_rate = ring_axes_at.py_func(0.4, 0.2, 0.7, 0.9, 1.5, 0.3)
    assert vertical == pytest.approx(-0.15 * (1 + np.sin(0.7)))
    assert horizontal == pytest.approx(0.9 * 0.15 * (1 + np.sin(0.7)))
    assert vertical_rate == pytest.approx(-0.15 * 0.7 * np.cos(0.7))
    assert horizontal_rate == pytest.approx(-0.9 * vertical_rate)


@pytest.mark.parametrize("phase", [0.0, 1.1, 3.9])
def test_rate_is_the_time_derivative(phase):
    """Central differences in tau, phase = Omega_ex tau, extrapolated once: right to h^4 and rounding."""
    _, rate = ring_deformation(COSINE, SINE, phase, **OPTIONS)

    def difference(step: float) -> np.ndarray:
        ahead, _ = ring_deformation(COSINE, SINE, phase + OPTIONS["frequency"] * step, **OPTIONS)
        behind, _ = ring_deformation(COSINE, SINE, phase - OPTIONS["frequency"] * step, **OPTIONS)
        return (ahead - behind) / (2 * step)

    expected = (4 * difference(1e-2) - difference(2e-2)) / 3
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-8 * 0.2)


def test_extremes_of_the_motion():
    """At rest at phase -pi/2; largest at pi/2: -delta at the top, rho delta at the sides; no rate."""
    rest, rest_rate = ring_deformation(COSINE, SINE, -np.pi / 2, **OPTIONS)
    np.testing.assert_allclose(rest, 0.0, atol=1e-16)
    np.testing.assert_allclose(rest_rate, 0.0, atol=1e-16)
    full, full_rate = ring_deformation(COSINE, SINE, np.pi / 2, **OPTIONS)
    np.testing.assert_allclose(full[[0, 16]], 0.918 * 0.2, rtol=1e-12)
    np.testing.assert_allclose(full[[8, 24]], -0.2, rtol=1e-12)
    np.testing.assert_allclose(full_rate, 0.0, atol=1e-16)


def test_a_small_motion_is_the_sum_of_two_cosines_squared():
    """q_r = d_h cos^2 + d_v sin^2 + (d_h - d_v)^2 sin^2 cos^2 / 2R + ... for small delta."""
    errors = []
    for displacement in (0.2, 0.02):
        options = OPTIONS | {"displacement": displacement}
        q, _ = ring_deformation(COSINE, SINE, 0.8, **options)
        horizontal, vertical, *_ = ring_axes_at.py_func(0.8, displacement, 0.7, 0.918, 1.0, 0.0)
        linear = horizontal * COSINE**2 + vertical * SINE**2
        second = (horizontal - vertical) ** 2 * SINE**2 * COSINE**2 / (2 * OPTIONS["radius_over_clearance"])
        np.testing.assert_allclose(q - linear, second, atol=1e-3 * np.max(second))
        errors.append(np.max(np.abs(q - linear)))
    assert errors[0] / errors[1] == pytest.approx(100.0, rel=1e-2)


def test_mean_over_a_period_is_the_ring_under_the_mean_load_up_to_second_order():
    phases = 2 * np.pi * np.arange(64) / 64
    q, rate = np.mean([ring_deformation(COSINE, SINE, phase, **OPTIONS) for phase in phases], axis=0)
    linear = 0.1 * (0.918 * COSINE**2 - SINE**2)
    np.testing.assert_allclose(q, linear, atol=0.2**2 / OPTIONS["radius_over_clearance"])
    # the trapezoidal rule integrates the derivative of a periodic function to rounding
    np.testing.assert_allclose(rate, 0.0, atol=1e-16)


def test_compiled_functions_give_the_same_numbers():
    @njit
    def along(cosine, sine, phase, out):  # type: ignore[no-untyped-def]
        h, v, h_rate, v_rate = ring_axes_at(phase, 0.2, 0.7, 0.918, 1.0, 0.0)
        for i in range(cosine.size):
            out[0, i] = ring_displacement_at(cosine[i], sine[i], h, v, 686.3)
            out[1, i] = ring_rate_at(cosine[i], sine[i], h, v, h_rate, v_rate, 686.3)

    out = np.empty((2, ANGLES.size))
    along(COSINE, SINE, 2.2, out)
    np.testing.assert_allclose(out, ring_deformation(COSINE, SINE, 2.2, **OPTIONS), rtol=1e-13, atol=1e-16)


def test_load_and_thin_wall_limits():
    ring = Ring(inner_radius=0.02, thickness=1e-5, width=0.016, young_modulus=206e9, poisson_ratio=0.3)
    coefficients = ring_coefficients(ring)
    assert coefficients.ratio == pytest.approx(THIN_RING.ratio, rel=1e-6)
    assert THIN_RING.ratio == pytest.approx((4 - np.pi) * 2 / (np.pi**2 - 8), rel=1e-14)
    bending = 206e9 * 0.016 * 1e-15 / 12
    expected = 0.5 * 0.0200050**3 / bending * (np.pi / 4 - 2 / np.pi)
    assert ring_displacement_from_load(ring, 0.5) == pytest.approx(expected, rel=1e-5)


def test_deformations_are_those_of_a_curved_beam():
    """Castigliano's theorem on the ring as a curved beam, the energy integrated numerically.

    Pairs of loads W (vertical) and P (horizontal) pull; over the angle phi from the horizontal axis the
    section carries M = M0 - (W/2) R (1 - cos) + (P/2) R sin, N = (W/2) cos + (P/2) sin, V = (W/2) sin -
    (P/2) cos, with M positive when it straightens. Energy per length: M^2/2EI - M N/EAR + N^2/2EA + F
    V^2/2GA; M0 makes it least.
    """
    ring = Ring(inner_radius=0.02, thickness=0.005, width=0.016, young_modulus=206e9, poisson_ratio=0.3)
    radius, area, second_moment = 0.0225, 0.016 * 0.005, 0.016 * 0.005**3 / 12
    points, weights = np.polynomial.legendre.leggauss(20)
    phi, weights = np.pi / 4 * (points + 1), 4 * np.pi / 4 * weights * radius
    zero, one = np.zeros_like(phi), np.ones_like(phi)
    # rows: M0 = 1, W = 1, P = 1
    moment = np.stack((one, -0.5 * radius * (1 - np.cos(phi)), 0.5 * radius * np.sin(phi)))
    normal = np.stack((zero, 0.5 * np.cos(phi), 0.5 * np.sin(phi)))
    shear = np.stack((zero, 0.5 * np.sin(phi), -0.5 * np.cos(phi)))

    def integral(left, right):
        return (left * weights) @ right.T

    flexibility = integral(moment, moment) / (206e9 * second_moment)
    flexibility += integral(normal, normal) / (206e9 * area)
    flexibility -= (integral(moment, normal) + integral(normal, moment)) / (206e9 * area * radius)
    flexibility += 1.2 * integral(shear, shear) / (206e9 / 2.6 * area)
    free = flexibility[1:, 1:] - np.outer(flexibility[1:, 0], flexibility[0, 1:]) / flexibility[0, 0]

    unit = radius**3 / (206e9 * second_moment)
    coefficients = ring_coefficients(ring)
    assert coefficients.vertical == pytest.approx(free[0, 0] / unit, rel=1e-12)
    assert coefficients.horizontal == pytest.approx(-free[1, 0] / unit, rel=1e-12)
