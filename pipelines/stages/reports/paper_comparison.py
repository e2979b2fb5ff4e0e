"""`agfb compare-paper`: the numbers that the paper prints beside those of stored bifurcation sets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.stages.reports.operating_range import REFERENCE_FREQUENCY
from pipelines.stages.reports.paper_planes import (
    DISPLACEMENT,
    NOT_COMPLETE,
    Finding,
    PaperCase,
    PaperPlane,
    as_text,
    case_of,
    doubling_at,
    doubling_intervals,
    highest_maximum,
    joined,
    lowest_doubling,
    nearest_maximum,
    threshold_at,
)
from pipelines.stages.reports.paper_rows import NOT_COMPARED, NOT_MET, Row, rounding_of
from pipelines.stages.reports.paper_statements import ANTIRESONANCES, statements

AT_LOW_FREQUENCY = f"threshold at excitation frequency {REFERENCE_FREQUENCY:g}"
AT_NEAREST_MAXIMUM = "threshold at the nearest maximum"
RECONSTRUCTION = (
    "The paper prints no dimensions of its rotor and bearings. These are the numbers of a reconstruction, "
    "not of the authors' machine."
)


@dataclass(frozen=True)
class Printed:
    """Numbers that the paper prints for one foil stiffness at the largest displacement, 0.2, as printed."""

    foil_stiffness: float
    low_threshold: str
    antiresonance: str
    threshold: str = "1.2"


PRINTED = tuple(
    Printed(stiffness, low, ANTIRESONANCES[stiffness])
    for stiffness, low in ((3.0, "1.1"), (10.0, "0.95"), (20.0, "0.95"), (50.0, "0.95"))
)
GAIN = "0.30"
PERIOD_DOUBLING_SPEED = "0.4"  # of k_b = 3 at its anti-resonance


def compare_paper(cases: Sequence[PaperCase]) -> list[Row]:
    """Every printed number beside ours, the period doublings of all cases, and the printed statements."""
    rows: list[Row] = []
    for printed in PRINTED:
        rows += _threshold_rows(printed, case_of(cases, printed.foil_stiffness))
    rows.append(_largest_gain(rows))
    rows += _period_doubling_rows(PRINTED[0], case_of(cases, PRINTED[0].foil_stiffness))
    for printed in PRINTED:
        rows += _smallest_displacement_rows(printed.foil_stiffness, cases)
    for case in cases:
        rows += _count_rows(case, cases)
    return rows + statements(cases)


def _row(
    case: PaperCase, quantity: str, source: str, printed: str | None, find: Callable[[PaperPlane], Finding]
) -> Row:
    """A printed number beside what ``find`` finds in the plane of a case."""
    value, remark = (None, case.reason) if case.stored is None else find(case.stored)
    if case.stored is not None and case.stored.stored.cautions:
        remark = joined(remark, NOT_COMPLETE)
    judged = ""
    if printed is not None and value is None:
        judged = NOT_COMPARED if case.stored is None else NOT_MET
    number, rounding = (None, 0.0) if printed is None else (float(printed), rounding_of(printed))
    return Row(
        quantity, source, case.foil_stiffness, case.displacement, number, value, remark, rounding, judged
    )


def _threshold_rows(printed: Printed, case: PaperCase) -> list[Row]:
    """The rows with the thresholds of one stiffness."""
    printed_at, at = printed.antiresonance, float(printed.antiresonance)
    nearest, highest = (
        f"anti-resonance: {which} maximum of the threshold" for which in ("nearest", "highest")
    )
    return [
        _row(case, AT_LOW_FREQUENCY, "low threshold", printed.low_threshold,
             lambda plane: threshold_at(plane, REFERENCE_FREQUENCY)),
        _row(case, nearest, "anti-resonance", printed_at, lambda plane: nearest_maximum(plane, at)[0]),
        _row(case, highest, "anti-resonance", None, highest_maximum),
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
    return Row(
        "largest gain in threshold speed",
        "gain",
        best,
        DISPLACEMENT,
        float(GAIN),
        gains.get(best),
        remark,
        rounding_of(GAIN),
        "" if gains else NOT_COMPARED,
    )


def _period_doubling_rows(printed: Printed, case: PaperCase) -> list[Row]:
    """The lowest period doubling at the printed anti-resonance, and in the whole plane."""
    at, speed = float(printed.antiresonance), PERIOD_DOUBLING_SPEED
    return [
        _row(case, f"lowest period doubling at excitation frequency {at:g}", "period doubling", speed,
             lambda plane: doubling_at(plane, at)),
        _row(case, "lowest period doubling of the plane", "period doubling", None, lowest_doubling),
    ]  # fmt: skip


def _smallest_displacement_rows(stiffness: float, cases: Sequence[PaperCase]) -> list[Row]:
    """How much the smallest displacement changes the threshold of a stiffness, against resting rings."""
    at_low = f"change of the threshold by the smallest displacement, at {REFERENCE_FREQUENCY:g}"
    anywhere, source = "the same, largest over the excitation frequency", "smallest displacement"
    moving = [case for case in cases if case.foil_stiffness == stiffness and case.displacement > 0.0]
    if len(moving) < 2:
        why = "the stores have not two displacements of this stiffness"
        return [
            Row(quantity, source, stiffness, None, 0.0, None, why, judged=NOT_COMPARED)
            for quantity in (at_low, anywhere)
        ]
    return [
        _row(moving[0], at_low, source, "0.00", _change_low),
        _row(moving[0], anywhere, source, "0.00", _change_anywhere),
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
    printed = "0.00" if len(moving) > 1 and case.displacement == moving[0] else None
    source, length = "period doublings", "excitation frequencies with period doublings, length"
    return [
        _row(case, "curves of period doublings", source, printed,
             lambda stored: (float(len(stored.of_kind("period_doubling"))), "")),
        _row(case, length, source, None, _doubled_length),
    ]  # fmt: skip


def _doubled_length(stored: PaperPlane) -> Finding:
    intervals = doubling_intervals(stored)
    return sum(high - low for low, high in intervals), as_text(intervals)
