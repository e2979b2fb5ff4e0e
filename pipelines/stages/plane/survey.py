"""The unstable multipliers of cycles over a plane, each found without continuation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipelines.case.arrays import Array
from pipelines.orbits.forced_cycle import ForcedCycle
from pipelines.stages.certificate.agreement import Places
from pipelines.stages.certificate.comparison import decided, multiplier_error, random_places
from pipelines.stages.certificate.crossings import UNKNOWN
from pipelines.stages.plane.problem import PlaneOptions, PlaneProblem, cycle_at
from pipelines.stages.survey.cells import nearest_to_circle
from pipelines.stages.survey.line import Found, cycles_of_line


@dataclass(frozen=True)
class PlaneSurvey:
    """What was found at the cells of a ``grid`` and at random ``points``.

    Cells lie along the first parameter of the plane, lines along the second.
    """

    grid: Places
    points: Places


def survey_plane(plane: PlaneProblem, options: PlaneOptions) -> PlaneSurvey:
    """Seek the cycle at every cell and at 100 random points, and count its unstable multipliers.

    The count is open where there is no cycle, and where a multiplier is nearer to the unit circle than the
    tolerances of cycles and time steps tell.
    """
    along, across = (
        np.linspace(*interval, cells) for interval, cells in zip(plane.ranges, options.cells, strict=True)
    )
    grid = [_line(plane, options, along, float(value)) for value in across]
    low, high = np.array(plane.ranges).T
    drawn = random_places(low, high)
    points = [cycle_at(plane, options, (float(x), float(y))) for x, y in drawn]
    return PlaneSurvey(
        _places(plane, options, along, across, np.array(grid, dtype=object)),
        _places(plane, options, drawn[:, 0], drawn[:, 1], np.array(points, dtype=object)),
    )


def _line(plane: PlaneProblem, options: PlaneOptions, along: Array, across: float) -> list[Found]:
    def cycle(cell: int, beside: ForcedCycle | None) -> Found:
        return cycle_at(plane, options, (float(along[cell]), across), beside)

    return cycles_of_line(len(along), cycle)


def _places(
    plane: PlaneProblem, options: PlaneOptions, along: Array, across: Array, cycles: np.ndarray
) -> Places:
    """What the ``cycles`` tell, whose shape is that of the places."""
    found = np.full(cycles.shape, UNKNOWN, dtype=np.int64)
    nearest = np.full(cycles.shape, complex(math.nan, math.nan))
    for place, one in np.ndenumerate(cycles):
        if isinstance(one, ForcedCycle):
            multipliers = one.cycle.spectrum.multipliers
            found[place] = int(np.sum(np.abs(multipliers) > 1.0))
            nearest[place] = nearest_to_circle(multipliers)
    error = multiplier_error(plane.cycles.options.step_tolerance, options.cycle.tolerance)
    return Places(along, across, decided(found, nearest, error), nearest)
