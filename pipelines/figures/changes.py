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
from matplotlib.ticker import MaxNLocator

from pipelines.datasets.case_table import CaseTable, Column, short_titles
from pipelines.figures import style
from pipelines.figures.bifurcation_diagram import EVENT_MARKS, event_handles

CONDITIONS = ("bearings.foil.stiffness", "excitation.frequency")
RESULT, KIND = "first_bifurcation_speed", "first_bifurcation"
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
    titles = [", ".join(texts) for texts in zip(*_written(conditions), strict=True)]
    for case in sorted(range(len(labels)), key=lambda case: [column.values[case] for column in conditions]):
        label = labels[case]
        title = titles[case] if titles else ""
        change = Change(label, float(results[RESULT][case]), str(results[KIND][case]))
        found.setdefault(title, []).append(change)
    ordered = {label: place for place, label in enumerate(dict.fromkeys([BASE, *labels]))}
    return [
        ChangePanel(title, tuple(sorted(changes, key=lambda each: ordered[each.label])))
        for title, changes in found.items()
    ]


def _labels(columns: Sequence[Column]) -> Iterator[str]:
    """For each case the keys that differ from the base, with their values."""
    written = _written(columns)
    usual = [Counter(texts).most_common(1)[0][0] for texts in written]
    for texts in zip(*written, strict=True):
        yield ", ".join(text for text, base in zip(texts, usual, strict=True) if text != base) or BASE


def _written(columns: Sequence[Column]) -> list[list[str]]:
    """The title and value of each column in each case; titles are told apart over all columns."""
    return [
        [
            f"{title} = {value:.6g}" if column.is_number else f"{title} = {value}"
            for value in column.values.tolist()
        ]
        for title, column in zip(short_titles(columns), columns, strict=True)
    ]


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
    kinds = {each.kind for panel in panels for each in panel.changes if np.isfinite(each.speed)}
    style.legend_below(figure, event_handles(kinds))
    figure.draw_without_rendering()  # the layout needs the size of the tick labels
    return style.finish(figure, "speed of the first bifurcation with one change at a time", note)


def _draw_panel(axes: Axes, panel: ChangePanel, labels: Sequence[str]) -> None:
    for change in panel.changes:
        place = labels.index(change.label)
        if np.isfinite(change.speed):
            axes.plot([panel.base, change.speed], [place, place], color=style.SKY, linewidth=2.0)
            axes.plot(change.speed, place, **EVENT_MARKS[change.kind].look())
        else:
            axes.text(0.5, place, NONE, transform=axes.get_yaxis_transform(), ha="center", va="center")
    if np.isfinite(panel.base):
        axes.axvline(panel.base, color=style.BLACK, linewidth=0.8)
    axes.grid(False, axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title(panel.title)
    axes.set_xlabel("speed")
