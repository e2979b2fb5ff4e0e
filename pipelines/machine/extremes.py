"""The extremes of both films at an instant, compiled: what a long run watches at every step."""

from __future__ import annotations

import numpy as np

from .film import FOIL, NODES, PRESSURE, STATIONS, film_geometry
from .kernels import RATES, kernel
from .rates import BEARINGS, bearing_views, film_workspace, journal_coordinates

# Observed values of bearing b lie at quantity * BEARINGS + b; largest values are kept as smallest negatives.
FILM, LOW_PRESSURE, HIGH_PRESSURE, LOW_FOIL, HIGH_FOIL = range(5)
OBSERVED = 5 * BEARINGS


@kernel(RATES)
def machine_extremes(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
    """Smallest film thickness, pressure and foil displacement, largest pressure and foil displacement
    (negative), over clearance and ambient pressure, into ``out`` (OBSERVED,).
    """
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
