"""Campbell diagram of the linearised machine: its oscillating modes, followed over the speed by eigenvector.

A mode is an oscillating eigenpair of the full linearisation, film and foil states included.  A speed is
inserted between two that do not tell

1.  which mode is which: |R_jk - 1| is too large (see ``modes``);
2.  how often a mode meets the synchronous line.  Its path g = Im lambda - Omega with second divided
    difference c leaves its chord by c h^2 / 4.  Does it end on one side, it must be farther from the line
    than that; does it change sides, |dg| > c h^2, so that it is monotone.

Where no speeds are closer the extremum of g is sought: a mode that hardly crosses the line does so twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pipelines.case.arrays import Array, ComplexArray
from pipelines.machine.assembly import Machine
from pipelines.machine.rotor_modes import whirl_directions
from pipelines.orbits.equilibria.equilibrium import equilibrium_along
from pipelines.orbits.equilibria.followed_mode import FollowedMode, LostModeError
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.equilibria.modes import LARGEST_DAMPING_RATIO, Match, ModeSet, match_modes, modes_at

# Modes up to this many times the highest speed are followed.
TOP = 1.2
# Modes that are damped a little more than asked for are followed with the same care: they may be lighter
# between two speeds.
DAMPING_MARGIN = 0.08
# No two speeds come closer than this part of the range, nor at the end of a stretch without equilibrium.
CLOSEST, CLOSEST_TO_GAP = 2.0**-12, 2.0**-8
# Times which the path may be farther from its chord than its curvature at the neighbouring speeds says.
BOW_SAFETY = 2.0
# A mode that crosses the synchronous line by less than this frequency touches it only.
TOUCHING = 1e-10


@dataclass(frozen=True)
class CampbellDiagram:
    """Modes followed over the requested and inserted speeds; NaN where a mode does not exist.

    ``eigenvalues`` (speeds, modes), ``directions`` (speeds, modes): +1 forward, -1 backward, 0 planar.
    ``missing``: reasons of the speeds without equilibrium, by index.  ``sets``: the modes at every speed;
    ``matches``: of the modes of a speed at the next one, None beside a speed without equilibrium;
    ``doubtful``: the intervals, by index of their lower speed, in which closer speeds did not help.
    """

    speeds: Array
    eigenvalues: ComplexArray
    directions: NDArray[np.int8]
    states: tuple[Array | None, ...]
    missing: dict[int, str]
    sets: tuple[ModeSet | None, ...]
    matches: tuple[Match | None, ...]
    doubtful: tuple[int, ...]

    @property
    def damping_ratios(self) -> Array:
        """-Re lambda / |lambda|, shape (speeds, modes)."""
        return np.asarray(-self.eigenvalues.real / np.abs(self.eigenvalues))


@dataclass
class _Path:
    """The growing diagram: one entry for every speed, and one match between neighbours."""

    machine: Machine
    parameters: Array
    top: float
    limit: float
    speeds: list[float] = field(default_factory=list)
    states: list[Array | None] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    sets: list[ModeSet | None] = field(default_factory=list)
    matches: list[Match | None] = field(default_factory=list)

    def insert(self, index: int, speeds: Array, place: int) -> None:
        """Compute ``speeds[place]`` and insert it at ``index``; its neighbours are those of ``speeds``."""
        speed, guess = float(speeds[place]), self._guess(index)
        equilibrium = equilibrium_along(self.machine, self.parameters, speeds, place, guess)
        state = equilibrium.state if equilibrium.converged else None
        at = at_speed(self.parameters, speed)
        self.speeds.insert(index, speed)
        self.states.insert(index, state)
        self.reasons.insert(index, equilibrium.reason)
        self.sets.insert(index, None if state is None else modes_at(self.machine, at, state, self.top))
        if len(self.speeds) > 1:
            self.matches.insert(min(index, len(self.matches)), None)
        for first in (index - 1, index):
            if 0 <= first < len(self.speeds) - 1:
                self.matches[first] = self._match(first, first + 1)

    def _guess(self, index: int) -> Array | None:
        """The state at the next lower speed that has an equilibrium."""
        return next((state for state in reversed(self.states[:index]) if state is not None), None)

    def _match(self, first: int, second: int) -> Match | None:
        one, other = self.sets[first], self.sets[second]
        return None if one is None or other is None else match_modes(one, other)

    def needs_speed(self, interval: int) -> bool:
        """Whether a speed must be inserted between two."""
        width = (self.speeds[interval + 1] - self.speeds[interval]) / (self.speeds[-1] - self.speeds[0])
        if (self.sets[interval] is None) != (self.sets[interval + 1] is None):
            return width > CLOSEST_TO_GAP
        return width > 2.0 * CLOSEST and self.is_open(interval)

    def is_open(self, interval: int) -> bool:
        """Whether the modes between two speeds are not matched beyond doubt."""
        match, first, second = self.matches[interval], self.sets[interval], self.sets[interval + 1]
        if match is None or first is None or second is None:
            return False
        certain = [pair for pair in match.pairs if match.certain[pair[0]]]
        for end, modes in enumerate((first, second)):
            in_doubt = self._followed(modes, self.top) & ~_among(certain, end, modes)
            alone = self._followed(modes, modes.top) & ~_among(match.pairs, end, modes)
            if (in_doubt | alone).any():
                return True
        return any(self._may_turn(interval, *pair) for pair in self._followed_pairs(interval))

    def _followed(self, modes: ModeSet, top: float) -> NDArray[np.bool_]:
        return (modes.damping_ratios < self.limit) & (modes.eigenvalues.imag <= top)

    def _followed_pairs(self, interval: int) -> list[tuple[int, int]]:
        """The modes matched beyond doubt at both speeds, and followed at one of them."""
        match, first, second = self.matches[interval], self.sets[interval], self.sets[interval + 1]
        if match is None or first is None or second is None:
            return []
        near, far = (self._followed(modes, self.top) for modes in (first, second))
        return [(j, k) for j, k in match.pairs if match.certain[j] and (near[j] or far[k])]

    def hidden_crossings(self, interval: int) -> list[float]:
        """Speeds between two at which a mode is on the other side of the synchronous line than at both."""
        found = []
        for first, second in self._followed_pairs(interval):
            low, high = self._excess(interval, first), self._excess(interval + 1, second)
            if low[1] * high[1] > 0.0 and self._may_turn(interval, first, second):
                extremum = self._extremum(interval, first, second)
                if extremum is not None:
                    found.append(extremum)
        return sorted(found)

    def _extremum(self, interval: int, first: int, second: int) -> float | None:
        """Where the path of a mode comes nearest to the synchronous line, if it is beyond the line there."""
        sets, (low, high) = self.sets[interval : interval + 2], self.speeds[interval : interval + 2]
        known = {
            speed: (modes, number)
            for speed, modes, number in zip((low, high), sets, (first, second), strict=True)
            if modes is not None
        }
        mode = FollowedMode(self.machine, self.parameters, self.states[interval], self.top, known)
        side = np.sign(mode.excess(low))
        try:
            nearest = minimize_scalar(
                lambda speed: side * mode.excess(float(speed)), bounds=(low, high), method="bounded",
                options={"xatol": 1e-6 * (high - low)},
            )  # fmt: skip
        except LostModeError:
            return None
        return float(nearest.x) if nearest.fun < -TOUCHING else None

    def _may_turn(self, interval: int, first: int, second: int) -> bool:
        """Whether a mode may meet the synchronous line more often than its sides at both speeds suggest."""
        points = [self._excess(interval, first), self._excess(interval + 1, second)]
        before = None if interval == 0 else self.matches[interval - 1]
        if before is not None and first in before.partner:
            mode = before.partner.index(first)
            if before.certain[mode]:
                points.insert(0, self._excess(interval - 1, mode))
        own = len(points) - 2
        after = None if interval + 1 == len(self.matches) else self.matches[interval + 1]
        if after is not None and after.certain[second]:
            points.append(self._excess(interval + 2, after.partner[second]))
        return may_turn(np.array(points), own)

    def _excess(self, index: int, mode: int) -> tuple[float, float]:
        modes = self.sets[index]
        assert modes is not None
        return self.speeds[index], float(modes.eigenvalues[mode].imag) - self.speeds[index]


def _among(pairs: list[tuple[int, int]], end: int, modes: ModeSet) -> NDArray[np.bool_]:
    """Which modes at one end of an interval belong to pairs."""
    return np.isin(np.arange(len(modes.eigenvalues)), [pair[end] for pair in pairs])


def may_turn(points: Array, own: int) -> bool:
    """Whether a path g(x) through ``points`` may have zeros besides the one that a change of sign shows.

    Between points ``own`` and ``own + 1`` of the ``points`` (2 to 4, two).  Two points alone do not
    determine the curvature.
    """
    if len(points) == 2:
        return True
    x, g = points.T
    slope = np.diff(g) / np.diff(x)
    curvature = float(np.max(np.abs(np.diff(slope) / (x[2:] - x[:-2]))))
    (low, high), (before, after) = x[own : own + 2], g[own : own + 2]
    bow = BOW_SAFETY * 0.25 * curvature * (high - low) ** 2
    if before * after > 0.0:
        return bool(min(abs(before), abs(after)) < bow)
    return bool(abs(after - before) < 4.0 * bow)


def campbell_diagram(
    machine: Machine,
    parameters: Array,
    speeds: Array,
    visit: Callable[[int], None] | None = None,
    max_damping_ratio: float = 0.5,
) -> CampbellDiagram:
    """Follow the oscillating modes over rising ``speeds``, with more speeds in between where needed.

    Needed for modes damped less than ``max_damping_ratio``.

    ``visit(count)`` is called before each speed with how many of those asked for are done.
    """
    limit = min(max_damping_ratio, LARGEST_DAMPING_RATIO) + DAMPING_MARGIN
    path = _Path(machine, parameters, TOP * float(speeds[-1]), limit)
    for index in range(len(speeds)):
        if visit is not None:
            visit(index)
        path.insert(index, speeds, index)
    while wanted := [interval for interval in range(len(path.matches)) if path.needs_speed(interval)]:
        for interval in reversed(wanted):
            if visit is not None:
                visit(len(speeds))
            low, high = path.speeds[interval : interval + 2]
            path.insert(interval + 1, np.array([low, 0.5 * (low + high), high]), 1)
    for interval in reversed(range(len(path.matches))):
        if path.is_open(interval):
            for speed in reversed(path.hidden_crossings(interval)):
                low, high = path.speeds[interval : interval + 2]
                path.insert(interval + 1, np.array([low, speed, high]), 1)
    return _diagram(path)


def _diagram(path: _Path) -> CampbellDiagram:
    columns, known = _columns(path.sets)
    eigenvalues = np.full((len(path.sets), known), complex(np.nan, np.nan))
    directions = np.zeros(eigenvalues.shape, dtype=np.int8)
    for index, modes in enumerate(path.sets):
        if modes is not None:
            eigenvalues[index, columns[index]] = modes.eigenvalues
            directions[index, columns[index]] = whirl_directions(modes.shapes)
    beyond = ~(
        (eigenvalues.imag <= path.top) & (-eigenvalues.real < LARGEST_DAMPING_RATIO * abs(eigenvalues))
    )
    eigenvalues[beyond], directions[beyond] = complex(np.nan, np.nan), 0
    drawn = np.flatnonzero(~beyond.all(axis=0))
    return CampbellDiagram(
        np.array(path.speeds),
        eigenvalues[:, drawn],
        directions[:, drawn],
        tuple(path.states),
        {index: path.reasons[index] for index, state in enumerate(path.states) if state is None},
        tuple(path.sets),
        tuple(path.matches),
        tuple(interval for interval in range(len(path.matches)) if path.is_open(interval)),
    )


def _columns(sets: list[ModeSet | None]) -> tuple[list[list[int]], int]:
    """Column of every mode at every speed, also across speeds without equilibrium, and their number."""
    columns: list[list[int]] = []
    last: tuple[ModeSet, list[int]] | None = None
    known = 0
    for modes in sets:
        own = [-1] * (0 if modes is None else len(modes.eigenvalues))
        if modes is not None:
            if last is not None:
                for column, partner in zip(last[1], match_modes(last[0], modes).partner, strict=True):
                    if partner >= 0:
                        own[partner] = column
            for mode in range(len(own)):
                if own[mode] < 0:
                    own[mode], known = known, known + 1
            last = modes, own
        columns.append(own)
    return columns, known
