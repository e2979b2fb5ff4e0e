"""One cycle inside the bearings: orbits and minimum film; pressure, foil and film around the journal."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, clearance_circle, limits
from pipelines.figures.contents import CaseView, Table, branch_title, stable_points

CYCLES = 4  # cycles drawn together
SNAPSHOTS = 4  # instants drawn together
PHASE_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)


def representative_points(branch: Table, count: int = CYCLES) -> NDArray[np.intp]:
    """Points evenly spread over a branch, including the first and the last."""
    points = len(branch["speed"])
    return np.unique(np.linspace(0, points - 1, min(count, points)).round().astype(np.intp))


def last_stable_point(branch: Table) -> int:
    """The point whose film is drawn: the last stable one, or the first if none is stable."""
    stable = np.flatnonzero(stable_points(branch))
    return int(stable[-1]) if len(stable) else 0


@style.in_style
def draw_orbits(case: CaseView, parameter: str, branch: Table, name: str) -> Figure:
    """Journal orbits inside the clearance circle and magnified, and the minimum film over one period."""
    figure = style.new_figure(0.9 + 2.35 * case.bearings)
    panels = figure.subplots(case.bearings, 3, squeeze=False, width_ratios=(1.0, 1.0, 1.15))
    for bearing, (whole, close, film) in enumerate(panels):
        clearance_circle(whole)
        for look, point in zip(_looks(branch, parameter), representative_points(branch), strict=True):
            _draw_orbit((whole, close), case, branch, int(point), bearing, look)
            _draw_minimum_film(film, branch, int(point), bearing, look)
        whole.set(xlim=(-1.08, 1.08), ylim=(-1.08, 1.08), ylabel=r"$\bar{y}_j$ [–]")
        whole.set_title(f"bearing {bearing + 1}, clearance dashed")
        whole.set_xticks((-1.0, -0.5, 0.0, 0.5, 1.0))
        whole.set_yticks((-1.0, -0.5, 0.0, 0.5, 1.0))
        close.set_title("magnified")
        close.set_aspect("equal", adjustable="datalim")
        close.margins(0.12)
        film.set(title="minimum film thickness", xlim=(0.0, 1.0), ylabel=r"$\min\,\bar{h}$ [–]")
        film.set_xticks(PHASE_TICKS)
        film.set_ylim(0.0, limits(branch["minimum_film_trace"][representative_points(branch)], 0.12)[1])
        case.add_micrometres(film, "", bearing)
    for axes, label in zip(
        panels[-1], (r"$\bar{x}_j$ [–]", r"$\bar{x}_j$ [–]", r"$\tau/T$ [–]"), strict=True
    ):
        axes.set_xlabel(label)
    handles = [Line2D([], [], **look) for look in _looks(branch, parameter)]
    handles.append(
        Line2D([], [], marker="o", markersize=3, color="#333333", linestyle="none", label=r"$\tau=0$")
    )
    style.legend_below(figure, handles)
    return style.finish(
        figure, f"{case.name}: orbits of the journals, {branch_title(name, branch)}", case.note
    )


def _looks(branch: Table, parameter: str) -> list[dict[str, Any]]:
    """Colour, dash and label of every drawn cycle."""
    symbol, stable = PARAMETER_AXES[parameter].symbol, stable_points(branch)
    return [
        {
            "color": style.CYCLE[number],
            "linestyle": "-" if stable[point] else (0, (3.5, 1.8)),
            "label": f"{symbol} = {float(branch[parameter][point]):.4g}"
            + ("" if stable[point] else ", unstable"),
        }
        for number, point in enumerate(representative_points(branch))
    ]


def _draw_orbit(
    panels: tuple[Axes, ...], case: CaseView, branch: Table, point: int, bearing: int, look: dict[str, Any]
) -> None:
    orbit = case.journal(branch["orbit"][point], bearing)
    closed = np.vstack([orbit, orbit[:1]])
    for axes in panels:
        axes.plot(*closed.T, **look)
    panels[-1].plot(*closed[0], marker="o", markersize=3, color=look["color"])


def _draw_minimum_film(axes: Axes, branch: Table, point: int, bearing: int, look: dict[str, Any]) -> None:
    film = branch["minimum_film_trace"][point][:, bearing]
    axes.plot(np.linspace(0.0, 1.0, len(film) + 1), np.append(film, film[0]), **look)


def once_around(degrees: NDArray[np.float64]) -> tuple[float, float]:
    """Limits of one turn around the nodes of a film, which may begin at any angle; NaN pads shorter films."""
    first, last = float(np.nanmin(degrees)), float(np.nanmax(degrees))
    start = first - 0.5 * (360.0 - (last - first))
    return start, start + 360.0


@style.in_style
def draw_film(case: CaseView, parameter: str, branch: Table, name: str, point: int | None = None) -> Figure:
    """Axial mean pressure, foil displacement and film thickness around each bearing, at some instants.

    Of the last stable cycle, unless another ``point`` of the branch is asked for.
    """
    point = last_stable_point(branch) if point is None else point
    figure = style.new_figure(6.4)
    panels = figure.subplots(3, case.bearings, squeeze=False, sharex="col", sharey="row")
    rows = (
        ("film_pressure", r"mean pressure $\bar{p}_m$ [–]", 1.0),
        ("foil_displacement", r"foil $\bar{q}$ [–]", 0.0),
        ("film_thickness", r"film thickness $\bar{h}$ [–]", None),
    )
    degrees = np.degrees(branch["theta"])  # (bearing, theta)
    snapshots = branch["film_pressure"].shape[1]
    chosen = np.unique(np.linspace(0, snapshots, min(SNAPSHOTS, snapshots), endpoint=False).astype(int))
    for row, (array, label, reference) in enumerate(rows):
        for bearing in range(case.bearings):
            axes = panels[row, bearing]
            if reference is not None:
                axes.axhline(reference, color="#666666", linewidth=0.8, linestyle=":")
            for number, snapshot in enumerate(chosen):
                axes.plot(
                    degrees[bearing],
                    branch[array][point, snapshot, bearing],
                    color=style.CYCLE[number],
                    label=rf"$\tau/T$ = {snapshot / snapshots:.3g}",
                )
            axes.xaxis.set_major_locator(MultipleLocator(90.0))
            axes.set_xlim(*once_around(degrees[bearing]))
        panels[row, 0].set_ylabel(label)
        panels[row, 0].set_ylim(*limits(branch[array][point], 0.08))
    for bearing in range(case.bearings):
        panels[0, bearing].set_title(f"bearing {bearing + 1}")
        panels[-1, bearing].set_xlabel(r"angle $\theta$ [°]")
        if bearing == case.bearings - 1 or case.clearance(bearing) != case.clearance(case.bearings - 1):
            case.add_micrometres(panels[1, bearing], "foil", bearing)
            case.add_micrometres(panels[2, bearing], "film thickness", bearing)
    style.legend_below(figure, panels[0, 0].get_legend_handles_labels()[0])
    symbol, value = PARAMETER_AXES[parameter].symbol, float(branch[parameter][point])
    state = "stable" if stable_points(branch)[point] else "unstable"
    place = f"{symbol} = {value:.4g}, {branch_title(name, branch)}"
    title = f"{case.name}: film and foil of the {state} cycle at {place}"
    return style.finish(figure, title, case.note)
