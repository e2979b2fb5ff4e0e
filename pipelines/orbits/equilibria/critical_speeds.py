"""Critical speeds of a Campbell diagram, what its counts say of them, and predicted parametric resonances.

A critical speed is where a mode whirls synchronously:

    Im lambda_j(Omega) = Omega        with damping ratio -Re lambda / |lambda| below a bound

The number of modes above the synchronous line and below the bound changes along the speed only where a mode
crosses the line or passes the bound; so between the ends of a range

    N(end) - N(begin) = sum of crossings (-1 downwards, +1 upwards) + sum of passages of the bound
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipelines.machine.assembly import Machine
from pipelines.machine.rotor_modes import whirl_directions
from pipelines.orbits.equilibria.campbell import DAMPING_MARGIN, TOP, CampbellDiagram
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import Array, ComplexArray, at_speed
from pipelines.orbits.equilibria.modes import LARGEST_DAMPING_RATIO, Match, ModeSet, match_modes, modes_at

NO_EQUILIBRIUM, NOT_TOLD_APART = "there is no equilibrium", "modes cannot be told apart"


@dataclass(frozen=True)
class CriticalSpeed:
    """Synchronous whirl: speed, eigenvalue there, +1 forward / -1 backward / 0 planar, shape (nodes, 2);
    ``change`` is -1 where the mode falls below the synchronous line with rising speed.
    """

    speed: float
    eigenvalue: complex
    direction: int
    shape: ComplexArray
    change: int

    @property
    def damping_ratio(self) -> float:
        """-Re lambda / |lambda|."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


@dataclass(frozen=True)
class Undecided:
    """Two speeds between which critical speeds may be missing, and why; how many modes are above the
    synchronous line ``before`` and ``after``.
    """

    low: float
    high: float
    before: int
    after: int
    reason: str

    @property
    def matters(self) -> bool:
        """Whether a critical speed is known to be missing, or modes are mixed up."""
        return self.before != self.after or self.reason != NO_EQUILIBRIUM

    def __str__(self) -> str:
        return (
            f"between the speeds {self.low:.4g} and {self.high:.4g} {self.reason}; the number of modes above "
            f"the synchronous line goes from {self.before} to {self.after}"
        )


@dataclass(frozen=True)
class CriticalSpeeds:
    """The critical speeds between the speeds of a diagram, rising, and where there may be others.

    ``counts`` (speeds,): modes above the synchronous line and below the bound, -1 without equilibrium.
    ``passages``: sum of passages of the bound above the line, +1 for a mode whose damping falls below it.
    """

    found: list[CriticalSpeed]
    undecided: list[Undecided]
    counts: NDArray[np.int64]
    passages: int


def critical_speeds(
    machine: Machine, parameters: Array, diagram: CampbellDiagram, max_damping_ratio: float
) -> CriticalSpeeds:
    """Locate the critical speeds to rounding, by bracketing, and check their number.

    Modes damped more than ``LARGEST_DAMPING_RATIO`` are no critical speeds either.
    """
    max_damping_ratio = min(max_damping_ratio, LARGEST_DAMPING_RATIO)
    counts = np.array(
        [
            -1 if modes is None else _above(modes, float(speed), max_damping_ratio).sum()
            for speed, modes in zip(diagram.speeds, diagram.sets, strict=True)
        ]
    )
    found: list[CriticalSpeed] = []
    undecided = _gaps(diagram, counts)
    passages = 0
    for index in range(len(diagram.matches)):
        interval = _interval(diagram, index)
        if interval is None:
            continue
        located = [
            _locate(machine, parameters, diagram.states[index], interval, pair)
            for pair in interval.crossing(max_damping_ratio + DAMPING_MARGIN)
        ]
        own = [one for one in located if one is not None and one.damping_ratio < max_damping_ratio]
        before, after = int(counts[index]), int(counts[index + 1])
        crossed = sum(one.change for one in own)
        known = interval.change(max_damping_ratio)
        found, passages = found + own, passages + known - crossed
        if None in located or known != after - before or interval.doubt_matters(max_damping_ratio):
            undecided.append(Undecided(*interval.speeds, before, after, NOT_TOLD_APART))
    return CriticalSpeeds(
        sorted(found, key=lambda critical: critical.speed),
        sorted(undecided, key=lambda one: one.low),
        counts,
        passages,
    )


def _above(modes: ModeSet, speed: float, max_damping_ratio: float) -> NDArray[np.bool_]:
    """Modes above the synchronous line and below the bound."""
    return np.asarray((modes.eigenvalues.imag > speed) & (modes.damping_ratios < max_damping_ratio))


