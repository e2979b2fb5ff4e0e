"""Dry runs: what the store has of every stage of every case, and about how long the rest takes.

Nothing is written. How many points a stage takes at most stands in its table; where that cannot be known
before, the plan says what decides it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pipelines.case.models import CalibrationTarget, Case
from pipelines.case.reading import NamedCase
from pipelines.case.survey_settings import survey_axes
from pipelines.datasets.branch import has_ended
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import COMPLETE
from pipelines.datasets.store import Store, local_name, open_for_reading
from pipelines.stages.calibration import calibrate
from pipelines.stages.curves import bifurcation_set, track_curves
from pipelines.stages.curves.lines import LINES
from pipelines.stages.curves.outlook import outlook
from pipelines.stages.cycles import continue_cycles
from pipelines.stages.cycles.branch import NOT_ASKED, WANTING_POINTS
from pipelines.stages.ending import stop_reasons
from pipelines.stages.linear import coefficients, criticals, missing_speeds, unbalance_response
from pipelines.stages.refinement import refine
from pipelines.stages.refinement.points import stored_points
from pipelines.stages.scheduling.durations import Durations
from pipelines.stages.survey import onsets, survey
from pipelines.stages.tori import continue_tori
from pipelines.stages.transients import transient
from pipelines.stages.transients.run import request_of

Attributes = Mapping[str, Any]

CYCLES_PER_ONSET = 2.5  # points of a branch, for the five cycles found alone that bracket an onset
CYCLE_ALONE = 0.5  # points of a branch
ONSETS_PER_TARGET = {"onset_slope": 2, "corner_frequency": 2}  # of as many cycles; other targets need one


class StageStatus(Enum):
    """How much of a stage is in the store."""

    NOTHING = "nothing"
    PARTIAL = "partial"
    COMPLETE = "complete"
    FAILED = "failed"  # ended for another reason; computed again only in another store
    DIFFERENT_SETTINGS = "computed with other settings"  # the run refuses it


@dataclass(frozen=True)
class Planned:
    """A stage of a case and what is left of it.

    ``there`` are ``points`` of at most ``most`` (None: not known before), the others take about
    ``seconds`` at most (None: not known), and at least ``least_seconds`` where that is known; ``note`` says
    what decides what is not known.
    """

    case_id: str
    stage: str
    there: StageStatus
    points: int = 0
    most: int | None = None
    seconds: float | None = None
    note: str = ""
    least_seconds: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """The plan as plain data."""
        return asdict(self) | {"there": self.there.value}


def plan(stages: Sequence[str], cases: Sequence[NamedCase], store_path: Path | None) -> Iterator[Planned]:
    """What every stage of every case has and still needs; ``store_path`` may not exist yet.

    Raises StoreError for a store that cannot be read, and CannotRunError for a transient that cannot start.
    """
    store = open_for_reading(store_path) if store_path is not None and store_path.exists() else None
    durations = Durations()
    for named in cases:
        for stage in stages:
            if stage == "transient":
                yield _run_in_time(named, store, store_path)
            else:
                found = _with_time(_found(stage, named, store), named.case, durations)
                yield _searching(found, named, store, durations) if stage == bifurcation_set.GROUP else found


@dataclass(frozen=True)
class _Here:
    """What a store holds of a case; ``own``: those of the ``groups`` that belong to one stage."""

    case: Case
    case_id: str
    store: Store | None
    groups: Mapping[str, Attributes]
    own: Mapping[str, Attributes]


@dataclass(frozen=True)
class _Extent:
    """How far a stage is, and how long it takes."""

    groups: tuple[str, ...]
    """Beginnings of the names of its groups."""
    success: frozenset[str]
    """Reasons to stop that are no failure."""
    table: str
    """The table of the case that must be the same, but for the keys ``free``."""
    duration: Callable[[Durations, Case], float | None]
    """Seconds of one point; None where there is no equilibrium to measure at."""
    free: frozenset[str] = frozenset()
    request_of: Callable[[Case], Attributes] | None = None
    """What a group was asked for, where that is more than its table."""
    renewed: bool = False
    """Whether a group with other settings is computed again."""
    out_of_points: str = WANTING_POINTS
    """The reason to stop that a larger value of the key ``limit`` lifts."""
    limit: str = "max_points"
    most: Callable[[Case], int | None] = lambda case: None
    """Points at most, where that is known before."""
    decided_by: str = ""
    """What decides the number of points where it is not known before."""
    without: Callable[[Case], str] = lambda case: ""
    """What the estimate of the time leaves out."""
    settles: bool = True
    """Whether nothing is left once its groups have ended."""
    adjusted: Callable[[Planned, _Here], Planned] = lambda found, here: found
    """What only this stage knows of what is there."""


def _made_in_one_piece(
    request_of: Callable[[Case], Attributes], success: frozenset[str]
) -> Callable[[Planned, _Here], Planned]:
    """A group that is written whole, and recomputed for another request."""

    def adjusted(found: Planned, here: _Here) -> Planned:
        if not here.own:
            return found
        (group,) = here.own.values()
        if group["request"] != request_of(here.case):
            return replace(found, there=StageStatus.NOTHING, points=0)
        ended = StageStatus.COMPLETE if group["stop_reason"] in success else StageStatus.FAILED
        return replace(found, there=ended, points=found.most or 0)

    return adjusted


def _in_both_directions(found: Planned, here: _Here) -> Planned:
    missing = len(here.own) < len(continue_cycles.directions(here.case))
    return (
        replace(found, there=StageStatus.PARTIAL)
        if missing and found.there is StageStatus.COMPLETE
        else found
    )


def _on_its_plane(found: Planned, here: _Here) -> Planned:
    """The survey: its ranges may be those of [track_curves]."""
    for group in here.own.values():
        axes = survey_axes(here.case.survey, here.case.track_curves)
        same = group["ranges"] == [[axis.low, axis.high] for axis in axes]
        if group["n_points"] and not (same and group["parameters"] == [axis.parameter for axis in axes]):
            return replace(found, there=StageStatus.DIFFERENT_SETTINGS)
    return found


def _of_stored_bifurcations(found: Planned, here: _Here) -> Planned:
    """The refinement: bifurcations that earlier stages will find are not known yet."""
    if here.store is None:
        return found
    stored = len(stored_points(here.store, here.case_id, here.case.refine.points_per_curve))
    more = found.there is StageStatus.COMPLETE and found.points < stored
    return replace(found, there=StageStatus.PARTIAL if more else found.there, most=stored or None)


def _searched(found: Planned, here: _Here) -> Planned:
    """The search of the plane is complete when a round met no new curve, or all rounds are done."""
    if found.there in (StageStatus.FAILED, StageStatus.DIFFERENT_SETTINGS):
        return found
    return replace(found, there=_search_state(here, found.there))


def _search_state(here: _Here, curves: StageStatus) -> StageStatus:
    if bifurcation_set.nothing_to_search(here.case) is not None:
        return StageStatus.COMPLETE
    search = here.groups.get(bifurcation_set.GROUP)
    table = here.case.bifurcation_set
    more = search is not None and (
        bool(search.get("boundaries", False)) > table.boundaries
        or bool(search.get("continue_boundaries", True)) < table.continue_boundaries
        or not set(table.kinds) <= set(search.get("kinds", table.kinds))
    )
    uncertified = table.certify and search is not None and "certificate" not in search
    if more or uncertified:
        return StageStatus.PARTIAL
    if search is not None and (search["complete"] or search["rounds"] >= table.max_rounds):
        return StageStatus.PARTIAL if curves is StageStatus.PARTIAL else StageStatus.COMPLETE
    begun = search is not None or any(name.startswith(LINES) for name in here.groups)
    return StageStatus.PARTIAL if begun else curves


def _of_one_machine(durations: Durations, case: Case) -> float | None:
    """A machine of a calibration: the cycles of all its targets."""
    cycle = durations.of_cycle(case)
    targets = () if case.calibrate is None else case.calibrate.targets
    return None if cycle is None else cycle * sum(_cycles_of_target(target) for target in targets)


def _cycles_of_target(target: CalibrationTarget) -> float:
    """Points of a branch that take as long as one target."""
    if target.quantity == "doubling_growth":
        return len(target.speeds or ()) * CYCLE_ALONE
    return ONSETS_PER_TARGET.get(target.quantity, 1) * CYCLES_PER_ONSET


def _curves(groups: tuple[str, ...], decided_by: str) -> _Extent:
    return _Extent(
        groups=groups,
        success=stop_reasons(track_curves.COMPLETE),
        table="track_curves",
        duration=Durations.of_curve_point,
        free=frozenset({"max_points", "max_curves"}),
        decided_by=decided_by,
        settles=False,  # a curve that has ended does not say whether every bifurcation lies on one
    )


_EXTENTS: Mapping[str, _Extent] = MappingProxyType(
    {
        "linearize": _Extent(
            groups=("linear",),
            success=missing_speeds.SUCCESSFUL,
            table="linearize",
            duration=Durations.of_equilibrium,
            most=lambda case: case.linearize.points,
            renewed=True,
        ),
        "coefficients": _Extent(
            groups=(coefficients.GROUP,),
            success=missing_speeds.SUCCESSFUL,
            table="coefficients",
            duration=Durations.of_coefficients,
            most=lambda case: case.coefficients.points,
            request_of=coefficients.request_of,
            renewed=True,
        ),
        "criticals": _Extent(
            groups=("criticals",),
            success=criticals.SUCCESSFUL,
            table="criticals",
            duration=Durations.of_campbell_speed,
            most=lambda case: case.criticals.points,
            adjusted=_made_in_one_piece(
                lambda case: case.criticals.model_dump(mode="json"), criticals.SUCCESSFUL
            ),
        ),
        "unbalance_response": _Extent(
            groups=(unbalance_response.GROUP,),
            success=missing_speeds.SUCCESSFUL,
            table="unbalance_response",
            duration=Durations.of_equilibrium,
            most=lambda case: case.unbalance_response.points,
            adjusted=_made_in_one_piece(unbalance_response.request_of, missing_speeds.SUCCESSFUL),
        ),
        "continue_cycles": _Extent(
            groups=("cycles/b", "cycles/d"),
            success=stop_reasons(continue_cycles.COMPLETE),
            table="continue_cycles",
            duration=Durations.of_cycle,
            free=frozenset(NOT_ASKED),
            most=lambda case: case.continue_cycles.max_points * len(continue_cycles.directions(case)),
            without=lambda case: (
                "without period-doubled branches" if case.continue_cycles.doublings > 0 else ""
            ),
            adjusted=_in_both_directions,
        ),
        "track_pd": _curves(("pd/",), "ends when every period doubling of the store lies on a curve"),
        "track_ns": _curves(("ns/",), "ends when every Neimark-Sacker point of the store lies on a curve"),
        "track_folds": _curves(("folds/",), "ends when every fold of the store lies on a curve"),
        "bifurcation_set": replace(
            _curves(("pd/", "ns/", "folds/"), "ends when a round of new lines meets no new curve"),
            settles=True,
            adjusted=_searched,
        ),
        "survey": _Extent(
            groups=(onsets.GROUP,),
            success=survey.SUCCESSFUL,
            table="survey",
            duration=Durations.of_survey_line,
            most=lambda case: survey_axes(case.survey, case.track_curves)[1].points,
            adjusted=_on_its_plane,
        ),
        "refine": _Extent(
            groups=("refinement",),
            success=frozenset({refine.ALL_RECOMPUTED}),
            table="refine",
            duration=Durations.of_refined_point,
            free=frozenset({"points_per_curve"}),
            decided_by="one point for every bifurcation that is found, each on several grids",
            adjusted=_of_stored_bifurcations,
        ),
        "continue_tori": _Extent(
            groups=("tori/",),
            success=stop_reasons(continue_tori.COMPLETE),
            table="continue_tori",
            duration=Durations.of_torus,
            free=frozenset({"max_points"}),
            decided_by="estimated with the fewest angles; a torus with more angles takes longer",
        ),
        "calibrate": _Extent(
            groups=(calibrate.GROUP,),
            success=frozenset({calibrate.CONVERGED}),
            table="calibrate",
            duration=_of_one_machine,
            free=frozenset({"max_evaluations"}),
            out_of_points=calibrate.OUT_OF_EVALUATIONS,
            limit="max_evaluations",
            most=lambda case: None if case.calibrate is None else case.calibrate.max_evaluations,
        ),
    }
)
"""Every stage but the transient, which measures itself."""


def _found(stage: str, named: NamedCase, store: Store | None) -> Planned:
    """How much of a stage is in the store."""
    case, extent = named.case, _EXTENTS[stage]
    groups = _groups(store, named.case_id)
    own = {name: attributes for name, attributes in groups.items() if name.startswith(extent.groups)}
    points = sum(int(attributes.get("n_points", 0)) for attributes in own.values())
    there = _state(own.values(), extent, case)
    if there is StageStatus.DIFFERENT_SETTINGS and extent.renewed:
        there, points = StageStatus.NOTHING, 0
    found = Planned(named.case_id, stage, there, points, extent.most(case), None, extent.decided_by)
    return extent.adjusted(found, _Here(case, named.case_id, store, groups, own))


def _groups(store: Store | None, case_id: str) -> dict[str, Attributes]:
    """Attributes of the groups of a case by name."""
    if store is None:
        return {}
    return {local_name(name): read_group(store, name, ()).attributes for name in list_groups(store, case_id)}


def _state(groups: Iterable[Attributes], extent: _Extent, case: Case) -> StageStatus:
    table = getattr(case, extent.table)
    asked = table.model_dump(mode="json", exclude=set(extent.free))
    if extent.request_of is not None:
        asked = extent.request_of(case)
    same = [(attributes, attributes.get("request", asked) == asked) for attributes in groups]
    # what was asked for otherwise and has no rows is made anew
    found = [attributes for attributes, is_same in same if is_same or attributes.get("n_points", 1)]
    if not found:
        return StageStatus.NOTHING
    if not all(is_same for attributes, is_same in same if attributes in found):
        return StageStatus.DIFFERENT_SETTINGS
    most = getattr(table, extent.limit, 0)
    ended = [
        each["status"] == COMPLETE or has_ended(each, each.get("n_points", 0), extent.out_of_points, most)
        for each in found
    ]
    if not all(ended):
        return StageStatus.PARTIAL
    success = [
        each["status"] == COMPLETE or (each["stop_reason"] in extent.success and each["n_points"] > 0)
        for each in found
    ]
    return StageStatus.COMPLETE if all(success) else StageStatus.FAILED


def _with_time(found: Planned, case: Case, durations: Durations) -> Planned:
    """A planned stage with the time of its missing points, or of one point if their number is not known."""
    extent = _EXTENTS[found.stage]
    ended = found.there in (StageStatus.COMPLETE, StageStatus.FAILED, StageStatus.DIFFERENT_SETTINGS)
    if ended and extent.settles:
        return replace(found, seconds=0.0, note="")
    each = extent.duration(durations, case)
    if each is None:
        return replace(found, note="there is no equilibrium to measure at")
    if found.most is None:
        return replace(found, note=f"{found.note}; a point takes about {each:.2g} s")
    return replace(found, seconds=max(0, found.most - found.points) * each, note=extent.without(case))


def _searching(found: Planned, named: NamedCase, store: Store | None, durations: Durations) -> Planned:
    """A search that has not ended, with the range of its time."""
    once = None if found.seconds == 0.0 else durations.of_pass(named.case)
    if once is None:
        return found
    ahead = outlook(named.case, _groups(store, named.case_id))
    fewest, most = ahead.lines
    number = f"{most}" if fewest == most else f"{fewest} to {most}"
    note = f"{number} lines; the number of curves is a guess until they are traced"
    return replace(found, seconds=ahead.most * once, least_seconds=ahead.least * once, note=note)


def _run_in_time(named: NamedCase, store: Store | None, store_path: Path | None) -> Planned:
    """A transient, whose duration its own stage measures."""
    groups = _groups(store, named.case_id)
    own = [
        found
        for name, found in groups.items()
        if name.startswith("transient/") and found["request"] == request_of(named.case)
    ]
    ahead = transient.outlook(named, store_path)
    begun = [int(found["n_points"]) for found in own]
    note = f"{ahead.steps} time steps"
    if not begun:
        return Planned(named.case_id, "transient", StageStatus.NOTHING, 0, None, ahead.seconds, note)
    there = StageStatus.PARTIAL
    if ahead.steps == 0:
        there = StageStatus.COMPLETE if own[0]["stop_reason"] in transient.SUCCESSFUL else StageStatus.FAILED
    most = int(own[0]["dimensions"]["sample"])
    return Planned(
        named.case_id, "transient", there, begun[0], most, ahead.seconds, note if ahead.steps else ""
    )
