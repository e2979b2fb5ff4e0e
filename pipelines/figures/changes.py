"""What changes of single keys do to the first bifurcation: one panel for each foil and excitation frequency.

Cases of a panel agree with one another in foil stiffness and excitation frequency; each row is one change of
the other keys.  The base, on top, has of each key the value that most cases have.
"""

from __future__ import annotations

from collections import Counter
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
NONE = "none"


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
    """The panels by rising conditions; none without changes or without first bifurcations."""
    results = {column.name: column.values for column in table.outputs}
    conditions = [column for column in table.inputs if column.name in CONDITIONS]
    changed = [column for column in table.inputs if column.name not in CONDITIONS]
    if RESULT not in results or not changed:
        return []
    found: dict[str, list[Change]] = {}
    labels = list(_labels(changed))
    for case in sorted(range(len(labels)), key=lambda case: [column.values[case] for column in conditions]):
        label = labels[case]
        title = ", ".join(_named(conditions, case))
        change = Change(label, float(results[RESULT][case]), str(results[KIND][case]))
        found.setdefault(title, []).append(change)
    ordered = {label: place for place, label in enumerate(dict.fromkeys([BASE, *labels]))}
    return [
        ChangePanel(title, tuple(sorted(changes, key=lambda each: ordered[each.label])))
        for title, changes in found.items()
    ]


def _labels(columns: Sequence[Column]) -> Iterator[str]:
    """For each case the keys that differ from the base, with their values."""
    usual = [Counter(column.values.tolist()).most_common(1)[0][0] for column in columns]
    for case in range(len(columns[0].values)):
        differing = [
            column for column, base in zip(columns, usual, strict=True) if column.values[case] != base
        ]
        yield ", ".join(_named(differing, case)) or BASE


def _named(columns: Sequence[Column], case: int) -> Iterator[str]:
    for title, column in zip(short_titles(columns), columns, strict=True):
        value = column.values[case]
        yield f"{title} = {value:.4g}" if column.is_number else f"{title} = {value}"


@style.in_style
def draw_changes(panels: Sequence[ChangePanel], note: str) -> Figure:
    """Speeds of the first bifurcation by change; a line marks the base."""
    labels = list(dict.fromkeys(each.label for panel in panels for each in panel.changes))
    rows, columns = (len(panels) + 1) // 2, min(2, len(panels))
    figure = style.new_figure(1.0 + rows * (0.8 + 0.2 * len(labels)))
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _draw_panel(axes, panel, labels)
    grid[0, 0].set_yticks(np.arange(len(labels)), [label.replace(", ", ",\n") for label in labels])
    grid[0, 0].tick_params(axis="y", labelsize=6.0)
    grid[0, 0].set_ylim(len(labels) - 0.5, -0.5)
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


def _draw_panel(axes: Axes, panel: ChangePanel, labels: Sequence[str]) -> None:
    for change in panel.changes:
        place = labels.index(change.label)
        if np.isfinite(change.speed):
            axes.plot([panel.base, change.speed], [place, place], color=style.SKY, linewidth=2.0)
            axes.plot(change.speed, place, MARKERS.get(change.kind, OTHER), color=style.BLUE, markersize=4)
        else:
            axes.text(0.5, place, NONE, transform=axes.get_yaxis_transform(), ha="center", va="center")
    if np.isfinite(panel.base):
        axes.axvline(panel.base, color=style.BLACK, linewidth=0.8)
    axes.grid(False, axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title(panel.title)
    axes.set_xlabel("speed")
