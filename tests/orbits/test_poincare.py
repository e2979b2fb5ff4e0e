"""Sections of known motions: values, places, and the order of the interpolation."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.orbits.time_runs.poincare import level_section, phase_section


def motion(time):
    return np.stack([np.sin(0.7 * time), np.cos(1.3 * time)], axis=-1)


def run_up(time):
    return 0.3 + 0.8 * time + 0.01 * time**2


def crossings(offset, last):
    """Times at which the phase of ``run_up`` is the offset plus whole turns."""
    levels = offset + 2.0 * np.pi * np.arange(0 if offset >= 0.3 else 1, 100)
    times = (np.sqrt(0.64 + 0.04 * (levels - 0.3)) - 0.8) / 0.02
    return times[times <= last]


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_the_order_of_a_section(degree):
    """Halving the distance of the samples of a run-up divides the error by 2^(degree + 1)."""
    errors = []
    for interval in (0.2, 0.1, 0.05):
        time = np.arange(int(60.0 / interval) + 1) * interval
        found = phase_section(run_up(time), motion(time), 1.0, degree)
        errors.append(np.sqrt(np.mean((found.values - motion(crossings(1.0, time[-1]))) ** 2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, degree + 1, atol=0.3)  # next order, and where crossings fall


def test_crossings_are_where_the_phase_is_reached():
    time = np.arange(601) * 0.1
    found = phase_section(run_up(time), motion(time), 1.0)
    np.testing.assert_allclose(0.1 * found.place, crossings(1.0, 60.0), rtol=0.0, atol=1e-11)


def test_crossings_on_samples_are_the_samples():
    """The phase of a ring whose period holds a whole number of samples, first and last sample included."""
    phase = 2.0 * np.pi / 16.0 * np.arange(5 * 16 + 1)
    values = np.cos(0.37 * np.arange(81.0))[:, None]
    found = phase_section(phase, values)
    np.testing.assert_allclose(found.place, 16.0 * np.arange(6), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(found.values, values[::16], rtol=0.0, atol=1e-11)  # rounding of the phase


def test_rising_through_a_level():
    time = np.arange(2000) * 0.05
    found = level_section(np.sin(0.7 * time), motion(time), 0.4)
    turns = np.arange(len(found.place))
    np.testing.assert_allclose(0.05 * found.place, (np.arcsin(0.4) + 2.0 * np.pi * turns) / 0.7, atol=1e-9)
    np.testing.assert_allclose(found.values[:, 0], 0.4, rtol=0.0, atol=1e-9)  # 0.035^6


def test_phases_that_tell_nothing_are_refused():
    for phase in (np.arange(5.0), np.arange(10.0)[::-1], 6.3 * np.arange(10.0)):
        with pytest.raises(ValueError, match="rising phase"):
            phase_section(phase, np.zeros((len(phase), 1)))
    with pytest.raises(ValueError, match="more than 5 samples"):
        level_section(np.arange(5.0), np.zeros((5, 1)), 2.0)
