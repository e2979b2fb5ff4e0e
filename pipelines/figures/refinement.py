"""Errors of bifurcation points: a line from the stored point to a cross at the extrapolated point.

The line is the error by the film grid; whiskers at the cross are the uncertainty of the extrapolation.  A
point without a clean order has a grey bar to both sides, as long as the bound of its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.contents import Table

BAR: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "zorder": 6}
CROSS: dict[str, Any] = {
    "color": style.BLACK, "marker": "x", "markersize": 3.5, "markeredgewidth": 0.9, "zorder": 7,
}  # fmt: skip
WHISKERS: dict[str, Any] = {"elinewidth": 0.9, "linestyle": "none"}
BOUND: dict[str, Any] = BAR | {"color": style.GREY, "marker": "|", "markersize": 4.0}
SAME = 1e-9  # relative distance of parameters that were copied from one group to another


@dataclass(frozen=True)
class ErrorBar:
    """The drawn data of one recomputed point along its free parameter.

    Both `ends` of the bar; `limit`: the extrapolated value with its `uncertainty`, NaN where the bar is
    only a bound.
    """

    ends: tuple[float, float]
    limit: float = np.nan
    uncertainty: float = np.nan

    @property
    def is_bound(self) -> bool:
        return bool(np.isnan(self.limit))


def error_bar(table: Table, row: int) -> ErrorBar | None:
    """The bar of a row of the group ``refinement``; None if the point could not be recomputed."""
    status, value = str(table["status"][row]), float(table["value"][row])
    if status == "refined":
        limit = float(table["richardson"][row])
        return ErrorBar((value, limit), limit, float(table["richardson_error"][row]))
    error = float(table["error"][row])
    return ErrorBar((value - error, value + error)) if status == "bound" else None


def draw_refinement(axes: Axes, table: Table, x: str, y: str) -> list[Line2D]:
    """Draw the errors of all recomputed points of a map over the parameters ``x`` and ``y``.

    `table`: the group `refinement`.  Points whose free parameter is on neither axis are left out.  Returns
    legend handles, none where nothing was drawn.
    """
    drawn: list[ErrorBar] = []
    for row in range(len(table["value"])):
        bar, free = error_bar(table, row), str(table["free"][row])
        if bar is None or free not in (x, y):
            continue
        draw_bar(axes, bar, float(table[y if free == x else x][row]), along_x=free == x)
        drawn.append(bar)
    return legend_handles(drawn)


def event_bars(table: Table | None, branch: Table, parameter: str) -> list[ErrorBar | None]:
    """The error bar of every event of a branch along ``parameter``, None for events without one.

    An event is recognised by its parameters, so that what was told of a branch that has been replaced is not
    drawn on the new one.
    """
    count = len(branch.optional("event_kind"))
    if table is None or count == 0 or len(table["value"]) == 0:
        return [None] * count
    stored = np.column_stack([table[name] for name in PARAMETER_AXES])
    bars: list[ErrorBar | None] = []
    for index in range(count):
        own = np.array([branch[f"event_{name}"][index] for name in PARAMETER_AXES])
        same = (np.abs(stored - own) <= SAME * np.abs(own)).all(axis=1)
        same &= (table["free"] == parameter) & (table["bifurcation"] == branch["event_kind"][index])
        rows = np.flatnonzero(same)
        bars.append(error_bar(table, int(rows[0])) if len(rows) else None)
    return bars


def legend_handles(bars: Sequence[ErrorBar]) -> list[Line2D]:
    """One handle for each kind of bar that was drawn."""
    handles = []
    if any(not bar.is_bound for bar in bars):
        handles.append(Line2D([], [], label="extrapolated from finer grids", **BAR | CROSS))
    if any(bar.is_bound for bar in bars):
        handles.append(Line2D([], [], label="bound of the error", **BOUND))
    return handles


def draw_bar(axes: Axes, bar: ErrorBar, other: float, along_x: bool) -> None:
    """Draw a bar along one axis, at the value ``other`` of the other axis."""
    look = BOUND | {"marker": "|" if along_x else "_"} if bar.is_bound else BAR
    axes.plot(*((bar.ends, (other, other)) if along_x else ((other, other), bar.ends)), **look)
    if bar.is_bound:
        return
    x, y = (bar.limit, other) if along_x else (other, bar.limit)
    width, height = (bar.uncertainty, None) if along_x else (None, bar.uncertainty)
    look = CROSS | WHISKERS
    axes.errorbar(x, y, xerr=width, yerr=height, **look)
