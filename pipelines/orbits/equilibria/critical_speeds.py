"""Critical speeds of a Campbell diagram, their check by counts of modes, and predicted parametric resonances.

A critical speed is where a mode whirls synchronously:

    Im lambda_j(Omega) = Omega        with damping ratio -Re lambda / |lambda| below a bound

The number of modes above the synchronous line and below the bound changes along the speed only where a mode
crosses the line or passes the bound; so between the ends of a range

    N(end) - N(begin) = sum of crossings (-1 downwards, +1 upwards) + sum of passages of the bound

Of a large machine only modes up to a highest frequency are counted, which they pass too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array, ComplexArray
from pipelines.machine.assembly import Machine
from pipelines.machine.rotor_modes import whirl_directions
from pipelines.orbits.equilibria.campbell import DAMPING_MARGIN, TOP, CampbellDiagram
from pipelines.orbits.equilibria.followed_mode import FollowedMode, LostModeError
from pipelines.orbits.equilibria.modes import LARGEST_DAMPING_RATIO, Match, ModeSet

Sides = NDArray[np.bool_]

# A mode whose frequency differs from the speed by less than this at an end of the range is synchronous there.
ON_LINE = 1e-8
# Which multiple of the least distance between eigenvalues may be that between those of one mode.
SIMILAR = 3.0

NO_EQUILIBRIUM, NOT_TOLD_APART = "there is no equilibrium", "modes cannot be told apart"


@dataclass(frozen=True)
class CriticalSpeed:
    """A critical speed: synchronous whirl.

    Speed, eigenvalue there, +1 forward / -1 backward / 0 planar, shape (nodes, 2); ``change`` is -1
    where the mode falls below the synchronous line with rising speed.
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
    """Two speeds between which critical speeds may be missing, and why.

    ``before`` and ``after``: how many modes are above the synchronous line.
    """

    low: float
    high: float
    before: int
    after: int
    reason: str

    @property
    def matters(self) -> bool:
        """Whether a critical speed is known to be missing, or modes may be confused."""
        return self.before != self.after or self.reason != NO_EQUILIBRIUM

    def __str__(self) -> str:
        return (
            f"between the speeds {self.low:.4g} and {self.high:.4g} {self.reason}; the number of modes above "
            f"the synchronous line goes from {self.before} to {self.after}"
        )


