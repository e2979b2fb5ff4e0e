"""Envelopes and rates of growth of known signals."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.orbits.time_runs.envelope import growth_rate, windowed_envelope, windowed_mean


def test_every_sample_belongs_to_one_window():
    values = np.array([[3.0, 0.0], [1.0, 5.0], [2.0, -1.0], [7.0, 4.0], [0.0, 9.0]])
    found = windowed_envelope(values, 2)
    np.testing.assert_array_equal(found.first, [0, 2])
    np.testing.assert_array_equal(found.low, [[1.0, 0.0], [0.0, -1.0]])
    np.testing.assert_array_equal(found.high, [[3.0, 5.0], [7.0, 9.0]])
    np.testing.assert_allclose(windowed_mean(values, 2), [[2.0, 2.5], [3.0, 4.0]], rtol=1e-15)


def test_the_envelope_of_a_growing_sine_grows_like_it():
    """Windows of one period: of exp(0.05 t) sin(2 pi t) the largest value grows by exp(0.05) from window to
    window, to rounding.
    """
    time = np.arange(20 * 64) / 64.0
    found = windowed_envelope(np.exp(0.05 * time) * np.sin(2.0 * np.pi * time), 64)
    growth = growth_rate(time[found.first], found.high - found.low)
    assert growth.rate == pytest.approx(0.05, rel=1e-12)
    assert growth.residual < 1e-12


def test_the_rate_is_that_of_least_squares():
    time = np.array([0.0, 1.0, 2.0, 5.0, 9.0])
    amplitude = np.array([1.0, 2.0, 0.0, 3.0, 11.0])  # zero has no logarithm
    kept = amplitude > 0.0
    slope, constant = np.polyfit(time[kept], np.log(amplitude[kept]), 1)
    growth = growth_rate(time, amplitude)
    assert growth.rate == pytest.approx(slope, rel=1e-12)
    left = np.log(amplitude[kept]) - slope * time[kept] - constant
    assert growth.residual == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-10)


def test_fading_weights_keep_a_beat_out_of_the_rate():
    """log A = 0.01 t + 0.4 sin(1.3 t): plain least squares are off by about 6 0.4 / (1.3 N^2), 5 % of the
    rate; weights that vanish at the ends with their slope win two orders in N.
    """
    time = np.arange(60.0)
    amplitude = np.exp(0.01 * time + 0.4 * np.sin(1.3 * time))
    plain = growth_rate(time, amplitude)
    faded = growth_rate(time, amplitude, np.hanning(62)[1:-1])
    assert abs(faded.rate - 0.01) < 1e-5 < 2e-4 < abs(plain.rate - 0.01)


def test_what_cannot_be_told_is_refused():
    with pytest.raises(ValueError, match="a window of 3 samples of 2"):
        windowed_envelope(np.zeros((2, 1)), 3)
    with pytest.raises(ValueError, match="two positive amplitudes"):
        growth_rate(np.arange(3.0), np.array([0.0, 1.0, 0.0]))
