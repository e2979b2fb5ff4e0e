"""Equilibria along the speed: eigenvalues, instability, bearing coefficients, static journal locus.

Coefficients of a bearing are over p0 R L/c and p0 R L t0/c of its own; t0 is that of the machine.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import (
    add_parameter_axis,
    add_right,
    clearance_circle,
    gap_handle,
    limits,
    seconds,
    shade_gaps,
)
from pipelines.figures.contents import CaseView, Table

COEFFICIENTS = (("xx", 0, 0), ("xy", 0, 1), ("yx", 1, 0), ("yy", 1, 1))
SYNCHRONOUS: dict[str, Any] = {"color": "#666666", "linewidth": 0.8, "linestyle": "-."}
LEAST_DAMPED = 4  # eigenvalues of each speed that the growth axis is made for
RATIO_LINES: tuple[Any, ...] = ("-", (0, (4, 1.5)), ":", "-.")


@style.in_style
def draw_linearization(case: CaseView, linear: Table) -> Figure:
    """Growth and frequency of the leading eigenvalues, journal locus, bearing coefficients."""
    figure = style.new_figure(5.2 + 2.2 * case.bearings)
    panels = figure.subplots(2 + case.bearings, 2)
    _draw_eigenvalues(panels[0, 0], panels[0, 1], linear)
    _draw_locus(panels[1, 0], case, linear)
    _draw_minimum_film(panels[1, 1], case, linear)
    for bearing, (stiffness, damping) in enumerate(panels[2:]):
        newton = newton_per_metre(case, bearing)
        _draw_coefficients(stiffness, linear, bearing, "stiffness", r"$\bar{K}$")
        add_right(stiffness, 1e-6 * newton, "[MN/m]")
        _draw_coefficients(damping, linear, bearing, "damping", r"$\bar{C}$")
        add_right(damping, 1e-3 * newton * seconds(case.scales), "[kN s/m]")
    over_speed = [panels[0, 0], panels[0, 1], panels[1, 1], *panels[2:].flat]
    for number, axes in enumerate(over_speed):
        add_parameter_axis(axes, "speed", case.scales, top=number < 2)
    _mark_instability(over_speed, linear)
    for axes in over_speed:
        shade_gaps(axes, linear["speed"], _has_equilibrium(linear))
    style.legend_below(figure, _legend(case, linear))
    instability = instability_speed(linear)
    title = f"{case.name}: equilibria along the rotating speed"
    if np.isfinite(instability):
        rpm = case.scales.rpm * instability
        title += rf", instability at $\bar{{\Omega}}$ = {instability:.4f} ({rpm:.0f} rpm)"
    return style.finish(figure, title, case.note)


def _draw_eigenvalues(growth: Axes, frequency: Axes, linear: Table) -> None:
    speed, eigenvalues = linear["speed"], linear["eigenvalues"]
    along = np.broadcast_to(speed[:, None], eigenvalues.shape)
    upper = np.isfinite(eigenvalues) & (eigenvalues.imag >= 0.0)
    unstable = upper & (eigenvalues.real > 0.0)
    for axes, part in ((growth, eigenvalues.real), (frequency, eigenvalues.imag)):
        axes.plot(along[upper], part[upper], ".", color=style.BLUE, markersize=3.5)
        axes.plot(along[unstable], part[unstable], ".", color=style.VERMILION, markersize=4.5)
        axes.set_xlim(*limits(speed, 0.03))
    growth.axhline(0.0, color="#333333", linewidth=0.9)
    growth.set_ylim(*limits(least_damped(eigenvalues, upper), 0.08))
    growth.set_ylabel(r"growth Re $\lambda$ [–]")
    growth.set_title("the least damped eigenvalues")
    frequency.set_ylim(0.0, 1.1 * float(speed.max()))
    frequency.set_ylabel(r"frequency Im $\lambda$ [–]")
    frequency.set_title("below the synchronous frequency")
    for ratio in (0.5, 1.0):
        frequency.plot(speed, ratio * speed, **SYNCHRONOUS)


def least_damped(eigenvalues: NDArray[np.complex128], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Real parts of the chosen eigenvalues nearest to instability at every speed.

    One strongly damped eigenvalue would hide them all.
    """
    sorted_parts = -np.sort(-np.where(chosen, eigenvalues.real, -np.inf), axis=1)
    return np.asarray(sorted_parts[:, :LEAST_DAMPED])


def instability_speed(linear: Table) -> float:
    """The located instability speed, NaN where none was found."""
    located = linear.attributes.get("instability_speed")
    return float("nan") if located is None else float(located)


