"""`agfb compare-paper`: the numbers that the paper prints beside those of stored bifurcation sets.

The paper speaks of the threshold speed as that of the Neimark-Sacker bifurcation, also where a period
doubling comes before it (Fig. 4a).  So the threshold at an excitation frequency is here the lowest
Neimark-Sacker point of a cycle that is otherwise stable, and the anti-resonance is a maximum of it over the
excitation frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
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

Array = NDArray[np.float64]

PROMINENCE = 0.01  # in speed: lower maxima of the threshold are no anti-resonance
GAP = 0.02  # of the plane's width: curves whose ends are nearer leave nothing open between them
NOT_COMPLETE = "the search of the plane is not complete"
SAME = 1e-6  # relative: parameters of a case that count as those of the paper
RECONSTRUCTION = (
    "The paper prints no dimensions of its rotor and bearings. These are the numbers of a reconstruction, "
    "not of the authors' machine."
)


@dataclass(frozen=True)
class Printed:
    """What the paper prints for one foil stiffness at the largest displacement, 0.2, and where."""

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
    """One number: printed (None where the paper gives none), ours (None where no store tells), both
    dimensionless, and a remark that says why or how.  ``source``: a key of `IN_THE_PAPER`.
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
    """What a store has of one case, and its threshold over the excitation frequency, found once."""

    stored: StoredPlane

    @property
    def plane(self) -> SpeedPlane:
        """The plane with all its curves."""
        return self.stored.plane

    @cached_property
    def threshold(self) -> SpeedPlane:
        """The plane with its Neimark-Sacker curves alone: other losses of stability do not count."""
        none = np.zeros(0, dtype=np.int64)
        curves = self.of_kind("neimark_sacker")
        return replace(self.plane, curves=curves, samples=np.zeros((0, 2)), unstable=none)

    @cached_property
    def envelope(self) -> tuple[Boundary, ...]:
        """The threshold by rising excitation frequency; nothing without Neimark-Sacker curves."""
        return tuple(lower_envelope(self.threshold)) if self.threshold.curves else ()

    def of_kind(self, bifurcation: str) -> list[BifurcationCurve]:
        """Its curves of one kind."""
        return [curve for curve in self.plane.curves if curve.bifurcation == bifurcation]


@dataclass(frozen=True)
class PaperCase:
    """One case of a store: its parameters and its plane, or why there is none."""

    foil_stiffness: float
    displacement: float
    stored: PaperPlane | None
    reason: str = ""


@dataclass(frozen=True)
class Found:
    """A number of ours, or why there is none; a remark may also stand beside a number."""

    value: float | None
    remark: str = ""


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
    gains: list[Found] = []
    for printed in PRINTED:
        case = _case_of(cases, printed.foil_stiffness, DISPLACEMENT)
        threshold_rows, gain = _thresholds(printed, case)
        rows += threshold_rows
        gains.append(gain)
    rows.append(_largest_gain(gains))
    rows += _period_doubling_rows(PRINTED[0], _case_of(cases, PRINTED[0].foil_stiffness, DISPLACEMENT))
    rows += _smallest_displacement(cases)
    for case in cases:
        rows += _counted(case, cases)
    return rows


def _case_of(cases: Sequence[PaperCase], stiffness: float, displacement: float) -> PaperCase:
    for case in cases:
        same = math.isclose(case.foil_stiffness, stiffness, rel_tol=SAME)
        if same and math.isclose(case.displacement, displacement, rel_tol=SAME):
            return case
    return PaperCase(stiffness, displacement, None, "no such case in the stores")


def _from(case: PaperCase, tell: Callable[[PaperPlane], Found]) -> Found:
    """What a case tells, with what its search left open."""
    if case.stored is None:
        return Found(None, case.reason)
    found = tell(case.stored)
    return Found(found.value, _remark(found.remark, case.stored))


def _remark(told: str, stored: PaperPlane) -> str:
    """A remark, and that of a plane that was not wholly searched."""
    return "; ".join(filter(None, (told, NOT_COMPLETE if stored.stored.cautions else "")))


def threshold_at(stored: PaperPlane, frequency: float) -> Found:
    """The threshold speed at an excitation frequency, or at the nearest end of the plane."""
    low, high = stored.plane.abscissae
    inside = min(max(frequency, low), high)
    moved = "" if inside == frequency else f"at {inside:.4g}, the end of the plane"
    boundary = stored.threshold.boundary(inside)
    if boundary.is_open:
        return Found(None, f"no Neimark-Sacker point up to speed {boundary.speed:.4g}")
    return Found(boundary.speed, moved)


