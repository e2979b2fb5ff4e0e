"""A map of the page: its drawing, and over it what the script needs to show the nearest stored cycle.

The drawing is an image; an SVG of the same size lies over it. Data become coordinates of the SVG by

    u = left + width (x - x0) / (x1 - x0),   v = top + height (y1 - y) / (y1 - y0)

with the rectangle of the axes (left, top, width, height) and their limits (x0, x1), (y0, y1).
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_right, add_top, limits
from pipelines.figures.case_tables import CaseTables
from pipelines.figures.certificate import draw_certificate, newest_certificate
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.page import elements
from pipelines.figures.page.stored_cycles import SAMPLES, StoredCycles, cycle_groups, stored_cycles
from pipelines.figures.stability_map import HORIZONTAL_FIRST, draw_stability_map, planes_of

POINTS_PER_INCH = 72.0
HELP = (
    "Click the map to see the nearest stored cycle: the orbits of the journals and the Floquet multipliers. "
    "With the keyboard: focus the map and press the arrow keys, or use the buttons."
)


def map_sections(store: Store, case: str, held: CaseTables, number: int, most: int) -> list[str]:
    """The maps of a case: one for every plane of curves, else one of the stored cycles alone.

    ``number`` of the case makes identifiers; ``most``: cycles that a map may hold.
    """
    planes = planes_of(held.curves, held.single)
    sections = []
    for place, plane in enumerate(planes, start=1):
        cycles = stored_cycles(store, held.view, case, (plane.x, plane.y), most)
        drawn = draw_stability_map(held.view, plane)
        nearest = nearest_boundary(held.single.get("operating_range"), (plane.x, plane.y))
        identifier = f"map-{number}-{place}"
        sections.append(_section(held.view, (plane.x, plane.y), drawn, cycles, identifier, nearest))
    if (certificate := newest_certificate(held)) is not None:
        drawn = draw_certificate(held.view, certificate, held.curves)
        sections.append(elements.picture(drawn, f"Certificate of the bifurcation set of {held.view.name}"))
    if not planes and (of_cycles := _plane_of_cycles(store, case)) is not None:
        cycles = stored_cycles(store, held.view, case, of_cycles, most)
        drawn = draw_cycle_plane(held.view, of_cycles, cycles)
        sections.append(_section(held.view, of_cycles, drawn, cycles, f"map-{number}-1"))
    return sections


def _plane_of_cycles(store: Store, case: str) -> tuple[str, str] | None:
    """The parameter of the first branch of cycles, and the first other one that the machine has."""
    for name in cycle_groups(store, case):
        branch = read_group(store, name, HORIZONTAL_FIRST)
        continued = str(branch.attributes["parameter"])
        others = [other for other in ("speed", *HORIZONTAL_FIRST) if other != continued]
        known = [other for other in others if branch.n_points and np.isfinite(branch[other]).any()]
        if known:
            first, second = sorted((continued, known[0]), key=HORIZONTAL_FIRST.index)
            return first, second
    return None


@style.in_style
def draw_cycle_plane(view: CaseView, plane: tuple[str, str], cycles: StoredCycles) -> Figure:
    """Axes of a plane without curves; the page draws the cycles."""
    figure = style.new_figure(5.0)
    axes = figure.subplots()
    x, y = (PARAMETER_AXES[name] for name in plane)
    axes.set(xlim=limits([cycle["x"] for cycle in cycles.cycles]), xlabel=x.label)
    axes.set(ylim=limits([cycle["y"] for cycle in cycles.cycles]), ylabel=y.label)
    add_top(axes, *x.dimensional(view.scales))
    add_right(axes, *y.dimensional(view.scales))
    return style.finish(figure, f"{view.name}: stored cycles", view.note)


def nearest_boundary(ranges: Table | None, plane: tuple[str, str]) -> list[float] | None:
    """Where in the plane the margin of the operating point ends, as `agfb report` has stored it."""
    margin = None if ranges is None else ranges.attributes.get("margin")
    nearest = None if margin is None else margin["nearest"]
    return None if nearest is None or not set(plane) <= nearest.keys() else [nearest[name] for name in plane]


def _section(
    view: CaseView,
    plane: tuple[str, str],
    figure: Figure,
    cycles: StoredCycles,
    identifier: str,
    nearest: list[float] | None = None,
) -> str:
    """Drawing, controls, place of the shown cycle, and data."""
    axes = figure.axes[0]
    frame = axes_frame(figure, axes)
    own = [view.parameters.get(name) for name in plane]
    point = operating_point(frame, *own)
    data = {
        "frame": frame,
        "parameters": [_parameter(view, name) for name in plane],
        "operating_point": point,
        "cycles": cycles.cycles,
    }
    names = " and ".join(PARAMETER_AXES[name].title for name in plane)
    marked = ""
    if point is not None:
        marked = " The operating point is a black diamond."
        marked += " A dotted line leads from it to the nearest boundary of stable cycles." if nearest else ""
    elif None not in own:
        marked = " The operating point lies outside this map."
    held = (
        f"{len(cycles.cycles)} of {cycles.total} stored cycles of this plane are in the page, their orbits "
        f"with at most {SAMPLES} points. Filled dots are stable cycles, open ones unstable.{marked}"
    )
    width, height = frame["size"]
    marks = _marks(frame, point, nearest)
    return f"""<div class="explorer" id="{identifier}">
{elements.paragraph(HELP, "script")}
<div class="plate map" tabindex="0" role="group" aria-label="{escape(f"Map over {names}")}">
{elements.image(figure, f"Map over {names}")}
<svg class="overlay" viewBox="0 0 {width:g} {height:g}" aria-hidden="true">{marks}</svg>
</div>
{elements.paragraph(held)}
<p class="script controls"><button type="button" data-go="-1">previous cycle</button>
<button type="button" data-go="1">next cycle</button></p>
<div class="cycle" role="status"></div>
{elements.embedded(data)}
</div>"""


def operating_point(frame: Mapping[str, Any], x: float | None, y: float | None) -> list[float] | None:
    """A case's own point if it has one, and it is on the map."""
    if x is None or y is None:
        return None
    (x0, x1), (y0, y1) = frame["x"], frame["y"]
    return [x, y] if x0 <= x <= x1 and y0 <= y <= y1 else None


