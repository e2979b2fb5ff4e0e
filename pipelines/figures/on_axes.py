"""The content of the main figures on axes of your own, for notebooks: each function takes a store and axes.

Lines, markers and axis labels are those of `agfb figures`; titles, legends and the figure's style are yours.
Every function returns handles for `Axes.legend`. ``case`` may be omitted where the store holds one case.

Raises ValueError for a case, a bearing or a direction that there is not, MissingDataError where the case
lacks the data, StoreError where the store cannot be read.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from pipelines.datasets.reading import list_cases
from pipelines.datasets.store import Store, StoreError, open_for_reading
from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.bifurcation_diagram import branch_handles, draw_branch, envelope, event_names
from pipelines.figures.case_tables import RUNS, CaseTables, read_case
from pipelines.figures.contents import MissingDataError, Table
from pipelines.figures.response_envelope import comparable, draw_chart, envelope_handles
from pipelines.figures.runs import label_along
from pipelines.figures.stability_map import PlaneView, curves_over, draw_plane

HORIZONTAL, VERTICAL = 0, 1
DIRECTIONS = {"horizontal": HORIZONTAL, "vertical": VERTICAL}
PLANE = frozenset({"excitation_frequency", "speed"})


def stability_map(
    store: Store | Path | str, axes: Axes, case: str | None = None, plane: Collection[str] = PLANE
) -> list[Any]:
    """Draw all bifurcation curves of a case over two parameters."""
    held = _read(store, case, ("curve", "bifurcation_set", "operating_range", "refinement"))
    inside = curves_over(held.curves, plane)
    if not inside:
        raise MissingDataError(f"{held.view.name} has no curves over {' and '.join(sorted(plane))}")
    return draw_plane(axes, PlaneView.of(inside, held.single))


def branch(
    store: Store | Path | str,
    axes: Axes,
    case: str | None = None,
    name: str = "b000",
    direction: str = "vertical",
) -> list[Any]:
    """Draw the extremes of the journals' orbits along a branch of cycles, solid where stable.

    Over the clearance of each bearing; ``direction``: horizontal or vertical.
    """
    if direction not in DIRECTIONS:
        raise ValueError(f"direction must be {' or '.join(DIRECTIONS)}, not {direction!r}")
    held = _read(store, case, ("cycles",))
    table = _chosen(held, held.of_kind("cycles"), name, "branch")
    parameter, quantity = str(table.attributes["parameter"]), envelope(DIRECTIONS[direction])
    for bearing in range(held.view.bearings):
        draw_branch(axes, table, parameter, quantity(held.view, table, bearing), bearing)
    axes.set(xlabel=PARAMETER_AXES[parameter].label, ylabel=f"{direction} motion / clearance")
    return list(branch_handles(held.view.bearings, set(event_names(table))))


def transient(
    store: Store | Path | str, axes: Axes, case: str | None = None, name: str = "t000", bearing: int = 1
) -> list[Any]:
    """Draw the vertical envelope of a transient in a bearing (1 or 2), over that of the stored cycles."""
    held = _read(store, case, (RUNS, "transient", "cycles"))
    if not 1 <= bearing <= held.view.bearings:
        raise ValueError(f"bearing must be 1 to {held.view.bearings}, not {bearing}")
    run = _chosen(held, {run.name: run for run in held.runs}, name, "transient")
    cycles = comparable(run, list(held.of_kind("cycles").values())) if run.over_speed else []
    draw_chart(axes, held.view, run, cycles, bearing - 1)
    label_along(axes, run.over_speed, held.view.scales)
    return list(envelope_handles([run], cycles))


def _read(store: Store | Path | str, case: str | None, kinds: Collection[str]) -> CaseTables:
    """The groups of these kinds of a case, by default of the only one."""
    opened = store if isinstance(store, Store) else open_for_reading(store)
    known = list_cases(opened)
    if case is None and len(known) != 1:
        raise ValueError(f"the store holds {len(known)} cases, choose one: {', '.join(known)}")
    if case is not None and case not in known:
        raise ValueError(f"the store holds no case {case!r} but {', '.join(known)}")
    damaged: list[StoreError] = []
    held = read_case(opened, case or known[0], kinds, lambda message: None, damaged)
    if damaged or held is None:
        raise damaged[0]
    return held


def _chosen(held: CaseTables, found: dict[str, Any], name: str, what: str) -> Any:
    if name not in found:
        raise MissingDataError(
            f"{held.view.name} has no {what} {name!r}; it has {', '.join(sorted(found)) or 'none'}"
        )
    chosen = found[name]
    if isinstance(chosen, Table) and not len(chosen["speed"]):
        raise MissingDataError(f"the {what} {name!r} of {held.view.name} has no points yet")
    return chosen
