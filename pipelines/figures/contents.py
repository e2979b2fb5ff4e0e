"""Data of the figures: plain arrays of one group, and what every figure of a case shares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipelines.figures.axes import AxisScales, add_right


class MissingDataError(Exception):
    """A figure cannot be drawn because the store does not hold what it shows."""


@dataclass(frozen=True)
class Table:
    """Arrays and attributes of one group of a store, committed rows only."""

    arrays: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """The array of this name; raises MissingDataError where the group has none."""
        if name not in self.arrays:
            raise MissingDataError(f"the array {name!r} is not in the store")
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def optional(self, name: str) -> NDArray[Any]:
        """The array of this name, an empty one where the group has none."""
        return self.arrays.get(name, np.zeros(0))


@dataclass(frozen=True)
class CaseView:
    """What every figure of one case needs.

    Its name, its note, its scales, its machine and its own values of the parameters that can be
    continued.
    """

    name: str
    note: str
    scales: AxisScales
    machine: Table
    parameters: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def bearings(self) -> int:
        """Number of bearings of the machine."""
        return len(self.machine["bearing_node"])

    def journal_coordinates(self, bearing: int) -> tuple[int, int]:
        """Columns of x and y of a journal among the coordinates of the masters.

        x, y of each master in order, and the slopes where they are kept.
        """
        journal = self.machine["bearing_node"][bearing]
        before, slopes = self.machine["master_node"] < journal, self.machine.optional("slope_node") < journal
        first = 2 * (int(before.sum()) + int(slopes.sum()))
        return first, first + 1

    def clearance(self, bearing: int) -> float:
        """A bearing's own clearance [µm], which scales its film and the motion of its journal."""
        return float(1e6 * self.machine["bearing_clearance"][bearing])

    def journal(self, coordinates: NDArray[np.float64], bearing: int) -> NDArray[np.float64]:
        """x and y of a journal over its own clearance (..., 2), from coordinates of the masters.

        The coordinates (..., coordinate) are over the clearance of the first bearing.
        """
        own = coordinates[..., list(self.journal_coordinates(bearing))]
        return np.asarray(own / (self.clearance(bearing) / self.clearance(0)))

    def add_micrometres(
        self, axes: Axes, label: str, bearing: int | None = None, apart: float = 0.11
    ) -> None:
        """Second y axis in µm beside an axis in clearances of one bearing, or of all bearings.

        For all of them, one axis for every different clearance, ``apart`` in widths of the axes.
        ``label`` without unit.
        """
        if bearing is not None:
            add_right(axes, self.clearance(bearing), f"{label} [µm]".strip())
            return
        clearances = [self.clearance(own) for own in range(self.bearings)]
        different = sorted(set(clearances), key=clearances.index)
        for number, clearance in enumerate(different):
            owner = f", bearing {clearances.index(clearance) + 1}" if len(different) > 1 else ""
            text = f"{label}{owner} [µm]".removeprefix(", ").strip()
            add_right(axes, clearance, text, 1.0 + apart * number)


@dataclass(frozen=True)
class FigurePlan:
    """One figure still to be drawn: the stem of its file name and the call that draws it."""

    kind: str
    stem: str
    draw: Callable[[], Figure]


def stable_points(branch: Table) -> NDArray[np.bool_]:
    """Points of a branch (point,) whose multipliers all lie inside the unit circle."""
    return np.asarray(branch["unstable_count"] == 0)


def excitation_periods(branch: Table) -> int:
    """How many excitation periods the cycles of a branch last: 1, or 2, 4, ... after period doublings."""
    return int(branch.attributes.get("turns", 1))


def branch_title(name: str, branch: Table) -> str:
    """Name of a branch in titles."""
    turns = excitation_periods(branch)
    return f"branch {name}" + (f" of {turns} excitation periods" if turns > 1 else "")
