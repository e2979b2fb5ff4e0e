"""The curves of a plane compared with what was found at cells and at random points of it, in memory.

The number of unstable multipliers at a place is open where a multiplier is nearer to the unit circle than the
places are accurate.  Where folds let several cycles coexist, a curve counts only where the cycle found at the
crossing is the one that bifurcates there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from pipelines.case.arrays import Array
from pipelines.datasets.curves import BifurcationCurve
from pipelines.orbits.forced_cycle import ForcedCycle
from pipelines.stages.certificate.agreement import (
    AGREES,
    DISAGREES,
    NOT_DECIDED,
    GridVerdicts,
    Integers,
    Judge,
    Places,
    Verdicts,
    judge_grid,
    judge_points,
)
from pipelines.stages.certificate.asked import Asked, asked_lines
from pipelines.stages.certificate.crossings import UNKNOWN, Crossing
from pipelines.stages.survey.line import Found

POINTS = 100  # random ones
SEED = 1
CONFIDENCE = 0.95  # of the largest share of the plane that may disagree
_MISSES = 4.0  # times the miss of a cycle: by so much its multipliers may be off
_SAME = 0.02  # distance of a multiplier from the critical one of a curve, below which it is that one

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Comparison:
    """What the curves of a plane say of the places in it.

    ``names``: the parameters along the lines of the ``grid`` and across them; ``points``: random ones.
    """

    names: tuple[str, str]
    grid: Places
    points: Places
    at_cells: GridVerdicts
    at_points: Verdicts

    @classmethod
    def of(cls, judge: Judge, names: tuple[str, str], grid: Places, points: Places) -> Comparison:
        """Judge all pairs of neighbouring cells, and each point against the nearest cell."""
        return cls(names, grid, points, judge_grid(judge, grid), judge_points(judge, grid, points))

    @property
    def resolution(self) -> tuple[float, float]:
        """The size of a cell in both parameters."""
        along, across = (float(values[1] - values[0]) for values in (self.grid.along, self.grid.across))
        return along, across

    @property
    def certified(self) -> bool:
        """Whether some pairs of cells are decided, and neither these nor any random point disagree."""
        wrong = self.at_cells.pairs(DISAGREES) + self.at_points.number(DISAGREES)
        return wrong == 0 and self.at_cells.pairs(AGREES) > 0

    @property
    def share_at_most(self) -> float:
        """The share of the plane that disagrees at most.

        With the confidence of 95 % that the random points give (Clopper and Pearson).
        """
        wrong, right = self.at_points.number(DISAGREES), self.at_points.number(AGREES)
        return 1.0 if right == 0 else float(beta.ppf(CONFIDENCE, wrong + 1, right))

    def numbers(self) -> dict[str, Any]:
        """How many places agree, disagree and are not decided; and whether the curves are certified."""
        numbers: dict[str, Any] = {}
        for name, verdict in (("agreeing", AGREES), ("disagreeing", DISAGREES), ("not_decided", NOT_DECIDED)):
            numbers |= {
                f"cells_{name}": self.at_cells.cells.number(verdict),
                f"pairs_{name}": self.at_cells.pairs(verdict),
                f"points_{name}": self.at_points.number(verdict),
            }
        return numbers | {"share_at_most": self.share_at_most, "certified": self.certified}

    def asked(self, known: Collection[Asked]) -> list[Asked]:
        """The lines that a search shall add, through the places that disagree; ``known`` ones are there."""
        return asked_lines(self.names, self.grid, self.at_cells.cells, self.points, self.at_points, known)


def multiplier_error(step_tolerance: float, miss: float) -> float:
    """How far the modulus of a multiplier may be off: by the time steps and by the ``miss`` of its cycle."""
    return step_tolerance + _MISSES * miss


def decided(found: Integers, nearest: Complex, error: float) -> Integers:
    """The numbers ``found``, `UNKNOWN` where the ``nearest`` multiplier is within the error of the circle."""
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(np.log(np.abs(nearest)))
    return np.where(apart > error, found, UNKNOWN)


def random_places(low: Array, high: Array, number: int = POINTS) -> Array:
    """Points (number, 2) drawn with equal probability between two corners (2,), (2,); always the same."""
    return np.asarray(low + (high - low) * np.random.default_rng(SEED).random((number, 2)))


def membership(
    curves: Sequence[BifurcationCurve], names: tuple[str, str], cycle_at: Callable[[float, float], Found]
) -> Callable[[Crossing], bool | None]:
    """Whether the cycle that is found at a crossing is the critical one of the curve; None without a cycle.

    ``cycle_at``: the cycle at values of the parameters ``names``.  Only folds let several cycles of the
    excitation period coexist: without any nothing is computed.
    """
    if all(curve.bifurcation != "fold" for curve in curves):
        return lambda crossing: True
    known: dict[tuple[str, float], bool | None] = {}

    def belongs(crossing: Crossing) -> bool | None:
        key = crossing.curve.name, crossing.arclength
        if key not in known:
            along, across = (float(crossing.place[crossing.curve.parameters.index(name)]) for name in names)
            found = cycle_at(along, across)
            known[key] = _is_critical(found, crossing) if isinstance(found, ForcedCycle) else None
        return known[key]

    return belongs


def _is_critical(found: ForcedCycle, crossing: Crossing) -> bool:
    """Whether a cycle has a multiplier on the arc between the critical ones of the rows around a crossing."""
    multipliers = found.cycle.spectrum.multipliers
    angles = np.clip(np.abs(np.angle(multipliers)), *crossing.curve.angles_around(crossing.arclength))
    upper = multipliers.real + 1j * np.abs(multipliers.imag)
    return bool(np.min(np.abs(upper - np.exp(1j * angles))) < _SAME)


def critical_rows(multipliers: Iterable[Complex], angles: Array) -> int:
    """How many rows come before the first one without a multiplier at the critical one exp(i angle).

    ``multipliers``: n arrays, filled up with NaN or not; ``angles`` (n,).  Beyond R1 and R2 a Neimark-Sacker
    curve goes on as one of neutral saddles, where no cycle bifurcates.
    """
    for index, (row, angle) in enumerate(zip(multipliers, angles, strict=True)):
        if np.nanmin(np.abs(row - np.exp(1j * angle)), initial=np.inf) > _SAME:
            return index
    return len(angles)