def maxima(stored: PaperPlane) -> list[Boundary]:
    """Maxima of the threshold over the excitation frequency, inside the plane, by rising frequency; where
    nothing bounds the speed, the middle of the open interval.

    Within a tongue of period doublings, and between the ends of curves that nearly meet, the threshold is
    not known: it has a gap, whose edges may be maxima.
    """
    heights = np.array([boundary.speed for boundary in stored.envelope])
    low, high = stored.plane.abscissae
    for is_open, run in groupby(range(len(heights)), lambda index: stored.envelope[index].is_open):
        places = list(run)
        first, middle, last = (stored.envelope[places[at]].abscissa for at in (0, len(places) // 2, -1))
        narrow = last - first < GAP * (high - low)
        if is_open and (narrow or not stored.plane.boundary(middle).is_open):
            heights[places] = stored.plane.speeds[0]
    peaks, _ = find_peaks(heights, prominence=PROMINENCE)
    return [stored.envelope[peak] for peak in peaks]


def _thresholds(printed: Printed, case: PaperCase) -> tuple[list[Row], Found]:
    """The rows of one stiffness that speak of thresholds, and its gain."""
    near, best = _nearest_maximum(printed, case), _highest_maximum(case)
    low = _from(case, lambda stored: threshold_at(stored, REFERENCE_FREQUENCY))
    at_printed = _from(case, lambda stored: threshold_at(stored, printed.antiresonance))
    frequency, threshold = near
    gain = Found(None, low.remark or threshold.remark)
    if low.value and threshold.value is not None:
        gain = Found(threshold.value / low.value - 1.0)

    def row(quantity: str, source: str, value: float, found: Found) -> Row:
        return Row(quantity, source, printed.foil_stiffness, DISPLACEMENT, value, found.value, found.remark)

    at = f"{printed.antiresonance:.2f}"
    return [
        row(f"threshold at excitation frequency {REFERENCE_FREQUENCY:g}", "low threshold",
            printed.low_threshold, low),
        row("anti-resonance: nearest maximum of the threshold", "anti-resonance",
            printed.antiresonance, frequency),
        row("anti-resonance: highest maximum of the threshold", "anti-resonance",
            printed.antiresonance, best),
        row("threshold at the nearest maximum", "threshold", printed.threshold, threshold),
        row(f"threshold at excitation frequency {at}", "threshold", printed.threshold, at_printed),
    ], gain  # fmt: skip


def _nearest_maximum(printed: Printed, case: PaperCase) -> tuple[Found, Found]:
    """Excitation frequency and threshold of the maximum nearest to the printed anti-resonance."""

    def nearest(stored: PaperPlane) -> Boundary | None:
        found = maxima(stored)
        return min(found, key=lambda each: abs(each.abscissa - printed.antiresonance)) if found else None

    return _maximum(case, nearest)


def _highest_maximum(case: PaperCase) -> Found:
    """Excitation frequency of the highest maximum, its threshold in the remark."""

    def highest(stored: PaperPlane) -> Boundary | None:
        return max(maxima(stored), key=lambda each: each.speed, default=None)

    frequency, threshold = _maximum(case, highest)
    told = "" if threshold.value is None else f"threshold {threshold.value:.4g}"
    return Found(frequency.value, "; ".join(filter(None, (told, frequency.remark))))


def _maximum(case: PaperCase, choose: Callable[[PaperPlane], Boundary | None]) -> tuple[Found, Found]:
    if case.stored is None:
        return Found(None, case.reason), Found(None, case.reason)
    boundary = choose(case.stored)
    if boundary is None:
        none = Found(None, _remark("the threshold has no maximum in the plane", case.stored))
        return none, none
    open_end = "at least: no Neimark-Sacker point up to the highest speed of the plane"
    remark = _remark(open_end if boundary.is_open else "", case.stored)
    return Found(boundary.abscissa, remark), Found(boundary.speed, remark)


def _largest_gain(gains: Sequence[Found]) -> Row:
    """The gain of the stiffness that gains most."""
    known = {
        printed.foil_stiffness: gain.value
        for printed, gain in zip(PRINTED, gains, strict=True)
        if gain.value is not None
    }
    if not known:
        remark = next(gain.remark for gain in gains)
        return Row("largest gain in threshold speed", "gain", None, DISPLACEMENT, GAIN, None, remark)
    best = max(known, key=lambda stiffness: known[stiffness])
    told = ", ".join(f"k_b = {stiffness:g}: {gain:+.1%}" for stiffness, gain in known.items())
    return Row("largest gain in threshold speed", "gain", best, DISPLACEMENT, GAIN, known[best], told)


def _period_doubling_rows(printed: Printed, case: PaperCase) -> list[Row]:
    """The lowest period doubling at the printed anti-resonance, and in the whole plane."""
    at = printed.antiresonance
    found = {
        f"lowest period doubling at excitation frequency {at:g}": _from(
            case, lambda stored: _doubling_at(stored, at)
        ),
        "lowest period doubling of the plane": _from(case, lambda stored: _lowest_doubling(stored)),
    }
    return [
        Row(quantity, "period doubling", printed.foil_stiffness, DISPLACEMENT, PERIOD_DOUBLING_SPEED,
            each.value, each.remark)
        for quantity, each in found.items()
    ]  # fmt: skip


def _doubling_at(stored: PaperPlane, frequency: float) -> Found:
    plane = replace(stored.plane, curves=stored.of_kind("period_doubling"))
    crossings = plane.crossings(plane.axis, frequency, *plane.speeds)
    if crossings:
        return Found(min(crossing.position for crossing in crossings))
    intervals = doubling_intervals(stored)
    where = ", ".join(f"{low:.4g} to {high:.4g}" for low, high in intervals)
    return Found(None, f"none there, but at {where}" if intervals else "no period doubling in the plane")


def _lowest_doubling(stored: PaperPlane) -> Found:
    axis = stored.plane.axis
    lowest: tuple[float, float] | None = None
    for curve in stored.of_kind("period_doubling"):
        points = curve.at(np.concatenate([curve.arclength, *curve.extrema]))
        row = points[np.argmin(points[:, 1 - axis])]
        place = float(row[1 - axis]), float(row[axis])
        lowest = place if lowest is None else min(lowest, place)
    if lowest is None:
        return Found(None, "no period doubling in the plane")
    return Found(lowest[0], f"at excitation frequency {lowest[1]:.4g}")


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


def _smallest_displacement(cases: Sequence[PaperCase]) -> list[Row]:
    """How far the smallest displacement of each stiffness moves the threshold from that of resting rings."""
    rows = []
    for printed in PRINTED:
        own = [
            case for case in cases if math.isclose(case.foil_stiffness, printed.foil_stiffness, rel_tol=SAME)
        ]
        moving = [case for case in own if case.displacement > 0.0]
        if len(moving) < 2:
            case, why = None, "the stores have not two displacements of this stiffness"
        else:
            case, why = moving[0], ""
        quantities: Mapping[str, Callable[[PaperPlane], Found]] = {
            f"change of the threshold by the smallest displacement, at {REFERENCE_FREQUENCY:g}": _change_low,
            "the same, largest over the excitation frequency": _change_anywhere,
        }
        for quantity, change in quantities.items():
            found = Found(None, why) if case is None else _from(case, change)
            displacement = None if case is None else case.displacement
            rows.append(
                Row(quantity, "smallest displacement", printed.foil_stiffness, displacement, 0.0,
                    found.value, found.remark)
            )  # fmt: skip
    return rows


def _change_low(stored: PaperPlane) -> Found:
    found = threshold_at(stored, REFERENCE_FREQUENCY)
    passive = stored.stored.passive
    if passive is None or found.value is None:
        return Found(None, found.remark or "the instability speed at displacement 0 is not stored")
    return Found(found.value / passive - 1.0, found.remark)


def _change_anywhere(stored: PaperPlane) -> Found:
    passive = stored.stored.passive
    if passive is None or not stored.envelope:
        return Found(
            None, "the instability speed at displacement 0, or Neimark-Sacker curves, are not stored"
        )
    boundaries = [boundary for boundary in stored.envelope if not boundary.is_open]
    changes = [boundary.speed / passive - 1.0 for boundary in boundaries]
    if not changes:
        return Found(None, "no Neimark-Sacker point in the plane")
    worst = int(np.argmax(np.abs(changes)))
    return Found(changes[worst], f"at excitation frequency {boundaries[worst].abscissa:.4g}")


def _counted(case: PaperCase, cases: Sequence[PaperCase]) -> list[Row]:
    """Number of curves of period doublings of a case and how much of the excitation frequency they cover;
    none is printed for the smallest displacement of the stores.
    """
    moving = sorted({each.displacement for each in cases if each.displacement > 0.0})
    printed = 0.0 if len(moving) > 1 and case.displacement == moving[0] else None

    def covered(stored: PaperPlane) -> Found:
        intervals = doubling_intervals(stored)
        where = ", ".join(f"{low:.4g} to {high:.4g}" for low, high in intervals)
        return Found(sum(high - low for low, high in intervals), where)

    number = _from(case, lambda stored: Found(float(len(stored.of_kind("period_doubling")))))
    length = _from(case, covered)
    return [
        Row(quantity, "period doublings", case.foil_stiffness, case.displacement, printed, each.value,
            each.remark)
        for quantity, each in (
            ("curves of period doublings", number),
            ("excitation frequencies with period doublings, length", length),
        )
    ]  # fmt: skip
