"""`agfb report`: the bifurcation-free speed range over the excitation frequency, from stored curves alone.

From the lowest speed up to the first period doubling, Neimark-Sacker point or fold of a stable cycle of the
excitation period (curves of doubled cycles and of cycles that are unstable already bound nothing; what lies
above the first boundary does not matter).  A fold ends the range also where it only gives birth to another
stable cycle: above it the machine may jump.
"""

from __future__ import annotations

import errno
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.datasets.branch import write_group
from pipelines.datasets.curves import CURVE_CONTAINERS, curves_of_plane
from pipelines.datasets.reading import case_attributes, list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, case_group, local_name, open_for_writing
from pipelines.stages.reports.first_boundary import UNSET, Boundary, SpeedPlane, lower_envelope
from pipelines.stages.reports.margin import Margin, margin_of

GROUP = "operating_range"
SPEED, FREQUENCY = "speed", "excitation_frequency"
REFERENCE_FREQUENCY = 0.2  # with which the paper compares (section 4)
NEAR = 0.05  # of the width of the plane: an end of a curve concerns the frequencies within this distance
ABOVE = 0.02  # of the height: an end this far above the first boundary may still change it


class NoSetError(Exception):
    """A case has no stored data from which an operating range follows."""


@dataclass(frozen=True)
class LooseEnd:
    """Where an unfinished curve stopped: name of its group, reason, position."""

    curve: str
    reason: str
    abscissa: float
    speed: float


@dataclass(frozen=True)
class Stretch:
    """Neighbouring abscissae bounded by one part of one curve, or by nothing."""

    first: Boundary
    last: Boundary
    lowest: float
    highest: float
    criticalities: tuple[str, ...]
    caution: bool


@dataclass(frozen=True)
class Best:
    """The largest bifurcation-free speed, and the interval of equally good abscissae around it.

    Equally good: as open as the best one, or else above the instability speed of the passive machine.
    """

    boundary: Boundary
    interval: tuple[float, float]


