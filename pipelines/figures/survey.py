"""Survey of a plane: growth rates and leading bifurcations, cell by cell, under the curves of the plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_right, add_top
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.stability_map import (
    CURVE_KINDS,
    HORIZONTAL_FIRST,
    INK,
    PlaneView,
    curves_over,
    draw_curves,
)

GROWTH_MAP = "RdBu_r"  # white at zero
SHARE = 98.0  # percentile of the growth rates of unstable cells at which the colours end
SHADES = (0.35, 0.65, 1.0)  # of a kind's colour: one or two unstable multipliers, three or four, more
SHADE_LABELS = ("1–2 multipliers", "3–4 multipliers", "5 or more")
MISSING: dict[str, tuple[str, dict[str, Any]]] = {
    "no_cycle": ("no cycle found", {"facecolor": "#DDDDDD", "hatch": "////"}),
    "no_equilibrium": ("no equilibrium", {"facecolor": "#BBBBBB", "hatch": "...."}),
    "thin_film": ("film below the limit", {"facecolor": "none", "hatch": "xxxx"}),
    "below_vacuum": ("pressure below vacuum", {"facecolor": "none", "hatch": "++++"}),
}
HATCH = {"edgecolor": "#8A8A8A", "linewidth": 0.0, "zorder": 0.6}


@dataclass(frozen=True)
class SurveyMap:
    """A survey with x along the last dimension of every array (y, x)."""

    x: str
    y: str
    abscissae: NDArray[np.float64]
    ordinates: NDArray[np.float64]
    arrays: Mapping[str, NDArray[Any]]

    @classmethod
    def of(cls, table: Table) -> SurveyMap:
        """The computed lines of a survey."""
        along, across = (str(name) for name in table.attributes["parameters"])
        x, _ = sorted((along, across), key=HORIZONTAL_FIRST.index)
        arrays = {name: table[name] for name in ("status", "growth_rate", "bifurcation", "unstable_count")}
        if x == along:
            return cls(along, across, table["along"], table["across"], arrays)
        turned = {name: array.T for name, array in arrays.items()}
        return cls(across, along, table["across"], table["along"], turned)


@style.in_style
def draw_survey(case: CaseView, table: Table, curves: Mapping[str, Table]) -> Figure:
    """Growth rates above, leading bifurcations of unstable cycles below, both under the ``curves``."""
    survey = SurveyMap.of(table)
    figure = style.new_figure(8.6)
    above, below = figure.subplots(2, sharex=True)
    handles = [*_draw_growth(figure, above, survey), *_draw_kinds(below, survey)]
    for axes in (above, below):
        axes.grid(False)
        axes.set(ylabel=PARAMETER_AXES[survey.y].label)
        axes.set(xlim=_limits(survey.abscissae), ylim=_limits(survey.ordinates))
        add_right(axes, *PARAMETER_AXES[survey.y].dimensional(case.scales))
    shown = _draw_missing((above, below), survey)
    below.set_xlabel(PARAMETER_AXES[survey.x].label)
    add_top(above, *PARAMETER_AXES[survey.x].dimensional(case.scales))
    if inside := curves_over(curves, (survey.x, survey.y), started=True):
        view = PlaneView.of(inside, {})
        for axes in (above, below):
            lines = draw_curves(axes, view)
        handles += [line for line in lines if line.get_label() not in {each.get_label() for each in handles}]
    style.legend_below(figure, [*handles, *shown], 4)
    return style.finish(figure, f"{case.name}: survey{_constants(table)}{_progress(table)}", case.note)


def _limits(values: NDArray[np.float64]) -> tuple[float, float]:
    """The outer edges of the cells."""
    return _edges(values, 0)[0], _edges(values, len(values) - 1)[1]


def _draw_growth(figure: Figure, axes: Axes, survey: SurveyMap) -> list[Line2D]:
    """Growth rates in colours that change at zero, and the line of zero growth."""
    growth = np.ma.masked_invalid(survey.arrays["growth_rate"])
    unstable = growth.compressed()[growth.compressed() > 0.0]
    largest = float(np.percentile(unstable, SHARE)) if unstable.size else float(np.abs(growth).max() or 1.0)
    cells = axes.pcolormesh(
        survey.abscissae, survey.ordinates, growth, shading="nearest", cmap=GROWTH_MAP,
        norm=Normalize(-largest, largest), rasterized=True, zorder=0.2,
    )  # fmt: skip
    bar = figure.colorbar(cells, ax=axes, extend="both", pad=0.11, aspect=28)
    bar.set_label("largest growth rate [–]")
    if unstable.size and min(growth.shape) > 1:
        axes.contour(survey.abscissae, survey.ordinates, growth, levels=[0.0], colors=INK, linewidths=0.9)
        return [Line2D([], [], color=INK, linewidth=0.9, label="growth rate 0")]
    return []


def _draw_kinds(axes: Axes, survey: SurveyMap) -> list[Patch]:
    """The bifurcation behind the leading multiplier of unstable cycles, darker with more unstable ones."""
    count = survey.arrays["unstable_count"]
    shade = np.searchsorted([2, 4], np.maximum(count, 1))
    kinds = list(CURVE_KINDS)
    colours = [_pale(CURVE_KINDS[kind][1], share) for kind in kinds for share in SHADES]
    index = np.full(count.shape, -1)
    for number, kind in enumerate(kinds):
        here = (survey.arrays["bifurcation"] == kind) & (count > 0)
        index[here] = len(SHADES) * number + shade[here]
    axes.pcolormesh(
        survey.abscissae, survey.ordinates, np.ma.masked_less(index, 0), shading="nearest",
        cmap=ListedColormap(colours), vmin=-0.5, vmax=len(colours) - 0.5, rasterized=True, zorder=0.2,
    )  # fmt: skip
    found = [kind for number, kind in enumerate(kinds) if np.any(index // len(SHADES) == number)]
    handles = [
        Patch(facecolor=_pale(CURVE_KINDS[kind][1], SHADES[1]), label=f"unstable: {CURVE_KINDS[kind][0]}")
        for kind in found
    ]
    shades = [
        Patch(facecolor=_pale(INK, share), label=label)
        for level, (share, label) in enumerate(zip(SHADES, SHADE_LABELS, strict=True))
        if np.any((index >= 0) & (shade == level))
    ]
    return handles + shades


def _pale(colour: str, share: float) -> str:
    """A colour mixed with white."""
    red, green, blue = (1.0 - share * (1.0 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def _draw_missing(charts: Sequence[Axes], survey: SurveyMap) -> list[Patch]:
    """Cells without a cycle, or with one that cannot be, hatched."""
    handles = []
    for status, (label, look) in MISSING.items():
        rows, columns = np.nonzero(survey.arrays["status"] == status)
        if not rows.size:
            continue
        handles.append(Patch(label=label, **{**HATCH, **look}))
        for axes in charts:
            for row, column in zip(rows, columns, strict=True):
                left, right = _edges(survey.abscissae, int(column))
                low, high = _edges(survey.ordinates, int(row))
                cell = Rectangle((left, low), right - left, high - low, **{**HATCH, **look})
                axes.add_patch(cell)
    return handles


def _edges(values: NDArray[np.float64], index: int) -> tuple[float, float]:
    """The edges of a cell of equally spaced values."""
    half = 0.5 * float(values[1] - values[0]) if len(values) > 1 else 0.5 * abs(float(values[0]))
    return float(values[index]) - half, float(values[index]) + half


def _constants(table: Table) -> str:
    """The parameters that are constant over the plane."""
    constants = table.attributes.get("constants", {})
    known = [
        f"{PARAMETER_AXES[name].symbol} = {constants[name]:.4g}"
        for name in ("displacement", "foil_stiffness")
        if constants.get(name) is not None
    ]
    return " at " + ", ".join(known) if known else ""


def _progress(table: Table) -> str:
    return " (running)" if table.attributes.get("status") == "running" else ""
