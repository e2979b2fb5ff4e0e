"""Bifurcation set in the plane of two parameters: curves of bifurcations, special points, resonances."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from pipelines.datasets.curves import FINISHED, BifurcationCurve, read_curve
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_right, add_top
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.placement import Label, place_labels
from pipelines.figures.refinement import draw_refinement
from pipelines.figures.resonance_lines import draw_frequencies, draw_resonances, resonance_handles

HORIZONTAL_FIRST = ("excitation_frequency", "displacement", "foil_stiffness", "speed")
SAMPLES = 12  # of the cubic between two rows
ALIKE = 0.004  # of the plane: special points of one kind this close are one point, met on two curves
NEAR, CROWD = 0.04, 3  # of the plane: so many points of one kind, each this near to another, share a label
LABEL_SIZE = 6.5

CURVE_KINDS = {
    "neimark_sacker": ("Neimark–Sacker (NS)", style.DEEP_PURPLE),
    "period_doubling": ("period doubling (PD)", style.ORANGE),
    "fold": ("fold (LPC)", style.GREEN),
}
NO_TYPE = "fold"  # a fold is neither supercritical nor subcritical
LINES: dict[str, Any] = {
    "supercritical": "-", "subcritical": (0, (4.5, 1.8)), "unset": (0, (1.0, 1.1)), NO_TYPE: "-"
}  # fmt: skip
WIDTHS = {"supercritical": 1.7, "subcritical": 1.7, "unset": 1.3, NO_TYPE: 1.7}
PALE, THIN = 0.38, 0.55  # alpha of curves of unstable cycles, and relative width of those of doubled cycles
SPECIAL_NAMES = {
    "fold_flip": "fold-flip",
    "fold_neimark_sacker": "fold-NS",
    "flip_neimark_sacker": "PD-NS",
    "double_neimark_sacker": "NS-NS",
    "generalised_flip": "GPD",
    "chenciner": "CH",
}
INK = "#333333"


@dataclass(frozen=True)
class PlaneView:
    """Content of a map: the groups of kind curve by name, and groups that add to them.

    ``x`` and ``y``: parameters of the axes; ``ranges``: their limits.
    """

    x: str
    y: str
    ranges: Mapping[str, tuple[float, float]]
    tables: Mapping[str, Table]
    curves: Sequence[BifurcationCurve]
    others: Mapping[str, Table] = field(default_factory=dict)

    @classmethod
    def of(cls, tables: Mapping[str, Table], others: Mapping[str, Table]) -> PlaneView:
        """The view of curves over two common parameters.

        ``others``: criticals, bifurcation_set and operating_range as far as the store has them.
        """
        attributes = next(iter(tables.values())).attributes
        names, ranges = attributes["parameters"], attributes["ranges"]
        x, y = sorted(names, key=HORIZONTAL_FIRST.index)
        curves = [read_curve(name, table.arrays, table.attributes) for name, table in tables.items()]
        limits = {
            str(name): (float(low), float(high)) for name, (low, high) in zip(names, ranges, strict=True)
        }
        return cls(x, y, limits, tables, [curve for curve in curves if curve is not None], others)

    def order(self, curve: BifurcationCurve) -> list[int]:
        """Columns of x and y among the parameters of a curve."""
        return [curve.parameters.index(self.x), curve.parameters.index(self.y)]


def same_plane(table: Table) -> frozenset[str]:
    """The two parameters of a curve, in any order."""
    return frozenset(str(name) for name in table.attributes["parameters"])


def curves_over(
    curves: Mapping[str, Table], plane: Collection[str], started: bool = False
) -> dict[str, Table]:
    """The curves over two parameters; ``started``: only those with points."""
    return {
        name: curve
        for name, curve in curves.items()
        if same_plane(curve) == frozenset(plane) and (len(curve["speed"]) or not started)
    }


def planes_of(curves: Mapping[str, Table], others: Mapping[str, Table]) -> list[PlaneView]:
    """The planes of two parameters over which a case has curves; ``others`` as in `PlaneView.of`."""
    planes = sorted({same_plane(curve) for curve in curves.values()}, key=sorted)
    return [PlaneView.of(curves_over(curves, plane), others) for plane in planes]


def map_stem(figure: str, x: str, y: str) -> str:
    """Stem of the file name of a map; the usual plane is not named."""
    return figure if (x, y) == ("excitation_frequency", "speed") else f"{figure}-{x}-{y}"


@style.in_style
def draw_stability_map(case: CaseView, view: PlaneView, scan_lines: bool = False) -> Figure:
    """Curves of bifurcations: solid if supercritical, dashed if subcritical, dotted if not known.

    Pale: the cycle is unstable on both sides. Thin: of cycles of two and more excitation periods. In a band:
    of regularised clipping.
    ``scan_lines``: the branches that searched the plane as a light grid.
    """
    figure = style.new_figure(6.9)
    axes = figure.subplots()
    handles = draw_plane(axes, view)
    if scan_lines:
        _draw_scan_lines(axes, view)
    top = _draw_resonances(axes, view, handles)
    add_second_axes(axes, top, view, case)
    style.legend_below(figure, handles, 4)
    style.finish(figure, f"{case.name}: bifurcation set{_constants(view)}{_progress(view)}", case.note)
    place_labels(axes, figure.canvas.get_renderer(), point_labels(view), _drawn_points(view), LABEL_SIZE)  # type: ignore[attr-defined]
    return figure


def draw_plane(axes: Axes, view: PlaneView) -> list[Any]:
    """Draw the plane with its curves and points on axes; returns the entries of a legend."""
    axes.grid(False)
    axes.set(xlim=view.ranges[view.x], ylim=view.ranges[view.y])
    axes.set(xlabel=PARAMETER_AXES[view.x].label, ylabel=PARAMETER_AXES[view.y].label)
    return [handle for layer in LAYERS for handle in layer(axes, view)]


def _drawn_points(view: PlaneView) -> NDArray[np.float64]:
    """Samples (n, 2) of all lines that labels must avoid."""
    found = [points for curve in view.curves for _, points in parts_of(curve, view)]
    if (passive := passive_speed(view)) is not None:
        along = np.linspace(*view.ranges[view.x], 400)
        found.append(np.column_stack([along, np.full_like(along, passive)]))
    return np.concatenate(found) if found else np.zeros((0, 2))


@dataclass(frozen=True)
class LineStyle:
    """Line style of a part of a curve."""

    bifurcation: str
    criticality: str
    unstable: bool
    doubled: bool

    @property
    def options(self) -> dict[str, Any]:
        """Line options of matplotlib."""
        return {
            "color": CURVE_KINDS[self.bifurcation][1],
            "linestyle": LINES[self.criticality],
            "linewidth": WIDTHS[self.criticality] * (THIN if self.doubled else 1.0),
            "alpha": PALE if self.unstable else 1.0,
            "zorder": 2.5 if self.unstable or self.doubled else 3.0,
            "dash_capstyle": "butt",
        }


def parts_of(curve: BifurcationCurve, view: PlaneView) -> Iterator[tuple[LineStyle, NDArray[np.float64]]]:
    """Parts of equal look with samples (n, 2) of x and y along the cubics."""
    ends, order = curve.stretches(), view.order(curve)
    middles = 0.5 * (ends[1:] + ends[:-1])
    looks = [
        LineStyle(
            curve.bifurcation,
            NO_TYPE if curve.bifurcation == "fold" else curve.criticality_at(float(middle)),
            curve.unstable_at(float(middle)) > 0,
            curve.turns > 1,
        )
        for middle in middles
    ]
    start = 0
    for stop in range(1, len(looks) + 1):
        if stop == len(looks) or looks[stop] != looks[start]:
            along = [
                np.linspace(low, high, SAMPLES, endpoint=False)
                for low, high in zip(ends[start:stop], ends[start + 1 : stop + 1], strict=True)
            ]
            yield looks[start], curve.at(np.concatenate([*along, ends[stop : stop + 1]]))[:, order]
            start = stop


def _draw_stable_range(axes: Axes, view: PlaneView) -> list[Patch]:
    """The speeds from the lowest one up to the first bifurcation."""
    table = view.others.get("operating_range")
    if table is None or view.y != "speed" or table.attributes.get("parameter") != view.x:
        return []
    abscissa, speed = (np.asarray(table[name], dtype=float) for name in ("abscissa", "speed"))
    lowest = float(table.attributes["lowest_speed"])
    stable = table["base"] != "unstable"
    axes.fill_between(abscissa, lowest, speed, where=stable, color=style.PALE_SKY, linewidth=0.0, zorder=0.3)
    return [Patch(facecolor=style.PALE_SKY, edgecolor="#B9D3E6", linewidth=0.6, label="free of bifurcations")]


def passive_speed(view: PlaneView) -> float | None:
    """The instability speed with undeformed rings; None if it is not known, or not inside the plane."""
    table = view.others.get("bifurcation_set")
    value = None if table is None else table.attributes.get("passive_instability_speed")
    if value is None or view.y != "speed":
        return None
    low, high = view.ranges["speed"]
    return float(value) if low <= value <= high else None


def _draw_passive(axes: Axes, view: PlaneView) -> list[Line2D]:
    value = passive_speed(view)
    if value is None:
        return []
    line = axes.axhline(value, color=INK, linewidth=0.9, linestyle=(0, (7, 2, 1.2, 2)), zorder=1.5)
    line.set_label(rf"instability at $\bar{{\delta}}=0$: {value:.4g}")
    return [line]


def draw_curves(axes: Axes, view: PlaneView) -> list[Line2D]:
    """Draw the curves of a plane; returns the legend of their looks."""
    looks: list[LineStyle] = []
    for curve in view.curves:
        for look, points in parts_of(curve, view):
            axes.plot(points[:, 0], points[:, 1], **look.options)
            if _inside(points, view):
                looks.append(look)
    kinds = {look.bifurcation for look in looks}
    handles = [
        Line2D([], [], color=colour, linewidth=1.7, label=label)
        for kind, (label, colour) in CURVE_KINDS.items()
        if kind in kinds
    ]
    names = {"unset": "type not known"}
    criticalities = {look.criticality for look in looks}
    handles += [
        Line2D([], [], color=INK, linestyle=line, linewidth=WIDTHS[name], label=names.get(name, name))
        for name, line in LINES.items()
        if name in criticalities and name != NO_TYPE
    ]
    if any(look.unstable for look in looks):
        handles.append(Line2D([], [], color=INK, alpha=PALE, linewidth=1.7, label="of an unstable cycle"))
    if any(look.doubled for look in looks):
        handles.append(Line2D([], [], color=INK, linewidth=1.7 * THIN, label="of doubled cycles"))
    return handles


def _inside(points: NDArray[np.float64], view: PlaneView) -> bool:
    """Whether any of the points (n, 2) lies in the drawn plane: the legend names what is seen."""
    low, high = np.array([view.ranges[view.x], view.ranges[view.y]]).T
    return bool(np.any(np.all((points >= low) & (points <= high), axis=1)))


def _draw_regularised(axes: Axes, view: PlaneView) -> list[Line2D]:
    """A pale band along the parts of curves that were computed with regularised clipping."""
    band: dict[str, Any] = {"linewidth": 5.0, "alpha": 0.25, "solid_capstyle": "butt", "zorder": 2.0}
    found = False
    for curve in view.curves:
        for low, high in curve.regularised():
            rows = np.count_nonzero((curve.arclength >= low) & (curve.arclength <= high))
            points = curve.at(np.linspace(low, high, SAMPLES * (rows - 1) + 1))[:, view.order(curve)]
            axes.plot(points[:, 0], points[:, 1], color=CURVE_KINDS[curve.bifurcation][1], **band)
            found = True
    return [Line2D([], [], color=INK, label="regularised clipping", **band)] if found else []


def incomplete_ends(view: PlaneView) -> list[tuple[str, float, float]]:
    """Kind of bifurcation and position where a curve continues but was not traced."""
    return [
        (str(table.attributes["bifurcation"]), float(table[view.x][-1]), float(table[view.y][-1]))
        for table in view.tables.values()
        if table.attributes.get("stop_reason") not in FINISHED and len(table[view.x])
    ]


def _draw_incomplete_ends(axes: Axes, view: PlaneView) -> list[Line2D]:
    """Open markers where a curve continues but was not traced."""
    look: dict[str, Any] = {
        "marker": "s", "markersize": 4.5, "markerfacecolor": "white", "linestyle": "none", "zorder": 4
    }  # fmt: skip
    ends = incomplete_ends(view)
    for kind, x, y in ends:
        axes.plot(x, y, markeredgecolor=CURVE_KINDS[kind][1], markeredgewidth=1.1, **look)
    handle = Line2D([], [], markeredgecolor=INK, markeredgewidth=1.1, label="curve not complete", **look)
    return [handle] if ends else []


def special_points(view: PlaneView) -> list[tuple[str, float, float, bool]]:
    """Kind, position and whether it was located, of every point of codimension two; shared points once.

    A tongue that is not resolved counts as not located.
    """
    found: list[tuple[str, float, float, bool]] = []
    width, height = (float(np.ptp(view.ranges[name])) for name in (view.x, view.y))
    for table in view.tables.values():
        columns = [table.optional(name) for name in ("event_kind", f"event_{view.x}", f"event_{view.y}")]
        located = np.isfinite(table.optional("event_residual"))
        if (tongue := table.optional("event_tongue")).size:
            located &= tongue != "unresolved"
        for kind, x, y, ok in zip(*columns, located, strict=True):
            same = (
                name == kind and abs(x - u) <= ALIKE * width and abs(y - v) <= ALIKE * height
                for name, u, v, _ in found
            )
            if not any(same):
                found.append((str(kind), float(x), float(y), bool(ok)))
    return found


def point_labels(view: PlaneView) -> list[Label]:
    """A label for each point of codimension two; one with their number for a crowd of one kind."""
    places: dict[str, list[tuple[float, float]]] = {}
    for kind, x, y, _ in special_points(view):
        places.setdefault(kind, []).append((x, y))
    size = [np.ptp(view.ranges[name]) for name in (view.x, view.y)]
    labels: list[Label] = []
    for kind, points in places.items():
        scaled = np.array(points) / size
        _, groups = connected_components(cdist(scaled, scaled) <= NEAR)
        for group in np.unique(groups):
            members = [points[index] for index in np.flatnonzero(groups == group)]
            if len(members) >= CROWD:
                middle = members[len(members) // 2]
                labels.append(Label(f"{len(members)} {_special_name(kind)}", *middle))
            else:
                labels += [Label(_special_name(kind), *point) for point in members]
    return labels


def _draw_special_points(axes: Axes, view: PlaneView) -> list[Line2D]:
    look: dict[str, Any] = {"marker": "o", "markersize": 3.4, "linestyle": "none", "zorder": 5}
    found = special_points(view)
    for _, x, y, located in found:
        axes.plot(x, y, markerfacecolor=INK if located else "white", markeredgecolor=INK, **look)
    handle = Line2D([], [], color=INK, label="point of codimension two", **look)
    return [handle] if found else []


def _special_name(kind: str) -> str:
    return SPECIAL_NAMES.get(kind, kind)


def _draw_scan_lines(axes: Axes, view: PlaneView) -> None:
    table = view.others.get("bifurcation_set")
    if table is None:
        return
    names = ("line_parameter", "line_fixed", "line_low", "line_high")
    look: dict[str, Any] = {"color": "#E2E2E2", "linewidth": 0.6, "zorder": 0.4}
    for parameter, fixed, low, high in zip(*(table[name] for name in names), strict=True):
        ends, still = [low, high], [fixed, fixed]
        axes.plot(*((ends, still) if parameter == view.x else (still, ends)), **look)


Layer = Callable[[Axes, PlaneView], Sequence[Any]]


def _draw_errors(axes: Axes, view: PlaneView) -> list[Line2D]:
    """Errors of points that were estimated on finer grids."""
    table = view.others.get("refinement")
    return [] if table is None else draw_refinement(axes, table, view.x, view.y)


# What is drawn over the plane, each giving its entries of the legend; a group that adds to the map adds its
# layer here and its name to drawing.BESIDE.
LAYERS: tuple[Layer, ...] = (
    draw_curves,
    _draw_regularised,
    _draw_special_points,
    _draw_incomplete_ends,
    _draw_stable_range,
    _draw_passive,
    _draw_errors,
)


def _draw_resonances(axes: Axes, view: PlaneView, handles: list[Any]) -> Axes:
    """Draw predicted resonances and add their legend entries; returns the axes on top."""
    criticals = view.others.get("criticals")
    if criticals is None or view.x != "excitation_frequency":
        return axes
    strip = draw_resonances(axes, criticals)
    moving = draw_frequencies(axes, criticals) if view.y == "speed" else []
    handles += resonance_handles(strip is not None, bool(moving))
    return axes if strip is None else strip


def add_second_axes(axes: Axes, top: Axes, view: PlaneView, case: CaseView) -> None:
    """Dimensional axes of both parameters, for x on the axes ``top``."""
    horizontal, vertical = PARAMETER_AXES[view.x], PARAMETER_AXES[view.y]
    add_top(top, *horizontal.dimensional(case.scales))
    add_right(axes, *vertical.dimensional(case.scales))


def _constants(view: PlaneView) -> str:
    """The parameters that are constant over the plane."""
    table = next((table for table in view.tables.values() if len(table[view.x])), None)
    if table is None:
        return ""
    fixed = [name for name in ("displacement", "foil_stiffness") if name not in (view.x, view.y)]
    known = [
        f"{PARAMETER_AXES[name].symbol} = {float(table[name][0]):.4g}"
        for name in fixed
        if name in table and np.isfinite(table[name][0])
    ]
    return " at " + ", ".join(known) if known else ""


def _progress(view: PlaneView) -> str:
    running = any(table.attributes.get("status") == "running" for table in view.tables.values())
    return " (running)" if running else ""