@dataclass(frozen=True)
class CriticalSpeeds:
    """The critical speeds between the speeds of a diagram, rising, and where others may be missing.

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
    sides = _sides(diagram)
    counts = np.array(
        [
            -1 if modes is None or above is None else _counted(modes, above, max_damping_ratio).sum()
            for modes, above in zip(diagram.sets, sides, strict=True)
        ]
    )
    found: list[CriticalSpeed] = []
    undecided = _gaps(diagram, counts)
    passages = 0
    for index in range(len(diagram.matches)):
        interval = _interval(diagram, sides, index)
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


def _sides(diagram: CampbellDiagram) -> list[Sides | None]:
    """Which modes are above the synchronous line at every speed.

    One that is synchronous at an end of the range crosses the line there: its side is the other one than at
    the neighbouring speed.
    """
    excess = [
        None if modes is None else modes.eigenvalues.imag - speed
        for speed, modes in zip(diagram.speeds, diagram.sets, strict=True)
    ]
    sides = [None if one is None else np.asarray(one > 0.0) for one in excess]
    for end, beside in ((0, 1), (-1, -2)) if diagram.matches else ():
        match = diagram.matches[end]
        for mode, partner in [] if match is None else match.pairs:
            own, other = (mode, partner) if end == 0 else (partner, mode)
            at_end, away, distance = sides[end], sides[beside], excess[end]
            if at_end is None or away is None or distance is None:
                continue
            if abs(distance[own]) <= ON_LINE:
                at_end[own] = not away[other]
    return sides


def _counted(modes: ModeSet, above: Sides, max_damping_ratio: float) -> Sides:
    """Modes above the synchronous line and below the bound."""
    known = modes.eigenvalues.imag <= modes.top
    return np.asarray(above & known & (modes.damping_ratios < max_damping_ratio))


@dataclass(frozen=True)
class _Interval:
    """Two neighbouring speeds with their modes and which of these are ``above`` the synchronous line.

    ``doubtful``: closer speeds did not distinguish the modes.
    """

    speeds: tuple[float, float]
    sets: tuple[ModeSet, ModeSet]
    above: tuple[Sides, Sides]
    match: Match
    doubtful: bool

    def crossing(self, limit: float) -> list[tuple[int, int]]:
        """Modes that change their side of the line, damped less than a limit at one of the speeds."""
        before, after = self.above
        light = [modes.damping_ratios < limit for modes in self.sets]
        return [(j, k) for j, k in self.match.pairs if before[j] != after[k] and (light[0][j] or light[1][k])]

    def change(self, max_damping_ratio: float) -> int:
        """Change of the count of modes above the line and below the bound, by modes known at both ends."""
        before, after = (_counted(self.sets[end], self.above[end], max_damping_ratio) for end in (0, 1))
        return sum(int(after[partner]) - int(before[mode]) for mode, partner in self.match.pairs)

    def doubt_matters(self, max_damping_ratio: float) -> bool:
        """Whether a mode in doubt may be one of several at the other speed on both sides of the line.

        Of those in doubt at the other speed the nearest count.
        """
        if not self.doubtful:
            return False
        in_doubt = [self._in_doubt(end) for end in (0, 1)]
        for end, other in ((0, 1), (1, 0)):
            light = in_doubt[end] & (self.sets[end].damping_ratios < max_damping_ratio)
            eigenvalues = self.sets[other].eigenvalues[in_doubt[other]]
            above = self.above[other][in_doubt[other]]
            distances = np.abs(self.sets[end].eigenvalues[light, None] - eigenvalues)
            near = distances <= SIMILAR * distances.min(axis=1, keepdims=True, initial=np.inf)
            if ((near & above).any(axis=1) & (near & ~above).any(axis=1)).any():
                return True
        return False

    def _in_doubt(self, end: int) -> NDArray[np.bool_]:
        """The modes of one end that are not matched beyond doubt at the other end."""
        certain = [pair[end] for pair in self.match.pairs if self.match.certain[pair[0]]]
        return ~np.isin(np.arange(len(self.above[end])), certain)


def _interval(diagram: CampbellDiagram, sides: list[Sides | None], index: int) -> _Interval | None:
    """The interval above a speed of the diagram; None beside a speed without equilibrium."""
    match, first, second = diagram.matches[index], diagram.sets[index], diagram.sets[index + 1]
    before, after = sides[index : index + 2]
    if match is None or first is None or second is None or before is None or after is None:
        return None
    speeds = float(diagram.speeds[index]), float(diagram.speeds[index + 1])
    return _Interval(speeds, (first, second), (before, after), match, index in diagram.doubtful)


def _gaps(diagram: CampbellDiagram, counts: NDArray[np.int64]) -> list[Undecided]:
    """The intervals without equilibrium between speeds that have one."""
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
    """The crossing of a mode with the synchronous line between two speeds; None if the mode is lost.

    ``state``: the equilibrium at the lower speed.
    """
    low, high = interval.speeds
    known = {
        speed: (modes, mode) for speed, modes, mode in zip(interval.speeds, interval.sets, pair, strict=True)
    }
    mode = FollowedMode(machine, parameters, state, TOP * high, known)
    try:
        if mode.excess(low) * mode.excess(high) < 0.0:
            speed = mode.crossing(low, high)
        else:  # synchronous at an end of the range
            speed = min(low, high, key=lambda end: abs(mode.excess(end)))
    except LostModeError:
        return None
    modes, number = mode.at(speed)
    eigenvalue, shape = complex(modes.eigenvalues[number]), modes.shapes[number]
    change = -1 if interval.above[0][pair[0]] else 1
    return CriticalSpeed(speed, eigenvalue, int(whirl_directions(shape[None])[0]), shape, change)


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
