"""Drawing of the machine to scale: elements, discs, bearings, masters and nodes (the paper's Fig. 2)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.contents import CaseView, Table

MATERIAL_COLOURS = ("#B8C4CE", "#E8C896", "#A9CDB5", "#D8B4C8", "#C9C1A6", "#9FB8D8")
DISC_COLOUR, BEARING_COLOUR = "#8C99A6", "#F2F2F2"
LEAST_DISC_WIDTH = 0.012  # of the rotor length: a disc has no width in the model, it is drawn as a thin plate
HOUSING = 0.55  # height of a bearing block over the journal radius
MOST_NUMBERED = 40  # with more nodes than this only the masters are numbered
MILLIMETRES = 1e3
CENTRE: dict[str, Any] = {
    "marker": "P",
    "linestyle": "none",
    "markersize": 8,
    "markerfacecolor": "white",
    "markeredgecolor": style.BLACK,
    "zorder": 6,
}


@style.in_style
def draw_machine(case: CaseView) -> Figure:
    """Side view of rotor and bearings, both axes in millimetres and equally scaled."""
    machine = case.machine
    position = MILLIMETRES * machine["node_position"]
    reach = _reach(machine)
    length = float(position[-1] - position[0])
    figure = style.new_figure(max(2.1, min(5.0, 1.55 + (style.DOUBLE_COLUMN - 0.8) * 2.6 * reach / length)))
    axes = figure.subplots()
    axes.grid(False)
    for bearing in range(case.bearings):
        _draw_bearing(axes, machine, bearing)
    _draw_elements(axes, machine, position)
    _draw_discs(axes, machine, position)
    _draw_supports(axes, machine, position, reach)
    axes.axhline(0.0, color="#333333", linewidth=0.6, linestyle=(0, (8, 2, 1.5, 2)), zorder=4)
    _draw_nodes(axes, machine, position, reach)
    _draw_span(axes, machine, position, reach)
    axes.set_xlim(position[0] - 0.04 * length, position[-1] + 0.04 * length)
    axes.set_ylim(-1.6 * reach, 1.55 * reach)
    axes.set_aspect("equal")
    axes.set(xlabel="along the rotor [mm]", ylabel="radius [mm]")
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(lambda radius, _: f"{abs(radius):g}")
    _draw_centre_of_gravity(axes, machine)
    style.legend_below(figure, _legend(machine), 4)
    return style.finish(figure, f"{case.name}: rotor and bearings to scale{_properties(machine)}", case.note)


def _properties(machine: Table) -> str:
    """Mass, centre of gravity and inertia as a second line of the title; "" in a store without them."""
    rotor = machine.attributes.get("rotor")
    if rotor is None:
        return ""
    return (
        f"\n{rotor['mass']:.4g} kg, centre of gravity at {MILLIMETRES * rotor['centre_of_gravity']:.4g} mm, "
        f"$I_d$ = {rotor['diametral_inertia']:.3g} kg m², $I_p$ = {rotor['polar_inertia']:.3g} kg m²"
    )


def _draw_centre_of_gravity(axes: Axes, machine: Table) -> None:
    rotor = machine.attributes.get("rotor")
    if rotor is not None:
        axes.plot(MILLIMETRES * rotor["centre_of_gravity"], 0.0, **CENTRE)


def _reach(machine: Table) -> float:
    """Largest drawn radius [mm]."""
    bearings = (1.0 + HOUSING) * machine["bearing_radius"]
    discs = machine.optional("disc_diameter_equivalent")
    shaft = _end_diameters(machine, "element_outer")
    return max(
        MILLIMETRES * float(np.max(bearings)), 0.5 * float(np.max(shaft)), *(0.5 * MILLIMETRES * discs)
    )


def material_colour(index: int) -> str:
    """Colour of a material, from its place among the materials of the rotor."""
    return MATERIAL_COLOURS[index % len(MATERIAL_COLOURS)]


def _end_diameters(machine: Table, name: str) -> NDArray[np.float64]:
    """Diameters [mm] of the elements at their left and right ends, (2, elements); a cylinder has one."""
    left, right = machine[name], machine.optional(f"{name}_right")
    return MILLIMETRES * np.array([left, right if right.size else left])


def _draw_elements(axes: Axes, machine: Table, position: NDArray[np.float64]) -> None:
    outer, inner = (0.5 * _end_diameters(machine, name).T for name in ("element_outer", "element_inner"))
    for element, ends in enumerate(pairwise(position)):
        colour = material_colour(int(machine["element_material"][element]))
        _trapezium(axes, ends, outer[element], colour, zorder=2)
        if inner[element].any():
            _trapezium(axes, ends, inner[element], "white", zorder=2.5)


def _disc_dimensions(machine: Table) -> NDArray[np.float64]:
    """Outer diameter, inner diameter and width [mm] of the discs, (discs, 3); NaN where not known."""
    count = machine.optional("disc_node").size
    found = [machine.optional(name) for name in ("disc_outer", "disc_inner", "disc_width")]
    return MILLIMETRES * np.array([each if each.size else np.full(count, np.nan) for each in found]).T


def _draw_discs(axes: Axes, machine: Table, position: NDArray[np.float64]) -> None:
    thin = LEAST_DISC_WIDTH * float(position[-1] - position[0])
    for node, equivalent, (outer, inner, width) in zip(
        machine.optional("disc_node"),
        MILLIMETRES * machine.optional("disc_diameter_equivalent"),
        _disc_dimensions(machine),
        strict=True,
    ):
        if np.isnan(outer):
            _box(axes, position[node] - 0.5 * thin, thin, -0.5 * equivalent, 0.5 * equivalent, DISC_COLOUR, 3)
            continue
        for low, high in ((-0.5 * outer, -0.5 * inner), (0.5 * inner, 0.5 * outer)):
            _box(axes, position[node] - 0.5 * width, width, low, high, DISC_COLOUR, zorder=3)


def _draw_bearing(axes: Axes, machine: Table, bearing: int) -> None:
    """Two hatched blocks, above and below the journal; the clearance is far too small to be seen."""
    centre = MILLIMETRES * float(machine["node_position"][machine["bearing_node"][bearing]])
    length = MILLIMETRES * float(machine["bearing_length"][bearing])
    radius = MILLIMETRES * float(machine["bearing_radius"][bearing])
    for low, high in ((radius, (1.0 + HOUSING) * radius), (-(1.0 + HOUSING) * radius, -radius)):
        _box(axes, centre - 0.5 * length, length, low, high, BEARING_COLOUR, zorder=1, hatch="/////")
    for sign in (
        -1.0,
        1.0,
    ):  # the journal surface: the model has its radius, but no shaft element of that size
        axes.plot(
            [centre - 0.5 * length, centre + 0.5 * length], [sign * radius] * 2, color=style.BLUE, zorder=3
        )
    loads = machine.attributes.get("rotor", {}).get("bearing_loads", ())
    label = f"B{bearing + 1}" + (f", {loads[bearing]:.4g} N" if len(loads) else "")
    axes.text(centre, (1.0 + HOUSING) * radius, label, ha="center", va="bottom", fontsize=7.5)


def _draw_supports(axes: Axes, machine: Table, position: NDArray[np.float64], reach: float) -> None:
    left, right = _end_diameters(machine, "element_outer")
    at_node = np.append(left, right[-1])
    for node in machine.optional("support_node"):
        x, size = float(position[node]), 0.22 * reach
        top = -0.5 * float(at_node[node])
        corners = [(x, top), (x - size, top - 1.4 * size), (x + size, top - 1.4 * size)]
        axes.add_patch(
            Polygon(corners, closed=True, facecolor="white", edgecolor="#333333", linewidth=0.8, zorder=3)
        )


def _draw_nodes(axes: Axes, machine: Table, position: NDArray[np.float64], reach: float) -> None:
    masters = set(machine["master_node"].tolist())
    for node, x in enumerate(position):
        master = node in masters
        axes.plot(
            x,
            0.0,
            marker="o",
            markersize=4.2 if master else 3.2,
            zorder=5,
            markeredgewidth=0.8,
            markerfacecolor=style.VERMILION if master else "white",
            markeredgecolor="#333333",
        )
        if len(position) > MOST_NUMBERED and not master:
            continue
        axes.annotate(
            str(node),
            (x, -1.08 * reach),
            ha="center",
            va="top",
            fontsize=7,
            fontweight="bold" if master else "normal",
        )


def _draw_span(axes: Axes, machine: Table, position: NDArray[np.float64], reach: float) -> None:
    """The bearing span, as a dimension line below the nodes' numbers."""
    left, right = (float(x) for x in sorted(position[machine["bearing_node"]])[:2])
    height = 1.32 * reach
    axes.annotate("", (left, height), (right, height), arrowprops={"arrowstyle": "<->", "linewidth": 0.7})
    axes.text(
        0.5 * (left + right),
        height,
        f"$L_s$ = {right - left:.4g} mm",
        ha="center",
        va="center",
        fontsize=7.5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
    )


