"""Spectra of sines: heights and places of the peaks."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.orbits.time_runs.spectrum import amplitude_spectrum, waterfall


@pytest.mark.parametrize("frequency", [0.5, 0.7003, 2.1717])
def test_a_sine_gives_a_peak_of_its_amplitude(frequency):
    """On and between the lines of the transform; the flat-top window is flat to 0.1 %."""
    time = np.arange(4000) * 0.1
    values = np.stack([5.0 + 0.3 * np.sin(frequency * time), 2.0 * np.cos(frequency * time)], axis=1)
    found = amplitude_spectrum(values, 0.1)
    np.testing.assert_allclose(found.amplitude.max(axis=0), [0.3, 2.0], rtol=1e-3)
    peaks = found.frequency[found.amplitude.argmax(axis=0)]
    np.testing.assert_allclose(peaks, frequency, atol=2.0 * np.pi / 400.0)  # one line


def test_two_sines_give_two_peaks():
    time = np.arange(8192) * 0.1
    found = amplitude_spectrum(0.3 * np.sin(0.7 * time) + 0.02 * np.sin(1.1 * time), 0.1)
    for frequency, amplitude in ((0.7, 0.3), (1.1, 0.02)):
        near = np.abs(found.frequency - frequency) < 0.1
        assert found.amplitude[near].max() == pytest.approx(amplitude, rel=2e-3)
    far = (np.abs(found.frequency - 0.7) > 0.1) & (np.abs(found.frequency - 1.1) > 0.1)
    assert found.amplitude[far].max() < 1e-4 * 0.3 + 1e-9  # side lobes of the window, -90 dB


def test_a_waterfall_follows_a_chirp():
    """A sweep of the frequency from 0.5 to 1.5: the peak of every piece is at the frequency in its middle."""
    time = np.arange(40_000) * 0.1
    rate = 1.0 / time[-1]
    values = 0.3 * np.sin(0.5 * time + 0.5 * rate * time**2)
    found = waterfall(np.stack([values, 2.0 * values], axis=1), 0.1, 1000, 250)
    assert found.amplitude.shape == (len(found.place), len(found.frequency), 2)
    middle = 0.5 + rate * 0.1 * found.place
    peaks = found.frequency[found.amplitude[:, :, 0].argmax(axis=1)]
    np.testing.assert_allclose(peaks, middle, atol=np.pi / 100.0 + 0.1 * rate * 1000 / 2)
    heights = found.amplitude.max(axis=1)
    assert np.all((heights[:, 0] > 0.96 * 0.3) & (heights[:, 0] < 1.001 * 0.3))
    np.testing.assert_allclose(heights[:, 1], 2.0 * heights[:, 0], rtol=1e-12)


def test_pieces_lie_wholly_inside_and_their_trends_do_not_count():
    values = 7.0 + 1e-3 * np.arange(1000) + np.sin(2.0 * np.pi / 20.0 * np.arange(1000))
    found = waterfall(values, 1.0, 200, 50)
    assert found.place[0] - 100 >= 0
    assert found.place[-1] + 100 <= 1000
    assert len(found.place) == 17
    assert found.amplitude[:, 0].max() < 1e-3  # 7 without its line
    np.testing.assert_allclose(found.amplitude.max(axis=1), 1.0, rtol=1e-2)  # the line takes a little
    with pytest.raises(ValueError, match="a piece of 2000 samples"):
        waterfall(values, 1.0, 2000, 50)