@dataclass(frozen=True)
class _Interval:
    """Two neighbouring speeds with their modes; ``doubtful`` where closer speeds did not tell these apart."""

    speeds: tuple[float, float]
    sets: tuple[ModeSet, ModeSet]
    match: Match
    doubtful: bool

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The modes that are known at both speeds."""
        return [(mode, partner) for mode, partner in enumerate(self.match.partner) if partner >= 0]

    def above(self, end: int) -> NDArray[np.bool_]:
        """Which modes of an end are above the synchronous line."""
        return np.asarray(self.sets[end].eigenvalues.imag > self.speeds[end])

    def crossing(self, limit: float) -> list[tuple[int, int]]:
        """Those that change the side of the line, damped less than a limit at one of the speeds."""
        before, after = self.above(0), self.above(1)
        light = [modes.damping_ratios < limit for modes in self.sets]
        return [(j, k) for j, k in self.pairs if before[j] != after[k] and (light[0][j] or light[1][k])]

    def change(self, max_damping_ratio: float) -> int:
        """Change of the count of modes above the line and below the bound, by those known at both speeds."""
        before, after = (_above(self.sets[end], self.speeds[end], max_damping_ratio) for end in (0, 1))
        return sum(int(after[partner]) - int(before[mode]) for mode, partner in self.pairs)

    def doubt_matters(self, max_damping_ratio: float) -> bool:
        """Whether modes that cannot be told apart are on both sides of the synchronous line."""
        if not self.doubtful:
            return False
        certain = (
            np.array(self.match.certain),
            np.isin(
                np.arange(len(self.sets[1].eigenvalues)),
                [partner for mode, partner in self.pairs if self.match.certain[mode]],
            ),
        )
        sides: set[bool] = set()
        for end in (0, 1):
            doubted = ~certain[end] & (self.sets[end].damping_ratios < max_damping_ratio)
            sides |= set(self.above(end)[doubted].tolist())
        return len(sides) == 2


def _interval(diagram: CampbellDiagram, index: int) -> _Interval | None:
    """The interval above a speed of the diagram; None beside a speed without equilibrium."""
    match, first, second = diagram.matches[index], diagram.sets[index], diagram.sets[index + 1]
    if match is None or first is None or second is None:
        return None
    speeds = float(diagram.speeds[index]), float(diagram.speeds[index + 1])
    return _Interval(speeds, (first, second), match, index in diagram.doubtful)


def _gaps(diagram: CampbellDiagram, counts: NDArray[np.int64]) -> list[Undecided]:
    """The stretches without equilibrium between speeds that have one."""
    present = np.flatnonzero(counts >= 0)
    return [
        Undecided(
            float(diagram.speeds[before]),
            float(diagram.speeds[after]),
            int(counts[before]),
            int(counts[after]),
            NO_EQUILIBRIUM,
        )
        for before, after in pairwise(present)
        if after > before + 1
    ]


def _locate(
    machine: Machine, parameters: Array, state: Array | None, interval: _Interval, pair: tuple[int, int]
) -> CriticalSpeed | None:
    """The crossing of a mode with the synchronous line between two speeds; None if it is lost on the way.

    ``state``: the equilibrium at the lower speed.
    """
    low, high = interval.speeds
    known = {
        speed: (complex(modes.eigenvalues[mode]), modes.shapes[mode])
        for speed, modes, mode in zip(interval.speeds, interval.sets, pair, strict=True)
    }

    def pair_at(speed: float) -> tuple[complex, ComplexArray]:
        if speed not in known:
            at = at_speed(parameters, speed)
            equilibrium = machine_equilibrium(machine, at, state)
            if not equilibrium.converged:
                raise _LostError
            modes = modes_at(machine, at, equilibrium.state, TOP * high)
            own = match_modes(interval.sets[0], modes).partner[pair[0]]
            if own < 0:
                raise _LostError
            known[speed] = complex(modes.eigenvalues[own]), modes.shapes[own]
        return known[speed]

    def excess(speed: float) -> float:
        return pair_at(speed)[0].imag - speed

    try:
        speed = float(brentq(excess, low, high, xtol=1e-10))
        eigenvalue, shape = pair_at(speed)
    except _LostError:
        return None
    change = 1 if excess(low) < 0.0 else -1
    return CriticalSpeed(speed, eigenvalue, int(whirl_directions(shape[None])[0]), shape, change)


class _LostError(Exception):
    """A mode is not found at a speed between two at which it is known."""


@dataclass(frozen=True)
class Resonance:
    """An excitation frequency at which Eq. 22 expects a parametric resonance or anti-resonance.

    ``first`` and ``second`` count the critical speeds from 1; ``kind`` is principal (2 Omega_j / n), sum or
    difference.
    """

    frequency: float
    first: int
    second: int
    order: int
    kind: str


def parametric_resonances(critical: Sequence[float], orders: int) -> list[Resonance]:
    """2 Omega_j / n and |Omega_j +- Omega_k| / n for n up to ``orders`` (Eq. 22), by rising frequency."""
    found = []
    for order in range(1, orders + 1):
        for j, first in enumerate(critical, start=1):
            found.append(Resonance(2.0 * first / order, j, j, order, "principal"))
            for k in range(j + 1, len(critical) + 1):
                second = critical[k - 1]
                found.append(Resonance((first + second) / order, j, k, order, "sum"))
                found.append(Resonance(abs(first - second) / order, j, k, order, "difference"))
    return sorted(found, key=lambda resonance: resonance.frequency)
