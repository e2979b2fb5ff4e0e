"""Speed, rotation angle and ring displacement of a run, and the force of an unbalance that speeds up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from pipelines.machine.film import DISPLACEMENT, DISPLACEMENT_RATE, EXCITATION_FREQUENCY, SPEED
from pipelines.machine.unbalance import unbalance_factors
from pipelines.orbits.time_runs.drive import BEGIN, Switching, make_drive, set_drive

TIMES, SPEEDS = [0.0, 3.0, 5.0], [0.5, 1.1, 0.8]
STEADY = Switching(0.2, 0.2)


def test_the_speed_is_linear_between_the_times_and_stays_after_the_last():
    drive = make_drive(TIMES, SPEEDS, 9.0, STEADY, 0.7)
    times = np.array([0.0, 1.5, 3.0, 4.0, 5.0, 7.0, 9.0])
    np.testing.assert_allclose(drive.speed(times), [0.5, 0.8, 1.1, 0.95, 0.8, 0.8, 0.8], rtol=1e-14)
    assert drive.largest_speed() == pytest.approx(1.1, rel=1e-14)


def test_the_angle_is_the_integral_of_the_speed():
    drive = make_drive(TIMES, SPEEDS, 9.0, STEADY, 0.7, angle=0.3)
    for end in (1.0, 3.0, 4.5, 9.0):
        expected = 0.3 + quad(lambda t: np.interp(t, TIMES, SPEEDS), 0.0, end, points=[3.0, 5.0])[0]
        assert float(drive.angle(np.array(end))) == pytest.approx(expected, rel=1e-10)


def test_kernel_and_tables_agree_and_the_ring_turns_on():
    switching = Switching(0.0, 0.3, begin=2.0, ramp=4.0)
    drive = make_drive(TIMES, SPEEDS, 9.0, switching, 0.7, ring_phase=0.4)
    parameters = np.zeros(5)
    parameters[EXCITATION_FREQUENCY] = 0.7
    for time in np.linspace(0.0, 9.0, 37):
        piece = drive.pieces[int(drive.piece_at(np.array(time)))]
        phase, angle, _ = set_drive(piece, time - piece[BEGIN], parameters)
        assert parameters[SPEED] == pytest.approx(float(drive.speed(np.array(time))), rel=1e-13)
        assert angle == pytest.approx(float(drive.angle(np.array(time))), abs=1e-13)
        assert parameters[DISPLACEMENT] == pytest.approx(float(drive.displacement(np.array(time))), abs=1e-15)
        assert math.cos(phase - 0.4 - 0.7 * time) == pytest.approx(1.0, abs=1e-13)


def test_a_switched_ring_neither_jumps_nor_kinks():
    """The rate is the derivative of the displacement, and vanishes with its own derivative at both ends."""
    drive = make_drive([0.0], [1.0], 9.0, Switching(0.3, 0.1, begin=2.0, ramp=4.0), 0.7)
    parameters = np.zeros(5)

    def rate(time: float) -> float:
        piece = drive.pieces[int(drive.piece_at(np.array(time)))]
        set_drive(piece, time - piece[BEGIN], parameters)
        return float(parameters[DISPLACEMENT_RATE])

    for time in (2.5, 4.0, 5.5):
        ends = drive.displacement(np.array([time - 1e-4, time + 1e-4]))
        assert rate(time) == pytest.approx((ends[1] - ends[0]) / 2e-4, abs=1e-8)
    assert rate(2.0) == rate(6.0) == rate(7.0) == 0.0
    assert abs(rate(2.001)) < 1e-6
    assert float(drive.displacement(np.array(2.0))) == 0.3
    assert float(drive.displacement(np.array(6.0))) == pytest.approx(0.1, abs=1e-15)


@pytest.mark.parametrize("acceleration", [0.0, 0.25, -0.4])
def test_the_force_is_the_negative_second_derivative_of_the_mass_position(acceleration):
    """F = -U d2/dtau2 (cos, sin)(phi) with phi = phi_0 + Omega tau + a tau^2/2, by differences."""
    speed, angle = 1.3, 0.7

    def position(t: float) -> np.ndarray:
        phi = angle + speed * t + 0.5 * acceleration * t * t
        return np.array([np.cos(phi), np.sin(phi)])

    h = 1e-3  # fourth-order difference: error h^4
    second = sum(w * position(k * h) for k, w in zip((-2, -1, 0, 1, 2), (-1, 16, -30, 16, -1), strict=True))
    expected = -second / (12.0 * h * h)
    np.testing.assert_allclose(unbalance_factors(angle, speed, acceleration), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": [1.0, 3.0, 5.0]}, "begin at 0"),
        ({"times": [0.0, 3.0, 3.0]}, "begin at 0 and rise"),
        ({"times": [0.0, 3.0]}, "one for each speed"),
        ({"speeds": [0.5, 0.0, 0.8]}, "positive"),
        ({"duration": 0.0}, "positive"),
        ({"switching": Switching(0.0, 0.2, 1.0, 0.0)}, "ramp"),
    ],
)
def test_impossible_drives_are_refused(changes, message):
    given = {"times": TIMES, "speeds": SPEEDS, "duration": 9.0, "switching": STEADY} | changes
    with pytest.raises(ValueError, match=message):
        make_drive(**given, frequency=0.7)
