"""Where the growth rate of a survey passes zero, by linear interpolation between cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.fields import MEASURES
from pipelines.case.units import Scale, in_both
from pipelines.datasets.records import Group

GROUP = "survey"
PHYSICAL = ("found", "thin_film")


class Onset(NamedTuple):
    """A change of stability between two lines: its place in both parameters, and the leading bifurcation."""

    along: float
    across: float
    bifurcation: str

    @property
    def kind(self) -> str:
        """The bifurcation in words."""
        return self.bifurcation.replace("_", " ")

    def place(self, parameters: Sequence[str], scale: Scale) -> str:
        """Its place in both units; ``parameters`` are those along and across the lines."""
        along, across = (
            f"{name.replace('_', ' ')} {in_both(MEASURES[name], value, scale, '.4g')}"
            for name, value in zip(parameters, (self.along, self.across), strict=True)
        )
        return f"{across}, {along}"


def known_growth(group: Group) -> Array:
    """Growth rates (lines, cells) of a survey; NaN where there is no cycle that can be."""
    usable = np.isin(group.labels("status"), PHYSICAL)
    return np.where(usable, group["growth_rate"], np.nan)


def onsets(group: Group) -> list[Onset]:
    """For every cell along the lines, the first passage from stable to unstable across them."""
    growth, kinds = known_growth(group), group.labels("bifurcation")
    found = []
    for cell, along in enumerate(group["along"]):
        place = first_rise(group["across"], growth[:, cell])
        if place is not None:
            line, across = place
            found.append(Onset(float(along), across, str(kinds[line, cell])))
    return found


def first_rise(positions: Array, values: Array) -> tuple[int, float] | None:
    """The first passage of ``values`` from below zero to above: the index above it, and the position.

    None without any between two neighbouring numbers.
    """
    below, above = values[:-1] < 0.0, values[1:] >= 0.0
    rises: NDArray[np.intp] = np.flatnonzero(below & above)
    if rises.size == 0:
        return None
    low = int(rises[0])
    share = values[low] / (values[low] - values[low + 1])
    return low + 1, float(positions[low] + share * (positions[low + 1] - positions[low]))
