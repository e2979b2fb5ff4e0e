"""Bifurcation tree: journals once per excitation period, along branches of cycles of 1, 2, 4 periods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis, limits
from pipelines.figures.bifurcation_diagram import (
    Curve,
    draw_threaded,
    event_handles,
    event_names,
    stability_handles,
    thread_events,
    turns_colour,
)
from pipelines.figures.contents import CaseView, Table, excitation_periods

MAGNIFIED_BELOW = 0.6  # part of the parameter's range below which the doubled cycles get a panel of their own
MARGIN = 0.12


@style.in_style
def draw_bifurcation_tree(
    case: CaseView, parameter: str, branches: Mapping[str, Table], axis: int = 1
) -> Figure:
    """Position of the first journal at the start of every excitation period against the parameter.

    ``axis`` 0: x, 1: y.

    ``branches`` by name, those of doubled cycles with the attribute ``turns``; at least one with points.
    """
    column = case.journal_coordinates(0)[axis]
    curves = joined_curves(branches, parameter, column)
    whole, doubled = _extents(branches, parameter)
    magnified = doubled is not None and np.ptp(doubled) < MAGNIFIED_BELOW * np.ptp(whole)
    figure = style.new_figure(6.6 if magnified else 4.3)
    panels = list(figure.subplots(2 if magnified else 1, 1, squeeze=False)[:, 0])
    for panel in panels:
        _draw_branches(panel, branches, curves)
        panel.set_ylabel(rf"$\bar{{{'xy'[axis]}}}_1(kT_{{ex}})$ [–]")
    panels[0].set_xlim(*limits(whole, 0.03))
    if magnified and doubled is not None:
        _magnify(panels, curves, limits(doubled, MARGIN))
    for panel in panels:
        case.add_micrometres(panel, "", 0)
    add_parameter_axis(panels[0], parameter, case.scales, bottom=False)
    add_parameter_axis(panels[-1], parameter, case.scales, top=False)
    style.legend_below(figure, _legend(branches), 4)
    title = f"{case.name}: bifurcation tree along the {PARAMETER_AXES[parameter].title}"
    return style.finish(figure, title, case.note)


def stroboscopic(branch: Table, column: int) -> NDArray[np.float64]:
    """A coordinate at the start of every excitation period (point, turns), from the samples of the orbit.

    Where a start falls between two samples, linear in between.
    """
    orbit, turns = np.asarray(branch["orbit"][:, :, column], dtype=float), excitation_periods(branch)
    samples = orbit.shape[1]
    place = np.arange(turns) * samples / turns
    before = place.astype(np.intp)
    share = place - before
    return np.asarray((1.0 - share) * orbit[:, before] + share * orbit[:, (before + 1) % samples])


def joined_curves(branches: Mapping[str, Table], parameter: str, column: int) -> dict[str, Curve]:
    """Every branch with its bifurcations inserted; doubled branches are joined to their period doublings.

    A doubled branch begins at the period doubling that it leaves, and ends at the one to which it
    returns.
    """
    curves = {
        name: thread_events(branch, parameter, stroboscopic(branch, column))
        for name, branch in branches.items()
    }
    return {name: _joined(branches[name], parameter, curve, curves) for name, curve in curves.items()}


def _joined(branch: Table, parameter: str, curve: Curve, curves: Mapping[str, Curve]) -> Curve:
    origin = branch.attributes.get("origin") or {}
    parent = curves.get(str(origin.get("group", "")).removeprefix("cycles/"))
    if parent is None or not 0 <= int(origin["event"]) < len(parent.event_rows):
        return curve
    left = int(origin["event"])
    others = [row for number, row in enumerate(parent.event_rows) if number != left]
    curve = _with_ends(curve, parent, [int(parent.event_rows[left])], [])
    if branch.attributes.get("stop_reason") != "limit" or len(branch["arclength"]) < 2:
        return curve
    # where a doubled branch ends for coming back, a period doubling of its parent is within two steps
    near = 2.0 * float(branch["arclength"][-1] - branch["arclength"][-2])
    last = float(branch[parameter][-1])
    back = sorted(others, key=lambda row: abs(parent.parameter[row] - last))[:1]
    return _with_ends(curve, parent, [], [int(r) for r in back if abs(parent.parameter[r] - last) <= near])


def _with_ends(curve: Curve, parent: Curve, first: list[int], last: list[int]) -> Curve:
    """A curve with rows of its parent added before and after it."""
    repeats = curve.values.shape[1] // parent.values.shape[1]
    values = [np.tile(parent.values[rows], repeats) for rows in (first, last)]
    return Curve(
        np.concatenate([parent.parameter[first], curve.parameter, parent.parameter[last]]),
        np.concatenate([values[0], curve.values, values[1]]),
        np.concatenate([curve.stable[: len(first)], curve.stable, curve.stable[-1:][: len(last)]]),
        curve.event_rows + len(first),
    )


def _extents(
    branches: Mapping[str, Table], parameter: str
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Parameters of all points, and of the points of doubled cycles (None without any)."""
    whole = np.concatenate([branch[parameter] for branch in branches.values()])
    doubled = [branch[parameter] for branch in branches.values() if excitation_periods(branch) > 1]
    return whole, np.concatenate(doubled) if doubled else None


def _magnify(panels: list[Axes], curves: Mapping[str, Curve], interval: tuple[float, float]) -> None:
    """Show the doubled cycles alone in the second panel, and mark its interval in the first."""
    low, high = interval
    inside = [
        curve.values[(curve.parameter >= low) & (curve.parameter <= high)].ravel()
        for curve in curves.values()
    ]
    panels[1].set(xlim=(low, high), ylim=limits(np.concatenate(inside), 0.08))
    panels[0].axvspan(low, high, color=style.PALE_SKY, linewidth=0.0, zorder=0)
    panels[1].set_title("doubled cycles, magnified")


def _draw_branches(axes: Axes, branches: Mapping[str, Table], curves: Mapping[str, Curve]) -> None:
    for name, branch in branches.items():
        draw_threaded(axes, curves[name], branch, _look(excitation_periods(branch)))


def _look(turns: int) -> dict[str, Any]:
    return {"color": turns_colour(turns), "linewidth": 1.3 if turns == 1 else 1.1}


def _legend(branches: Mapping[str, Table]) -> list[Line2D]:
    turns = sorted({excitation_periods(branch) for branch in branches.values()})
    names = {1: r"period $T_{ex}$"}
    handles = [Line2D([], [], label=names.get(n, rf"${n}\,T_{{ex}}$"), **_look(n)) for n in turns]
    kinds = {kind for branch in branches.values() for kind in event_names(branch)}
    return handles + stability_handles() + event_handles(kinds)
