"""Unbalance response as polar plots: amplitude and phase at the probes, the speed along the line."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.bode import AXES, COLOURS, MOST_PROBES
from pipelines.figures.contents import CaseView, Table

LABELS = 5  # speeds named along a line
APART = 0.06  # of the largest amplitude: labels nearer to each other are left out


@style.in_style
def draw_polar(case: CaseView, response: Table) -> Figure:
    """Amplitude in µm over the phase ahead of the rotor's mark, all planes together, probe by probe."""
    nodes = response["probe_node"][:MOST_PROBES]
    motion = response["response"].sum(axis=1) * case.scales.micrometres
    columns = min(2, len(nodes))
    rows = -(-len(nodes) // columns)
    figure = style.new_figure(1.1 + 3.5 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"}).ravel()
    rpm = case.scales.rpm * response["speed"]
    for number, node in enumerate(nodes):
        for axis, colour in enumerate(COLOURS):
            _draw_line(panels[number], motion[:, number, axis], rpm, colour)
        panels[number].set_title(f"node {node}, amplitude [µm]", pad=12)
        panels[number].set_rlabel_position(67.5)
    for axes in panels[len(nodes) :]:
        axes.set_axis_off()
    handles = [Line2D([], [], color=colour, label=axis) for axis, colour in zip(AXES, COLOURS, strict=True)]
    style.legend_below(figure, handles)
    title = f"{case.name}: unbalance response, phase ahead of the rotor's mark, speeds in rpm"
    return style.finish(figure, title, case.note)


def _draw_line(
    axes: PolarAxes, motion: NDArray[np.complex128], rpm: NDArray[np.float64], colour: str
) -> None:
    """The tip of the phasor over the speed, with some speeds written beside it."""
    axes.plot(np.angle(motion), np.abs(motion), color=colour)
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motion)))])
    places = np.searchsorted(length, np.linspace(0.0, length[-1], LABELS)).clip(0, len(rpm) - 1)
    named: list[complex] = []
    for place in dict.fromkeys(places.tolist()):
        tip = complex(motion[place])
        if any(abs(tip - other) < APART * float(np.abs(motion).max()) for other in named):
            continue
        named.append(tip)
        axes.plot(np.angle(tip), abs(tip), "o", color=colour, markersize=3)
        axes.annotate(
            f"{rpm[place]:.0f}",
            (float(np.angle(tip)), abs(tip)),
            xytext=(3, 3),
            textcoords="offset points",
            fontsize=6.5,
            color=colour,
        )
