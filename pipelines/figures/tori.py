"""Tori: their extent and rotation number along a parameter, and their invariant curves on the section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis, limits
from pipelines.figures.bifurcation_diagram import (
    Curve,
    draw_threaded,
    envelope,
    event_handles,
    event_names,
    stability_handles,
    thread_events,
)
from pipelines.figures.contents import CaseView, Table, stable_points
from pipelines.figures.orbits import representative_points

CURVES = 8  # invariant curves drawn together
ROOM = 0.3  # of the parameter's range of the tori, on either side, in which cycles are shown
CYCLE_LOOK: Mapping[str, Any] = {"color": style.GREY, "linewidth": 1.0}
ROTATION_LOOK: Mapping[str, Any] = {"color": style.GREEN, "linewidth": 1.3}


def is_unbalanced(tori: Table) -> bool:
    """Whether a branch of tori is driven by unbalance, not born at a Neimark-Sacker point."""
    return "unbalance" in tori.attributes


@style.in_style
def draw_tori(case: CaseView, parameter: str, tori: Sequence[Table], cycles: Sequence[Table] = ()) -> Figure:
    """Extremes of the journals over each torus, extremes of the cycles behind them, and the rotation number.

    ``tori``: at least one branch with points; ``cycles``: branches along the same parameter.
    """
    figure = style.new_figure(7.0)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 0.8))
    along = np.concatenate([branch[parameter] for branch in tori])
    interval = limits(along, ROOM)
    for axes, axis, name in zip(panels, (1, 0), ("vertical", "horizontal"), strict=False):
        shown = [
            _draw(axes, branch, parameter, envelope(axis)(case, branch, bearing), look)
            for bearing in range(case.bearings)
            for branches, look in ((cycles, CYCLE_LOOK), (tori, style.bearing_look(bearing)))
            for branch in branches
        ]
        axes.set_ylim(*limits(np.concatenate([_inside(curve, interval) for curve in shown]), 0.08))
        axes.set_ylabel(rf"{name} $\bar{{{'xy'[axis]}}}_j$ [–]")
        case.add_micrometres(axes, "")
    for branch in tori:
        turns = np.asarray(branch["rotation"], dtype=float)[:, None] / (2.0 * np.pi)
        _draw(panels[2], branch, parameter, turns, ROTATION_LOOK)
    panels[2].set_ylabel(r"rotation $\rho/2\pi$ [–]")
    panels[0].set_xlim(*interval)
    add_parameter_axis(panels[0], parameter, case.scales, bottom=False)
    add_parameter_axis(panels[-1], parameter, case.scales, top=False)
    style.legend_below(figure, _legend(case.bearings, tori, cycles), 4)
    kind = "with unbalance" if is_unbalanced(tori[0]) else "born at Neimark–Sacker points"
    title = f"{case.name}: tori {kind}, along the {PARAMETER_AXES[parameter].title}"
    return style.finish(figure, title, case.note)


def _draw(
    axes: Axes, branch: Table, parameter: str, values: NDArray[np.float64], look: Mapping[str, Any]
) -> Curve:
    """Values (point, k) of a branch with its bifurcations."""
    curve = thread_events(branch, parameter, values)
    draw_threaded(axes, curve, branch, look)
    return curve


def _inside(curve: Curve, interval: tuple[float, float]) -> NDArray[np.float64]:
    """The visible values of a curve."""
    shown = (curve.parameter >= interval[0]) & (curve.parameter <= interval[1])
    return curve.values[shown].ravel()


def _stability_handles(tori: Sequence[Table]) -> list[Line2D]:
    """Legend entries of the stability; tori whose stability is open are drawn as unstable."""
    open_ones = any(np.any(branch["unstable_count"] < 0) for branch in tori)
    return stability_handles(unstable="unstable or open" if open_ones else "unstable")


def _legend(bearings: int, tori: Sequence[Table], cycles: Sequence[Table]) -> list[Line2D]:
    handles = [
        Line2D([], [], label=f"torus, bearing {bearing + 1}", **style.bearing_look(bearing))
        for bearing in range(bearings)
    ]
    if cycles:
        handles.append(Line2D([], [], label="cycles", **CYCLE_LOOK))
    handles.append(Line2D([], [], label="rotation number", **ROTATION_LOOK))
    handles += _stability_handles(tori)
    return handles + event_handles({kind for branch in (*cycles, *tori) for kind in event_names(branch)})


@style.in_style
def draw_section(case: CaseView, parameter: str, tori: Table, name: str) -> Figure:
    """Invariant curves of each journal at the start of the excitation period, coloured by the parameter."""
    figure = style.new_figure(4.2)
    panels = figure.subplots(1, case.bearings, squeeze=False)[0]
    points, stable = representative_points(tori, CURVES), stable_points(tori)
    values = np.asarray(tori[parameter], dtype=float)
    norm = Normalize(*limits(values[points], 0.0))
    colours = ScalarMappable(norm, style.PARAMETER_MAP)
    for bearing, axes in enumerate(panels):
        for point in points:
            curve = case.journal(tori["section_curve"][point], bearing)
            closed = np.vstack([curve, curve[:1]])
            line = "-" if stable[point] else style.UNSTABLE
            axes.plot(*closed.T, linestyle=line, color=colours.to_rgba(values[point]))
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.08)
        axes.set(title=f"bearing {bearing + 1}", xlabel=r"$\bar{x}_j(kT_{ex})$ [–]")
    panels[0].set_ylabel(r"$\bar{y}_j(kT_{ex})$ [–]")
    figure.colorbar(colours, ax=list(panels), label=PARAMETER_AXES[parameter].label, shrink=0.9)
    style.legend_below(figure, _stability_handles([tori]))
    return style.finish(figure, f"{case.name}: invariant curves on the section, branch {name}", case.note)
