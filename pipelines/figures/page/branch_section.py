"""Branches of cycles, the survey, and estimates of errors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.bifurcation_diagram import EVENT_MARKS, draw_bifurcation_diagram
from pipelines.figures.case_tables import CaseTables
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.page import elements
from pipelines.figures.survey import draw_survey

MOST_ROWS = 40  # of a table of points


def branches(held: CaseTables) -> list[str]:
    """A diagram for every parameter along which there are branches, and their bifurcations."""
    view, found = held.view, []
    cycles = {name: table for name, table in held.of_kind("cycles").items() if len(table["speed"])}
    for parameter in PARAMETER_AXES:
        along = [table for table in cycles.values() if table.attributes.get("parameter") == parameter]
        if along:
            drawing = draw_bifurcation_diagram(view, parameter, along, held.single.get("refinement"))
            title = f"Limit cycles of {view.name} along the {PARAMETER_AXES[parameter].title}"
            found.append(elements.picture(drawing, title))
    rows = [row for name, table in cycles.items() for row in _events(view, name, table)]
    if rows:
        header = ("branch", "bifurcation", "parameter", "value", "in units", "angle of the multiplier [°]")
        found.append(elements.table(header, rows[:MOST_ROWS], _some("Bifurcations on the branches", rows)))
    return found


def _events(view: CaseView, name: str, branch: Table) -> list[tuple[elements.Cell, ...]]:
    parameter = str(branch.attributes["parameter"])
    axis = PARAMETER_AXES[parameter]
    factor, _ = axis.dimensional(view.scales)
    values, angles = branch.optional(f"event_{parameter}"), np.degrees(branch.optional("event_angle"))
    return [
        (
            f"cycles/{name}",
            EVENT_MARKS[str(kind)].label,
            axis.title,
            float(value),
            f"{elements.number(factor * float(value))} {axis.unit}",
            float(angle),
        )
        for kind, value, angle in zip(branch.optional("event_kind"), values, angles, strict=True)
    ]


def survey(held: CaseTables) -> list[str]:
    """The map of growth rates."""
    table = held.single.get("survey")
    if table is None or not len(table["across"]):
        return []
    drawing = draw_survey(held.view, table, held.curves)
    return [elements.picture(drawing, f"Growth rates of {held.view.name} over the plane")]


def errors(held: CaseTables) -> list[str]:
    """Errors by the time steps of curves and branches, and by the grids of refined points."""
    rows = [
        row
        for title, tables in (
            ("branches of cycles", held.of_kind("cycles")),
            ("bifurcation curves", held.curves),
        )
        for row in _step_errors(title, tables)
    ]
    header = ("points on", "number", "median", "largest", "not known")
    found = [elements.table(header, rows, "Error of the multipliers by the time steps")] if rows else []
    if (refinement := held.single.get("refinement")) is not None:
        found.append(_refined(refinement))
    return found


def _step_errors(title: str, tables: Mapping[str, Table]) -> list[tuple[elements.Cell, ...]]:
    every = [table.optional("step_error") for table in tables.values()]
    values = np.concatenate([np.zeros(0), *every])
    known = values[np.isfinite(values)]
    if not len(values):
        return []
    largest = (float(np.median(known)), float(np.max(known))) if len(known) else (None, None)
    return [(title, f"{len(values)}", *largest, f"{len(values) - len(known)}")]


def _refined(table: Table) -> str:
    rows: list[tuple[elements.Cell, ...]] = [
        (
            EVENT_MARKS[str(table["bifurcation"][row])].label,
            str(table["free"][row]).replace("_", " "),
            float(table["value"][row]),
            float(table["error"][row]),
            str(table["status"][row]).replace("_", " "),
        )
        for row in range(len(table["value"]))
    ]
    header = ("bifurcation", "parameter", "stored value", "error", "status")
    return elements.table(header, rows[:MOST_ROWS], _some("Points recomputed on finer grids", rows))


def _some(caption: str, rows: list[tuple[elements.Cell, ...]]) -> str:
    return caption if len(rows) <= MOST_ROWS else f"{caption}: the first {MOST_ROWS} of {len(rows)}"
