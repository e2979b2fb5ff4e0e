"""Floquet multipliers along a branch of limit cycles."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis, limits
from pipelines.figures.bifurcation_diagram import EVENT_MARKS, event_handle, event_names
from pipelines.figures.contents import CaseView, Table

CLOSE_UP = 0.16  # half width of the window near the unit circle
LARGEST_SHOWN = 1.6  # multipliers beyond this would shrink the unit circle to a dot


@style.in_style
def draw_multipliers(case: CaseView, parameter: str, branch: Table, name: str) -> Figure:
    """Multipliers in the complex plane, near the circle, and their moduli against the continued parameter."""
    multipliers = np.asarray(branch["multipliers"])
    along = np.asarray(branch[parameter], dtype=float)
    norm = Normalize(float(along.min()), float(along.max()) if len(along) > 1 else float(along.min()) + 1e-6)
    figure = style.new_figure(6.6)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0))
    whole, close = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    moduli = figure.add_subplot(grid[1, :])

    points = _draw_plane(whole, multipliers, along, norm)
    reach = min(LARGEST_SHOWN, 1.15 * max(1.0, float(np.nanmax(np.abs(multipliers)))))
    whole.set(xlim=(-reach, reach), ylim=(-reach, reach), title="all multipliers")
    centre = window_centre(branch, multipliers)
    _draw_plane(close, multipliers, along, norm)
    _mark_events(close, branch)
    close.set(
        xlim=(centre.real - CLOSE_UP, centre.real + CLOSE_UP),
        ylim=(centre.imag - CLOSE_UP, centre.imag + CLOSE_UP),
        title="near the unit circle",
    )
    whole.add_patch(
        Rectangle(
            (centre.real - CLOSE_UP, centre.imag - CLOSE_UP),
            2 * CLOSE_UP,
            2 * CLOSE_UP,
            fill=False,
            edgecolor=style.VERMILION,
            linewidth=0.9,
        )
    )
    bar = figure.colorbar(points, ax=[whole, close], pad=0.02, aspect=25)
    bar.set_label(PARAMETER_AXES[parameter].label)
    _draw_moduli(moduli, multipliers, along, branch, parameter)
    add_parameter_axis(moduli, parameter, case.scales)
    kinds = set(event_names(branch))
    handles = [event_handle(mark) for kind, mark in EVENT_MARKS.items() if kind in kinds]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return style.finish(figure, f"{case.name}: Floquet multipliers of branch {name}", case.note)


def window_centre(branch: Table, multipliers: NDArray[np.complex128]) -> complex:
    """Where to look closely: a crossing if one was located, else the multiplier which came nearest to the circle.

    Of a complex pair the upper one.
    """
    if "event_multipliers" in branch and len(branch["event_multipliers"]):
        candidates = np.asarray(branch["event_multipliers"][0])
    else:
        candidates = multipliers[np.unravel_index(np.nanargmax(np.abs(multipliers)), multipliers.shape)[0]]
    candidates = candidates[np.isfinite(candidates)]
    nearest = complex(candidates[np.argmin(np.abs(np.abs(candidates) - 1.0))])
    return complex(nearest.real, abs(nearest.imag))


def _draw_plane(
    axes: Axes, multipliers: NDArray[np.complex128], along: NDArray[np.float64], norm: Normalize
) -> PathCollection:
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor="#333333", linewidth=0.9))
    axes.axhline(0.0, color="#BBBBBB", linewidth=0.5, zorder=0)
    axes.axvline(0.0, color="#BBBBBB", linewidth=0.5, zorder=0)
    rows, _ = np.nonzero(np.isfinite(multipliers))
    known = multipliers[np.isfinite(multipliers)]
    points = axes.scatter(
        known.real,
        known.imag,
        c=along[rows],
        cmap=style.PARAMETER_MAP,
        norm=norm,
        s=9,
        linewidths=0,
        zorder=3,
    )
    axes.set(xlabel=r"Re $\mu$", ylabel=r"Im $\mu$", aspect="equal")
    return points


def _mark_events(axes: Axes, branch: Table) -> None:
    for row, kind in enumerate(event_names(branch)):
        mark = EVENT_MARKS[kind]
        multipliers = np.asarray(branch["event_multipliers"][row])
        multipliers = multipliers[np.isfinite(multipliers)]
        critical = multipliers[np.argmin(np.abs(np.abs(multipliers) - 1.0))]
        for value in {complex(critical), complex(critical.conjugate())}:
            axes.plot(
                value.real,
                value.imag,
                marker=mark.marker,
                markersize=9,
                markerfacecolor="none",
                markeredgecolor=mark.colour,
                markeredgewidth=1.4,
                linestyle="none",
                zorder=4,
            )


def _draw_moduli(
    axes: Axes, multipliers: NDArray[np.complex128], along: NDArray[np.float64], branch: Table, parameter: str
) -> None:
    moduli = np.abs(multipliers)
    oscillating = np.abs(multipliers.imag) > 1e-9 * moduli
    along_all = np.broadcast_to(along[:, None], moduli.shape)
    for chosen, colour, label in (
        (oscillating, style.BLUE, "complex pairs"),
        (~oscillating & (multipliers.real > 0), style.GREEN, "real positive"),
        (~oscillating & (multipliers.real < 0), style.ORANGE, "real negative"),
    ):
        axes.plot(along_all[chosen], moduli[chosen], ".", color=colour, markersize=3.0, label=label)
    axes.axhline(1.0, color="#333333", linewidth=0.9)
    for row, kind in enumerate(event_names(branch)):
        mark = EVENT_MARKS[kind]
        value = float(branch[f"event_{parameter}"][row])
        axes.axvline(value, color=mark.colour, linewidth=1.0, linestyle=":")
        axes.plot(
            value,
            1.0,
            marker=mark.marker,
            markersize=5.5,
            color=mark.colour,
            markeredgecolor="white",
            zorder=5,
        )
    top = min(LARGEST_SHOWN, max(1.15, 1.05 * float(np.nanmax(moduli))))
    axes.set(ylabel=r"$|\mu|$", ylim=(0.0, top))
    axes.set_xlim(*limits(along, 0.03))
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title="multipliers")
