"""How far cycles are from a period doubling, and the corner where Neimark-Sacker points end on one.

With the exponents of the multipliers mu against half the excitation frequency,

    sigma = ln(-mu) / T,    T = 2 pi / Omega_ex,

a pair is conjugate outside a tongue of period doublings, and real inside it.  The *growth of period doubling*

    g = max (Re sigma - |Im sigma|)    over the multipliers with Re mu < 0

is inside the growth rate ln|mu| / T of the leading negative multiplier; outside, the growth rate of a pair
less its distance from half the excitation frequency.  It is zero at a period doubling, continuous where the
pair becomes real, and exists also where there is no period doubling.

The *corner* is the 1:2 resonance, mu = -1 twice, in which a curve of Neimark-Sacker points ends on one of
period doublings.  With sigma = a + i sqrt(-q), it lies at a = q = 0, and a and q are smooth there.  It is
approached from the side of the conjugate pair, where the pair cannot be mistaken for the real multipliers of
another mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.orbits.shooting import Cycle
from pipelines.stages.calibration.onset_nearby import Cycles, Undecided
from pipelines.stages.survey.cells import bifurcation_of

DETUNING = 0.02  # |Im sigma| at which a = 0 is solved first
NEARER = (0.0, 0.75, 0.94)  # shares of the way in q from there to the corner; the rest is extrapolated
CHANGE = 2e-3  # of frequency and speed for the first derivatives
STEP = 0.03  # largest change of frequency or speed by one step
PLACE = 1e-4  # last step towards each of the places
CORRECTIONS = 15
SHORTENED = 4  # times that a step is halved
BELOW = (0.98, 0.96, 0.93)  # shares of an expected corner's frequency, at which the search begins
FREQUENCIES = 6  # of the first search: so many lines along the speed over the range of frequencies
SPEED_STEP = 0.05  # of the first search along these lines


@dataclass(frozen=True)
class Corner:
    """Where Neimark-Sacker points end on period doublings, dimensionless."""

    frequency: float
    speed: float


def exponents(cycle: Cycle) -> NDArray[np.complex128]:
    """sigma = ln(-mu) / T of the multipliers with negative real part (k,)."""
    multipliers = np.asarray(cycle.spectrum.multipliers, dtype=complex)
    found: NDArray[np.complex128] = np.log(-multipliers[multipliers.real < 0.0]) / cycle.unknowns.period
    return found


def doubling_growth(cycle: Cycle) -> float:
    """The growth of period doubling; -Omega_ex / 2 without a multiplier in the left half plane."""
    found = exponents(cycle)
    least = -math.pi / cycle.unknowns.period
    return float(np.max(found.real - np.abs(found.imag), initial=least))


def leading_pair(cycle: Cycle) -> complex | None:
    """sigma, Im > 0, of the leading multipliers in the left half plane; None where they are real."""
    multipliers = np.asarray(cycle.spectrum.multipliers, dtype=complex)
    left = multipliers[multipliers.real < 0.0]
    leading = complex(left[np.argmax(np.abs(left))]) if len(left) else 0j
    if leading == 0j or bifurcation_of(leading) == "period_doubling":
        return None
    sigma = complex(np.log(-leading)) / cycle.unknowns.period
    return complex(sigma.real, abs(sigma.imag))


def first_corner(
    cycles: Cycles, frequencies: tuple[float, float], speeds: tuple[float, float]
) -> Corner | None:
    """The corner at the lowest frequency of a range; None where none is found.  Raises StopRequested.

    Along the Neimark-Sacker curve with rising frequency q rises to zero, nearly linearly.
    """
    known: list[tuple[float, float, float]] = []
    for frequency in np.linspace(*frequencies, FREQUENCIES).tolist():
        lowest = speeds[0] if not known else max(speeds[0], known[-1][1] - 4.0 * SPEED_STEP)
        point = _neimark_sacker(cycles, frequency, lowest, speeds[1])
        if point is not None:
            known.append((frequency, *point))
        if len(known) > 1:
            expected = _extrapolated(*known[-2:])
            spacing = known[-1][0] - known[-2][0]
            if expected is not None and (point is None or expected.frequency < known[-1][0] + spacing):
                found = corner_near(cycles, expected)
                if found is not None and _within(found, frequencies, speeds):
                    return found
    return None


def _within(corner: Corner, frequencies: tuple[float, float], speeds: tuple[float, float]) -> bool:
    return frequencies[0] <= corner.frequency <= frequencies[1] and speeds[0] <= corner.speed <= speeds[1]


def _neimark_sacker(
    cycles: Cycles, frequency: float, lowest: float, highest: float
) -> tuple[float, float] | None:
    """Speed and q of the lowest Neimark-Sacker point at a frequency, by linear interpolation."""
    below: tuple[float, complex] | None = None
    for speed in np.arange(lowest, highest + 0.5 * SPEED_STEP, SPEED_STEP).tolist():
        try:
            sigma = leading_pair(cycles.at(speed, frequency))
        except Undecided:
            sigma = None
        if sigma is not None and below is not None and below[1].real < 0.0 <= sigma.real:
            share = below[1].real / (below[1].real - sigma.real)
            detuning = below[1].imag + share * (sigma.imag - below[1].imag)
            return below[0] + share * (speed - below[0]), -(detuning**2)
        below = None if sigma is None else (speed, sigma)
    return None


def _extrapolated(first: tuple[float, float, float], second: tuple[float, float, float]) -> Corner | None:
    """Where q of two Neimark-Sacker points (frequency, speed, q) passes zero; None where it falls."""
    (frequency, speed, splitting), (further, beyond, higher) = first, second
    if higher <= splitting:
        return None
    share = -higher / (higher - splitting)
    return Corner(further + share * (further - frequency), beyond + share * (beyond - speed))


def corner_near(cycles: Cycles, expected: Corner) -> Corner | None:
    """The corner near an expected one; None where the search loses the pair.  Raises StopRequested."""
    try:
        return _solved(cycles, _detuned(cycles, expected))
    except Undecided:
        return None


def _detuned(cycles: Cycles, expected: Corner) -> Array:
    """A place (frequency, speed) below the expected corner where the pair is conjugate.  Raises Undecided."""
    for share in BELOW:
        place = np.array([share * expected.frequency, expected.speed])
        if leading_pair(cycles.at(place[1], place[0])) is not None:
            return place
    raise Undecided


def _solved(cycles: Cycles, place: Array) -> Corner | None:
    """The corner from a place (frequency, speed) with a conjugate pair.  Raises Undecided, StopRequested.

    Newton's method on (a, q + DETUNING^2) = (0, share DETUNING^2) for rising shares, with derivatives by
    differences that the steps correct (Broyden).
    """
    value, slopes = _conditions(cycles, place), np.empty((2, 2))
    for column, change in enumerate(np.diag([-CHANGE, CHANGE])):
        slopes[:, column] = (_conditions(cycles, place + change) - value) / change[column]
    shares = list(NEARER)
    for _ in range(CORRECTIONS):
        step = _step(slopes, value, shares[0])
        step *= min(1.0, STEP / np.abs(step).max())
        moved, found = _stepped(cycles, place, step)
        step, place = moved - place, moved
        if np.abs(step).max() > 0.5 * CHANGE:  # over less the errors of the cycles tell more than the slopes
            slopes += np.outer(found - value - slopes @ step, step) / (step @ step)
        value = found
        if np.abs(step).max() < PLACE:
            del shares[0]
        if not shares:
            frequency, speed = place + _step(slopes, value, 1.0)
            return Corner(float(frequency), float(speed))
    return None


def _step(slopes: Array, value: Array, share: float) -> Array:
    """Newton's step to a = 0 and a share of the way in q from the first place to the corner."""
    return np.asarray(np.linalg.solve(slopes, [0.0, share * DETUNING**2] - value), dtype=np.float64)


def _stepped(cycles: Cycles, place: Array, step: Array) -> tuple[Array, Array]:
    """The place after a step, shortened until its leading pair is conjugate, and the conditions there."""
    for _ in range(SHORTENED):
        try:
            return place + step, _conditions(cycles, place + step)
        except Undecided:
            step = 0.5 * step
    raise Undecided


def _conditions(cycles: Cycles, place: Array) -> Array:
    """(a, q + DETUNING^2) of the leading pair at (frequency, speed).  Raises Undecided."""
    pair = leading_pair(cycles.at(float(place[1]), float(place[0]))) if place.min() > 0.0 else None
    if pair is None:
        raise Undecided
    return np.array([pair.real, DETUNING**2 - pair.imag**2])
