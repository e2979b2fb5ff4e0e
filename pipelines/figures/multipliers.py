"""Floquet multipliers along a branch of limit cycles."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis, limits
from pipelines.figures.bifurcation_diagram import EVENT_MARKS, event_looks, event_names
from pipelines.figures.contents import CaseView, Table, branch_title

LARGEST_SHOWN = 1.6  # multipliers beyond this would shrink the unit circle to a dot
CLOSE_UP = (0.75, 1.1)  # moduli shown near the circle, at least
ANGLES = {0: "0", 60: "60", 90: "90\nR4", 120: "120\nR3", 180: "180"}  # strong resonances are named

MULTIPLIER_KINDS = (
    ("complex pair", style.BLUE, "o"),
    ("real, positive", style.GREEN, "^"),
    ("real, negative", style.ORANGE, "v"),
)


@style.in_style
def draw_multipliers(case: CaseView, parameter: str, branch: Table, name: str) -> Figure:
    """Multipliers in the complex plane and near the unrolled circle; moduli against the parameter."""
    multipliers = np.asarray(branch["multipliers"])
    along = np.asarray(branch[parameter], dtype=float)
    norm = Normalize(*limits(along, 0.0))
    figure = style.new_figure(6.6)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.2, 1.0), width_ratios=(1.0, 1.15))
    whole, close = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    moduli = figure.add_subplot(grid[1, :])
    _draw_plane(whole, multipliers, along, norm)
    points = _draw_unrolled(close, multipliers, along, norm, branch)
    figure.colorbar(points, ax=close, pad=0.03, aspect=25).set_label(PARAMETER_AXES[parameter].label)
    _draw_moduli(moduli, multipliers, along, branch, parameter)
    add_parameter_axis(moduli, parameter, case.scales)
    present = set(event_names(branch))
    handles = [
        Line2D([], [], label=mark.label, **mark.look())
        for kind, mark in EVENT_MARKS.items()
        if kind in present
    ]
    handles += [
        Line2D([], [], color=colour, marker=marker, markersize=3.5, linestyle="none", label=label)
        for label, colour, marker in MULTIPLIER_KINDS
    ]
    style.legend_below(figure, handles, 4)
    return style.finish(
        figure, f"{case.name}: Floquet multipliers of {branch_title(name, branch)}", case.note
    )


def _scatter(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], values: NDArray[np.float64], norm: Normalize
) -> PathCollection:
    return axes.scatter(x, y, c=values, cmap=style.PARAMETER_MAP, norm=norm, s=9, linewidths=0, zorder=3)


def _draw_plane(
    axes: Axes, multipliers: NDArray[np.complex128], along: NDArray[np.float64], norm: Normalize
) -> None:
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor="#333333", linewidth=0.9))
    known = np.isfinite(multipliers)
    rows = np.nonzero(known)[0]
    _scatter(axes, multipliers[known].real, multipliers[known].imag, along[rows], norm)
    largest = float(np.max(np.abs(multipliers[known]), initial=1.0))
    reach = 1.15 * min(LARGEST_SHOWN, largest)
    axes.set(
        xlabel=r"Re $\mu$", ylabel=r"Im $\mu$", aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach)
    )
    axes.set_title("complex plane")


def _draw_unrolled(
    axes: Axes,
    multipliers: NDArray[np.complex128],
    along: NDArray[np.float64],
    norm: Normalize,
    branch: Table,
) -> PathCollection:
    """The neighbourhood of the upper half circle, cut open: angle against modulus."""
    known = np.isfinite(multipliers) & (multipliers.imag >= 0.0)
    modulus, angle = np.abs(multipliers[known]), np.degrees(np.angle(multipliers[known]))
    points = _scatter(axes, angle, modulus, along[np.nonzero(known)[0]], norm)
    axes.axhline(1.0, color="#333333", linewidth=0.9)
    for row, kind in enumerate(event_names(branch)):
        if kind == "neutral_saddle":  # its multipliers are not on the circle
            continue
        mark = EVENT_MARKS[kind]
        axes.plot(
            abs(np.degrees(branch["event_angle"][row])),
            1.0,
            marker=mark.marker,
            markersize=9,
            markerfacecolor="none",
            markeredgecolor=mark.colour,
            markeredgewidth=1.4,
            zorder=4,
        )
    top = min(LARGEST_SHOWN, max(CLOSE_UP[1], 1.02 * float(np.max(modulus, initial=1.0))))
    axes.set(xlim=(-6.0, 186.0), ylim=(CLOSE_UP[0], top), title="near the unit circle, cut open")
    axes.set_xticks(list(ANGLES), list(ANGLES.values()))
    axes.set(xlabel=r"arg $\mu$ [°]", ylabel=r"$|\mu|$")
    return points


def _draw_moduli(
    axes: Axes, multipliers: NDArray[np.complex128], along: NDArray[np.float64], branch: Table, parameter: str
) -> None:
    moduli = np.abs(multipliers)
    oscillating = np.abs(multipliers.imag) > 1e-9 * moduli
    parameters = np.broadcast_to(along[:, None], moduli.shape)
    groups = (oscillating, ~oscillating & (multipliers.real > 0.0), ~oscillating & (multipliers.real < 0.0))
    for chosen, (_, colour, marker) in zip(groups, MULTIPLIER_KINDS, strict=True):
        axes.plot(
            parameters[chosen], moduli[chosen], marker, color=colour, markersize=2.4, markeredgewidth=0.0
        )
    axes.axhline(1.0, color="#333333", linewidth=0.9)
    for row, (kind, look) in enumerate(zip(event_names(branch), event_looks(branch), strict=True)):
        value = float(branch[f"event_{parameter}"][row])
        axes.axvline(value, color=EVENT_MARKS[kind].colour, linewidth=1.0, linestyle=":")
        axes.plot(value, 1.0, **look)
    top = min(LARGEST_SHOWN, max(1.15, 1.05 * float(np.nanmax(moduli, initial=1.0))))
    axes.set(ylabel=r"$|\mu|$", ylim=(0.0, top))
    axes.set_xlim(*limits(along, 0.03))
