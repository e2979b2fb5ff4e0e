"""The lines that a search shall add: through the places at which the curves do not explain the stability.

Cells side by side that disagree are one patch, as are those that a tongue without a curve covers. A branch
through the middle of a patch, along either parameter, passes what bounds it.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipelines.stages.certificate.agreement import DISAGREES, Places, Verdicts

_TOUCHING = np.ones((3, 3), dtype=int)  # cells that share a corner belong to one patch


class Asked(NamedTuple):
    """A line along one of the two parameters, through a value of the other one."""

    parameter: str
    fixed: float


def asked_lines(
    names: tuple[str, str],
    grid: Places,
    cells: Verdicts,
    points: Places,
    at_points: Verdicts,
    known: Collection[Asked],
) -> list[Asked]:
    """Two lines through every patch, and through every point beside all patches, without the ``known`` ones.

    ``names``: the parameters along the lines of the grid and across them.
    """
    along, across = names
    disagrees = cells.verdict == DISAGREES
    places = [(grid.along[cell], grid.across[line]) for line, cell in _middles(disagrees)]
    covered = ndimage.binary_dilation(disagrees, _TOUCHING)
    for number in np.flatnonzero(at_points.verdict == DISAGREES):
        place = points.along[number], points.across[number]
        line, cell = (
            int(np.argmin(np.abs(values - value)))
            for values, value in zip((grid.across, grid.along), place[::-1], strict=True)
        )
        if not covered[line, cell]:
            places.append(place)
    found = [Asked(along, float(y)) for _, y in places] + [Asked(across, float(x)) for x, _ in places]
    return [line for line in dict.fromkeys(found) if line not in known]


def _middles(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Of every patch of chosen cells the one nearest to its centre."""
    patches, count = ndimage.label(chosen, _TOUCHING)
    middles = []
    for patch in range(1, count + 1):
        members = np.argwhere(patches == patch)
        line, cell = members[int(np.argmin(np.abs(members - members.mean(axis=0)).sum(axis=1)))]
        middles.append((int(line), int(cell)))
    return middles
