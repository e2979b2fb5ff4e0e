"""Amplitude spectra of sampled motions: of a whole stretch, and of short pieces along a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from pipelines.case.arrays import Array

_PADDING = 2  # of the pieces of a waterfall: its frequencies lie twice as close


@dataclass(frozen=True)
class Spectrum:
    """``frequency`` (frequencies,) [rad per unit of time] and ``amplitude`` (frequencies, ...)."""

    frequency: Array
    amplitude: Array


@dataclass(frozen=True)
class Waterfall:
    """Spectra of pieces of a motion.

    ``place`` (pieces,): middle of each piece in samples; ``frequency`` (frequencies,); ``amplitude``
    (pieces, frequencies, ...).
    """

    place: Array
    frequency: Array
    amplitude: Array


def amplitude_spectrum(values: Array, interval: float) -> Spectrum:
    """Spectrum of ``values`` (samples, ...) that lie ``interval`` apart, without their mean.

    A sine of amplitude A gives a peak of height A wherever its frequency lies (flat-top window: within 0.1 %,
    for frequencies of at least five periods in the samples); lines less than ten periods apart merge.
    """
    window = signal.windows.flattop(len(values), sym=False)
    motion = values - np.average(values, axis=0, weights=window)  # so that no line lies at zero
    weighted = motion * window.reshape(-1, *[1] * (values.ndim - 1))
    amplitude: Array = 2.0 * np.abs(np.fft.rfft(weighted, axis=0)) / window.sum()
    frequency = np.arange(len(amplitude), dtype=np.float64) * (2.0 * np.pi / (len(values) * interval))
    return Spectrum(frequency, amplitude)


def waterfall(values: Array, interval: float, piece: int, hop: int) -> Waterfall:
    """Spectra of pieces of ``piece`` samples, ``hop`` apart and wholly within ``values`` (samples, ...).

    The straight line through each piece is taken out. Blackman-Harris window, whose side lobes are 92 dB
    down: a sine of amplitude A gives a peak between 0.97 A and A.
    Raises ValueError for fewer samples than a piece holds.
    """
    if len(values) < piece:
        raise ValueError(f"a piece of {piece} samples of {len(values)} that there are")
    transform = signal.ShortTimeFFT(
        signal.windows.blackmanharris(piece, sym=False),
        hop,
        1.0 / interval,
        mfft=_PADDING * piece,
        scale_to="magnitude",
    )
    # Slices whose piece lies wholly inside, counted as the transform does: the middle of piece p at p * hop.
    first = transform.lower_border_end[1]
    last = max(first + 1, transform.upper_border_begin(len(values))[1])
    channels = values.reshape(len(values), -1).T
    spectra = transform.stft_detrend(channels, "linear", p0=first, p1=last)
    shape = (last - first, transform.f_pts, *values.shape[1:])
    amplitude = 2.0 * np.abs(spectra).transpose(2, 1, 0).reshape(shape)
    return Waterfall(np.arange(first, last) * float(hop), 2.0 * np.pi * transform.f, amplitude)
