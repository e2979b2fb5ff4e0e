"""Invariant curves against closed forms: convergence in the angles, of Newton's method, multipliers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.fourier import angles, shift_matrix
from pipelines.bifurcations.tori.invariant_curve import TorusCorrection, correct_on_angles, correct_torus
from pipelines.bifurcations.tori.problem import FourierOptions, TorusProblem, TorusUnknowns, fixed_parameter
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.stability import torus_spectrum
from pipelines.bifurcations.tori.start import torus_around
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import NewtonStop, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.explicit_maps import CLOCK
from tests.bifurcations.quasi_periodic import moebius_circle, moebius_rotation, two_tones
from tests.systems import hopf_pair

M_, THETA, D, B, E = 0.1, 1.0, -0.5, 0.3, 0.7
RADIUS, ROTATION, MULTIPLIER = moebius_circle(M_, THETA, D, B)
SHARP = ShootingOptions(tolerance=1e-13)


def moebius_problem(fourier: FourierOptions | None = None) -> TorusProblem:
    circle = PeriodCircle(moebius_rotation(), np.array([M_, THETA, D, B, E, CLOCK]), "m", 1)
    return TorusProblem(circle, SHARP, FourierOptions() if fourier is None else fourier)


def exact_circle(count: int) -> np.ndarray:
    w = RADIUS * np.exp(1j * angles(count))
    seen = w / (1.0 - E * w)
    return np.stack([seen.real, seen.imag], axis=1)


def solved(count: int, disturbed: float = 1.02) -> TorusCorrection:
    problem, exact = moebius_problem(), exact_circle(count)
    guess = TorusUnknowns(exact * disturbed, ROTATION + 0.01, M_)
    bases = constant_bases(np.eye(2), count)
    return correct_on_angles(problem, guess, fixed_parameter(problem, count, M_), bases, exact)


def test_newton_is_quadratic() -> None:
    """Residuals r with r_next < C r^2 down to rounding: the linearisation is exact, the rotation included."""
    residuals = np.array(solved(31).residual_norms)
    assert residuals[-1] <= 1e-13
    large = residuals[:-1] > 1e-9
    assert np.count_nonzero(large) >= 3
    assert np.all(residuals[1:][large] < 40.0 * residuals[:-1][large] ** 2)


def test_error_falls_geometrically() -> None:
    """The amplitudes of the exact curve fall like (e r)^k, k the wave number; so must the error in K."""
    numbers, errors, rotations = [], [], []
    for count in (15, 19, 23, 27, 31, 35, 39, 43):
        torus = solved(count).torus
        assert torus is not None
        numbers.append(count // 2)
        errors.append(np.max(np.abs(torus.unknowns.states - exact_circle(count))))
        rotations.append(abs(torus.unknowns.rotation - ROTATION))
        # the estimate is of the size of the last amplitude, not of the error at the angles alone
        assert errors[-1] < 10.0 * torus.error
        assert torus.error < 30.0 * (E * RADIUS) ** (count // 2)
    slope = np.polyfit(numbers, np.log(errors), 1)[0]
    # the shift divides wave number k by |exp(i k rho) - mu|, which scatters single errors
    assert slope == pytest.approx(math.log(E * RADIUS), rel=0.1)
    # the rotation is a mean over the curve: its error falls at twice the rate, to rounding
    assert rotations[-1] < 1e-14


def test_multipliers_of_the_exact_circle() -> None:
    problem, correction = moebius_problem(), solved(41)
    assert correction.torus is not None
    spectrum = torus_spectrum(problem, correction.torus)
    assert spectrum.complete
    assert abs(spectrum.multipliers[spectrum.trivial] - 1.0) < 1e-9
    assert spectrum.moduli == pytest.approx([MULTIPLIER], abs=1e-9)
    # weighted means along the rotation, 400 steps
    assert spectrum.growth == pytest.approx([1.0, MULTIPLIER], abs=1e-5)


def test_angles_follow_the_series() -> None:
    """15 angles are doubled (2 M + 1) until the error estimate meets the tolerance, and not further."""
    problem = moebius_problem(FourierOptions(tolerance=1e-9))
    guess = TorusUnknowns(exact_circle(15), ROTATION, M_)
    constraint, bases = fixed_parameter(problem, 15, M_), constant_bases(np.eye(2), 15)
    correction = correct_torus(problem, guess, constraint, bases, exact_circle(15))
    torus = correction.torus
    assert torus is not None
    assert not correction.rough
    assert torus.count == 63
    assert torus.error < 1e-9
    # the phase was fixed by a coarse reference: compare at the angle that fits best
    turned = [
        np.max(np.abs(shift_matrix(63, shift)[0] @ torus.unknowns.states - exact_circle(63)))
        for shift in np.linspace(-1e-4, 1e-4, 2001)
    ]
    assert min(turned) < 1e-6
    most = replace(problem, fourier=FourierOptions(tolerance=1e-9, most=31))
    assert correct_torus(most, guess, constraint, bases, exact_circle(15)).rough


def test_linear_response_to_two_frequencies() -> None:
    """Closed form: every frequency has its own response; Newton's method needs one iteration."""
    omega, speed, damping, load, second, modulation = 1.0, 0.618, 0.2, 0.2, 0.3, 0.5
    period_map = PeriodMap(two_tones(damping, 0.0, modulation), DOPRI8, samples=1)
    parameters = np.array([omega, speed, load, second, 0.0])
    circle = PeriodCircle(period_map, parameters, "speed", 128, "angle", "speed")
    problem = TorusProblem(circle, SHARP)
    start = torus_around(problem, np.zeros(2), speed)
    guess = TorusUnknowns(start.states, start.rotation, speed)
    correction = correct_torus(problem, guess, fixed_parameter(problem, 15, speed), start.bases)
    torus = correction.torus
    assert torus is not None
    assert correction.iterations <= 2  # the second one is rounding
    assert correction.residual_norms[1] < 1e-12
    exact = np.zeros((15, 2))
    at = angles(15)
    for frequency, force in (
        (speed, second),
        (speed + omega, 0.5 * second * modulation),
        (speed - omega, 0.5 * second * modulation),
    ):
        response = force / (1.0 - frequency**2 + 1j * damping * frequency) * np.exp(1j * at)
        exact += np.stack([response.real, (1j * frequency * response).real], axis=1)
    steady = load / (1.0 - omega**2 + 1j * damping * omega)
    exact += [steady.real, (1j * omega * steady).real]
    # eighth order with 128 steps per period: errors of about 1e-11
    assert np.max(np.abs(torus.unknowns.states - exact)) < 1e-9
    assert torus.unknowns.rotation == pytest.approx(2.0 * math.pi * speed / omega, rel=1e-15)
    spectrum = torus_spectrum(problem, torus)
    assert spectrum.trivial == -1
    assert spectrum.moduli == pytest.approx([math.exp(-0.5 * damping * period_map.period(parameters))] * 2)


