"""How far the condensed rotor follows the full one: frequencies, decrements, mode shapes, unbalance response."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipelines.figures import style
from pipelines.figures.axes import add_parameter_axis, limits
from pipelines.figures.contents import CaseView, Table


@style.in_style
def draw_condensation(case: CaseView, criticals: Table) -> Figure:
    """Full against condensed rotor on the linearised bearings."""
    figure = style.new_figure(5.8)
    grid = figure.add_gridspec(2, 2)
    _draw_bars(
        figure.add_subplot(grid[0, 0]),
        criticals["full_frequency"],
        criticals["condensed_frequency"],
        r"natural frequency [–]",
        deviation=True,
    )
    _draw_bars(
        figure.add_subplot(grid[1, 0]),
        criticals["full_decrement"],
        criticals["condensed_decrement"],
        "logarithmic decrement [–]",
        deviation=False,
    )
    _draw_assurance(figure.add_subplot(grid[0, 1]), criticals)
    _draw_unbalance(figure.add_subplot(grid[1, 1]), case, criticals)
    return style.finish(figure, f"{case.name}: full and condensed rotor", case.note)


def _draw_bars(axes: Axes, full: np.ndarray, condensed: np.ndarray, label: str, deviation: bool) -> None:
    """Both rotors side by side, mode by mode; the relative deviation above the bars where it is asked for."""
    modes = np.arange(1, len(full) + 1)
    axes.bar(modes - 0.2, full, 0.38, color=style.BLUE, label="full")
    axes.bar(modes + 0.2, condensed, 0.38, color=style.ORANGE, label="condensed")
    if deviation:
        for mode, exact, approximate in zip(modes, full, condensed, strict=True):
            if np.isfinite(exact) and np.isfinite(approximate) and exact != 0.0:
                percent = 100.0 * (approximate / exact - 1.0)
                axes.text(
                    mode, max(exact, approximate), f"{percent:+.2g} %", ha="center", va="bottom", fontsize=6
                )
    axes.axhline(0.0, color="#333333", linewidth=0.6)
    axes.grid(False, axis="x")
    axes.set_xticks(modes)
    axes.set(xlabel="mode", ylabel=label)
    axes.margins(y=0.16)
    axes.legend(loc="best")


def _draw_assurance(axes: Axes, criticals: Table) -> None:
    """Modal assurance criterion: one on the diagonal where the condensed modes are those of the full rotor."""
    assurance = criticals["mac"]
    image = axes.imshow(assurance, vmin=0.0, vmax=1.0, cmap="Blues", origin="lower")
    axes.grid(False)
    for row, column in np.ndindex(*assurance.shape):
        value = float(assurance[row, column])
        if np.isfinite(value):
            axes.text(
                column,
                row,
                f"{value:.2f}",
                ha="center",
                va="center",
                fontsize=6,
                color="white" if value > 0.6 else "#333333",
            )
    for ticks, axis, modes in zip(
        (axes.set_xticks, axes.set_yticks), "xy", assurance.shape[::-1], strict=True
    ):
        ticks(np.arange(modes), [str(mode + 1) for mode in range(modes)])
        axes.tick_params(axis=axis, length=0)
    axes.set(xlabel="mode, condensed rotor", ylabel="mode, full rotor")
    axes.figure.colorbar(image, ax=axes, label="modal assurance criterion [–]", pad=0.02)


def _draw_unbalance(axes: Axes, case: CaseView, criticals: Table) -> None:
    """Amplitudes of the first and last shown stations against the speed, both rotors."""
    speed = criticals["unbalance_speed"]
    full, condensed = (np.abs(criticals[f"unbalance_{rotor}"]) for rotor in ("full", "condensed"))
    full, condensed = full.reshape(len(speed), -1), condensed.reshape(len(speed), -1)
    for column in range(full.shape[1]):
        colour = style.CYCLE[column % len(style.CYCLE)]
        axes.plot(speed, full[:, column], color=colour, linewidth=2.6, alpha=0.4)
        axes.plot(speed, condensed[:, column], color=colour, linewidth=1.0, linestyle=(0, (4, 1.5)))
    axes.set_yscale("log")
    axes.set_xlim(*limits(speed, 0.0))
    axes.set_ylabel("unbalance response [–]")
    add_parameter_axis(axes, "speed", case.scales)
