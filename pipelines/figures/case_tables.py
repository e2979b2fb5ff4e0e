"""The content of a store for one case, read as far as some figures need it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipelines.datasets.curves import CURVE_CONTAINERS
from pipelines.datasets.dimensional import StoredScales
from pipelines.datasets.reading import case_attributes, list_groups, read_group
from pipelines.datasets.store import Store, StoreError, case_group, local_name
from pipelines.figures.axes import AxisScales
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.runs import RUN_ARRAYS, RunView

Notify = Callable[[str], None]

RUNS = "transient_analysis"


@dataclass(frozen=True)
class CaseTables:
    """Groups of a case by their path below it (``cycles/b000``), and what every figure of the case needs."""

    view: CaseView
    tables: Mapping[str, Table]

    def of_kind(self, kind: str) -> dict[str, Table]:
        """Groups of a kind by the last part of their name: cycles by ``b000``, ..."""
        return {
            name.rsplit("/", 1)[-1]: table for name, table in self.tables.items() if kind_of(name) == kind
        }

    @property
    def curves(self) -> dict[str, Table]:
        """Curves of bifurcations by name: ``ns/c000``."""
        return {name: table for name, table in self.tables.items() if kind_of(name) == "curve"}

    @property
    def single(self) -> dict[str, Table]:
        """Groups that a case has at most once, by kind."""
        return {name: table for name, table in self.tables.items() if "/" not in name}

    @property
    def runs(self) -> list[RunView]:
        """The transients that have ended, with their analysis."""
        return [
            RunView(name, analysis, self.tables[f"transient/{name}"])
            for name, analysis in self.of_kind(RUNS).items()
            if f"transient/{name}" in self.tables
        ]


def kind_of(group: str) -> str:
    """Kind of a group from its path below the case: cycles/b000 holds cycles, ns/c000 a curve."""
    container = group.split("/")[0]
    return "curve" if container in CURVE_CONTAINERS else container


def read_case(
    store: Store, case: str, needed: Collection[str], notify: Notify, damaged: list[StoreError]
) -> CaseTables | None:
    """The groups of the kinds ``needed``; unreadable groups are reported, and their errors collected.

    None where the case itself cannot be read.
    """
    try:
        groups = [local_name(name) for name in list_groups(store, case)]
        view = _case_view(store, case, groups)
    except StoreError as error:
        notify(f"{case} is left out: {error.message}")
        damaged.append(error)
        return None
    tables = {}
    for name in groups:
        if kind_of(name) not in needed or _is_search_line(name):
            continue
        try:
            tables[name] = _table(store, case, name)
        except StoreError as error:
            notify(f"{case_group(case, name)} is left out: {error.message}")
            damaged.append(error)
    return CaseTables(view, tables)


def _is_search_line(group: str) -> bool:
    """Whether a group is one of the branches that searched the plane."""
    return group.startswith("cycles/s")


def _table(store: Store, case: str, name: str) -> Table:
    arrays = RUN_ARRAYS if kind_of(name) == "transient" else None
    group = read_group(store, case_group(case, name), arrays)
    return Table(group.labelled(), group.attributes)


def _case_view(store: Store, case: str, groups: Collection[str]) -> CaseView:
    attributes = case_attributes(store, case)
    machine = _table(store, case, "machine") if "machine" in groups else Table({})
    return CaseView(
        name=str(attributes.get("name") or case),
        note=str(attributes.get("reconstruction") or ""),
        scales=_scales(StoredScales(store, case), attributes["scales"]),
        machine=machine,
        parameters=attributes.get("parameters") or {},
    )


def _scales(scales: StoredScales, stored: Mapping[str, Any]) -> AxisScales:
    """Scales of the axes from the ``stored`` scales of the case, which are in SI units."""
    return AxisScales(
        rpm=stored["speed_rpm_per_unit"],
        hertz=stored["hertz_per_unit"],
        micrometres=1e6 * stored["displacement"],
        stiffness=1e-9 * stored["pressure"] / stored["displacement"],
        bearings_differ=len(set(scales.of_bearings.get("um", np.zeros(0)).tolist())) > 1,
        of_bearings=scales.of_bearings,
    )
