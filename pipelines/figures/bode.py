"""Unbalance response over the speed: amplitude and phase at the probes (Bode plot)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import add_parameter_axis, add_right, limits
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.linearization import instability_speed

MOST_PROBES = 4
AXES = ("x", "y")
COLOURS = (style.BLUE, style.VERMILION)
IMPORTANT = 2.5  # API Std 684: a peak with a larger amplification factor is a critical speed
UNSTABLE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": style.UNSTABLE}


@style.in_style
def draw_bode(case: CaseView, response: Table, linear: Table | None = None) -> Figure:
    """Amplitude above phase for every probe, all planes together; peaks with their amplification factors.

    ``linear``: the group of `agfb linearize`, whose instability speed is marked.
    """
    nodes = response["probe_node"][:MOST_PROBES]
    total = response["response"].sum(axis=1)
    figure = style.new_figure(1.0 + 2.6 * len(nodes))
    panels = figure.subplots(2 * len(nodes), 1, squeeze=False, sharex=True, height_ratios=[2, 1] * len(nodes))
    for number, node in enumerate(nodes):
        amplitude, phase = panels[2 * number, 0], panels[2 * number + 1, 0]
        _draw_amplitude(amplitude, case, response, total[:, number], number)
        _draw_phase(phase, response["speed"], total[:, number])
        amplitude.set_title(f"node {node}")
        add_parameter_axis(amplitude, "speed", case.scales, bottom=False, top=number == 0)
    add_parameter_axis(panels[-1, 0], "speed", case.scales, top=False)
    panels[0, 0].set_xlim(*limits(response["speed"], 0.0))
    handles = [Line2D([], [], color=colour, label=axis) for axis, colour in zip(AXES, COLOURS, strict=True)]
    if linear is not None and np.isfinite(instability := instability_speed(linear)):
        for axes in panels.flat:
            axes.axvline(instability, **UNSTABLE)
        handles.append(Line2D([], [], label="above: the equilibrium is unstable", **UNSTABLE))
    style.legend_below(figure, handles)
    more = len(response["probe_node"]) - len(nodes)
    title = f"{case.name}: unbalance response" + (f", {more} more probes in the store" if more else "")
    return style.finish(figure, title, case.note)


def _draw_amplitude(
    axes: Axes, case: CaseView, response: Table, motion: NDArray[np.complex128], probe: int
) -> None:
    for axis, (name, colour) in enumerate(zip(AXES, COLOURS, strict=True)):
        axes.plot(response["speed"], np.abs(motion[:, axis]), color=colour)
        own = (response["peak_probe"] == probe) & (response["peak_axis"] == name)
        for speed, amplitude, factor in zip(
            response["peak_speed"][own],
            response["peak_amplitude"][own],
            response["peak_amplification"][own],
            strict=True,
        ):
            axes.plot(speed, amplitude, "o", color=colour, markersize=3.5)
            if factor >= IMPORTANT:
                axes.annotate(
                    f"{factor:.3g}",
                    (speed, amplitude),
                    xytext=(0, 3),
                    textcoords="offset points",
                    ha="center",
                    va="bottom",
                    fontsize=7,
                    color=colour,
                )
    axes.set_ylim(0.0, 1.15 * float(np.abs(motion).max()) or 1.0)
    axes.set_ylabel("amplitude / clearance")
    add_right(axes, case.scales.micrometres, "[µm]")


def _draw_phase(axes: Axes, speed: NDArray[np.float64], motion: NDArray[np.complex128]) -> None:
    """Phase ahead of the rotor's mark in degrees, followed continuously from the lowest speed."""
    for axis, colour in enumerate(COLOURS):
        axes.plot(speed, np.rad2deg(np.unwrap(np.angle(motion[:, axis]))), color=colour)
    axes.yaxis.set_major_locator(MultipleLocator(90.0))
    axes.set_ylabel("phase [°]")