@dataclass(frozen=True)
class OperatingRange:
    """The first boundary over the abscissa (``parameter``), and the conclusions from it.

    ``curves``: names that ``Boundary.curve`` counts; ``caution``: for every boundary whether an incomplete
    curve ends near it; ``margin``: of the case's own operating point, None where that has none.  Speeds are
    dimensionless; None where not known.
    """

    parameter: str
    abscissae: tuple[float, float]
    speeds: tuple[float, float]
    boundaries: tuple[Boundary, ...]
    caution: tuple[bool, ...]
    curves: tuple[str, ...]
    passive: float | None
    reference: Boundary | None
    best: Best | None
    cautions: tuple[str, ...]
    margin: Margin | None = None

    @property
    def passive_gain(self) -> float | None:
        """Relative gain of the best speed over the instability speed without displacement of the rings."""
        return self._gain(self.passive)

    @property
    def reference_gain(self) -> float | None:
        """Relative gain over the reference frequency; None unless a bifurcation bounds the range there."""
        bounded = self.reference is not None and self.reference.curve >= 0
        return self._gain(self.reference.speed) if bounded and self.reference is not None else None

    def _gain(self, speed: float | None) -> float | None:
        return None if self.best is None or not speed else self.best.boundary.speed / speed - 1.0

    def stretches(self) -> list[Stretch]:
        """The boundary in parts, by increasing abscissa."""
        parts = groupby(zip(self.boundaries, self.caution, strict=True), key=lambda pair: pair[0].identity)
        return [_stretch(list(part)) for _, part in parts]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of the group ``operating_range``."""
        spec, found = KINDS[GROUP], self.boundaries

        def flags(name: str) -> NDArray[Any]:
            meanings = (UNSET, *spec.array(name).flags)
            return np.array([meanings.index(getattr(boundary, name)) - 1 for boundary in found])

        return {
            "abscissa": np.array([boundary.abscissa for boundary in found]),
            "speed": np.array([boundary.speed for boundary in found]),
            "base": flags("base"),
            "bifurcation": flags("bifurcation"),
            "criticality": flags("criticality"),
            "angle": np.array([boundary.angle for boundary in found]),
            "curve": np.array([boundary.curve for boundary in found]),
            "caution": np.array(self.caution, dtype=int),
        }

    def attributes(self) -> dict[str, Any]:
        """The attributes of the group: plain data without NaN."""
        return {
            "parameter": self.parameter,
            "range": list(self.abscissae),
            "lowest_speed": self.speeds[0],
            "highest_speed": self.speeds[1],
            "curves": list(self.curves),
            "passive_instability_speed": self.passive,
            "passive_gain": self.passive_gain,
            "reference": None if self.reference is None else self.boundary_data(self.reference),
            "reference_gain": self.reference_gain,
            "best": None if self.best is None else self.boundary_data(self.best.boundary),
            "best_interval": None if self.best is None else list(self.best.interval),
            "cautions": list(self.cautions),
            "margin": None if self.margin is None else self.margin.as_dict(),
        }

    def boundary_data(self, boundary: Boundary) -> dict[str, Any]:
        """One boundary as plain data; ``open``: the speed is a lower bound."""
        return {
            self.parameter: boundary.abscissa,
            "speed": boundary.speed,
            "open": boundary.is_open,
            "base": boundary.base,
            "bifurcation": boundary.bifurcation,
            "criticality": boundary.criticality,
            "curve": None if boundary.curve < 0 else self.curves[boundary.curve],
        }


def _stretch(part: Sequence[tuple[Boundary, bool]]) -> Stretch:
    boundaries = [boundary for boundary, _ in part]
    speeds = [boundary.speed for boundary in boundaries]
    kinds = tuple(dict.fromkeys(boundary.criticality for boundary in boundaries))
    return Stretch(
        boundaries[0], boundaries[-1], min(speeds), max(speeds), kinds, any(caution for _, caution in part)
    )


@dataclass(frozen=True)
class StoredPlane:
    """The curves of a case over the speed and another ``parameter``.

    Also the instability speed of the machine without displacement of its rings (None where not known)
    and what the search of the plane left open.
    """

    plane: SpeedPlane
    parameter: str
    passive: float | None
    cautions: tuple[str, ...]


def operating_range(store: Store, case: str) -> OperatingRange:
    """The operating range of a case, from its curves, its branches and its group ``bifurcation_set``.

    Raises what `stored_plane` raises.
    """
    stored = stored_plane(store, case)
    found = range_over(stored.plane, stored.parameter, stored.passive, stored.cautions)
    own = case_attributes(store, case).get("parameters") or {}
    return replace(found, margin=margin_of(stored.plane, stored.parameter, own))


def stored_plane(store: Store, case: str) -> StoredPlane:
    """The stored data of a case over the speed.

    Raises NoSetError where the case has neither curves nor a set over the speed, StoreError for damaged
    groups.
    """
    groups = {local_name(name): name for name in list_groups(store, case)}
    searched = (
        read_group(store, groups["bifurcation_set"], ()).attributes if "bifurcation_set" in groups else {}
    )
    read = [
        read_group(store, path) for name, path in groups.items() if name.split("/")[0] in CURVE_CONTAINERS
    ]
    parameters, ranges = _plane(searched, read)
    speed_axis = parameters.index(SPEED)
    curves = curves_of_plane(read, parameters)
    low, high = ranges[speed_axis]
    plane = SpeedPlane(
        curves,
        1 - speed_axis,
        ranges[1 - speed_axis],
        (max(low, float(searched.get("lowest_speed", low))), high),
        *_samples(store, groups, parameters[1 - speed_axis]),
    )
    passive = searched.get("passive_instability_speed")
    return StoredPlane(plane, parameters[1 - speed_axis], passive, tuple(set_cautions(searched)))


def _plane(
    searched: dict[str, Any] | Any, curves: Sequence[Group]
) -> tuple[list[str], list[tuple[float, float]]]:
    """Names and ranges of the two parameters, from the set or from the first curve over the speed."""
    for attributes in (searched, *(curve.attributes for curve in curves)):
        if SPEED in attributes.get("parameters", ()):
            ranges = [(float(low), float(high)) for low, high in attributes["ranges"]]
            return list(attributes["parameters"]), ranges
    raise NoSetError("no bifurcation set over the rotating speed")


def _samples(store: Store, groups: dict[str, str], abscissa: str) -> tuple[Array, NDArray[np.int64]]:
    """Parameters (n, 2) of the stored cycles of the excitation period and their unstable multipliers (n,)."""
    places, unstable = [np.zeros((0, 2))], [np.zeros(0, dtype=np.int64)]
    for name, path in groups.items():
        if not name.startswith("cycles/"):
            continue
        branch = read_group(store, path, (abscissa, SPEED, "unstable_count"))
        in_plane = branch.attributes.get("parameter") in (abscissa, SPEED)
        if in_plane and branch.attributes.get("turns", 1) == 1:
            places.append(np.column_stack([branch[abscissa], branch[SPEED]]))
            unstable.append(np.asarray(branch["unstable_count"], dtype=np.int64))
    return np.concatenate(places), np.concatenate(unstable)


def set_cautions(searched: dict[str, Any] | Any) -> list[str]:
    """Cautions about a plane, from the attributes of its search (none without a search)."""
    if not searched:
        return ["the plane was not searched: bifurcations off the tracked curves are not known"]
    cautions = (
        [] if searched.get("complete") else [f"the search is not complete: {searched.get('covered', '')}"]
    )
    if "fold" not in searched.get("kinds", ("fold",)):
        cautions.append(
            "folds were not traced (bifurcation_set.kinds), except where Neimark-Sacker curves end: "
            "stability may end earlier at a fold"
        )
    if searched.get("boundaries", False):
        cautions.append(
            "only curves that bound stable cycles where a branch or a curve meets them were traced "
            "(bifurcation_set.boundaries): the others may bound stable cycles elsewhere"
        )
    return cautions


def range_over(
    plane: SpeedPlane, parameter: str, passive: float | None, cautions: Sequence[str] = ()
) -> OperatingRange:
    """The operating range over a plane whose abscissa is ``parameter``.

    ``passive``: instability speed without displacement of the rings; ``cautions``: those known before.
    """
    boundaries = lower_envelope(plane, speeds=() if passive is None else (passive,))
    near = [_near(plane, boundaries, end) for end in loose_ends(plane)]
    caution = np.any(near, axis=0) if near else np.zeros(len(boundaries), dtype=bool)
    further = [
        f"{end.curve} stopped ({end.reason.replace('_', ' ')}) at {parameter.replace('_', ' ')} "
        f"{end.abscissa:.4g}, speed {end.speed:.4g}, near the first boundary"
        for end, concerned in zip(loose_ends(plane), near, strict=True)
        if concerned.any()
    ]
    if any(boundary.base == UNSET for boundary in boundaries):
        further.append(
            "the stability at the lowest speed is not known everywhere from stored cycles: assumed stable"
        )
    return OperatingRange(
        parameter,
        plane.abscissae,
        plane.speeds,
        tuple(boundaries),
        tuple(bool(value) for value in caution),
        tuple(curve.name for curve in plane.curves),
        passive,
        _reference(plane) if parameter == FREQUENCY else None,
        best_of(boundaries, passive),
        (*cautions, *further),
    )


def _reference(plane: SpeedPlane) -> Boundary:
    """The boundary at the paper's reference frequency, or at the lowest of the plane if that is higher."""
    low, high = plane.abscissae
    return plane.boundary(REFERENCE_FREQUENCY if low <= REFERENCE_FREQUENCY <= high else low)


