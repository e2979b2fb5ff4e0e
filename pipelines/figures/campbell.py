"""Campbell diagram: natural frequencies against rotating speed, critical speeds and their mode shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import (
    add_parameter_axis,
    add_right,
    coloured_line,
    gap_handle,
    limits,
    shade_gaps,
)
from pipelines.figures.contents import CaseView, Table

DAMPING_MAP = colormaps["cividis"].with_extremes(under=style.VERMILION)
LARGEST_DAMPING = 0.5  # modes damped more than this are no criticals
SHAPES = 4  # mode shapes in a row
MOST_SHAPES = 12
LINES: dict[str, Any] = {"forward": "-", "backward": (0, (4, 1.5)), "mixed": ":"}
# Colour changes from segment to segment, so dashes are cut out of the whole line in white.
GAPS: dict[str, Any] = {"backward": (0, (1.2, 3.5)), "mixed": (0, (0.9, 0.9))}
DIRECTION_COLOURS = {"forward": style.BLUE, "backward": style.VERMILION, "mixed": style.PURPLE}
END: dict[str, Any] = {
    "linestyle": "none",
    "marker": "|",
    "markersize": 6,
    "color": "#333333",
    "markeredgewidth": 1.0,
}
OBLIQUE = 0.1  # how far along the rotor a horizontal displacement of 1 is drawn, over its length
RESONANCE_MARKS = {
    "principal": ("D", style.VERMILION, r"$2\bar{\Omega}_j/n$"),
    "sum": ("^", style.BLUE, r"$(\bar{\Omega}_j+\bar{\Omega}_k)/n$"),
    "difference": ("v", style.GREEN, r"$|\bar{\Omega}_j-\bar{\Omega}_k|/n$"),
}


@style.in_style
def draw_campbell(case: CaseView, criticals: Table) -> Figure:
    """Frequencies coloured by damping, with critical speeds, their mode shapes and predicted resonances."""
    shapes = min(MOST_SHAPES, len(criticals["critical_speed"]))
    rows = -(-shapes // SHAPES)
    resonances = len(criticals["resonance_frequency"]) if "resonance_frequency" in criticals else 0
    ratios = [3.4] + ([1.25 * rows] if shapes else []) + ([1.1] if resonances else [])
    figure = style.new_figure(1.1 + 1.35 * sum(ratios))
    panels = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    style.legend_below(panels[0], _draw_frequencies(panels[0].subplots(), case, criticals))
    if shapes:
        _draw_shapes(shape_panels(panels[1], shapes), case, criticals)
    if resonances:
        _draw_resonances(panels[-1].subplots(), case, criticals)
    return style.finish(figure, f"{case.name}: Campbell diagram", case.note)


def _draw_frequencies(axes: Axes, case: CaseView, criticals: Table) -> list[Artist]:
    """Draw frequencies over the speed; returns the legend entries."""
    speed, frequency = criticals["speed"], criticals["frequency"]
    damping, direction = criticals["damping_ratio"], criticals["direction"]
    norm = Normalize(0.0, LARGEST_DAMPING)
    lines = None
    for mode in range(frequency.shape[1]):
        lines = coloured_line(
            axes, speed, frequency[:, mode], damping[:, mode], norm, DAMPING_MAP, linewidth=1.6
        )
        for name, gaps in GAPS.items():
            axes.plot(
                speed,
                stretches(frequency[:, mode], direction[:, mode] == name),
                color="white",
                linewidth=2.2,
                linestyle=gaps,
                dash_capstyle="butt",
            )
    top = float(np.nanmax(frequency)) if np.isfinite(frequency).any() else float(np.max(speed))
    top = min(top, 2.0 * float(np.max(speed)))
    axes.plot([0.0, top], [0.0, top], color="#666666", linewidth=0.8, linestyle="-.")
    axes.set_xlim(*limits(speed, 0.0))
    axes.set_ylim(0.0, top)  # modes are followed up to it: their lines leave at the edge
    ends = np.concatenate([inner_ends(speed, frequency[:, mode], top) for mode in range(frequency.shape[1])])
    axes.plot(*ends.T, **END)
    _mark_criticals(axes, criticals)
    axes.set_ylabel(r"natural frequency Im $\lambda$ [–]")
    add_parameter_axis(axes, "speed", case.scales)
    add_right(axes, case.scales.hertz, "natural frequency [Hz]")
    if lines is not None:
        bar = axes.figure.colorbar(lines, ax=axes, extend="both", pad=0.02, aspect=25)
        bar.set_label("damping ratio [–], below 0 unstable")
    handles: list[Artist] = [
        Line2D([], [], color="#333333", linestyle=LINES[name], label=name) for name in LINES
    ]
    handles.append(Line2D([], [], color="#666666", linewidth=0.8, linestyle="-.", label="synchronous"))
    handles.append(_critical_handle())
    if np.any(damping < 0.0):
        handles.append(Line2D([], [], color=style.VERMILION, label="unstable"))
    if len(ends):
        handles.append(Line2D([], [], label="hardly oscillates beyond", **END))
    present = np.isfinite(frequency).any(axis=1)
    if not present.all():
        shade_gaps(axes, speed, present)
        handles.append(gap_handle("no equilibrium"))
    return handles


def inner_ends(speed: NDArray[np.float64], frequency: NDArray[np.float64], top: float) -> NDArray[np.float64]:
    """Where a line below ``top`` begins or ends inside the range of speeds, (ends, 2).

    Beyond that point its mode is too strongly damped to be followed, or the speed has no equilibrium.
    """
    known = np.isfinite(frequency)
    alone = np.zeros(len(speed), dtype=bool)
    alone[1:] |= known[1:] & ~known[:-1]
    alone[:-1] |= known[:-1] & ~known[1:]
    chosen = alone & (frequency < top)
    return np.column_stack([speed[chosen], frequency[chosen]])


def stretches(values: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Values at the chosen points and the point after each, NaN elsewhere: the lines that leave them."""
    kept = chosen.copy()
    kept[1:] |= chosen[:-1]
    return np.where(kept, values, np.nan)


