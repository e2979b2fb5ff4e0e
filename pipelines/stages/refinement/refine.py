"""`--refine`: errors of located bifurcations, estimated by recomputing them on finer grids.

Every chosen point becomes one row of the group ``refinement``, committed as soon as it is computed. A row
depends on the stored point alone, so that an interrupted refinement goes on with the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store
from pipelines.stages.job import Job
from pipelines.stages.parameter_columns import parameter_columns
from pipelines.stages.parts import Row, RowPlan, compute_alone, discard_all
from pipelines.stages.refinement.levels import (
    BOUND,
    REFINED,
    ErrorEstimate,
    Grid,
    Level,
    Refinement,
    build_level,
    estimate,
    formal_order,
    grid_family,
    refine_point,
)
from pipelines.stages.refinement.points import StoredPoint, stored_points
from pipelines.stages.results import Report, ShouldStop, StageResult

GROUP = "refinement"
ALL_RECOMPUTED = "all points are recomputed"
NOTHING = "no bifurcation is stored"


def refine(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the group ``refinement`` of a case with one row per bifurcation point.

    Points that already have a row are left alone.
    """
    return compute_alone(plan_refine(named, store_path, report, should_stop))


def plan_refine(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> RefinementPlan:
    """The points of a case; each is a part."""
    return RefinementPlan(Job.of("refine", named, store_path, report, should_stop))


@dataclass(frozen=True)
class RefinementPlan(RowPlan):
    """One row for each point."""

    job: Job
    group = GROUP

    @cached_property
    def levels(self) -> list[Level]:
        """The grids with their machines."""
        return [build_level(self.job.case, grid) for grid in grid_family(self.job.case)]

    @cached_property
    def points(self) -> list[StoredPoint]:
        """The stored points of the case."""
        return stored_points(self.job.store, self.job.case_id, self.job.case.refine.points_per_curve)

    def missing(self) -> tuple[int, list[Row]]:
        """The points without a row."""
        known = _known(self.job.store, self.job.path(GROUP))
        waiting = [point.key for point in self.points if point.key not in known]
        rows = [Row("-".join(map(str, key)), {"key": key}) for key in waiting]
        return len(known) + len(rows) if self.points else 0, rows

    def open(self, group: str, rows: int) -> BranchWriter:
        """Open the group for so many points."""
        return _open(self.job.store, self.job.path(group), self.job.case, rows)

    def row(self, job: Job, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        """Recompute one point."""
        point = next(each for each in self.points if list(each.key) == list(arguments["key"]))
        found = refine_point(job.machine, self.levels, point)
        known = estimate(point.value, grid_family(job.case), found, formal_order(job.case))
        return _row(job.case, point, found, known), _message(point, found, known)

    def finish(self, branch: BranchWriter) -> None:
        """All points are recomputed."""
        branch.finish(ALL_RECOMPUTED)

    def result(self) -> StageResult:
        """How many points are refined."""
        store, group = self.job.store, self.job.path(GROUP)
        if not self.job.should_stop():
            discard_all(self.job)
        if not store.has_group(group):
            return StageResult(self.job.case_id, True, NOTHING, "continue cycles through a bifurcation first")
        return _result(self.job.case_id, read_group(store, group))


def _known(store: Store, group: str) -> set[tuple[int, int, int]]:
    """Keys of the points that already have a row."""
    if not store.has_group(group):
        return set()
    rows = read_group(store, group, ("source", "source_number", "source_index"))
    columns = (rows["source"], rows["source_number"], rows["source_index"])
    return {(int(a), int(b), int(c)) for a, b, c in zip(*columns, strict=True)}


def _open(store: Store, group: str, case: Case, capacity: int) -> BranchWriter:
    # More points may be asked for later; everything else must stay as it was.
    request = case.refine.model_dump(mode="json", exclude={"points_per_curve"})
    grids = grid_family(case)
    static = {
        "level_unknowns": np.array([_unknowns(case, grid) for grid in grids], dtype=np.int32),
        "level_circumferential": np.array([grid.circumferential for grid in grids], dtype=np.int32),
        "level_axial": np.array([grid.axial for grid in grids], dtype=np.int32),
    }
    sizes = {"refined": capacity, "level": len(grids)}
    attributes = {"request": request, "formal_order": formal_order(case)}
    return open_branch(store, group, "refinement", sizes, static, attributes, wait=True)


def _unknowns(case: Case, grid: Grid) -> int:
    """Number of unknowns N on a grid, as the kernels count it."""
    periodic = [bearing.film == "periodic" for bearing in case.bearings]
    nodes = sum(grid.circumferential - (0 if whole else 1) for whole in periodic)
    return nodes * (grid.axial + 1) + 2 * case.rotor.condensed_freedoms


def _row(case: Case, point: StoredPoint, found: Refinement, known: ErrorEstimate) -> dict[str, Any]:
    """One row of the group."""
    kind = KINDS["refinement"].array("bifurcation").flag(point.kind.name.lower())
    return {
        "source": np.int8(point.source),
        "source_number": point.number,
        "source_index": point.index,
        "bifurcation": np.int8(kind),
        "turns": point.turns,
        **parameter_columns(case, point.parameters),
        "held": np.int8(PARAMETERS.index(point.held)),
        "free": np.int8(PARAMETERS.index(point.free)),
        "value": point.value,
        "level_value": found.values,
        "level_angle": found.angles,
        "level_steps": found.steps,
        "observed_order": known.order,
        "richardson": known.richardson,
        "richardson_error": known.richardson_error,
        "error": known.error,
        "axial_error": known.axial_error,
        "step_error": known.step_error,
        "status": np.int8(known.status),
        "failed_level": found.failed_level,
    }


def _message(point: StoredPoint, found: Refinement, known: ErrorEstimate) -> str:
    name = f"{point.kind.name.lower().replace('_', ' ')} at {point.free} {point.value:.6g}"
    if known.status == REFINED:
        return f"{name}: extrapolated {known.richardson:.6g}, order {known.order:.2f}"
    if known.status == BOUND:
        return f"{name}: no clean order, error below {known.error:.2g}"
    return f"{name}: {found.reason}"


def _result(case_id: str, group: Group) -> StageResult:
    """How many points are refined, and the largest error; points without an estimate do not fail the case."""
    ended = group.attributes["status"] == ENDED
    labels, errors = group.labels("status"), group["error"]
    summary: dict[str, Any] = {"points": group.n_points}
    for label in dict.fromkeys(str(one) for one in labels):
        summary[label.replace("_", " ")] = int(np.sum(labels == label))
    if np.any(np.isfinite(errors)):
        summary["largest error"] = float(f"{np.nanmax(errors):.3g}")
    reason = ALL_RECOMPUTED if ended else "stopped on request"
    return StageResult(case_id, True, reason, "", summary)
