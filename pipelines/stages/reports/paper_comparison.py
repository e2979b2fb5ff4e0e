"""`agfb compare-paper`: the numbers that the paper prints beside those of stored bifurcation sets.

In the paper the threshold speed is that of the Neimark-Sacker bifurcation, even if a period doubling comes at
a lower speed (Fig. 4a).  The threshold at an excitation frequency is therefore the lowest Neimark-Sacker
point of a cycle that is otherwise stable, and an anti-resonance is a maximum of the threshold over the
excitation frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from scipy.signal import find_peaks

from pipelines.datasets.curves import BifurcationCurve
from pipelines.datasets.reading import case_attributes, list_cases
from pipelines.datasets.store import Store
from pipelines.stages.reports.first_boundary import Boundary, SpeedPlane, lower_envelope
from pipelines.stages.reports.operating_range import (
    FREQUENCY,
    REFERENCE_FREQUENCY,
    NoSetError,
    StoredPlane,
    stored_plane,
)

Finding = tuple[float | None, str]
"""A computed number, None where the plane has none, and a remark on it."""

PROMINENCE = 0.01  # in speed: less prominent maxima of the threshold are no anti-resonance
NARROW = 0.02  # of the plane's width: a narrower gap between the ends of two curves does not count as open
NOT_COMPLETE = "the search of the plane is not complete"
OPEN_END = "at least: no Neimark-Sacker point up to the highest speed of the plane"
NO_MAXIMUM = "the threshold has no maximum in the plane"
AT_LOW_FREQUENCY = f"threshold at excitation frequency {REFERENCE_FREQUENCY:g}"
AT_NEAREST_MAXIMUM = "threshold at the nearest maximum"
RECONSTRUCTION = (
    "The paper prints no dimensions of its rotor and bearings. These are the numbers of a reconstruction, "
    "not of the authors' machine."
)


@dataclass(frozen=True)
class Printed:
    """Numbers that the paper prints for one foil stiffness at the largest displacement, 0.2."""

    foil_stiffness: float
    low_threshold: float
    antiresonance: float
    threshold: float


DISPLACEMENT = 0.2
PRINTED = (
    Printed(3.0, low_threshold=1.1, antiresonance=0.63, threshold=1.2),
    Printed(10.0, low_threshold=0.95, antiresonance=0.70, threshold=1.2),
    Printed(20.0, low_threshold=0.95, antiresonance=0.72, threshold=1.2),
    Printed(50.0, low_threshold=0.95, antiresonance=0.74, threshold=1.2),
)
GAIN = 0.30
PERIOD_DOUBLING_SPEED = 0.4  # of k_b = 3 at its anti-resonance
IN_THE_PAPER = {
    "low threshold": "Sec. 4, Fig. 4, upper charts: 'parametric excitation is of low frequency, e.g. 0.2'",
    "anti-resonance": "Sec. 4: 'found to be 0.63, 0.70, 0.72, 0.74 respectively'",
    "threshold": "Sec. 4: 'a Neimark-Sacker bifurcation at the ending speed of c.a. 1.2'",
    "gain": "Sec. 4: 'increase of the threshold speed of instability up to 30%'",
    "period doubling": "Sec. 4, Fig. 4a: 'in much lower rotating speed, c.a. 0.4'",
    "period doublings": "Sec. 4, Fig. 3: 'for the lowest value no period doubling bifurcation occurs'; "
    "'as the stiffness coefficient increases, only Neimark-Sacker bifurcations appear'",
    "smallest displacement": "Sec. 4: 'selected so as not to affect the threshold speed of instability'",
}
"""Where each printed number stands."""


@dataclass(frozen=True)
class Row:
    """One dimensionless number of the paper beside that of the stores, with a remark.

    ``printed``: None where the paper gives no number; ``ours``: None where no store has one; ``source``: a
    key of ``IN_THE_PAPER``.
    """

    quantity: str
    source: str
    foil_stiffness: float | None
    displacement: float | None
    printed: float | None
    ours: float | None
    remark: str = ""

    @property
    def difference(self) -> float | None:
        """Ours less printed."""
        return None if self.ours is None or self.printed is None else self.ours - self.printed

    @property
    def relative(self) -> float | None:
        """The difference over the printed number."""
        return None if self.difference is None or not self.printed else self.difference / self.printed

    def as_dict(self) -> dict[str, Any]:
        """Plain data, fit for JSON."""
        return {**asdict(self), "difference": self.difference, "relative": self.relative}


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
    """One case of a store: its parameters and its plane, or why there is none."""

    foil_stiffness: float
    displacement: float
    stored: PaperPlane | None
    reason: str = ""


def read_cases_of_paper(stores: Sequence[Store]) -> list[PaperCase]:
    """All cases of the stores that have a foil stiffness, by rising stiffness and displacement.

    The first of several cases with the same two parameters counts.  Raises StoreError for damaged groups.
    """
    found: dict[tuple[float, float], PaperCase] = {}
    for store in stores:
        for case in list_cases(store):
            parameters = case_attributes(store, case).get("parameters", {})
            stiffness, displacement = parameters.get("foil_stiffness"), parameters.get("displacement")
            if stiffness is None or displacement is None:
                continue
            stored, reason = _plane_of(store, case)
            key = (float(f"{stiffness:.6g}"), float(f"{displacement:.6g}"))
            found.setdefault(key, PaperCase(*key, stored, reason))
    return [found[key] for key in sorted(found)]


def _plane_of(store: Store, case: str) -> tuple[PaperPlane | None, str]:
    try:
        stored = stored_plane(store, case)
    except NoSetError as error:
        return None, f"{error}: `agfb run` searches one"
    if stored.parameter != FREQUENCY:
        return None, f"its curves lie over {stored.parameter.replace('_', ' ')}, not the excitation frequency"
    return PaperPlane(stored), ""


def compare_paper(cases: Sequence[PaperCase]) -> list[Row]:
    """Every printed number beside ours, and the period doublings of all cases."""
    rows: list[Row] = []
    for printed in PRINTED:
        rows += _threshold_rows(printed, _case_of(cases, printed.foil_stiffness))
    rows.append(_largest_gain(rows))
    rows += _period_doubling_rows(PRINTED[0], _case_of(cases, PRINTED[0].foil_stiffness))
    for printed in PRINTED:
        rows += _smallest_displacement_rows(printed.foil_stiffness, cases)
    for case in cases:
        rows += _count_rows(case, cases)
    return rows


def _case_of(cases: Sequence[PaperCase], stiffness: float) -> PaperCase:
    """The case of a stiffness at the largest displacement of the paper."""
    for case in cases:
        if (case.foil_stiffness, case.displacement) == (stiffness, DISPLACEMENT):
            return case
    return PaperCase(stiffness, DISPLACEMENT, None, "no such case in the stores")


def _row(
    case: PaperCase, quantity: str, source: str, printed: float | None, find: Callable[[PaperPlane], Finding]
) -> Row:
    """A printed number beside what ``find`` finds in the plane of a case."""
    value, remark = (None, case.reason) if case.stored is None else find(case.stored)
    if case.stored is not None and case.stored.stored.cautions:
        remark = _joined(remark, NOT_COMPLETE)
    return Row(quantity, source, case.foil_stiffness, case.displacement, printed, value, remark)


def _joined(*remarks: str) -> str:
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
    return maximum.abscissa, _joined(f"threshold {maximum.speed:.4g}", OPEN_END if maximum.is_open else "")


def _threshold_rows(printed: Printed, case: PaperCase) -> list[Row]:
    """The rows with the thresholds of one stiffness."""
    at = printed.antiresonance
    return [
        _row(case, AT_LOW_FREQUENCY, "low threshold", printed.low_threshold,
             lambda plane: threshold_at(plane, REFERENCE_FREQUENCY)),
        _row(case, "anti-resonance: nearest maximum of the threshold", "anti-resonance", at,
             lambda plane: nearest_maximum(plane, at)[0]),
        _row(case, "anti-resonance: highest maximum of the threshold", "anti-resonance", at, highest_maximum),
        _row(case, AT_NEAREST_MAXIMUM, "threshold", printed.threshold,
             lambda plane: nearest_maximum(plane, at)[1]),
        _row(case, f"threshold at excitation frequency {at:.2f}", "threshold", printed.threshold,
             lambda plane: threshold_at(plane, at)),
    ]  # fmt: skip


def _largest_gain(rows: Sequence[Row]) -> Row:
    """The largest gain in threshold speed over all stiffnesses, from their rows."""
    lows = [row for row in rows if row.quantity == AT_LOW_FREQUENCY]
    tops = [row for row in rows if row.quantity == AT_NEAREST_MAXIMUM]
    gains = {
        low.foil_stiffness: top.ours / low.ours - 1.0
        for low, top in zip(lows, tops, strict=True)
        if low.ours and top.ours is not None
    }
    best = max(gains, key=lambda stiffness: gains[stiffness], default=None)
    remark = ", ".join(f"k_b = {stiffness:g}: {gain:+.1%}" for stiffness, gain in gains.items())
    remark = remark or lows[0].remark or tops[0].remark
    return Row("largest gain in threshold speed", "gain", best, DISPLACEMENT, GAIN, gains.get(best), remark)


def _period_doubling_rows(printed: Printed, case: PaperCase) -> list[Row]:
    """The lowest period doubling at the printed anti-resonance, and in the whole plane."""
    at, speed = printed.antiresonance, PERIOD_DOUBLING_SPEED
    return [
        _row(case, f"lowest period doubling at excitation frequency {at:g}", "period doubling", speed,
             lambda plane: _doubling_at(plane, at)),
        _row(case, "lowest period doubling of the plane", "period doubling", speed, _lowest_doubling),
    ]  # fmt: skip


def _doubling_at(stored: PaperPlane, frequency: float) -> Finding:
    plane = replace(stored.plane, curves=stored.of_kind("period_doubling"))
    crossings = plane.crossings(plane.axis, frequency, *plane.speeds)
    if crossings:
        return min(crossing.position for crossing in crossings), ""
    where = _as_text(doubling_intervals(stored))
    return None, f"none there, but at {where}" if where else "no period doubling in the plane"


def _lowest_doubling(stored: PaperPlane) -> Finding:
    axis = stored.plane.axis
    lowest: list[tuple[float, float]] = []
    for curve in stored.of_kind("period_doubling"):
        points = curve.at(np.concatenate([curve.arclength, *curve.extrema]))
        row = points[np.argmin(points[:, 1 - axis])]
        lowest.append((float(row[1 - axis]), float(row[axis])))
    if not lowest:
        return None, "no period doubling in the plane"
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


def _as_text(intervals: Sequence[tuple[float, float]]) -> str:
    return ", ".join(f"{low:.4g} to {high:.4g}" for low, high in intervals)


def _smallest_displacement_rows(stiffness: float, cases: Sequence[PaperCase]) -> list[Row]:
    """How much the smallest displacement changes the threshold of a stiffness, against resting rings."""
    at_low = f"change of the threshold by the smallest displacement, at {REFERENCE_FREQUENCY:g}"
    anywhere, source = "the same, largest over the excitation frequency", "smallest displacement"
    moving = [case for case in cases if case.foil_stiffness == stiffness and case.displacement > 0.0]
    if len(moving) < 2:
        why = "the stores have not two displacements of this stiffness"
        return [Row(quantity, source, stiffness, None, 0.0, None, why) for quantity in (at_low, anywhere)]
    return [
        _row(moving[0], at_low, source, 0.0, _change_low),
        _row(moving[0], anywhere, source, 0.0, _change_anywhere),
    ]


def _change_low(stored: PaperPlane) -> Finding:
    threshold, remark = threshold_at(stored, REFERENCE_FREQUENCY)
    passive = stored.stored.passive
    if passive is None or threshold is None:
        return None, remark or "the instability speed at displacement 0 is not stored"
    return threshold / passive - 1.0, remark


def _change_anywhere(stored: PaperPlane) -> Finding:
    passive = stored.stored.passive
    if passive is None or not stored.envelope:
        return None, "the instability speed at displacement 0, or Neimark-Sacker curves, are not stored"
    boundaries = [boundary for boundary in stored.envelope if not boundary.is_open]
    if not boundaries:
        return None, "no Neimark-Sacker point in the plane"
    changes = [boundary.speed / passive - 1.0 for boundary in boundaries]
    worst = int(np.argmax(np.abs(changes)))
    return changes[worst], f"at excitation frequency {boundaries[worst].abscissa:.4g}"


def _count_rows(case: PaperCase, cases: Sequence[PaperCase]) -> list[Row]:
    """Number of period-doubling curves of a case, and how much of the excitation frequency they cover.

    The paper states that there are none at the smallest displacement.
    """
    moving = sorted({each.displacement for each in cases if each.displacement > 0.0})
    printed = 0.0 if len(moving) > 1 and case.displacement == moving[0] else None
    source, length = "period doublings", "excitation frequencies with period doublings, length"
    return [
        _row(case, "curves of period doublings", source, printed,
             lambda stored: (float(len(stored.of_kind("period_doubling"))), "")),
        _row(case, length, source, printed, _doubled_length),
    ]  # fmt: skip


def _doubled_length(stored: PaperPlane) -> Finding:
    intervals = doubling_intervals(stored)
    return sum(high - low for low, high in intervals), _as_text(intervals)
