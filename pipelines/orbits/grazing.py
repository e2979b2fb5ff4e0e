"""Where an orbit grazes the ambient pressure: a film touches it without slope over angle and time.

At a station along the bearing the gauge pressure u = p - 1 is a function of the angle theta and the phase
alpha.  The set u > 0, over which Guembel's force integrates, changes its shape where u is zero and
stationary: a part of it appears at a maximum, a hole at a minimum, and two parts join at a saddle.  Beside a
node of the grid of angles and samples, with differences D of second order,

    u = u_0 + g.d + 1/2 d.H d,    g = Du,  H = D^2 u,    stationary at d = -H^-1 g with u = u_0 + 1/2 g.d

which counts where d leads no further than to the middle between nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipelines.case.arrays import Array
from pipelines.machine.assembly import Machine
from pipelines.machine.rates import BEARINGS

_REACH = 0.55  # in spacings: a stationary point between two nodes counts for one of them at least


@dataclass(frozen=True)
class Graze:
    """The stationary point of the gauge pressure that is nearest to zero.

    ``gauge``: its pressure above ambient, over ambient; ``bearing``, ``angle`` theta and ``phase`` of the
    period, both [rad].
    """

    gauge: float
    bearing: int
    angle: float
    phase: float


@dataclass(frozen=True)
class StationaryPoints:
    """Values (n,) of a function of two variables where it is stationary, and their rows and columns (n,)."""

    values: Array
    rows: Array
    columns: Array


def stationary_points(field: Array, periodic: bool = True) -> StationaryPoints:
    """The stationary points of a function on a grid (rows, columns), of fourth order in value.

    It is periodic along the rows, and along the columns where ``periodic``; there the ends count otherwise as
    neighbours only.
    """

    def shifted(rows: int, columns: int) -> Array:
        return np.roll(field, (-rows, -columns), axis=(0, 1))

    down, right = (0.5 * (shifted(*step) - shifted(-step[0], -step[1])) for step in ((1, 0), (0, 1)))
    twice_down, twice_right = (
        shifted(*step) - 2.0 * field + shifted(-step[0], -step[1]) for step in ((1, 0), (0, 1))
    )
    mixed = 0.25 * (shifted(1, 1) - shifted(1, -1) - shifted(-1, 1) + shifted(-1, -1))
    determinant = twice_down * twice_right - mixed * mixed
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = (mixed * right - twice_right * down) / determinant
        columns = (mixed * down - twice_down * right) / determinant
        values = field + 0.5 * (down * rows + right * columns)
    found = (np.abs(rows) <= _REACH) & (np.abs(columns) <= _REACH)
    if not periodic:
        found[:, [0, -1]] = False
    i, j = np.nonzero(found)
    return StationaryPoints(values[found], i + rows[found], j + columns[found])


def nearest_graze(machine: Machine, orbit: Array, period_multiple: int = 1) -> Graze | None:
    """Where an orbit (samples, N or more) comes nearest to grazing under Guembel's clipping.

    ``period_multiple``: forcing periods of the cycle.  None where no film is clipped in this way, or none has
    a stationary pressure.
    """
    nearest: Graze | None = None
    for index in range(BEARINGS):
        bearing = machine.bearings[index]
        settings = bearing.settings
        if settings.clipping != "gumbel":
            continue
        gauge = machine.pressures(orbit, index).reshape(len(orbit), settings.axial, settings.nodes) - 1.0
        for station in range(settings.axial):
            graze = _nearest(gauge[:, station], index, settings.periodic, period_multiple)
            if graze is None or (nearest is not None and abs(graze.gauge) >= abs(nearest.gauge)):
                continue
            spacing = float(bearing.angles[1] - bearing.angles[0])
            nearest = Graze(graze.gauge, index, float(bearing.angles[0]) + spacing * graze.angle, graze.phase)
    return nearest


def _nearest(gauge: Array, bearing: int, periodic: bool, period_multiple: int) -> Graze | None:
    """The nearest graze of a station (samples, nodes), its angle counted in nodes."""
    found = stationary_points(gauge, periodic)
    if not found.values.size:
        return None
    best = int(np.argmin(np.abs(found.values)))
    phase = 2.0 * np.pi * period_multiple * float(found.rows[best]) / len(gauge)
    return Graze(float(found.values[best]), bearing, float(found.columns[best]), phase)
