"""Bifurcation sets of several cases in one plane, for instance for several displacements of the rings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipelines.datasets.curves import UNKNOWN, BifurcationCurve
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.resonance_lines import draw_resonances, resonance_handles
from pipelines.figures.stability_map import (
    CURVE_KINDS,
    INK,
    PALE,
    THIN,
    PlaneView,
    add_second_axes,
    incomplete_ends,
    parts_of,
    passive_speed,
)

WIDTH = 1.6
# A colour is a case here, so that the line tells the kind of bifurcation.
LINES: dict[str, Any] = {"neimark_sacker": "-", "period_doubling": (0, (4.0, 1.5)), "fold": (0, (1.0, 1.2))}
PASSIVE: dict[str, Any] = {"linewidth": 1.0, "linestyle": (0, (9, 4)), "zorder": 1.5}
LOOSE: dict[str, Any] = {
    "marker": "s", "markersize": 4.0, "markerfacecolor": "white", "markeredgewidth": 1.0, "linestyle": "none",
}  # fmt: skip
SAME_SPEED = 1e-4  # of instability, as far as it is written down


@dataclass(frozen=True)
class Overlay:
    """The set of one of several cases, with what distinguishes the case."""

    label: str
    case: CaseView
    view: PlaneView


@style.in_style
def draw_map_sets(overlays: Sequence[Overlay], title: str) -> Figure:
    """Curves of all cases over the same two parameters, one colour for each case (the paper's Fig. 3)."""
    first = overlays[0].view
    figure = style.new_figure(6.9)
    axes = figure.subplots()
    axes.grid(False)
    for name, limit in ((first.x, axes.set_xlim), (first.y, axes.set_ylim)):
        ranges = [overlay.view.ranges[name] for overlay in overlays]
        limit(min(low for low, _ in ranges), max(high for _, high in ranges))
    axes.set(xlabel=PARAMETER_AXES[first.x].label, ylabel=PARAMETER_AXES[first.y].label)
    handles = [*_draw_cases(axes, overlays), *_kinds_legend(overlays), *_draw_passive_speeds(axes, overlays)]
    top = axes
    criticals = _common_criticals(overlays)
    if criticals is not None and (strip := draw_resonances(axes, criticals)) is not None:
        top, handles = strip, [*handles, *resonance_handles(lines=True, frequencies=False)]
    if all(overlay.case.scales == overlays[0].case.scales for overlay in overlays):
        add_second_axes(axes, top, first, overlays[0].case)
    style.legend_below(figure, handles, 4)
    return style.finish(figure, title, overlays[0].case.note)


def colour_of(number: int) -> str:
    """Colour of the case of this number."""
    return style.CYCLE[number % len(style.CYCLE)]


def _draw_cases(axes: Axes, overlays: Sequence[Overlay]) -> list[Line2D]:
    """Draw the curves of every case; returns the legend of the colours."""
    handles = []
    for number, overlay in enumerate(overlays):
        colour = colour_of(number)
        for curve in overlay.view.curves:
            for look, points in parts_of(_of_one_type(curve), overlay.view):
                axes.plot(
                    points[:, 0],
                    points[:, 1],
                    color=colour,
                    linestyle=LINES[look.bifurcation],
                    linewidth=WIDTH * (THIN if look.doubled else 1.0),
                    alpha=PALE if look.unstable else 1.0,
                    zorder=2.5 if look.unstable or look.doubled else 3.0,
                )
        for _, x, y in incomplete_ends(overlay.view):
            axes.plot(x, y, markeredgecolor=colour, zorder=4, **LOOSE)
        handles.append(Line2D([], [], color=colour, linewidth=2.4, label=overlay.label))
    return handles


def _of_one_type(curve: BifurcationCurve) -> BifurcationCurve:
    """The curve without its criticality, which is not drawn: dashes continue where it changes."""
    return replace(curve, criticality=np.full(len(curve.arclength), UNKNOWN))


def _kinds_legend(overlays: Sequence[Overlay]) -> list[Line2D]:
    """Legend of the lines and open ends that occur."""
    looks = [
        look
        for overlay in overlays
        for curve in overlay.view.curves
        for look, _ in parts_of(_of_one_type(curve), overlay.view)
    ]
    kinds = {look.bifurcation for look in looks}
    handles = [
        Line2D([], [], color=INK, linestyle=line, linewidth=WIDTH, label=CURVE_KINDS[kind][0])
        for kind, line in LINES.items()
        if kind in kinds
    ]
    if any(look.unstable for look in looks):
        handles.append(Line2D([], [], color=INK, alpha=PALE, linewidth=WIDTH, label="of an unstable cycle"))
    if any(look.doubled for look in looks):
        handles.append(Line2D([], [], color=INK, linewidth=WIDTH * THIN, label="of doubled cycles"))
    if any(incomplete_ends(overlay.view) for overlay in overlays):
        handles.append(Line2D([], [], markeredgecolor=INK, label="curve not complete", **LOOSE))
    return handles


def _draw_passive_speeds(axes: Axes, overlays: Sequence[Overlay]) -> list[Line2D]:
    """The instability speed with undeformed rings: one line if the cases share it, else one for each."""
    known = [
        (number, value)
        for number, overlay in enumerate(overlays)
        if (value := passive_speed(overlay.view)) is not None
    ]
    if not known:
        return []
    values = [value for _, value in known]
    if max(values) - min(values) <= SAME_SPEED * max(values):
        line = axes.axhline(values[0], color=INK, **PASSIVE)
        line.set_label(rf"instability at $\bar{{\delta}}=0$: {values[0]:.4g}")
        return [line]
    for number, value in known:
        axes.axhline(value, color=colour_of(number), **PASSIVE)
    return [Line2D([], [], color=INK, label=r"instability at $\bar{\delta}=0$", **PASSIVE)]


def _common_criticals(overlays: Sequence[Overlay]) -> Table | None:
    """The critical speeds that represent all cases: from the least displacement, if foils are alike."""
    foils = {overlay.case.parameters.get("foil_stiffness") for overlay in overlays}
    if len(foils) > 1 or overlays[0].view.x != "excitation_frequency":
        return None
    least = min(overlays, key=lambda overlay: overlay.case.parameters.get("displacement") or 0.0)
    return least.view.others.get("criticals")
