"""Stiffness and damping of the bearings over the whirl frequency, one line for each of several speeds."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import add_right, add_top, limits
from pipelines.figures.contents import CaseView, MissingDataError, Table

ENTRIES = (("xx", 0, 0), ("xy", 0, 1), ("yx", 1, 0), ("yy", 1, 1))
_QUANTITIES = (
    ("stiffness", r"$\bar{K}$", "N/m", "[MN/m]", 1e-6),
    ("damping", r"$\bar{C}$", "N s/m", "[kN s/m]", 1e-3),
)
LINES = 6  # speeds at most
SYNCHRONOUS: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": ":"}


@style.in_style
def draw_coefficients(case: CaseView, coefficients: Table) -> Figure:
    """K and C of every bearing, entry by entry, over the whirl frequency; dotted where it is the speed."""
    known = np.isfinite(coefficients["stiffness"]).all(axis=(1, 2, 3, 4))
    if not known.any():
        raise MissingDataError("no speed has an equilibrium")
    table = {name: coefficients[name][known] for name in ("speed", "stiffness", "damping")}
    speeds = table["speed"]
    lines = np.unique(np.linspace(0, len(speeds) - 1, LINES).round().astype(int))
    figure = style.new_figure(2.0 + 3.1 * case.bearings)
    panels = figure.subplots(2 * case.bearings, len(ENTRIES), sharex=True, sharey="row", squeeze=False)
    norm = Normalize(float(speeds[0]), float(speeds[-1]))
    for bearing in range(case.bearings):
        for row, (name, symbol, unit, label, factor) in enumerate(_QUANTITIES):
            own = panels[2 * bearing + row]
            for axes, (entry, i, j) in zip(own, ENTRIES, strict=True):
                values = table[name][:, :, bearing, i, j]
                _draw_entry(axes, coefficients["frequency"], speeds, values, lines, norm)
                axes.set_title(f"{symbol[:-1]}_{{{entry}}}$, bearing {bearing + 1}", fontsize=8)
            own[0].set_ylabel(f"{name} {symbol} [–]")
            if unit in case.scales.of_bearings:
                add_right(own[-1], factor * float(case.scales.of_bearings[unit][bearing]), label)
    for axes in panels[-1]:
        axes.set_xlabel(r"whirl frequency $\bar{\omega}$ [–]")
        axes.set_xlim(*limits(coefficients["frequency"], 0.0))
    for axes in panels[0]:
        add_top(axes, case.scales.hertz, "[Hz]", ticks=3)
    bar = figure.colorbar(
        ScalarMappable(norm, colormaps[style.PARAMETER_MAP]), ax=panels, orientation="horizontal", aspect=60
    )
    bar.set_label(r"rotating speed $\bar{\Omega}$ [–]")
    add_top(bar.ax, case.scales.rpm, "rotating speed [rpm]")
    style.legend_below(figure, [Line2D([], [], label="whirl at the rotating speed", **SYNCHRONOUS)])
    ring = coefficients.attributes["request"]["ring"]
    title = f"{case.name}: stiffness and damping of film and foil, rings {_RINGS[ring]}"
    return style.finish(figure, title, case.note)


_RINGS = {"mean": "in their mean position", "undeformed": "undeformed"}


def _draw_entry(
    axes: Axes,
    frequency: NDArray[np.float64],
    speeds: NDArray[np.float64],
    values: NDArray[np.float64],
    lines: NDArray[np.intp],
    norm: Normalize,
) -> None:
    """One entry (speeds, frequencies): a line for each chosen speed, and the synchronous values."""
    colours = colormaps[style.PARAMETER_MAP]
    for line in lines:
        axes.plot(frequency, values[line], color=colours(norm(speeds[line])), linewidth=1.0)
    inside = (speeds >= frequency[0]) & (speeds <= frequency[-1])
    synchronous = [np.interp(speed, frequency, row) for speed, row in zip(speeds, values, strict=True)]
    axes.plot(speeds[inside], np.array(synchronous)[inside], **SYNCHRONOUS)
    axes.axhline(0.0, color="#666666", linewidth=0.6)