def _trapezium(
    axes: Axes, ends: tuple[float, float], radii: NDArray[np.float64], colour: str, zorder: float
) -> None:
    """Side view of a cylinder or cone between two places, with its radii there."""
    left, right = ends
    corners = [(left, -radii[0]), (left, radii[0]), (right, radii[1]), (right, -radii[1])]
    axes.add_patch(
        Polygon(corners, closed=True, facecolor=colour, edgecolor="#333333", linewidth=0.6, zorder=zorder)
    )


def _box(
    axes: Axes,
    x: float,
    width: float,
    low: float,
    high: float,
    colour: str,
    zorder: float,
    hatch: str | None = None,
) -> None:
    axes.add_patch(
        Rectangle(
            (x, low),
            width,
            high - low,
            facecolor=colour,
            edgecolor="#333333",
            linewidth=0.6,
            zorder=zorder,
            hatch=hatch,
        )
    )


def _legend(machine: Table) -> list[Line2D | Patch]:
    names = machine.attributes.get("material_names", [])
    used = sorted({int(index) for index in machine["element_material"]})
    handles: list[Line2D | Patch] = [
        Patch(
            facecolor=material_colour(index),
            edgecolor="#333333",
            linewidth=0.6,
            label=style.literal(str(names[index])) if index < len(names) else f"material {index}",
        )
        for index in used
    ]
    if len(machine.optional("disc_node")):
        to_scale = not np.isnan(_disc_dimensions(machine)).any()
        label = "disc" if to_scale else "disc (equal inertia)"
        handles.append(Patch(facecolor=DISC_COLOUR, edgecolor="#333333", linewidth=0.6, label=label))
    handles.append(
        Patch(
            facecolor=BEARING_COLOUR,
            edgecolor="#333333",
            hatch="/////",
            linewidth=0.6,
            label="gas foil bearing",
        )
    )
    handles.append(Line2D([], [], color=style.BLUE, label="journal surface"))
    for label, face in (("master node", style.VERMILION), ("slave node", "white")):
        handles.append(
            Line2D(
                [],
                [],
                marker="o",
                markersize=4.5,
                color="none",
                markerfacecolor=face,
                markeredgecolor="#333333",
                label=label,
            )
        )
    if "rotor" in machine.attributes:
        handles.append(Line2D([], [], label="centre of gravity", **CENTRE))
    return handles
