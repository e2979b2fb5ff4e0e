"""Compare the stability found at points of a plane with the curves between them.

Each pair of neighbouring cells is judged alone: from the number of unstable multipliers of one of them the
curves on the way give that of the other (`crossings`). So nothing is carried farther than to the next cell,
and a curve that is missing spoils only the pairs on both sides of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.datasets.schema import VERDICTS
from pipelines.stages.certificate.crossings import (
    UNKNOWN,
    Counts,
    Crossing,
    Leg,
    PlaneCurves,
    Rule,
    carried,
    passed,
    stability_passed,
)
from pipelines.stages.survey.cells import bifurcation_of

AGREES, DISAGREES, NOT_DECIDED = range(len(VERDICTS))
Integers = NDArray[np.int64]
Index = tuple[int, int]  # line and cell


@dataclass(frozen=True)
class Places:
    """Points of the plane: ``along`` and ``across`` with the arrays of what was found there.

    ``found``: unstable multipliers, `UNKNOWN` where they are open; ``nearest``: the multiplier with the
    modulus nearest to 1. Both have the shape (lines, cells) of a grid, or (points,).
    """

    along: Array
    across: Array
    found: Integers
    nearest: NDArray[np.complex128]


@dataclass(frozen=True)
class Verdicts:
    """What became of some places: the number ``expected`` there and the index of the verdict."""

    expected: Integers
    verdict: Integers

    def number(self, verdict: int) -> int:
        """How many places have a verdict."""
        return int(np.sum(self.verdict == verdict))


@dataclass(frozen=True)
class GridVerdicts:
    """The verdicts of the cells of a grid, and of the pairs of neighbours along and across its lines."""

    cells: Verdicts
    pair_along: Integers
    pair_across: Integers

    def pairs(self, verdict: int) -> int:
        """How many pairs have a verdict."""
        return int(np.sum(self.pair_along == verdict) + np.sum(self.pair_across == verdict))


@dataclass(frozen=True)
class Judge:
    """What the curves of a plane say of two places in it.

    ``axis``: index of the parameter along the lines among those of the curves. ``kinds``: bifurcations whose
    curves were asked for; others are no disagreement. ``boundaries``: only curves that bound stable cycles
    were. ``belongs``: whether the cycles found are those of a crossing; None where that is open.
    """

    curves: PlaneCurves
    axis: int
    kinds: Collection[str]
    boundaries: bool = False
    belongs: Callable[[Crossing], bool | None] = lambda crossing: True

    def told(self, count: int) -> int:
        """What of a number of unstable multipliers is compared."""
        return min(count, 1) if self.boundaries else count

    def verdict(
        self, begin: int, end: int, nearest: Sequence[complex], legs: Sequence[Leg]
    ) -> tuple[int, Counts]:
        """The verdict on a path between two places, and what the first one lets expect at the second.

        Behind a fold another cycle may be found, with any number: such a path decides only if the curves
        explain what is found without the fold. ``nearest``: the nearest multipliers of both places.
        """
        if UNKNOWN in (begin, end):
            return NOT_DECIDED, frozenset()
        met = self.curves.path(legs)
        theirs = {id(crossing): crossing.is_fold or self.belongs(crossing) for crossing in met}
        if None in theirs.values():
            return NOT_DECIDED, frozenset()
        on_the_way = [crossing for crossing in met if theirs[id(crossing)] and not crossing.is_fold]
        rule: Rule = stability_passed if self.boundaries else passed
        expected = carried(self.told(begin), on_the_way, rule)
        if self.told(end) in expected:
            return AGREES, expected
        missing = bifurcation_of(min(nearest, key=lambda multiplier: abs(np.log(abs(multiplier)))))
        if missing not in self.kinds or any(crossing.is_fold for crossing in met):
            return NOT_DECIDED, frozenset()
        return DISAGREES, expected

    def legs(self, begin: tuple[float, float], end: tuple[float, float]) -> list[Leg]:
        """A path between two places (along, across): first along, then across."""
        return [Leg(1 - self.axis, begin[1], begin[0], end[0]), Leg(self.axis, end[0], begin[1], end[1])]


def judge_grid(judge: Judge, grid: Places) -> GridVerdicts:
    """The verdicts on all pairs of neighbouring cells, and on the cells."""
    lines, cells = grid.found.shape
    pair_along = np.full((lines, max(0, cells - 1)), NOT_DECIDED)
    pair_across = np.full((max(0, lines - 1), cells), NOT_DECIDED)
    votes: dict[Index, list[tuple[int, Index, Counts]]] = {each: [] for each in np.ndindex(lines, cells)}
    for pairs, (down, right) in ((pair_along, (0, 1)), (pair_across, (1, 0))):
        for line, cell in np.ndindex(pairs.shape):
            here, there = (line, cell), (line + down, cell + right)
            verdict, forwards, backwards = _both_ways(judge, grid, here, there)
            pairs[line, cell] = verdict
            votes[there].append((verdict, here, forwards))
            votes[here].append((verdict, there, backwards))
    return GridVerdicts(_cells(grid, votes), pair_along, pair_across)


def _both_ways(judge: Judge, grid: Places, here: Index, there: Index) -> tuple[int, Counts, Counts]:
    """The verdict on a pair of cells, and what each lets expect at the other."""
    ends = [(float(grid.along[cell]), float(grid.across[line])) for line, cell in (here, there)]
    nearest = [complex(grid.nearest[each]) for each in (here, there)]
    first, second = int(grid.found[here]), int(grid.found[there])
    verdict, forwards = judge.verdict(first, second, nearest, judge.legs(ends[0], ends[1]))
    _, backwards = judge.verdict(second, first, nearest, judge.legs(ends[1], ends[0]))
    return verdict, forwards, backwards


def _cells(grid: Places, votes: dict[Index, list[tuple[int, Index, Counts]]]) -> Verdicts:
    """Which cell of a disagreeing pair is at odds with its surroundings, and what these expect of it.

    The less stable one, the inside of a tongue; but before it one that disagrees with all of its neighbours.
    """
    expected, verdict = np.full(grid.found.shape, UNKNOWN), np.full(grid.found.shape, NOT_DECIDED)
    alone = np.zeros(grid.found.shape, dtype=bool)
    for cell, cast in votes.items():
        decided = [vote for vote, _, _ in cast if vote != NOT_DECIDED]
        if decided:
            verdict[cell], expected[cell] = AGREES, grid.found[cell]
            alone[cell] = AGREES not in decided
    for cell, cast in votes.items():
        against = [
            counts
            for vote, other, counts in cast
            if vote == DISAGREES
            and (alone[cell], grid.found[cell], cell) > (alone[other], grid.found[other], other)
        ]
        if against:
            verdict[cell], expected[cell] = DISAGREES, _most_told(against)
    return Verdicts(expected, verdict)


def _most_told(told: Sequence[Counts]) -> int:
    """The number that most neighbours expect, of equally many the smallest; `UNKNOWN` if none expects any."""
    numbers = Counter(number for counts in told for number in counts)
    return min(numbers, key=lambda number: (-numbers[number], number), default=UNKNOWN)


def judge_points(judge: Judge, grid: Places, points: Places) -> Verdicts:
    """The verdicts on points, each compared with the nearest cell whose number is known."""
    expected, verdict = np.full(points.found.shape, UNKNOWN), np.full(points.found.shape, NOT_DECIDED)
    known = [cell for cell in product(*map(range, grid.found.shape)) if grid.found[cell] != UNKNOWN]
    places = np.array([(grid.along[cell], grid.across[line]) for line, cell in known]).reshape(-1, 2)
    cell_size = np.array([_spacing(grid.along), _spacing(grid.across)])
    for number, place in enumerate(zip(points.along.tolist(), points.across.tolist(), strict=True)):
        if not known:
            break
        cell = known[int(np.argmin(np.abs((places - place) / cell_size).max(axis=1)))]
        begin = float(grid.along[cell[1]]), float(grid.across[cell[0]])
        nearest = [complex(grid.nearest[cell]), complex(points.nearest[number])]
        counts = int(grid.found[cell]), int(points.found[number])
        verdict[number], told = judge.verdict(*counts, nearest, judge.legs(begin, place))
        if verdict[number] == AGREES:
            expected[number] = counts[1]
        elif verdict[number] == DISAGREES:
            expected[number] = _most_told([told])
    return Verdicts(expected, verdict)


def _spacing(values: Array) -> float:
    """The distance between two of equally spaced values."""
    return float(values[1] - values[0])