def loose_ends(plane: SpeedPlane) -> list[LooseEnd]:
    """Last points of the curves that continue but were not traced."""
    ends = []
    for curve in plane.curves:
        if not curve.is_complete and curve.unstable[-1] <= 0:
            place = curve.points[-1]
            reason = curve.stop_reason or "still running"
            ends.append(LooseEnd(curve.name, reason, float(place[plane.axis]), float(place[1 - plane.axis])))
    return ends


def _near(plane: SpeedPlane, boundaries: Sequence[Boundary], end: LooseEnd) -> NDArray[np.bool_]:
    """Boundaries that the missing part of a curve could lower."""
    reach, above = NEAR * np.ptp(plane.abscissae), ABOVE * np.ptp(plane.speeds)
    beside = np.array([abs(boundary.abscissa - end.abscissa) <= reach for boundary in boundaries])
    below = np.array([end.speed <= boundary.speed + above for boundary in boundaries])
    return beside & below


def best_of(boundaries: Sequence[Boundary], passive: float | None) -> Best | None:
    """The abscissa with the largest bifurcation-free speed; None if all are unstable at the lowest speed.

    The middle of the widest interval where the speed is open.
    """
    usable = [number for number, boundary in enumerate(boundaries) if boundary.base != "unstable"]
    if not usable:
        return None
    opened = _runs([boundary.is_open for boundary in boundaries])
    if opened:
        first, last = max(opened, key=lambda run: boundaries[run[1]].abscissa - boundaries[run[0]].abscissa)
        interval = boundaries[first].abscissa, boundaries[last].abscissa
        middle = min(
            boundaries[first : last + 1], key=lambda boundary: abs(boundary.abscissa - 0.5 * sum(interval))
        )
        return Best(middle, interval)
    best = max(usable, key=lambda number: boundaries[number].speed)
    level = boundaries[best].speed if passive is None else min(passive, boundaries[best].speed)
    runs = _runs([b.base != "unstable" and b.speed >= level for b in boundaries])
    first, last = next(run for run in runs if run[0] <= best <= run[1])
    return Best(boundaries[best], (boundaries[first].abscissa, boundaries[last].abscissa))


def _runs(chosen: Sequence[bool]) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    numbers = [number for number, value in enumerate(chosen) if value]
    starts = [n for n in numbers if n == 0 or not chosen[n - 1]]
    ends = [n for n in numbers if n + 1 == len(chosen) or not chosen[n + 1]]
    return list(zip(starts, ends, strict=True))


def write_operating_range(store: Store, case: str, found: OperatingRange) -> bool:
    """Write the range into the group ``operating_range`` of its case, replacing an older one.

    Gives False where the store cannot be written.  Raises StoreError, and OSError for other reasons.
    """
    try:
        writable = open_for_writing(store.path, durable=store.durable)
        write_group(writable, case_group(case, GROUP), GROUP, found.arrays(), found.attributes())
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            return False
        raise
    return True