def _draw_locus(axes: Axes, case: CaseView, linear: Table) -> None:
    clearance_circle(axes)
    journal = linear["journal"]
    for bearing in range(case.bearings):
        axes.plot(journal[:, bearing, 0], journal[:, bearing, 1], **style.bearing_look(bearing))
    known = np.flatnonzero(_has_equilibrium(linear))
    for row, height in ((int(known[0]), -3), (int(known[-1]), 3)) if known.size else ():
        axes.plot(journal[row, :, 0], journal[row, :, 1], ".", color="#333333", markersize=4)
        axes.annotate(
            rf"$\bar{{\Omega}}$ = {float(linear['speed'][row]):.3g}",
            journal[row, 0],
            textcoords="offset points",
            xytext=(-5 if journal[row, 0, 0] > 0.0 else 5, height),
            ha="right" if journal[row, 0, 0] > 0.0 else "left",
            va="top" if height < 0 else "bottom",
            fontsize=7,
        )
    axes.set(xlim=(-1.08, 1.08), ylim=(-1.08, 1.08), xlabel=r"$\bar{x}_j$ [–]", ylabel=r"$\bar{y}_j$ [–]")
    axes.set_title("static journal locus, clearance dashed")


def _has_equilibrium(linear: Table) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(linear["minimum_film"]).all(axis=1))


def _draw_minimum_film(axes: Axes, case: CaseView, linear: Table) -> None:
    for bearing in range(case.bearings):
        axes.plot(linear["speed"], linear["minimum_film"][:, bearing], **style.bearing_look(bearing))
    axes.set_ylabel(r"minimum film $\bar{h}$ [–]")
    axes.set_ylim(0.0, limits(linear["minimum_film"], 0.1)[1])
    axes.set_xlim(*limits(linear["speed"], 0.03))
    case.add_micrometres(axes, "", apart=0.27)


def newton_per_metre(case: CaseView, bearing: int) -> float:
    """p0 R L/c [N/m] of a bearing, in which its stiffness is stored."""
    radius, length, clearance = (
        float(case.machine[f"bearing_{name}"][bearing]) for name in ("radius", "length", "clearance")
    )
    # k_bar = k c/p0 with the clearance of the first bearing
    pressure = 1e9 * case.scales.stiffness * 1e-6 * case.scales.micrometres
    return pressure * radius * length / clearance


def _draw_coefficients(axes: Axes, linear: Table, bearing: int, title: str, symbol: str) -> None:
    """Coefficients of one bearing, one colour each, one dash per whirl ratio."""
    values = linear[f"bearing_{title}"][:, :, bearing]
    for number, (_, row, column) in enumerate(COEFFICIENTS):
        for ratio in range(values.shape[1]):
            axes.plot(
                linear["speed"],
                values[:, ratio, row, column],
                color=style.CYCLE[number],
                linestyle=RATIO_LINES[ratio % len(RATIO_LINES)],
            )
    axes.axhline(0.0, color="#666666", linewidth=0.6)
    axes.set_ylabel(f"{title} {symbol} [–]")
    axes.set_xlim(*limits(linear["speed"], 0.03))
    axes.set_title(f"{title} of bearing {bearing + 1}")


def _mark_instability(panels: list[Axes], linear: Table) -> None:
    speed = instability_speed(linear)
    if np.isfinite(speed):
        for axes in panels:
            axes.axvline(speed, color=style.VERMILION, linewidth=1.0, linestyle=":")


def _legend(case: CaseView, linear: Table) -> list[Artist]:
    handles: list[Artist] = [
        Line2D([], [], color=style.CYCLE[i], label=name) for i, (name, _, _) in enumerate(COEFFICIENTS)
    ]
    handles += [
        Line2D([], [], label=f"bearing {b + 1}", **style.bearing_look(b)) for b in range(case.bearings)
    ]
    for number, ratio in enumerate(linear["whirl_ratio"]):
        line = RATIO_LINES[number % len(RATIO_LINES)]
        handles.append(Line2D([], [], color="#333333", linestyle=line, label=f"whirl ratio {float(ratio):g}"))
    handles.append(Line2D([], [], label="half and full speed", **SYNCHRONOUS))
    if np.isfinite(instability_speed(linear)):
        handles.append(Line2D([], [], color=style.VERMILION, linestyle=":", label="instability speed"))
    if not _has_equilibrium(linear).all():
        handles.append(gap_handle("no equilibrium"))
    return handles
