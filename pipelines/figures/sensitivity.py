"""How the results of several machines depend on the keys in which these differ: tornado and scatter matrix.

A linear fit  y = a + sum_i b_i u_i  over the cases, u_i = (x_i - middle of x_i) / half range of x_i, is
drawn as a tornado: bar i reaches from a - |b_i| to a + |b_i|, which the fit tells for the ends of the range
of input i while the others rest in the middle.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipelines.datasets.case_table import DIMENSIONAL, CaseTable, Column, short_titles
from pipelines.figures import style
from pipelines.figures.case_tables import Notify
from pipelines.figures.changes import change_panels, draw_changes
from pipelines.figures.contents import FigurePlan

Array = NDArray[np.float64]

TABLE_KINDS = ("tornado", "scatter", "changes")
MOST_OUTPUTS = 6  # panels of a tornado
MOST_VARIABLES = 8  # rows of a scatter matrix
LABEL_WIDTH = 12  # letters in a line of their labels
LOW, HIGH = style.SKY, style.VERMILION
GOOD_FIT = 0.9  # share of the variance: below it the bars are not the whole story


@dataclass(frozen=True)
class LinearFit:
    """The fit of one output (n,) over inputs scaled to [-1, 1].

    ``middle``: a; ``effects``: b_i by input; ``explained``: share of the variance that the fit explains,
    adjusted for its number of coefficients.
    """

    middle: float
    effects: Array
    explained: float


def linear_fit(inputs: Array, output: Array) -> LinearFit:
    """Least squares over n > m + 1 cases; ``inputs`` (n, m), whose columns all vary."""
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    scaled = (2.0 * inputs - low - high) / (high - low)
    count, width = scaled.shape
    matrix = np.column_stack([np.ones(count), scaled])
    coefficients = np.linalg.lstsq(matrix, output, rcond=None)[0]
    left = np.sum((output - matrix @ coefficients) ** 2) / (count - width - 1)
    total = np.sum((output - output.mean()) ** 2) / (count - 1)
    return LinearFit(float(coefficients[0]), coefficients[1:], float(1.0 - left / total))


def varying(columns: Sequence[Column]) -> list[Column]:
    """Columns of numbers that are known in two cases at least, and differ."""
    return [
        column
        for column in columns
        if column.is_number and len(set(column.values[np.isfinite(column.values)].tolist())) > 1
    ]


def shown_outputs(table: CaseTable) -> list[Column]:
    """Varying outputs; in rpm and Hz where there are, because the scales differ between machines."""
    names = {column.name for column in table.outputs}
    dimensional = {f"{name}_{ending}" for name in names for ending in DIMENSIONAL} & names
    replaced = {name.rpartition("_")[0] for name in dimensional}
    return [column for column in varying(table.outputs) if column.name not in replaced]


@dataclass(frozen=True)
class Quantity:
    """A column as it is drawn: title, unit ("" for none), values (n,); lengths in mm or µm."""

    title: str
    unit: str
    values: Array

    @property
    def label(self) -> str:
        """Title and unit, for an axis."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def range(self) -> str:
        """Lowest and highest value, and the unit."""
        return f"{np.nanmin(self.values):.4g} – {np.nanmax(self.values):.4g} {self.unit}".rstrip()


def quantities(columns: Sequence[Column]) -> list[Quantity]:
    """Columns as they are drawn, told apart by their titles."""
    found = []
    for title, column in zip(short_titles(columns), columns, strict=True):
        factor, unit = 1.0, "" if column.unit == "1" else column.unit
        if unit == "m":
            factor, unit = (1e6, "µm") if np.nanmax(np.abs(column.values)) < 1e-3 else (1e3, "mm")
        found.append(Quantity(title, unit, factor * column.values))
    return found


@dataclass(frozen=True)
class Panel:
    """One output of a tornado, over the cases in which it is known."""

    output: Quantity
    fit: LinearFit
    cases: int


def tornado_panels(table: CaseTable) -> Iterator[Panel]:
    """The outputs that are known in more cases than the fit has coefficients."""
    inputs = varying(table.inputs)
    for output in quantities(shown_outputs(table)):
        columns = np.column_stack([*(column.values for column in inputs), output.values])
        known = columns[np.isfinite(columns).all(axis=1)]
        if len(known) > len(inputs) + 1 and np.all(np.ptp(known, axis=0) > 0.0):
            yield Panel(output, linear_fit(known[:, :-1], known[:, -1]), len(known))