def test_slope_of_a_known_rotation() -> None:
    """d rho/d parameter for the second frequency, for that of the forcing and for neither."""
    period_map = PeriodMap(two_tones(), DOPRI8, samples=1, period_multiple=2)
    parameters = np.array([1.3, 0.7, 0.2, 0.3, 0.0])
    for name in ("speed", "frequency", "F"):
        circle = PeriodCircle(period_map, parameters, name, 64, "angle", "speed")
        value = float(parameters[circle.index])
        sides = [circle.rotation(value + h) for h in (-1e-5, 0.0, 1e-5)]
        below, here, above = (side for side in sides if side is not None)
        assert here[0] == pytest.approx(4.0 * math.pi * 0.7 / 1.3)
        assert here[1] == pytest.approx((above[0] - below[0]) / 2e-5, rel=1e-8)


def test_rational_rotation_is_told() -> None:
    """At rho = 7/5 turns circles of eigenvalues have many eigenfunctions; the growth still has their moduli,
    whose product is that of the constant divergence.
    """
    period_map = PeriodMap(two_tones(0.2, 0.5, 0.5), DOPRI8, samples=1)
    circle = PeriodCircle(period_map, np.array([1.0, 1.4, 0.2, 0.3, 0.0]), "speed", 64, "angle", "speed")
    problem = TorusProblem(circle)
    start = torus_around(problem, np.zeros(2), 1.4)
    guess = TorusUnknowns(start.states, start.rotation, 1.4)
    torus = correct_torus(problem, guess, fixed_parameter(problem, 15, 1.4), start.bases).torus
    assert torus is not None
    spectrum = torus_spectrum(problem, torus)
    assert not spectrum.complete
    assert spectrum.unstable == 0
    assert np.prod(spectrum.moduli) >= math.exp(-0.2 * 2.0 * math.pi) * (1.0 - 1e-6)


def test_what_is_refused() -> None:
    problem = moebius_problem()
    guess, bases = TorusUnknowns(exact_circle(15), ROTATION, M_), constant_bases(np.eye(2), 15)
    with pytest.raises(ValueError, match="reference"):
        correct_torus(problem, guess, fixed_parameter(problem, 15, M_), bases)
    with pytest.raises(ValueError, match="odd numbers"):
        FourierOptions(fewest=16)
    with pytest.raises(ValueError, match="torus_from_event"):
        torus_around(problem, np.zeros(2), M_)
    period_map = PeriodMap(two_tones(), DOPRI8, samples=1)
    parameters = np.array([1.0, 0.6, 0.2, 0.3, 0.0])
    with pytest.raises(ValueError, match="both"):
        PeriodCircle(period_map, parameters, "speed", 64, angle="angle")
    with pytest.raises(ValueError, match="4 parameters"):
        PeriodCircle(period_map, parameters[:4], "speed", 64)
    with pytest.raises(ValueError, match="unknown parameter"):
        PeriodCircle(period_map, parameters, "pace", 64)
    with pytest.raises(ValueError, match="stroboscopic"):
        PeriodCircle(PeriodMap(hopf_pair(), DOPRI8, Formulation.AUTONOMOUS), np.array([0.1, 0.2]), "mu", 64)


def test_failures_are_results() -> None:
    """Far from any curve the corrector says why it gave up."""
    problem = moebius_problem()
    guess = TorusUnknowns(exact_circle(15) * 40.0, ROTATION, M_)
    bases = constant_bases(np.eye(2), 15)
    correction = correct_torus(problem, guess, fixed_parameter(problem, 15, M_), bases, exact_circle(15))
    assert correction.torus is None
    assert correction.stop in (NewtonStop.DIVERGED, NewtonStop.ITERATIONS, NewtonStop.NON_FINITE)
