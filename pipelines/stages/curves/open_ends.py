"""Ends of bifurcation curves inside the plane from which no stored curve goes on.

A curve may end at the border of the plane, where it closes, and on another curve.  At R1 and R2 a
Neimark-Sacker curve must lie on a stored fold or period-doubling curve.  Every other end is open: how the
curve goes on is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pipelines.bifurcations.curve import CurveStart, CurveStop
from pipelines.bifurcations.curves.codimension_two import resonant_end
from pipelines.bifurcations.detection import EventKind
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.store import Store, case_group, local_name
from pipelines.stages.curves.rows import CONTAINERS, TRACED, traced
from pipelines.stages.ending import stop_reasons
from pipelines.stages.job import Origin

_NAMES = (*TRACED, "kappa", "unstable_count")
_CLOSED = stop_reasons([CurveStop.RANGE, CurveStop.CLOSED, CurveStop.TRACED, CurveStop.LEAVES_BOUNDARY])
_RESONANT = stop_reasons([CurveStop.RESONANCE_1, CurveStop.RESONANCE_2])


@dataclass(frozen=True)
class OpenEnd:
    """An end of a curve, the name of whose group is ``curve``: both parameters there, and why it is open.

    ``bounds``: whether the curve bounds stable cycles there.
    """

    curve: str
    parameters: tuple[float, float]
    reason: str
    bounds: bool

    def sentence(self) -> str:
        """Where the end is, and why."""
        first, second = self.parameters
        return f"{self.curve} at {first:.5g}, {second:.5g}: {self.reason}"

    def as_dict(self) -> dict[str, Any]:
        """The end as plain data."""
        return asdict(self) | {"parameters": list(self.parameters)}


def open_ends(store: Store, case: str) -> list[OpenEnd]:
    """The open ends of all curves of a case, in the order of their groups.

    Raises StoreError for damaged groups.
    """
    curves = {name: _read(store, path) for name, path in _curve_groups(store, case)}
    return [end for name, curve in curves.items() for end in _open_ends_of(store, case, name, curves)]


def caution(ends: Sequence[OpenEnd]) -> str:
    """The open ends of boundaries of stable cycles as one sentence; empty if there are none."""
    told = [end.sentence() for end in ends if end.bounds]
    if not told:
        return ""
    number = (
        "a boundary of stable cycles ends"
        if len(told) == 1
        else f"{len(told)} boundaries of stable cycles end"
    )
    return f"{number} inside the plane, and no curve goes on from there: {'; '.join(told)}"


def _curve_groups(store: Store, case: str) -> Iterator[tuple[str, str]]:
    for path in list_groups(store, case):
        name = local_name(path)
        if name.split("/")[0] in CONTAINERS.values():
            yield name, path


def _read(store: Store, path: str) -> Group:
    attributes = read_group(store, path, ()).attributes
    held = {*_NAMES, *attributes["parameters"]}.intersection(attributes["arrays"])
    curve = read_group(store, path, sorted(held))
    stateless = {"state": np.zeros((curve.n_points, 1))}  # a store may be written without its states
    return replace(curve, arrays={**stateless, **curve.arrays})


def _open_ends_of(store: Store, case: str, name: str, curves: Mapping[str, Group]) -> Iterator[OpenEnd]:
    curve = curves[name]
    if curve.n_points == 0:
        if curve.attributes["status"] == ENDED:
            yield OpenEnd(name, _place_of_origin(store, case, curve), _advice(curve), True)
        return
    for row, reason in ((0, _why_first_is_open(name, curves)), (-1, _why_last_is_open(name, curves))):
        if reason:
            yield OpenEnd(name, _place(curve, row), reason, int(curve["unstable_count"][row]) <= 0)


def _why_first_is_open(name: str, curves: Mapping[str, Group]) -> str:
    curve = curves[name]
    if _is_resonant(curve, 0):
        return _why_resonance_is_open(name, curves, 0)
    origin, closed = Origin.of(curve.attributes), CurveStop.CLOSED.name.lower()
    container = name.split("/")[0]
    halves = [
        other
        for label, other in curves.items()
        if label.split("/")[0] == container and Origin.of(other.attributes) == origin
    ]
    if len(halves) > 1 or any(half.attributes["stop_reason"] == closed for half in halves):
        return ""
    return "the other direction is not traced"


def _why_last_is_open(name: str, curves: Mapping[str, Group]) -> str:
    curve = curves[name]
    reason = curve.attributes["stop_reason"]
    if curve.attributes["status"] != ENDED:
        return "still running, or interrupted: run again"
    if reason in _RESONANT:
        return _why_resonance_is_open(name, curves, -1)
    return "" if reason in _CLOSED else _advice(curve)


def _advice(curve: Group) -> str:
    """The advice stored at the end of a curve, or else the reason."""
    return str(curve.attributes["stop_advice"]) or str(curve.attributes["stop_reason"]).replace("_", " ")


def _is_resonant(curve: Group, row: int) -> bool:
    kind = EventKind[str(curve.attributes["bifurcation"]).upper()]
    return resonant_end(kind, float(curve["kappa"][row])) is not None


def _why_resonance_is_open(name: str, curves: Mapping[str, Group], row: int) -> str:
    """Empty if a curve of the other kind passes through R1 or R2 at a row of a Neimark-Sacker curve."""
    curve = curves[name]
    at_one = float(curve["kappa"][row]) > 0.0
    kind = EventKind.FOLD if at_one else EventKind.PERIOD_DOUBLING
    there = CurveStart(np.array(curve["state"][row]), _place(curve, row), angle=0.0 if at_one else np.pi)
    own = curve.attributes
    for label, other in curves.items():
        same = label.split("/")[0] == CONTAINERS[kind] and other.attributes["turns"] == own["turns"]
        if not same or other.n_points == 0:
            continue
        origin = Origin.of(other.attributes)
        starts_here = row == -1 and origin is not None and origin.group == name
        if starts_here or (other.n_points > 1 and traced(other, tuple(own["parameters"])).holds(there)):
            return ""
    words = kind.name.lower().replace("_", "-")
    remedy = (
        "set bifurcation_set.boundaries = false to trace curves of unstable cycles"
        if int(curve["unstable_count"][row]) > 0
        else f"run agfb {_COMMANDS[kind]}"
    )
    point = "R1" if at_one else "R2"
    return f"it ends at {point}, and the {words} curve through this point is not traced: {remedy}"


_COMMANDS = {EventKind.FOLD: "track-folds", EventKind.PERIOD_DOUBLING: "track-pd"}


def _place(curve: Group, row: int) -> tuple[float, float]:
    first, second = (float(curve[name][row]) for name in curve.attributes["parameters"])
    return first, second


def _place_of_origin(store: Store, case: str, curve: Group) -> tuple[float, float]:
    """The bifurcation at which a curve without a point should have started."""
    origin = curve.attributes["origin"]
    names = [f"event_{name}" for name in curve.attributes["parameters"]]
    found = read_group(store, case_group(case, str(origin["group"])), names)
    first, second = (float(found[name][int(origin["event"])]) for name in names)
    return first, second
