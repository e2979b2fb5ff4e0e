"""The bifurcation sets of the paper's cases, and what their curves tell.

In the paper the threshold speed is that of the Neimark-Sacker bifurcation, even if a period doubling comes at
a lower speed (Fig. 4a).  The threshold at an excitation frequency is therefore the lowest Neimark-Sacker
point of a cycle that is otherwise stable, and an anti-resonance is a maximum of the threshold over the
excitation frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np
from scipy.signal import find_peaks

from pipelines.datasets.curves import BifurcationCurve
from pipelines.datasets.reading import case_attributes, list_cases, list_groups, read_group
from pipelines.datasets.store import Store, case_group
from pipelines.stages.reports.first_boundary import Boundary, SpeedPlane, lower_envelope
from pipelines.stages.reports.operating_range import FREQUENCY, NoSetError, StoredPlane, stored_plane

Finding = tuple[float | None, str]
"""A computed number, None where the plane has none, and a remark on it."""

DISPLACEMENT = 0.2  # the largest of the paper
PROMINENCE = 0.01  # in speed: less prominent maxima of the threshold are no anti-resonance
NARROW = 0.02  # of the plane's width: a narrower gap between the ends of two curves does not count as open
NOT_COMPLETE = "the search of the plane is not complete"
OPEN_END = "at least: no Neimark-Sacker point up to the highest speed of the plane"
NO_MAXIMUM = "the threshold has no maximum in the plane"
NO_DOUBLING = "no period doubling in the plane"


@dataclass(frozen=True)
class PaperPlane:
    """The bifurcation set of one case, and its threshold over the excitation frequency, computed once."""

    stored: StoredPlane

    @property
    def plane(self) -> SpeedPlane:
        """The plane with all its curves."""
        return self.stored.plane

    @cached_property
    def threshold(self) -> SpeedPlane:
        """The plane with its Neimark-Sacker curves alone: other bifurcations do not count."""
        none = np.zeros(0, dtype=np.int64)
        curves = self.of_kind("neimark_sacker")
        return replace(self.plane, curves=curves, samples=np.zeros((0, 2)), unstable=none)

    @cached_property
    def envelope(self) -> tuple[Boundary, ...]:
        """The threshold by rising excitation frequency; nothing without Neimark-Sacker curves."""
        return tuple(lower_envelope(self.threshold)) if self.threshold.curves else ()

    def of_kind(self, bifurcation: str) -> list[BifurcationCurve]:
        """The curves of one kind."""
        return [curve for curve in self.plane.curves if curve.bifurcation == bifurcation]


@dataclass(frozen=True)
class PaperCase:
    """One case of a store: its parameters and its plane, or why there is none.

    ``rpm`` of speed 1, None where not stored; ``critical_speeds`` dimensionless, by rising speed.
    """

    foil_stiffness: float
    displacement: float
    stored: PaperPlane | None
    reason: str = ""
    rpm: float | None = None
    critical_speeds: tuple[float, ...] = ()


def read_cases_of_paper(stores: Sequence[Store]) -> list[PaperCase]:
    """All cases of the stores that have a foil stiffness, by rising stiffness and displacement.

    The first of several cases with the same two parameters counts.  Raises StoreError for damaged groups.
    """
    found: dict[tuple[float, float], PaperCase] = {}
    for store in stores:
        for case in list_cases(store):
            attributes = case_attributes(store, case)
            parameters = attributes.get("parameters", {})
            stiffness, displacement = parameters.get("foil_stiffness"), parameters.get("displacement")
            if stiffness is None or displacement is None:
                continue
            stored, reason = _plane_of(store, case)
            key = (float(f"{stiffness:.6g}"), float(f"{displacement:.6g}"))
            rpm = attributes.get("scales", {}).get("speed_rpm_per_unit")
            found.setdefault(key, PaperCase(*key, stored, reason, rpm, _critical_speeds(store, case)))
    return [found[key] for key in sorted(found)]


def _critical_speeds(store: Store, case: str) -> tuple[float, ...]:
    """The stored critical speeds of a case, none where they are not computed."""
    name = case_group(case, "criticals")
    if name not in list_groups(store, case):
        return ()
    speeds = read_group(store, name, ("critical_speed",))["critical_speed"]
    return tuple(sorted(float(speed) for speed in speeds if np.isfinite(speed)))


def _plane_of(store: Store, case: str) -> tuple[PaperPlane | None, str]:
    try:
        stored = stored_plane(store, case)
    except NoSetError as error:
        return None, f"{error}: `agfb run` searches one"
    if stored.parameter != FREQUENCY:
        return None, f"its curves lie over {stored.parameter.replace('_', ' ')}, not the excitation frequency"
    return PaperPlane(stored), ""


def case_of(cases: Sequence[PaperCase], stiffness: float) -> PaperCase:
    """The case of a stiffness at the largest displacement of the paper."""
    for case in cases:
        if (case.foil_stiffness, case.displacement) == (stiffness, DISPLACEMENT):
            return case
    return PaperCase(stiffness, DISPLACEMENT, None, "no such case in the stores")


def joined(*remarks: str) -> str:
    """Remarks in one line."""
    return "; ".join(filter(None, remarks))


def threshold_at(stored: PaperPlane, frequency: float) -> Finding:
    """The threshold speed at an excitation frequency, or at the nearest end of the plane."""
    low, high = stored.plane.abscissae
    inside = min(max(frequency, low), high)
    moved = "" if inside == frequency else f"at {inside:.4g}, the end of the plane"
    boundary = stored.threshold.boundary(inside)
    if boundary.is_open:
        return None, f"no Neimark-Sacker point up to speed {boundary.speed:.4g}"
    return boundary.speed, moved


def maxima(stored: PaperPlane) -> list[Boundary]:
    """Maxima of the threshold over the excitation frequency, inside the plane, by rising frequency.

    Where the threshold lies above the plane, the middle of that interval counts as a maximum.  Within a
    tongue of period doublings, and between the ends of curves that nearly meet, the threshold is not known:
    it has a gap, whose edges may be maxima.
    """
    heights = np.array([boundary.speed for boundary in stored.envelope])
    low, high = stored.plane.abscissae
    for is_open, run in groupby(range(len(heights)), lambda index: stored.envelope[index].is_open):
        places = list(run)
        first, middle, last = (stored.envelope[places[at]].abscissa for at in (0, len(places) // 2, -1))
        narrow = last - first < NARROW * (high - low)
        if is_open and (narrow or not stored.plane.boundary(middle).is_open):
            heights[places] = stored.plane.speeds[0]
    peaks, _ = find_peaks(heights, prominence=PROMINENCE)
    return [stored.envelope[peak] for peak in peaks]


def nearest_maximum(stored: PaperPlane, frequency: float) -> tuple[Finding, Finding]:
    """Excitation frequency and threshold of the maximum nearest to a frequency."""
    maximum = min(maxima(stored), key=lambda each: abs(each.abscissa - frequency), default=None)
    if maximum is None:
        return (None, NO_MAXIMUM), (None, NO_MAXIMUM)
    remark = OPEN_END if maximum.is_open else ""
    return (maximum.abscissa, remark), (maximum.speed, remark)


def highest_maximum(stored: PaperPlane) -> Finding:
    """Excitation frequency of the highest maximum, its threshold in the remark."""
    maximum = max(maxima(stored), key=lambda each: each.speed, default=None)
    if maximum is None:
        return None, NO_MAXIMUM
    return maximum.abscissa, joined(f"threshold {maximum.speed:.4g}", OPEN_END if maximum.is_open else "")


def doubling_at(stored: PaperPlane, frequency: float) -> Finding:
    """The lowest period doubling at an excitation frequency."""
    plane = replace(stored.plane, curves=stored.of_kind("period_doubling"))
    crossings = plane.crossings(plane.axis, frequency, *plane.speeds)
    if crossings:
        return min(crossing.position for crossing in crossings), ""
    where = as_text(doubling_intervals(stored))
    return None, f"none there, but at {where}" if where else NO_DOUBLING


def lowest_doubling(stored: PaperPlane) -> Finding:
    """Speed of the lowest period doubling, its excitation frequency in the remark."""
    axis = stored.plane.axis
    lowest: list[tuple[float, float]] = []
    for curve in stored.of_kind("period_doubling"):
        points = curve.at(np.concatenate([curve.arclength, *curve.extrema]))
        row = points[np.argmin(points[:, 1 - axis])]
        lowest.append((float(row[1 - axis]), float(row[axis])))
    if not lowest:
        return None, NO_DOUBLING
    speed, frequency = min(lowest)
    return speed, f"at excitation frequency {frequency:.4g}"


def doubling_intervals(stored: PaperPlane) -> list[tuple[float, float]]:
    """Intervals of the excitation frequency over which there are period doublings, apart and rising."""
    axis = stored.plane.axis
    extents = sorted(
        (float(low[axis]), float(high[axis]))
        for low, high in (curve.extent for curve in stored.of_kind("period_doubling"))
    )
    joined: list[tuple[float, float]] = []
    for low, high in extents:
        if joined and low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return joined


def as_text(intervals: Sequence[tuple[float, float]]) -> str:
    """Intervals in one line."""
    return ", ".join(f"{low:.4g} to {high:.4g}" for low, high in intervals)
