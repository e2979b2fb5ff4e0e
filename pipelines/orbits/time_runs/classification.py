"""Classify the motion at the end of a transient from its Poincare points, with the evidence.

The points are taken once per period T of what drives the machine. Where they repeat after n periods the
motion is n-periodic; where they change steadily it is not settled; otherwise the 0-1 test of Gottwald and
Melbourne (SIAM J. Appl. Dyn. Syst. 8 (2009) 129) tells quasi-periodic from chaotic motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from pipelines.case.arrays import Array
from pipelines.orbits.time_runs.envelope import growth_rate

RETURNS = (1, 2, 4, 8)  # periods after which a motion may repeat
FEWEST_POINTS = 32  # four of every eighth one
FEWEST_POINTS_TESTED = 128  # by the 0-1 test
# Measured on tori of three frequencies: of 150 points half give K above 0.77, of 600 all give less than 0.11.
FEWEST_POINTS_OF_CHAOS = 600
_STRETCHES = 4
_FREQUENCIES = 100  # of the 0-1 test, between pi/5 and 4 pi/5 to stay clear of its resonances
_REGULAR, _CHAOTIC = 0.2, 0.8


class Motion(Enum):
    """Kinds of motion; periods count those of the section."""

    EQUILIBRIUM = "equilibrium"
    PERIOD_1 = "period_1"
    PERIOD_2 = "period_2"
    PERIOD_4 = "period_4"
    PERIOD_8 = "period_8"
    QUASI_PERIODIC = "quasi_periodic"
    CHAOTIC = "chaotic"
    UNSETTLED = "unsettled"


@dataclass(frozen=True)
class Limits:
    """What counts as small.

    Motions below ``rest`` are an equilibrium, points that return within ``repeats`` of the size of the
    orbit repeat, changes of the returns below ``noise`` of it are rounding; returns are steady unless
    they change by the factor ``steady`` from the first to the last quarter.
    """

    rest: float = 1e-6
    repeats: float = 1e-3
    noise: float = 1e-7
    steady: float = 1.5


@dataclass(frozen=True)
class Classification:
    """The kind of a motion (None: ``reason`` says why it cannot be decided) and the evidence.

    ``size``: half of the largest extent of the orbit.  ``returns`` (4,): root mean square distance of points
    1, 2, 4, 8 periods apart, or any multiple of these, over the size.  ``growth``: slope of the logarithm of
    the distance of successive points, per period.  ``chaos``: outcome K of the 0-1 test, from 0 (regular) to
    1 (chaotic); NaN where there are too few points or nothing moves.
    """

    motion: Motion | None
    reason: str
    size: float
    returns: Array
    growth: float
    chaos: float


def classify(points: Array, orbit: Array, limits: Limits | None = None) -> Classification:
    """Classify a motion from its Poincare points (points, k) and its samples ``orbit`` (samples, k)."""
    limits = limits or Limits()
    size = 0.5 * float(np.max(np.ptp(orbit, axis=0)))
    nothing = np.full(len(RETURNS), np.nan)
    if size < limits.rest:
        return Classification(Motion.EQUILIBRIUM, "", size, nothing, np.nan, np.nan)
    if len(points) < FEWEST_POINTS:
        reason = f"{len(points)} periods of steady drive; {FEWEST_POINTS} are needed"
        return Classification(None, reason, size, nothing, np.nan, np.nan)
    returns = np.array([return_distance(points, period) for period in RETURNS]) / size
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1) / size
    chaos = chaos_test(points) if len(points) >= FEWEST_POINTS_TESTED else np.nan
    growth = _growth(steps)
    motion = _motion(returns, _trend(steps, limits), limits) or _aperiodic(chaos, len(points))
    reason = "" if motion is not None else _undecided(chaos, len(points))
    return Classification(motion, reason, size, returns, growth, chaos)


def _growth(steps: Array) -> float:
    """Growth rate per period; NaN where nothing moves.

    The steps of an elliptic spiral beat: the weights fade out at both ends.
    """
    if np.count_nonzero(steps) < 2:
        return np.nan
    weights = np.hanning(len(steps) + 2)[1:-1]
    return growth_rate(np.arange(len(steps), dtype=float), steps, weights).rate


def _motion(returns: Array, trend: int, limits: Limits) -> Motion | None:
    """Unsettled or periodic; None if neither."""
    if trend > 0:
        return Motion.UNSETTLED
    for period, distance in zip(RETURNS, returns, strict=True):
        if distance < limits.repeats:
            return Motion(f"period_{period}")
    return Motion.UNSETTLED if trend < 0 else None


def _aperiodic(chaos: float, points: int) -> Motion | None:
    """Quasi-periodic or chaotic; None if the test cannot decide. Too few points easily look chaotic."""
    if chaos < _REGULAR:
        return Motion.QUASI_PERIODIC
    return Motion.CHAOTIC if chaos > _CHAOTIC and points >= FEWEST_POINTS_OF_CHAOS else None


def _undecided(chaos: float, points: int) -> str:
    needed = FEWEST_POINTS_TESTED if np.isnan(chaos) else FEWEST_POINTS_OF_CHAOS
    told = "" if np.isnan(chaos) else f", with an outcome {chaos:.2f} of the 0-1 test"
    return (
        f"no return after 1, 2, 4 or 8 in {points} periods of steady drive{told}; to tell "
        f"quasi-periodic from chaotic takes {needed} or more"
    )


def return_distance(points: Array, period: int) -> float:
    """Root mean square distance of points (points, k) any multiple of ``period`` apart.

    A slow drift, which successive returns do not show, makes it large too.
    """
    # The mean over all pairs is twice the variance.
    spread = [np.sum(np.var(points[first::period], axis=0)) for first in range(period)]
    return float(np.sqrt(2.0 * np.mean(spread)))


def _trend(steps: Array, limits: Limits) -> int:
    """1 or -1 if the steps (steps,) between successive points grow or shrink from quarter to quarter."""
    level = np.array([np.sqrt(np.mean(part**2)) for part in np.array_split(steps, _STRETCHES)])
    change = np.diff(level)
    if level.max() < limits.noise:
        return 0
    if np.all(change > 0.0) and level[-1] > limits.steady * level[0]:
        return 1
    return -1 if np.all(change < 0.0) and level[0] > limits.steady * level[-1] else 0


def chaos_test(points: Array) -> float:
    """The outcome K of the 0-1 test for chaos.

    The median over c of the correlation between n and the mean square displacement of

        p(n) = sum_j x_j cos(j c),   q(n) = sum_j x_j sin(j c)

    freed of its oscillating part; x is the coordinate of the points (points, k) that moves most. NaN where
    none moves.
    """
    x = points[:, int(np.argmax(np.var(points, axis=0)))]
    if not np.any(x != x[0]):
        return np.nan
    x = (x - x.mean()) / x.std()
    angles = np.linspace(np.pi / 5, 4 * np.pi / 5, _FREQUENCIES)
    turning = np.exp(1j * angles[:, None] * np.arange(1, len(x) + 1))
    path = np.cumsum(x * turning, axis=1)
    longest = len(x) // 10
    lags = np.arange(1, longest + 1)
    compared = len(x) - longest
    squares = np.array(
        [np.mean(np.abs(path[:, n : n + compared] - path[:, :compared]) ** 2, axis=1) for n in lags]
    ).T
    mean = np.mean(x[:compared]) ** 2
    squares -= mean * (1.0 - np.cos(lags * angles[:, None])) / (1.0 - np.cos(angles[:, None]))
    found = [np.corrcoef(lags, row)[0, 1] for row in squares]
    return float(np.median(found))
