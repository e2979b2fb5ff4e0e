"""Certificate of a plane: unstable multipliers, cell by cell, under the curves that should explain them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_right, add_top
from pipelines.figures.case_tables import CaseTables
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.stability_map import HORIZONTAL_FIRST, PlaneView, curves_over, draw_curves

COUNTS = ("stable", "1 unstable multiplier", "2", "3", "4 or more")
SHADES = ("#FFFFFF", "#FBE3D2", "#D9DCEE", "#F3C3A4", "#B4BADC")
MARKS: dict[str, tuple[str, dict[str, Any]]] = {
    "agrees": ("random point that agrees", {"marker": ".", "markersize": 2.5, "color": "#555555"}),
    "not_decided": ("not decided", {"marker": "+", "markersize": 4.0, "color": "#7A7A7A"}),
    "disagrees": ("not explained by the curves", {"marker": "x", "markersize": 5.5, "color": "#C00000"}),
}


def newest_certificate(case: CaseTables) -> Table | None:
    """The newest certificate; those before it asked for lines that have been added since."""
    found = case.of_kind("certificate")
    return found[max(found)] if found else None


@style.in_style
def draw_certificate(case: CaseView, table: Table, curves: Mapping[str, Table]) -> Figure:
    """Cells and random points, with those marked that the ``curves`` do not explain."""
    along, across = (str(name) for name in table.attributes["parameters"])
    x, y = sorted((along, across), key=HORIZONTAL_FIRST.index)
    figure = style.new_figure(6.9)
    axes = figure.subplots()
    axes.grid(False)
    axes.set(xlabel=PARAMETER_AXES[x].label, ylabel=PARAMETER_AXES[y].label)
    handles: list[Any] = list(_draw_counts(axes, table, turned=x != along))
    if inside := curves_over(curves, (x, y), started=True):
        handles += draw_curves(axes, PlaneView.of(inside, {}))
    handles += _draw_verdicts(axes, table, turned=x != along)
    add_right(axes, *PARAMETER_AXES[y].dimensional(case.scales))
    add_top(axes, *PARAMETER_AXES[x].dimensional(case.scales))
    style.legend_below(figure, handles, 4)
    told = "certified" if table.attributes["certified"] else "not certified"
    steps = " × ".join(f"{size:.3g}" for size in table.attributes["resolution"])
    return style.finish(figure, f"{case.name}: bifurcation set, {told} on cells of {steps}", case.note)


def _draw_counts(axes: Axes, table: Table, turned: bool) -> Sequence[Patch]:
    """Cells in the colour of their number of unstable multipliers."""
    found = np.ma.masked_less(np.minimum(table["found"], len(COUNTS) - 1), 0)
    places, counts = (table["along"], table["across"]), found
    if turned:
        places, counts = places[::-1], found.T
    axes.pcolormesh(
        *places, counts, shading="nearest", cmap=ListedColormap(SHADES), vmin=-0.5, vmax=len(SHADES) - 0.5,
        rasterized=True, zorder=0.2,
    )  # fmt: skip
    return [
        Patch(facecolor=SHADES[number], edgecolor="#BBBBBB", linewidth=0.5, label=label)
        for number, label in enumerate(COUNTS)
        if np.any(found == number)
    ]


def _draw_verdicts(axes: Axes, table: Table, turned: bool) -> Sequence[Line2D]:
    """Marks on all random points, and on the cells that do not agree."""
    grid = np.meshgrid(table["along"], table["across"])
    handles = []
    for verdict, (label, look) in MARKS.items():
        places = [_chosen(grid, table["verdict"] == verdict)] if verdict != "agrees" else []
        points = (table["point_along"], table["point_across"])
        places.append(_chosen(points, table["point_verdict"] == verdict))
        first, second = np.concatenate(places, axis=1)[:: -1 if turned else 1]
        if first.size:
            axes.plot(first, second, linestyle="none", zorder=6, **look)
            handles.append(Line2D([], [], linestyle="none", label=label, **look))
    return handles


def _chosen(places: Sequence[NDArray[np.float64]], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Both parameters (2, n) of the chosen places."""
    return np.array([values[chosen] for values in places])