def _critical_handle() -> Line2D:
    return Line2D(
        [],
        [],
        marker="o",
        markersize=6,
        markerfacecolor="white",
        color="none",
        markeredgecolor=style.VERMILION,
        markeredgewidth=1.3,
        label="critical speed",
    )


def _mark_criticals(axes: Axes, criticals: Table) -> None:
    for number, speed in enumerate(criticals["critical_speed"], start=1):
        axes.plot(
            speed,
            speed,
            marker="o",
            markersize=6,
            markerfacecolor="white",
            markeredgecolor=style.VERMILION,
            markeredgewidth=1.3,
            zorder=5,
        )
        axes.annotate(
            str(number),
            (speed, speed),
            textcoords="offset points",
            xytext=(6, -9) if number % 2 else (-10, 5),
            fontsize=7.5,
            color=style.VERMILION,
        )


def _draw_shapes(panels: NDArray[np.object_], case: CaseView, criticals: Table) -> None:
    for number, axes in enumerate(panels):
        direction = str(criticals["critical_direction"][number])
        draw_shape(axes, case, criticals["critical_mode_shape"][number], direction)
        speed = float(criticals["critical_speed"][number])
        damping = float(criticals["critical_damping_ratio"][number])
        axes.set_title(
            rf"{number + 1}: $\bar{{\Omega}}$ = {speed:.3f} ({case.scales.rpm * speed:.0f} rpm)"
            f"\n{direction}, damping {damping:.3f}",
            fontsize=7.5,
        )


def draw_shape(axes: Axes, case: CaseView, mode: NDArray[np.complex128], direction: str) -> None:
    """A mode shape in oblique projection: the orbit of every node, and the bent axis at one instant."""
    position = 1e3 * case.machine["node_position"]
    bearings = case.machine["bearing_node"]
    depth = OBLIQUE * float(position[-1] - position[0])
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 49))
    shape = largest_deflection(mode)
    colour = DIRECTION_COLOURS.get(direction, style.GREY)
    axes.plot(position, np.zeros_like(position), color="#999999", linewidth=0.7)
    orbits = np.real(shape[:, :, None] * turn)
    for place, orbit in zip(position, orbits, strict=True):
        axes.plot(place + depth * orbit[0], orbit[1], color=colour, linewidth=0.5, alpha=0.6)
    axes.plot(position + depth * orbits[:, 0, 0], orbits[:, 1, 0], color=colour, marker=".", markersize=3.5)
    axes.plot(position[bearings], np.zeros(len(bearings)), linestyle="none", marker=6, color="#333333")
    axes.set_ylim(-1.15, 1.15)
    axes.set_yticks((-1.0, 0.0, 1.0))
    axes.xaxis.set_major_locator(MaxNLocator(4))


def shape_panels(figure: SubFigure, shapes: int) -> NDArray[np.object_]:
    """Axes for so many mode shapes, row by row, with their outer labels."""
    rows = -(-shapes // SHAPES)
    grid = figure.subplots(rows, min(SHAPES, shapes), sharex=True, sharey=True, squeeze=False)
    for axes in grid.ravel()[shapes:]:
        axes.set_axis_off()
    for axes in grid[-1]:
        axes.set_xlabel("along the rotor [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("mode shape [–]")
    return grid.ravel()[:shapes]


def largest_deflection(shape: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """A complex mode shape (node, 2) rotated so that its real part is farthest out, largest radius 1.

    Re(u e^{-i a}) has its largest norm for a = arg(sum u^2) / 2.
    """
    phase = 0.5 * np.angle(np.sum(shape**2))
    turned = shape * np.exp(-1j * phase)
    largest = float(np.max(np.linalg.norm(turned, axis=1)))
    return turned / largest if largest > 0.0 else turned


def _draw_resonances(axes: Axes, case: CaseView, criticals: Table) -> None:
    frequency, order = criticals["resonance_frequency"], criticals["resonance_order"]
    kind = criticals["resonance_kind"]
    for name, (marker, colour, label) in RESONANCE_MARKS.items():
        chosen = kind == name
        if not chosen.any():
            continue
        axes.plot(
            frequency[chosen],
            order[chosen],
            linestyle="none",
            marker=marker,
            color=colour,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.5,
            label=label,
        )
    axes.set_yticks(np.unique(order))
    axes.set_ylim(float(order.max()) + 0.6, float(order.min()) - 0.6)
    axes.set_xlim(0.0, limits(frequency, 0.04)[1])
    axes.set_ylabel("order $n$")
    axes.set_title("predicted parametric resonances and anti-resonances")
    add_parameter_axis(axes, "excitation_frequency", case.scales)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05))