@style.in_style
def draw_tornado(table: CaseTable, panels: Sequence[Panel], note: str) -> Figure:
    """One panel for every output: bars by input, the longest on top."""
    inputs = quantities(varying(table.inputs))
    rows = (len(panels) + 1) // 2
    figure = style.new_figure(0.9 + rows * (0.9 + 0.28 * len(inputs)))
    grid = figure.subplots(rows, min(2, len(panels)), squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _draw_bars(axes, panel, [f"{each.title}\n{each.range}" for each in inputs])
        axes.set_xlabel(panel.output.label)
    for axes in grid.flat[len(panels) :]:
        axes.axis("off")
    handles = [Patch(color=LOW, label="lowest value"), Patch(color=HIGH, label="highest value")]
    style.legend_below(figure, handles)
    figure.draw_without_rendering()  # the layout needs the size of the tick labels
    return style.finish(figure, "effect of each input over its range, from a linear fit", note)


def _draw_bars(axes: Axes, panel: Panel, labels: Sequence[str]) -> None:
    fit = panel.fit
    order = np.argsort(np.abs(fit.effects))
    places = np.arange(len(order))
    for sign, colour in ((-1.0, LOW), (1.0, HIGH)):
        axes.barh(places, sign * fit.effects[order], left=fit.middle, color=colour, height=0.7)
    axes.axvline(fit.middle, color=style.BLACK, linewidth=0.8)
    axes.set_yticks(places, [labels[place] for place in order])
    axes.grid(False, axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    doubt = "" if fit.explained >= GOOD_FIT else ": see the scatter matrix"
    axes.set_title(f"{panel.cases} cases, fit explains {max(fit.explained, 0.0):.0%}{doubt}")


@style.in_style
def draw_scatter(inputs: Sequence[Quantity], outputs: Sequence[Quantity], note: str) -> Figure:
    """Every pair of inputs and outputs; above the diagonal their correlations."""
    variables = (*inputs, *outputs)
    count = len(variables)
    figure = style.new_figure(style.DOUBLE_COLUMN)
    grid = figure.subplots(count, count, squeeze=False, sharex="col")
    for row, y in enumerate(variables):
        for column, x in enumerate(variables):
            axes = grid[row, column]
            axes.grid(False)
            axes.xaxis.set_major_locator(MaxNLocator(2))
            if row == column:
                axes.hist(x.values[np.isfinite(x.values)], bins="sturges", color=style.GREY)
                axes.set_yticks([])
            elif row < column:
                _write_correlation(axes, x.values, y.values)
            else:
                colour = style.BLUE if row < len(inputs) else style.VERMILION
                axes.plot(x.values, y.values, ".", color=colour, markersize=3)
                axes.yaxis.set_major_locator(MaxNLocator(2))
                axes.tick_params(labelleft=column == 0)
        label = "\n".join(wrap(y.label, LABEL_WIDTH))
        grid[row, 0].set_ylabel(label, fontsize=6.5)
        grid[-1, row].set_xlabel(label, fontsize=6.5)
        grid[-1, row].tick_params(axis="x", labelrotation=45.0)
    figure.align_ylabels()
    return style.finish(figure, "inputs and results of all cases", note)


def _write_correlation(axes: Axes, x: Array, y: Array) -> None:
    """The correlation coefficient of what is known of both, the larger the stronger."""
    axes.axis("off")
    known = np.isfinite(x) & np.isfinite(y)
    if known.sum() > 2 and np.ptp(x[known]) > 0.0 and np.ptp(y[known]) > 0.0:
        value = round(float(np.corrcoef(x[known], y[known])[0, 1]), 2) + 0.0  # no -0.00
        centred: dict[str, Any] = {"ha": "center", "va": "center", "transform": axes.transAxes}
        axes.text(0.5, 0.5, f"{value:.2f}", fontsize=7.0 + 5.0 * abs(value), **centred)


def table_plans(table: CaseTable, kinds: Collection[str], note: str, notify: Notify) -> Iterator[FigurePlan]:
    """The figures of the table of some cases; ``notify`` receives why one of ``kinds`` cannot be drawn."""
    if "changes" in kinds:
        yield from _changes(table, note, notify)
    kinds = [kind for kind in kinds if kind != "changes"]
    inputs, outputs = quantities(varying(table.inputs)), quantities(shown_outputs(table))
    missing = "key with numbers in which they differ" * (not inputs) or "result that differs" * (not outputs)
    if missing and kinds:
        notify(f"{' and '.join(kinds)} left out: the chosen cases have no {missing}")
    if missing:
        return
    if "tornado" in kinds:
        panels = list(tornado_panels(table))
        if panels:
            shown = panels[:MOST_OUTPUTS]
            yield FigurePlan("tornado", "tornado", partial(draw_tornado, table, shown, note))
        else:
            needed = len(inputs) + 2
            notify(f"tornado is left out: {len(inputs)} inputs need {needed} cases with a result, none has")
    if "scatter" in kinds:
        room = max(MOST_VARIABLES - len(inputs), 1)
        if len(inputs) < MOST_VARIABLES:
            yield FigurePlan("scatter", "scatter", partial(draw_scatter, inputs, outputs[:room], note))
        else:
            notify(f"scatter is left out: {len(inputs)} inputs differ; it shows at most {MOST_VARIABLES - 1}")


def _changes(table: CaseTable, note: str, notify: Notify) -> Iterator[FigurePlan]:
    panels = change_panels(table)
    if panels:
        yield FigurePlan("changes", "changes", partial(draw_changes, panels, note))
    else:
        notify("changes is left out: the chosen cases differ in no key, or have no branch along the speed")
