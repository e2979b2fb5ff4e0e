"""Critical speed map: undamped critical speeds over the support stiffness, and that of the bearings."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipelines.figures import style
from pipelines.figures.axes import add_right
from pipelines.figures.contents import CaseView, Table

WHIRL: tuple[tuple[str, str, Any], ...] = (
    ("map_forward", "forward", "-"),
    ("map_backward", "backward", (0, (4, 1.5))),
)
DIRECT: tuple[tuple[str, Any], ...] = (("xx", "-"), ("yy", ":"))


@style.in_style
def draw_critical_map(case: CaseView, criticals: Table) -> Figure:
    """Lines of critical speeds; they are critical where a line of a bearing's stiffness crosses them."""
    figure = style.new_figure(4.6)
    axes = figure.subplots()
    stiffness, speed = criticals["support_stiffness"], criticals["unbalance_speed"]
    handles: list[Artist] = []
    for name, label, dashes in WHIRL:
        axes.loglog(stiffness, criticals[name], color="#555555", linestyle=dashes, linewidth=1.0)
        handles.append(Line2D([], [], color="#555555", linestyle=dashes, linewidth=1.0, label=label))
    for bearing in range(case.bearings):
        colour = style.BEARING_COLOURS[bearing % len(style.BEARING_COLOURS)]
        for axis, (entry, dashes) in enumerate(DIRECT):
            own = criticals["direct_stiffness"][:, bearing, axis]
            shown = np.where(own > 0.0, own, np.nan)
            label = f"$K_{{{entry}}}$ of bearing {bearing + 1}"
            axes.plot(shown, speed, color=colour, linestyle=dashes)
            handles.append(Line2D([], [], color=colour, linestyle=dashes, label=label))
    operation = case.parameters.get("speed")
    if operation is not None:
        axes.axhline(operation, color=style.GREEN, linewidth=0.9, linestyle="-.")
        handles.append(Line2D([], [], color=style.GREEN, linestyle="-.", label="operating speed"))
    axes.set_xlim(float(stiffness[0]), float(stiffness[-1]))
    lines = np.concatenate([criticals[name].ravel() for name, _, _ in WHIRL])
    lowest = min(float(np.nanmin(lines)), float(speed[0]))
    axes.set_ylim(0.8 * lowest, 2.0 * max(float(speed[-1]), operation or 0.0))
    axes.set_xlabel("support stiffness [N/m]")
    axes.set_ylabel(r"undamped critical speed $\bar{\Omega}$ [–]")
    add_right(axes, case.scales.rpm, "[rpm]")
    style.legend_below(figure, handles, 4)
    return style.finish(figure, f"{case.name}: critical speed map of the full rotor", case.note)