def _marks(frame: Mapping[str, Any], point: list[float] | None, nearest: list[float] | None) -> str:
    """The operating point, and a line to the nearest boundary."""
    if point is None:
        return ""
    u, v = placed(frame, *point)
    line = ""
    if nearest is not None:
        end_u, end_v = placed(frame, *nearest)
        line = f'<path class="margin" d="M{u:.2f},{v:.2f} L{end_u:.2f},{end_v:.2f}"></path>'
    return f'{line}<path class="point" d="M{u:.2f},{v:.2f} m-5,0 l5,-5 l5,5 l-5,5 z"></path>'


def placed(frame: Mapping[str, Any], x: float, y: float) -> tuple[float, float]:
    """Coordinates of the SVG over a drawing (u, v)."""
    (left, top, width, height), (x0, x1), (y0, y1) = frame["axes"], frame["x"], frame["y"]
    return left + width * (x - x0) / (x1 - x0), top + height * (y1 - y) / (y1 - y0)


def axes_frame(figure: Figure, axes: Axes) -> dict[str, Any]:
    """Size of the drawing, rectangle of its axes from the upper left corner, and their limits.

    All lengths in points, as in the SVG that matplotlib writes.
    """
    width, height = (POINTS_PER_INCH * length for length in figure.get_size_inches())
    box = axes.get_position()
    rectangle = [box.x0 * width, (1.0 - box.y1) * height, box.width * width, box.height * height]
    return {
        "size": [float(width), float(height)],
        "axes": [round(float(length), 3) for length in rectangle],
        "x": [float(limit) for limit in axes.get_xlim()],
        "y": [float(limit) for limit in axes.get_ylim()],
    }


def _parameter(view: CaseView, name: str) -> Mapping[str, Any]:
    """Title of a parameter and its dimensional unit, for the text of a cycle."""
    axis = PARAMETER_AXES[name]
    factor, _ = axis.dimensional(view.scales)
    return {"title": axis.title, "factor": factor, "unit": axis.unit}
