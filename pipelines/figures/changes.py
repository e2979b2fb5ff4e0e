"""What changes of single keys do to the first bifurcation: one panel for each foil and excitation frequency.

The first case is the base.  Cases of a panel agree with one another in foil stiffness and excitation
frequency; each row is one change of the other keys, the base on top.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from pipelines.datasets.case_table import CaseTable, Column, short_titles
from pipelines.figures import style

CONDITIONS = ("bearings.foil.stiffness", "excitation.frequency")
RESULT, KIND = "first_bifurcation_speed", "first_bifurcation"
MARKERS = {"neimark_sacker": "o", "period_doubling": "s", "fold": "^"}
OTHER = "D"
BASE = "unchanged"


@dataclass(frozen=True)
class Change:
    """One change at the conditions of a panel: its label, the speed (NaN: no bifurcation), its kind."""

    label: str
    speed: float
    kind: str


@dataclass(frozen=True)
class ChangePanel:
    """All changes at one foil stiffness and excitation frequency; the base is the first, if it is there."""

    title: str
    changes: tuple[Change, ...]

    @property
    def base(self) -> float:
        """The speed without a change; NaN where there is none."""
        return next((each.speed for each in self.changes if each.label == BASE), float("nan"))


def change_panels(table: CaseTable) -> list[ChangePanel]:
    """The panels by the order of the cases; none without changes or without first bifurcations."""
    results = {column.name: column.values for column in table.outputs}
    conditions = [column for column in table.inputs if column.name in CONDITIONS]
    changed = [column for column in table.inputs if column.name not in CONDITIONS]
    if RESULT not in results or not changed:
        return []
    found: dict[str, list[Change]] = {}
    labels = list(_labels(changed))
    for case, label in enumerate(labels):
        title = ", ".join(_named(conditions, case))
        change = Change(label, float(results[RESULT][case]), str(results[KIND][case]))
        found.setdefault(title, []).append(change)
    ordered = {label: place for place, label in enumerate(dict.fromkeys(labels))}
    return [
        ChangePanel(title, tuple(sorted(changes, key=lambda each: ordered[each.label])))
        for title, changes in found.items()
    ]


def _labels(columns: Sequence[Column]) -> Iterator[str]:
    """For each case the keys that differ from the first case, with their values."""
    for case in range(len(columns[0].values)):
        differing = [column for column in columns if not _same(column, case)]
        yield ", ".join(_named(differing, case)) or BASE


def _same(column: Column, case: int) -> bool:
    value, base = column.values[case], column.values[0]
    return bool(value == base or (column.is_number and np.isnan(value) and np.isnan(base)))


def _named(columns: Sequence[Column], case: int) -> Iterator[str]:
    for title, column in zip(short_titles(columns), columns, strict=True):
        value = column.values[case]
        yield f"{title} = {value:.4g}" if column.is_number else f"{title} = {value}"


@style.in_style
def draw_changes(panels: Sequence[ChangePanel], note: str) -> Figure:
    """Speeds of the first bifurcation by change; a line marks the base."""
    most = max(len(panel.changes) for panel in panels)
    rows, columns = (len(panels) + 1) // 2, min(2, len(panels))
    figure = style.new_figure(0.9 + rows * (0.7 + 0.16 * most))
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _draw_panel(axes, panel)
    for axes in grid.flat[len(panels) :]:
        axes.axis("off")
    kinds = dict.fromkeys(each.kind for panel in panels for each in panel.changes if np.isfinite(each.speed))
    handles = [
        Line2D(
            [],
            [],
            color=style.BLUE,
            linestyle="",
            marker=MARKERS.get(kind, OTHER),
            label=kind.replace("_", " "),
        )
        for kind in kinds
    ]
    style.legend_below(figure, handles)
    figure.draw_without_rendering()  # the layout needs the size of the tick labels
    return style.finish(figure, "speed of the first bifurcation with one change at a time", note)


def _draw_panel(axes: Axes, panel: ChangePanel) -> None:
    places = np.arange(len(panel.changes))
    for place, change in zip(places, panel.changes, strict=True):
        if np.isfinite(change.speed):
            axes.plot([panel.base, change.speed], [place, place], color=style.SKY, linewidth=2.0)
            axes.plot(change.speed, place, MARKERS.get(change.kind, OTHER), color=style.BLUE, markersize=4)
    if np.isfinite(panel.base):
        axes.axvline(panel.base, color=style.BLACK, linewidth=0.8)
    axes.set_yticks(
        places, [f"{each.label}{'' if np.isfinite(each.speed) else ' (none)'}" for each in panel.changes]
    )
    axes.set_ylim(len(panel.changes) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title(panel.title)
    axes.set_xlabel("speed")
