"""What a command would do: of every stage of every case what is there, and about how long the rest takes.

Nothing is written. How many points a stage takes at most stands in its table; where that cannot be known
before, the plan says what decides it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import has_ended
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import COMPLETE
from pipelines.datasets.store import Store, open_for_reading
from pipelines.stages import (
    bifurcation_set,
    calibrate,
    continue_cycles,
    continue_tori,
    criticals,
    curve_tracking,
    missing_speeds,
    refine,
    transient,
)
from pipelines.stages.branch_run import NOT_ASKED, WANTING_POINTS
from pipelines.stages.durations import Durations
from pipelines.stages.refine_points import stored_points
from pipelines.stages.transient_run import request_of

Attributes = Mapping[str, Any]

CYCLES_PER_ONSET = 8  # a branch that begins near an onset has four to twelve points


class There(Enum):
    """What of a stage is in the store."""

    NOTHING = "nothing"
    PARTIAL = "partial"
    COMPLETE = "complete"
    FAILED = "failed"  # ended for another reason; computed again only in another store
    OTHERWISE = "computed otherwise"  # with another table: the run refuses it


@dataclass(frozen=True)
class Planned:
    """A stage of a case: ``there`` are ``points`` of at most ``most`` (None: not known before), the others
    take about ``seconds`` at most (None: not known); ``note`` says what decides what is not known.
    """

    case_id: str
    stage: str
    there: There
    points: int = 0
    most: int | None = None
    seconds: float | None = None
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return asdict(self) | {"there": self.there.value}


def plan(stages: Sequence[str], cases: Sequence[NamedCase], store_path: Path | None) -> Iterator[Planned]:
    """What is there and what is left of every stage of every case; ``store_path`` may not exist yet.

    Raises StoreError for a store that cannot be read, and CannotRunError for a run in time that cannot start.
    """
    store = open_for_reading(store_path) if store_path is not None and store_path.exists() else None
    durations = Durations()
    for named in cases:
        for stage in stages:
            if stage == "transient":
                yield _run_in_time(named, store, store_path)
            else:
                yield _with_time(_found(stage, named, store), named.case, durations)


@dataclass(frozen=True)
class _Extent:
    """Groups of a stage by the beginning of their names, reasons to stop that are no failure, the table that
    must be the same, but for some keys, and the reason to stop that the key ``most`` of the table lifts.
    """

    groups: tuple[str, ...]
    well: frozenset[str]
    table: str
    free: frozenset[str] = frozenset()
    wanting: str = WANTING_POINTS
    most: str = "max_points"


def _names(stops: Iterable[Enum]) -> frozenset[str]:
    return frozenset(stop.name.lower() for stop in stops)


_CURVES = _names(curve_tracking.COMPLETE)
_MORE_CURVES = frozenset({"max_points", "max_curves"})
_EXTENTS: Mapping[str, _Extent] = MappingProxyType(
    {
        "linearize": _Extent(("linear",), missing_speeds.WELL, "linearize"),
        "criticals": _Extent(("criticals",), criticals.WELL, "criticals"),
        "continue_cycles": _Extent(
            ("cycles/b", "cycles/d"),
            _names(continue_cycles.COMPLETE),
            "continue_cycles",
            frozenset(NOT_ASKED),
        ),
        "track_pd": _Extent(("pd/",), _CURVES, "track_curves", _MORE_CURVES),
        "track_ns": _Extent(("ns/",), _CURVES, "track_curves", _MORE_CURVES),
        "track_folds": _Extent(("folds/",), _CURVES, "track_curves", _MORE_CURVES),
        "bifurcation_set": _Extent(("pd/", "ns/", "folds/"), _CURVES, "track_curves", _MORE_CURVES),
        "refine": _Extent(
            ("refinement",), frozenset({refine.FINISHED}), "refine", frozenset({"points_per_curve"})
        ),
        "continue_tori": _Extent(
            ("tori/",), _names(continue_tori.COMPLETE), "continue_tori", frozenset({"max_points"})
        ),
        "calibrate": _Extent(
            (calibrate.GROUP,),
            frozenset({calibrate.CONVERGED}),
            "calibrate",
            frozenset({"max_evaluations"}),
            calibrate.OUT_OF_EVALUATIONS,
            "max_evaluations",
        ),
    }
)
_DECIDED_BY: Mapping[str, str] = MappingProxyType(
    {
        "track_pd": "ends when every period doubling of the store lies on a curve",
        "track_ns": "ends when every Neimark-Sacker point of the store lies on a curve",
        "track_folds": "ends when every fold of the store lies on a curve",
        "bifurcation_set": "ends when a round of fresh lines meets no new curve",
        "refine": "one point for every bifurcation that is found, each on several grids",
        "continue_tori": "a torus takes the longer the more angles it needs, here with the fewest",
    }
)


def _found(stage: str, named: NamedCase, store: Store | None) -> Planned:
    """What is there of a stage."""
    case, extent = named.case, _EXTENTS[stage]
    groups = _groups(store, named.case_id)
    own = {name: found for name, found in groups.items() if name.startswith(extent.groups)}
    most = _most(stage, case)
    points = sum(int(found.get("n_points", 0)) for found in own.values())
    there = _state(own.values(), extent, case)
    if stage == "criticals" and own:
        # made in one piece, and again for another table
        (group,) = own.values()
        well = There.COMPLETE if group["stop_reason"] in extent.well else There.FAILED
        there = There.NOTHING if there is There.OTHERWISE else well
        points = 0 if there is There.NOTHING else case.criticals.points
    if stage == "continue_cycles" and there is There.COMPLETE:
        if len(own) < len(continue_cycles.directions(case)):
            there = There.PARTIAL
    if stage == "refine" and store is not None:
        stored = len(stored_points(store, named.case_id, case.refine.points_per_curve))
        most = stored or None  # those that earlier stages will find are not known
        there = There.PARTIAL if there is There.COMPLETE and points < stored else there
    if stage == "bifurcation_set" and there not in (There.FAILED, There.OTHERWISE):
        there = _searched(groups, case, there)
    return Planned(named.case_id, stage, there, points, most, None, _DECIDED_BY.get(stage, ""))


def _groups(store: Store | None, case_id: str) -> dict[str, Attributes]:
    """Attributes of the groups of a case by name."""
    if store is None:
        return {}
    return {
        name.split("/", 2)[2]: read_group(store, name, ()).attributes for name in list_groups(store, case_id)
    }


def _state(groups: Iterable[Attributes], extent: _Extent, case: Case) -> There:
    table = getattr(case, extent.table)
    asked = table.model_dump(mode="json", exclude=set(extent.free))
    same = [(attributes, attributes.get("request", asked) == asked) for attributes in groups]
    # what was asked for otherwise and has no rows is made anew
    found = [attributes for attributes, is_same in same if is_same or attributes.get("n_points", 1)]
    if not found:
        return There.NOTHING
    if not all(is_same for attributes, is_same in same if attributes in found):
        return There.OTHERWISE
    most = getattr(table, extent.most, 0)
    ended = [
        each["status"] == COMPLETE or has_ended(each, each.get("n_points", 0), extent.wanting, most)
        for each in found
    ]
    if not all(ended):
        return There.PARTIAL
    well = [
        each["status"] == COMPLETE or (each["stop_reason"] in extent.well and each["n_points"] > 0)
        for each in found
    ]
    return There.COMPLETE if all(well) else There.FAILED


def _searched(groups: Mapping[str, Attributes], case: Case, curves: There) -> There:
    """How far the search of the plane is: complete when a round met no new curve, or all rounds are made."""
    if bifurcation_set.nothing_to_search(case) is not None:
        return There.COMPLETE
    search = groups.get(bifurcation_set.GROUP)
    table = case.bifurcation_set
    more = search is not None and (
        bool(search.get("boundaries", False)) > table.boundaries
        or not set(table.kinds) <= set(search.get("kinds", table.kinds))
    )
    if more:
        return There.PARTIAL
    if search is not None and (search["complete"] or search["rounds"] >= table.max_rounds):
        return There.PARTIAL if curves is There.PARTIAL else There.COMPLETE
    begun = search is not None or any(name.startswith("cycles/s") for name in groups)
    return There.PARTIAL if begun else curves


def _most(stage: str, case: Case) -> int | None:
    """Points that a stage has at most."""
    if stage == "linearize":
        return case.linearize.points
    if stage == "criticals":
        return case.criticals.points
    if stage == "continue_cycles":
        return case.continue_cycles.max_points * len(continue_cycles.directions(case))
    if stage == "calibrate" and case.calibrate is not None:
        return case.calibrate.max_evaluations
    return None


def _with_time(found: Planned, case: Case, durations: Durations) -> Planned:
    """The same with the time of the points that are left, or of one point where their number is not known."""
    settled = found.there in (There.COMPLETE, There.FAILED, There.OTHERWISE)
    if settled and found.stage not in ("track_pd", "track_ns", "track_folds"):
        return replace(found, seconds=0.0, note="")
    each = _one_point(found.stage, case, durations)
    if each is None:
        return replace(found, note="there is no equilibrium to measure at")
    if found.most is None:
        return replace(found, note=f"{found.note}; a point takes about {each:.2g} s")
    more = "without branches of doubled cycles" if _doubles(found.stage, case) else ""
    return replace(found, seconds=max(0, found.most - found.points) * each, note=more)


def _one_point(stage: str, case: Case, durations: Durations) -> float | None:
    if stage == "linearize":
        return durations.of_equilibrium(case)
    if stage == "criticals":
        return durations.of_campbell_speed(case)
    if stage == "continue_cycles":
        return durations.of_cycle(case)
    if stage == "calibrate":
        cycle = durations.of_cycle(case)
        return None if cycle is None else CYCLES_PER_ONSET * _onsets(case) * cycle
    if stage == "refine":
        return durations.of_refined_point(case)
    return durations.of_torus(case) if stage == "continue_tori" else durations.of_curve_point(case)


def _onsets(case: Case) -> int:
    """Onset speeds that one machine of a calibration needs; a slope needs two."""
    targets = () if case.calibrate is None else case.calibrate.targets
    return sum(2 if target.quantity == "onset_slope" else 1 for target in targets)


def _doubles(stage: str, case: Case) -> bool:
    return stage == "continue_cycles" and case.continue_cycles.doublings > 0


def _run_in_time(named: NamedCase, store: Store | None, store_path: Path | None) -> Planned:
    """A run in time is measured by its own stage."""
    request = request_of(named.case)
    groups = _groups(store, named.case_id)
    own = [
        found
        for name, found in groups.items()
        if name.startswith("transient/") and found["request"] == request
    ]
    ahead = transient.outlook(named, store_path)
    begun = [int(found["n_points"]) for found in own]
    note = f"{ahead.steps} time steps"
    if not begun:
        return Planned(named.case_id, "transient", There.NOTHING, 0, None, ahead.seconds, note)
    there = There.PARTIAL
    if ahead.steps == 0:
        there = There.COMPLETE if own[0]["stop_reason"] in transient.COMPLETE else There.FAILED
    most = int(own[0]["dimensions"]["sample"])
    return Planned(
        named.case_id, "transient", there, begun[0], most, ahead.seconds, note if ahead.steps else ""
    )
