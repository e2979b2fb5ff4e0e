"""Extremes of both films at an instant, compiled: a transient computes them at every step."""

from __future__ import annotations

import numpy as np

from .film import FOIL, NODES, PRESSURE, STATIONS, film_geometry
from .kernels import RATES, kernel
from .lanes import borrowed
from .rates import BEARINGS, bearing_views, film_workspace, journal_coordinates

# The value of bearing b lies at quantity * BEARINGS + b; largest values are negated, so that all are minima.
FILM, LOW_PRESSURE, HIGH_PRESSURE, LOW_FOIL, HIGH_FOIL = range(5)
OBSERVED = 5 * BEARINGS


@kernel(RATES)
def machine_extremes(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
    """Write smallest film thickness and extremes of pressure and foil displacement into ``out`` (OBSERVED,).

    Lengths are in units of the clearance, pressures in units of the ambient pressure; largest values are
    negated.
    """
    state, parameters, constants = borrowed(state), borrowed(parameters), borrowed(constants)
    layout, work, out = borrowed(layout), borrowed(work), borrowed(out)
    for bearing in range(BEARINGS):
        integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
        nodes, rows = integers[NODES], integers[NODES] * integers[STATIONS]
        thickness, thickness_rate, _, scratch, _ = film_workspace(integers, work)
        journal = journal_coordinates(bearing, state, clearance, layout)
        film_geometry(
            phase, state, parameters, integers, scalars, arrays, journal,
            thickness, thickness_rate, scratch[0],
        )  # fmt: skip
        pressure = state[integers[PRESSURE] : integers[PRESSURE] + rows]
        foil = state[integers[FOIL] : integers[FOIL] + nodes]
        out[FILM * BEARINGS + bearing] = np.min(thickness)
        out[LOW_PRESSURE * BEARINGS + bearing] = np.min(pressure)
        out[HIGH_PRESSURE * BEARINGS + bearing] = -np.max(pressure)
        out[LOW_FOIL * BEARINGS + bearing] = np.min(foil)
        out[HIGH_FOIL * BEARINGS + bearing] = -np.max(foil)
