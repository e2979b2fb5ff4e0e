"""Agreement of the condensed and the full rotor: frequencies, damping, shapes, unbalance response."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import add_parameter_axis, add_right, limits
from pipelines.figures.contents import CaseView, Table

FloatArray = NDArray[np.float64]

LEAST_PRINTED = 0.05  # smaller values of the criterion are left to the colour
FULL_LINE: dict[str, Any] = {"linewidth": 2.6, "alpha": 0.4}
CONDENSED_LINE: dict[str, Any] = {"linewidth": 1.0, "linestyle": (0, (4, 1.5))}


@style.in_style
def draw_condensation(case: CaseView, criticals: Table) -> Figure:
    """Full against condensed rotor on the linearised bearings."""
    figure = style.new_figure(5.8)
    grid = figure.add_gridspec(2, 2)
    frequencies = figure.add_subplot(grid[0, 0])
    _draw_bars(
        frequencies,
        criticals["full_frequency"],
        criticals["condensed_frequency"],
        r"natural frequency [–]",
        deviation=True,
    )
    add_right(frequencies, case.scales.hertz, "[Hz]")
    frequencies.set_title(_near_operation(case, criticals))
    _draw_bars(
        figure.add_subplot(grid[1, 0]),
        criticals["full_decrement"],
        criticals["condensed_decrement"],
        "logarithmic decrement [–]",
        deviation=False,
    )
    _draw_assurance(figure.add_subplot(grid[0, 1]), criticals)
    handles = _draw_unbalance(figure.add_subplot(grid[1, 1]), case, criticals)
    bars = [Patch(color=style.BLUE, label="full"), Patch(color=style.ORANGE, label="condensed")]
    style.legend_below(figure, [*bars, *handles], 7)
    title, error = f"{case.name}: full and condensed rotor", criticals.attributes.get("condensation_error")
    if error is not None:
        title += f", modes below the highest speed up to {100.0 * error:.2g} % off"
    return style.finish(figure, title, case.note)


def _near_operation(case: CaseView, criticals: Table) -> str:
    """At which speed the modes are compared."""
    speed = criticals.attributes.get("compared_speed")
    return "" if speed is None else f"at {case.scales.rpm * speed:.0f} rpm, K and C of synchronous whirl"


def _draw_bars(axes: Axes, full: FloatArray, condensed: FloatArray, label: str, deviation: bool) -> None:
    """Both rotors side by side, mode by mode; relative deviations above the bars on request."""
    modes = np.arange(1, len(full) + 1)
    axes.bar(modes - 0.2, full, 0.38, color=style.BLUE, label="full")
    axes.bar(modes + 0.2, condensed, 0.38, color=style.ORANGE, label="condensed")
    if deviation:
        for mode, exact, approximate in zip(modes.tolist(), full, condensed, strict=True):
            if np.isfinite(exact) and np.isfinite(approximate) and exact != 0.0:
                percent = 100.0 * (approximate / exact - 1.0)
                axes.text(
                    mode,
                    max(exact, approximate),
                    f" {percent:+.2g} %",
                    ha="center",
                    va="bottom",
                    fontsize=6.5,
                    rotation=90,
                )
    axes.axhline(0.0, color="#333333", linewidth=0.6)
    axes.grid(False, axis="x")
    axes.set_xticks(modes)
    axes.set(xlabel="mode", ylabel=label)
    axes.margins(y=0.3)


def _draw_assurance(axes: Axes, criticals: Table) -> None:
    """Modal assurance criterion: one on the diagonal where both rotors have the same modes."""
    assurance = criticals["mac"]
    axes.imshow(assurance, vmin=0.0, vmax=1.0, cmap="Blues", origin="lower", aspect="auto")
    axes.grid(False)
    for row, column in np.ndindex(*assurance.shape):
        value = float(assurance[row, column])
        if np.isfinite(value) and value >= LEAST_PRINTED:
            axes.text(
                column,
                row,
                f"{value:.2f}",
                ha="center",
                va="center",
                fontsize=6,
                color="white" if value > 0.6 else "#333333",
            )
    rows, columns = assurance.shape
    axes.set_xticks(np.arange(columns), [str(mode + 1) for mode in range(columns)])
    axes.set_yticks(np.arange(rows), [str(mode + 1) for mode in range(rows)])
    axes.tick_params(length=0)
    axes.set(xlabel="mode, condensed rotor", ylabel="mode, full rotor")
    axes.set_title("modal assurance criterion")


def _draw_unbalance(axes: Axes, case: CaseView, criticals: Table) -> list[Line2D]:
    """Draw the amplitude at every response node over the speed, both rotors; returns the legend entries."""
    speed, nodes = criticals["unbalance_speed"], criticals["response_node"]
    for column in range(len(nodes)):
        colour = style.CYCLE[(column + 2) % len(style.CYCLE)]
        axes.plot(speed, criticals["unbalance_full"][:, column], color=colour, **FULL_LINE)
        axes.plot(speed, criticals["unbalance_condensed"][:, column], color=colour, **CONDENSED_LINE)
    axes.set_yscale("log")
    axes.set_xlim(*limits(speed, 0.0))
    axes.set_ylabel("unbalance response [–]")
    add_parameter_axis(axes, "speed", case.scales)
    add_right(axes, case.scales.micrometres, "unbalance response [µm]")
    eccentricity = criticals.attributes.get("unbalance_eccentricity")
    if eccentricity is not None:
        axes.set_title(f"unbalance: mass times {1e2 * eccentricity:g} % of the clearance")
    return [
        *(
            Line2D([], [], color=style.CYCLE[(i + 2) % len(style.CYCLE)], label=f"node {n}")
            for i, n in enumerate(nodes)
        ),
        Line2D([], [], color="#555555", label="full", **FULL_LINE),
        Line2D([], [], color="#555555", label="condensed", **CONDENSED_LINE),
    ]
