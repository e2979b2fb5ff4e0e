"""Envelopes of sampled motions, and growth rates of amplitudes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array


@dataclass(frozen=True)
class Envelope:
    """Smallest and largest value of every window, each (windows, ...).

    ``first`` (windows,): index of the sample with which each window begins.
    """

    first: NDArray[np.intp]
    low: Array
    high: Array


def windowed_envelope(values: Array, window: int) -> Envelope:
    """Envelope of ``values`` (samples, ...) in windows of ``window`` samples one after the other.

    The samples at the end that do not fill a window belong to the last one. Raises ValueError for an empty
    window and for fewer samples than one window holds.
    """
    first = _starts(len(values), window)
    return Envelope(first, np.minimum.reduceat(values, first), np.maximum.reduceat(values, first))


def windowed_mean(values: Array, window: int) -> Array:
    """Mean of ``values`` (samples, ...) in the windows of `windowed_envelope`; ValueError as there."""
    first = _starts(len(values), window)
    counts = np.diff(np.append(first, len(values)))
    return np.asarray(np.add.reduceat(values, first) / counts.reshape(-1, *[1] * (values.ndim - 1)))


def _starts(count: int, window: int) -> NDArray[np.intp]:
    if window < 1 or count < window:
        raise ValueError(f"a window of {window} samples of {count} that there are")
    return np.arange(count // window) * window


@dataclass(frozen=True)
class Growth:
    """log(amplitude) = ``rate`` t + constant, and the root mean square of the remainder."""

    rate: float
    residual: float


def growth_rate(time: Array, amplitude: Array, weights: Array | None = None) -> Growth:
    """Exponential growth of an amplitude (samples,) by least squares on its logarithm; negative: decay.

    Values that are not positive are left out. ``weights`` (samples,) that fade towards both ends keep an
    amplitude that beats from changing the rate. Raises ValueError where fewer than two values are left.
    """
    positive = amplitude > 0.0
    if np.count_nonzero(positive) < 2:
        raise ValueError("a rate of growth needs two positive amplitudes")
    time, logarithm = time[positive], np.log(amplitude[positive])
    weights = np.ones(len(time)) if weights is None else weights[positive]
    weights = weights / weights.sum()
    centred = time - weights @ time
    rate = float(weights @ (centred * logarithm) / (weights @ centred**2))
    left = logarithm - weights @ logarithm - rate * centred
    return Growth(rate, float(np.sqrt(weights @ left**2)))
