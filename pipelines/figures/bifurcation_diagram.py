"""Response envelope of the journals along branches of limit cycles, with stability and bifurcations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis, limits
from pipelines.figures.contents import CaseView, Table, stable_points
from pipelines.figures.refinement import draw_bar, event_bars, legend_handles


@dataclass(frozen=True)
class EventMark:
    """Marker of a bifurcation."""

    label: str
    marker: str
    colour: str

    def look(self, located: bool = True) -> dict[str, Any]:
        """Marker options; hollow where the bifurcation was detected between two points but not located."""
        return {
            "marker": self.marker,
            "markersize": 5.5,
            "linestyle": "none",
            "markerfacecolor": self.colour if located else "white",
            "markeredgecolor": "white" if located else self.colour,
            "markeredgewidth": 0.6 if located else 1.2,
        }


EVENT_MARKS = {
    "fold": EventMark("fold (LPC)", "s", style.GREEN),
    "period_doubling": EventMark("period doubling (PD)", "D", style.ORANGE),
    "neimark_sacker": EventMark("Neimark–Sacker (NS)", "o", style.PURPLE),
    "branch_point": EventMark("branch point (BP)", "^", style.BLACK),
    "neutral_saddle": EventMark("neutral saddle", "X", style.GREY),
    "hopf": EventMark("Hopf bifurcation of a torus", "o", style.PURPLE),
    "unknown": EventMark("bifurcation of a torus", "*", style.BLACK),
    "own_period_doubling": EventMark("period doubling of half the period", "d", style.ORANGE),
}


# Cycles of 1, 2, 4 and 8 excitation periods.
TURNS_COLOURS = {1: style.BLACK, 2: style.VERMILION, 4: style.BLUE, 8: style.GREEN}


def turns_colour(turns: int) -> str:
    """Colour of cycles of ``turns`` excitation periods when several kinds share a diagram."""
    return TURNS_COLOURS.get(turns, style.GREY)


@dataclass(frozen=True)
class Curve:
    """A branch with its bifurcation points inserted: parameter (n,), values (n, k), stable (n - 1,)."""

    parameter: NDArray[np.float64]
    values: NDArray[np.float64]
    stable: NDArray[np.bool_]
    event_rows: NDArray[np.intp]


def thread_events(branch: Table, parameter: str, values: NDArray[np.float64]) -> Curve:
    """Insert the located bifurcations between the points around them.

    A store keeps the parameter and the state of a bifurcation, not its envelope: ``values`` (point, k) are
    read off between the neighbours, at the fraction of the way which the state has gone.
    """
    along = np.asarray(branch[parameter], dtype=float)
    stable, after = stable_points(branch), event_neighbours(branch)
    if len(after) == 0:
        return Curve(along, values, stable[:-1] & stable[1:], after)
    beyond = np.minimum(after + 1, len(along) - 1)
    fraction = _fraction(branch, after, beyond)
    events = values[after] + fraction[:, None] * (values[beyond] - values[after])
    place = np.concatenate([np.arange(len(along), dtype=float), after + np.clip(fraction, 1e-6, 1.0 - 1e-6)])
    order = np.argsort(place)
    is_point, place = order < len(along), place[order]
    # Up to a bifurcation a stretch is as stable as the point before it, from there on as the point behind it.
    left = stable[np.floor(place[:-1]).astype(int)]
    right = stable[np.minimum(np.ceil(place[1:]).astype(int), len(along) - 1)]
    stretch = np.where(is_point[1:], np.where(is_point[:-1], left & right, right), left)
    parameters = np.concatenate([along, branch[f"event_{parameter}"]])
    return Curve(
        parameters[order], np.concatenate([values, events])[order], stretch, np.argsort(order)[len(along) :]
    )


def event_neighbours(branch: Table) -> NDArray[np.intp]:
    """Point before each located bifurcation (event,); empty where the store keeps no bifurcations."""
    if "event_after_point" not in branch:
        return np.zeros(0, dtype=np.intp)
    return np.asarray(branch["event_after_point"], dtype=np.intp)


def _fraction(branch: Table, before: NDArray[np.intp], beyond: NDArray[np.intp]) -> NDArray[np.float64]:
    """Position between 0 and 1 of each bifurcation between its two neighbours.

    From the arclength, where the store keeps it, else in state space.
    """
    if "event_arclength" in branch:
        arclength = branch["arclength"]
        length = arclength[beyond] - arclength[before]
        return np.asarray(
            (branch["event_arclength"] - arclength[before]) / np.where(length > 0.0, length, 1.0)
        )
    state, events = branch["state"], branch["event_state"]
    from_start = np.linalg.norm(events - state[before], axis=1)
    to_end = np.linalg.norm(state[beyond] - events, axis=1)
    whole = from_start + to_end
    return np.asarray(np.where(whole > 0.0, from_start / np.where(whole > 0.0, whole, 1.0), 0.5))


def event_names(branch: Table) -> list[str]:
    """Names of the located bifurcations of a branch, in order."""
    return [str(name) for name in branch["event_kind"]] if "event_kind" in branch else []


def event_looks(branch: Table) -> list[dict[str, Any]]:
    """Marker options of every bifurcation of a branch, in order."""
    located = np.isfinite(branch.optional("event_residual"))
    return [EVENT_MARKS[kind].look(bool(ok)) for kind, ok in zip(event_names(branch), located, strict=True)]


@style.in_style
def draw_bifurcation_diagram(
    case: CaseView, parameter: str, branches: Sequence[Table], refinement: Table | None = None
) -> Figure:
    """Envelope of the vertical and horizontal journal motion, and its largest eccentricity.

    Bifurcations in the group ``refinement`` are drawn with the errors of their parameter.
    """
    figure = style.new_figure(7.4)
    panels = figure.subplots(3, 1, sharex=True)
    quantities = (envelope(1), envelope(0), largest_eccentricity)
    labels = (r"vertical $\bar{y}_j$ [–]", r"horizontal $\bar{x}_j$ [–]", r"$\max\,|\bar{r}_j|$ [–]")
    twins = ("vertical", "horizontal", "eccentricity")
    for axes, quantity, label, twin in zip(panels, quantities, labels, twins, strict=True):
        drawn = [
            values
            for branch in branches
            for bearing in range(case.bearings)
            for values in draw_branch(axes, branch, parameter, quantity(case, branch, bearing), bearing)
        ]
        for branch in branches:
            for bearing in range(case.bearings):
                _draw_errors(axes, branch, parameter, quantity(case, branch, bearing), refinement)
        axes.set_ylim(*limits(np.concatenate(drawn), 0.08))
        axes.set_ylabel(label)
        case.add_micrometres(axes, twin)
    panels[0].set_xlim(*limits(np.concatenate([branch[parameter] for branch in branches]), 0.03))
    add_parameter_axis(panels[0], parameter, case.scales, bottom=False)
    add_parameter_axis(panels[-1], parameter, case.scales, top=False)
    kinds = {kind for branch in branches for kind in event_names(branch)}
    bars = [
        bar for branch in branches for bar in event_bars(refinement, branch, parameter) if bar is not None
    ]
    style.legend_below(figure, branch_handles(case.bearings, kinds) + legend_handles(bars), 4)
    title = f"{case.name}: limit cycles along the {PARAMETER_AXES[parameter].title}{_progress(branches)}"
    return style.finish(figure, title, case.note)


Quantity = Callable[[CaseView, Table, int], NDArray[np.float64]]


def envelope(axis: int) -> Quantity:
    """Largest and smallest journal coordinate of each cycle over the bearing's own clearance, (point, 2).

    Axis 0: x, 1: y.
    """

    def quantity(case: CaseView, branch: Table, bearing: int) -> NDArray[np.float64]:
        extremes = [case.journal(branch[name], bearing) for name in ("orbit_maximum", "orbit_minimum")]
        return np.column_stack([extreme[:, axis] for extreme in extremes])

    return quantity


def largest_eccentricity(case: CaseView, branch: Table, bearing: int) -> NDArray[np.float64]:
    """Largest distance of the journal from the bearing centre over its clearance, (point, 1)."""
    orbit = case.journal(branch["orbit"], bearing)
    return np.asarray(np.hypot(orbit[..., 0], orbit[..., 1]).max(axis=1)[:, None])


def draw_branch(
    axes: Axes, branch: Table, parameter: str, values: NDArray[np.float64], bearing: int
) -> list[NDArray[np.float64]]:
    """Draw ``values`` (point, k) of a branch, as those of a bearing; returns the lines drawn."""
    curve = thread_events(branch, parameter, values)
    draw_threaded(axes, curve, branch, style.bearing_look(bearing))
    return list(curve.values.T)


def draw_threaded(axes: Axes, curve: Curve, branch: Table, look: Mapping[str, Any]) -> None:
    """Draw a branch with its bifurcations: stable parts solid, others dashed, a single point as a dot."""
    for column in curve.values.T:
        for start, stop in runs(curve.stable):
            line = "-" if curve.stable[start] else style.UNSTABLE
            axes.plot(curve.parameter[start : stop + 1], column[start : stop + 1], linestyle=line, **look)
        if len(curve.parameter) == 1:
            axes.plot(curve.parameter, column, marker="o", linestyle="none", **look)
        for row, mark in zip(curve.event_rows, event_looks(branch), strict=True):
            axes.plot(curve.parameter[row], column[row], zorder=5, **mark)


def _draw_errors(
    axes: Axes, branch: Table, parameter: str, values: NDArray[np.float64], refinement: Table | None
) -> None:
    """The error of every bifurcation's parameter, beside its marker."""
    curve = thread_events(branch, parameter, values)
    for row, bar in zip(curve.event_rows, event_bars(refinement, branch, parameter), strict=True):
        if bar is not None:
            for height in curve.values[row]:
                draw_bar(axes, bar, float(height), along_x=True)


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last-plus-one index of every run of equal flags."""
    if len(flags) == 0:
        return []
    edges = np.flatnonzero(flags[1:] != flags[:-1]) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(flags)], strict=True))


def branch_handles(bearings: int, kinds: Collection[str]) -> list[Line2D]:
    """Legend entries of the bearings, of stability, and of some kinds of bifurcations."""
    handles = [
        Line2D([], [], label=f"bearing {bearing + 1}", **style.bearing_look(bearing))
        for bearing in range(bearings)
    ]
    return handles + stability_handles() + event_handles(kinds)


def stability_handles(
    stable: str = "stable", unstable: str = "unstable", colour: str = "#333333"
) -> list[Line2D]:
    """Legend entries of solid and dashed lines."""
    return [
        Line2D([], [], color=colour, linestyle="-", label=stable),
        Line2D([], [], color=colour, linestyle=style.UNSTABLE, label=unstable),
    ]


def event_handles(kinds: Collection[str]) -> list[Line2D]:
    """Legend entries of the markers of some kinds of bifurcations."""
    return [
        Line2D([], [], label=mark.label, **mark.look()) for kind, mark in EVENT_MARKS.items() if kind in kinds
    ]


def _progress(branches: Sequence[Table]) -> str:
    """A note in the title while the store is still being written."""
    if not any(branch.attributes.get("status") == "running" for branch in branches):
        return ""
    points = sum(len(branch["speed"]) for branch in branches)
    return f" (running, {points} point{'s' if points > 1 else ''})"
