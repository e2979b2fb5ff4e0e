"""The machine at its operating speed: the shaft under its weight, and the modes around the speed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipelines.figures import style
from pipelines.figures.axes import limits
from pipelines.figures.campbell import SHAPES, draw_shape, shape_panels
from pipelines.figures.contents import CaseView, MissingDataError, Table

MOST_SHAPES = 12
UNSTABLE: dict[str, Any] = {"color": style.VERMILION, "fontsize": 7.5, "fontweight": "bold"}


@style.in_style
def draw_operating_point(case: CaseView, point: Table) -> Figure:
    """Static deflection with the reactions, and the mode shapes nearest to the rotating speed."""
    if not point.attributes["equilibrium"]:
        raise MissingDataError(f"no equilibrium at the operating speed: {point.attributes['reason']}")
    rpm = float(point.attributes["speed_rpm"])
    nearest = np.argsort(np.abs(point["frequency_rpm"] - rpm), kind="stable")[:MOST_SHAPES]
    shown = np.sort(nearest)
    rows = -(-len(shown) // SHAPES)
    ratios = [1.9] + ([1.45 * rows] if rows else [])
    figure = style.new_figure(1.0 + sum(ratios))
    panels = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    _draw_deflection(panels[0].subplots(), case, point)
    if rows:
        for axes, mode in zip(shape_panels(panels[1], len(shown)), shown.tolist(), strict=True):
            direction = str(point["direction"][mode])
            draw_shape(axes, case, point["mode_shape"][mode], direction)
            decrement = float(point["logarithmic_decrement"][mode])
            axes.set_title(
                f"{mode + 1}: {point['frequency_rpm'][mode]:.0f} rpm, {point['frequency_hertz'][mode]:.4g} Hz"
                f"\n{direction}, decrement {decrement:.3g}",
                fontsize=7.5,
            )
            if decrement < 0.0:
                axes.text(0.5, 0.03, "unstable", transform=axes.transAxes, ha="center", **UNSTABLE)
    title = rf"{case.name}: operating speed {rpm:.0f} rpm, $\bar{{\Omega}}$ = {point.attributes['speed']:.4g}"
    return style.finish(figure, title, case.note)


def _draw_deflection(axes: Axes, case: CaseView, point: Table) -> None:
    """Deflection of the nodes in µm; at the bearings reaction, eccentricity and smallest film."""
    position, deflection = 1e3 * case.machine["node_position"], 1e6 * point["deflection"]
    for axis, (name, colour) in enumerate((("x", style.BLUE), ("y", style.VERMILION))):
        axes.plot(position, deflection[:, axis], color=colour, marker=".", label=name)
    axes.axhline(0.0, color="#333333", linewidth=0.7)
    low, high = limits(np.append(deflection, 0.0), 0.08)
    axes.set_ylim(low, high + 0.45 * (high - low))
    for bearing, node in enumerate(point["bearing_node"].tolist()):
        axes.axvline(position[node], color="#999999", linewidth=0.7, linestyle=":")
        axes.annotate(
            f"bearing {bearing + 1}: {np.hypot(*point['reaction'][bearing]):.4g} N\n"
            f"eccentricity {point['eccentricity'][bearing]:.3f}, "
            f"attitude {np.rad2deg(point['attitude_angle'][bearing]):.0f}°\n"
            f"film {1e6 * point['minimum_film'][bearing]:.3g} µm",
            (position[node], high + 0.42 * (high - low)),
            ha="center",
            va="top",
            fontsize=7,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )
    axes.set_xlabel("along the rotor [mm]")
    axes.set_ylabel("deflection [µm]")
    axes.set_title("static deflection from the line of the bearings' centres")
    axes.legend(loc="upper center")
