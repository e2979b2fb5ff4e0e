"""What happens in the bearings during one cycle: orbits, minimum film, and pressure, foil and film around them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_right, clearance_circle, limits
from pipelines.figures.contents import CaseView, Table, stable_points

CYCLES = 4  # cycles drawn together
SNAPSHOTS = 4  # instants drawn together
PHASE_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)
ANGLE_TICKS = (0, 90, 180, 270, 360)


def representative_points(branch: Table, count: int = CYCLES) -> NDArray[np.intp]:
    """Points spread evenly over a branch, first and last included."""
    points = len(branch["speed"])
    return np.unique(np.linspace(0, points - 1, min(count, points)).round().astype(np.intp))


def last_stable_point(branch: Table) -> int:
    """The point whose film is drawn: the last stable one, or the first where none is stable."""
    stable = np.flatnonzero(stable_points(branch))
    return int(stable[-1]) if len(stable) else 0


@style.in_style
def draw_orbits(case: CaseView, parameter: str, branch: Table, name: str) -> Figure:
    """Journal orbits inside the clearance circle, and the minimum film thickness over one period."""
    figure = style.new_figure(6.2)
    bearings = case.bearings
    panels = figure.subplots(2, bearings, squeeze=False, height_ratios=(1.5, 1.0))
    symbol = PARAMETER_AXES[parameter].symbol
    for bearing in range(bearings):
        above, below = panels[0, bearing], panels[1, bearing]
        clearance_circle(above)
        for number, point in enumerate(representative_points(branch)):
            stable = bool(stable_points(branch)[point])
            label = f"{symbol} = {float(branch[parameter][point]):.4g}" + ("" if stable else ", unstable")
            look = {
                "color": style.CYCLE[number],
                "linestyle": "-" if stable else (0, (3.5, 1.8)),
                "label": label,
            }
            _draw_cycle(above, below, case, branch, int(point), bearing, look)
        above.set(title=f"bearing {bearing + 1}", xlabel=r"$\bar{x}_j$ [–]", ylabel=r"$\bar{y}_j$ [–]")
        above.set(xlim=(-1.08, 1.08), ylim=(-1.08, 1.08))
        below.set(
            xlabel="phase of the excitation [periods]", ylabel=r"minimum film $\bar{h}$ [–]", xlim=(0.0, 1.0)
        )
        below.set_xticks(PHASE_TICKS)
        below.set_ylim(0.0, limits(branch["minimum_film_trace"][representative_points(branch)], 0.12)[1])
        add_right(below, case.scales.micrometres, "minimum film [µm]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    title = f"{case.name}: orbits of the journals, branch {name} (nominal clearance dashed)"
    return style.finish(figure, title, case.note)


def _draw_cycle(
    above: Axes, below: Axes, case: CaseView, branch: Table, point: int, bearing: int, look: dict[str, object]
) -> None:
    x, y = case.journal_coordinates(bearing)
    orbit = branch["orbit"][point]
    closed = np.vstack([orbit, orbit[:1]])
    above.plot(closed[:, x], closed[:, y], **look)  # type: ignore[arg-type]
    above.plot(closed[0, x], closed[0, y], marker="o", markersize=3, color=look["color"])  # type: ignore[arg-type]
    film = branch["minimum_film_trace"][point][:, bearing]
    below.plot(np.linspace(0.0, 1.0, len(film) + 1), np.append(film, film[0]), **look)  # type: ignore[arg-type]


@style.in_style
def draw_film(case: CaseView, parameter: str, branch: Table, name: str, point: int) -> Figure:
    """Axial mean pressure, foil displacement and film thickness around each bearing, at instants of one cycle."""
    figure = style.new_figure(6.4)
    panels = figure.subplots(3, case.bearings, squeeze=False, sharex=True, sharey="row")
    rows = (
        ("film_pressure", r"mean pressure $\bar{p}_m$ [–]", 1.0),
        ("foil_displacement", r"foil $\bar{q}$ [–]", 0.0),
        ("film_thickness", r"film thickness $\bar{h}$ [–]", None),
    )
    degrees = np.degrees(branch["theta"])
    snapshots = branch["film_pressure"].shape[1]
    chosen = np.unique(np.linspace(0, snapshots, min(SNAPSHOTS, snapshots), endpoint=False).astype(int))
    for row, (array, label, reference) in enumerate(rows):
        for bearing in range(case.bearings):
            axes = panels[row, bearing]
            if reference is not None:
                axes.axhline(reference, color="#666666", linewidth=0.8, linestyle=":")
            for number, snapshot in enumerate(chosen):
                axes.plot(
                    degrees,
                    branch[array][point, snapshot, bearing],
                    color=style.CYCLE[number],
                    label=f"phase {snapshot / snapshots:.3g} of the period",
                )
            axes.set_xticks(ANGLE_TICKS)
            axes.set_xlim(0.0, 360.0)
        panels[row, 0].set_ylabel(label)
        panels[row, 0].set_ylim(*limits(branch[array][point], 0.08))
    for bearing in range(case.bearings):
        panels[0, bearing].set_title(f"bearing {bearing + 1}")
        panels[-1, bearing].set_xlabel(r"angle $\theta$ [°]")
        add_right(panels[-1, bearing], case.scales.micrometres, "film [µm]")
        add_right(panels[1, bearing], case.scales.micrometres, "foil [µm]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    symbol, value = PARAMETER_AXES[parameter].symbol, float(branch[parameter][point])
    state = "stable" if stable_points(branch)[point] else "unstable"
    title = f"{case.name}: film and foil of the {state} cycle at {symbol} = {value:.4g}, branch {name}"
    return style.finish(figure, title, case.note)
