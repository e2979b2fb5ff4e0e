"""The bifurcation points of a case to recompute: events of branches, points along curves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipelines.bifurcations.detection import EventKind
from pipelines.case.arrays import Array
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, local_name
from pipelines.stages.parameter_columns import stored_parameters

# Folder and first letter of the groups, in the order of the flag ``source``.
SOURCES = ("cycles/b", "cycles/d", "pd/c", "ns/c", "folds/c")
SAME_PARAMETERS = (
    1e-5  # of two stored points that coincide: far above their tolerances, far below any grid's error
)
SAME_ANGLE = 1e-3
VERTICAL = 0.2  # change of the first parameter / that of the second, both over their ranges


@dataclass(frozen=True)
class StoredPoint:
    """A stored bifurcation: its place in the store and its data.

    ``parameters`` (4,) in the order of PARAMETERS, ``state`` (N,), ``steps`` per period; ``angle`` is None
    unless the critical multipliers are a complex pair; ``held`` and ``free``: names of the parameter that all
    grids share and of the one whose value they tell.
    """

    source: int
    number: int
    index: int
    kind: EventKind
    turns: int
    parameters: Array
    state: Array
    period: float
    angle: float | None
    steps: int
    held: str
    free: str

    @property
    def key(self) -> tuple[int, int, int]:
        """Its place in the store."""
        return self.source, self.number, self.index

    @property
    def value(self) -> float:
        """The stored value of the free parameter."""
        return float(self.parameters[PARAMETERS.index(self.free)])

    def coincides(self, other: StoredPoint) -> bool:
        """Whether two points are one bifurcation, found twice."""
        return (
            self.kind is other.kind
            and self.turns == other.turns
            and bool(
                np.allclose(self.parameters, other.parameters, rtol=SAME_PARAMETERS, atol=SAME_PARAMETERS)
            )
            and abs((self.angle or 0.0) - (other.angle or 0.0)) <= SAME_ANGLE
        )


def stored_points(store: Store, case_id: str, per_curve: int) -> list[StoredPoint]:
    """The points of a case to recompute, every bifurcation once; equal stores give equal lists."""
    chosen: list[StoredPoint] = []
    for group in _groups(store, case_id):
        found = _events(group) if group.kind == "cycles" else _curve_points(group, per_curve)
        for point in found:
            if not any(point.coincides(other) for other in chosen):
                chosen.append(point)
    return chosen


def _groups(store: Store, case_id: str) -> list[Group]:
    """Branches and curves in the order of ``SOURCES``, first halves of curves before second halves."""
    names = [name for name in list_groups(store, case_id) if _source(local_name(name)) is not None]
    groups = [read_group(store, name, _arrays(local_name(name).split("/")[0])) for name in names]

    def place(group: Group) -> tuple[int, int, str]:
        source = _source(local_name(group.name))
        return source or 0, int(group.attributes.get("half") or 0), group.name

    return sorted(groups, key=place)


def _arrays(folder: str) -> tuple[str, ...]:
    """The needed arrays of a group: not its orbits and films."""
    if folder == "cycles":
        events = ("kind", "after_point", "period", "state", "angle", "residual", *PARAMETERS)
        return ("steps_per_period", *(f"event_{name}" for name in events))
    return ("period", "state", "parameter_tangent", "arclength", "angle", "steps_per_period", *PARAMETERS)


def _source(name: str) -> int | None:
    """Index in ``SOURCES`` of ``cycles/b000`` and the like; None for every other group."""
    return next((i for i, start in enumerate(SOURCES) if name.startswith(start)), None)


def _place(group: Group) -> tuple[int, int]:
    name = local_name(group.name)
    source = _source(name)
    assert source is not None
    return source, int(name.removeprefix(SOURCES[source]))


_REFINED = (EventKind.FOLD, EventKind.PERIOD_DOUBLING, EventKind.NEIMARK_SACKER)


def _events(group: Group) -> Iterator[StoredPoint]:
    """Located folds, period doublings and Neimark-Sacker points of a branch."""
    kinds, free = KINDS["cycles"].array("event_kind").flags, str(group.attributes["parameter"])
    held = "speed" if free == "excitation_frequency" else "excitation_frequency"
    source, number = _place(group)
    steps = group["steps_per_period"]
    for index in range(group.n_events):
        kind = EventKind.__members__.get(kinds[int(group["event_kind"][index])].upper())
        if kind not in _REFINED or not math.isfinite(group["event_residual"][index]):
            continue
        assert kind is not None
        # an event is located with the steps of the point behind it
        behind = min(int(group["event_after_point"][index]) + 1, len(steps) - 1)
        yield StoredPoint(
            source, number, index, kind, int(group.attributes.get("turns", 1)),
            stored_parameters(group.arrays, index, "event_"),
            group["event_state"][index], float(group["event_period"][index]),
            _angle(kind, float(group["event_angle"][index])), int(steps[behind]), held, free,
        )  # fmt: skip


def _curve_points(group: Group, per_curve: int) -> Iterator[StoredPoint]:
    """The first point of a curve and ``per_curve`` more, evenly spread over its length.

    Without its end, which may be a point of codimension two.
    """
    if group.n_points == 0:
        return
    source, number = _place(group)
    kind = EventKind[str(group.attributes["bifurcation"]).upper()]
    first, second = group.attributes["parameters"]
    length = group["arclength"]
    wanted = np.linspace(length[0], length[-1], per_curve + 2)[:-1]
    rows = dict.fromkeys(int(np.argmin(np.abs(length - at))) for at in wanted)
    for row in rows:
        vertical = _is_vertical(group["parameter_tangent"][row], group.attributes["ranges"])
        held, free = (second, first) if vertical else (first, second)
        yield StoredPoint(
            source, number, row, kind, int(group.attributes.get("turns", 1)),
            stored_parameters(group.arrays, row), group["state"][row],
            float(group["period"][row]), _angle(kind, float(group["angle"][row])),
            int(group["steps_per_period"][row]), str(held), str(free),
        )  # fmt: skip


def _is_vertical(tangent: Array, ranges: list[list[float]]) -> bool:
    """Whether a curve runs along its second parameter, which then distinguishes points of the curve."""
    first, second = (abs(t) / (high - low) for t, (low, high) in zip(tangent, ranges, strict=True))
    return bool(first < VERTICAL * second)


def _angle(kind: EventKind, angle: float) -> float | None:
    return angle if kind is EventKind.NEIMARK_SACKER and math.isfinite(angle) else None
