"""Poincare sections of motions known at equally spaced samples.

Between the samples everything is a polynomial of degree p through the p + 1 samples around the crossing, so
that place and values of a crossing have errors of order p + 1 in the distance of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array

DEGREE = 5
_NEWTON_STEPS = 30
_SETTLED = 1e-13  # of the distance of two samples


@dataclass(frozen=True)
class Section:
    """Crossings: ``place`` (crossings,) in samples, ``values`` (crossings, ...) there."""

    place: Array
    values: Array


def phase_section(phase: Array, values: Array, offset: float = 0.0, degree: int = DEGREE) -> Section:
    """``values`` (samples, ...) wherever the growing ``phase`` (samples,) [rad] is ``offset`` + whole turns.

    Raises ValueError for a phase that does not rise, for fewer samples than the polynomial needs, and where
    two samples are a turn or more apart.
    """
    steps = np.diff(phase)
    if len(phase) <= degree or np.any(steps <= 0.0) or np.any(steps >= 2.0 * np.pi):
        raise ValueError(
            f"a section needs more than {degree} samples of a rising phase, less than a turn apart"
        )
    turns = (phase - offset) / (2.0 * np.pi)
    first, last = int(np.ceil(turns[0])), int(np.floor(turns[-1]))
    levels = offset + 2.0 * np.pi * np.arange(first, last + 1, dtype=np.float64)
    before = np.clip(np.searchsorted(phase, levels, side="right") - 1, 0, len(phase) - 2)
    return _section(phase, levels, before, values, degree)


def level_section(signal: Array, values: Array, level: float, degree: int = DEGREE) -> Section:
    """``values`` (samples, ...) wherever ``signal`` (samples,) rises through a level.

    The section of a motion without a given phase.

    Raises ValueError for fewer samples than the polynomial needs.
    """
    if len(signal) <= degree:
        raise ValueError(f"a section needs more than {degree} samples")
    before = np.flatnonzero((signal[:-1] < level) & (signal[1:] >= level))
    return _section(signal, np.full(len(before), level), before, values, degree)


def _section(signal: Array, levels: Array, before: NDArray[np.intp], values: Array, degree: int) -> Section:
    """Solve for the position of every crossing after the sample ``before``, and interpolate there."""
    starts = np.clip(before - (degree - 1) // 2, 0, len(signal) - degree - 1)
    stencils = starts[:, None] + np.arange(degree + 1)
    # Coefficients of the polynomial in x, the place counted from the stencil's begin.
    powers = np.vander(np.arange(degree + 1.0), increasing=True)
    inverse = np.linalg.inv(powers)
    coefficients = signal[stencils] @ inverse.T
    rise = signal[before + 1] - signal[before]
    x = before - starts + (levels - signal[before]) / rise
    slopes = coefficients[:, 1:] * np.arange(1.0, degree + 1.0)
    for _ in range(_NEWTON_STEPS):
        vandermonde = np.vander(x, degree + 1, increasing=True)
        excess = np.sum(vandermonde * coefficients, axis=1) - levels
        change = excess / np.sum(vandermonde[:, :-1] * slopes, axis=1)
        x = np.clip(x - change, before - starts, before - starts + 1)
        if np.all(np.abs(change) < _SETTLED):
            break
    weights = np.vander(x, degree + 1, increasing=True) @ inverse
    found = np.einsum("cj,cj...->c...", weights, values[stencils])
    return Section(starts + x, found)
