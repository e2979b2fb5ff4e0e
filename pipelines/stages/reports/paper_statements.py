"""What the paper states in words about its bifurcation sets, and whether the stores agree.

The gain of a set is the maximum of its threshold nearest to the printed anti-resonance, over the threshold
at a low excitation frequency, less one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pipelines.stages.reports.first_boundary import lower_envelope
from pipelines.stages.reports.operating_range import REFERENCE_FREQUENCY
from pipelines.stages.reports.paper_planes import (
    DISPLACEMENT,
    PaperCase,
    PaperPlane,
    as_text,
    case_of,
    doubling_at,
    doubling_intervals,
    nearest_maximum,
    threshold_at,
)
from pipelines.stages.reports.paper_rows import CLOSE, MET, NEARLY, NOT_COMPARED, NOT_MET, Row, verdict_of

ANTIRESONANCES = {3.0: "0.63", 10.0: "0.70", 20.0: "0.72", 50.0: "0.74"}
"""Printed excitation frequencies of the anti-resonances, as printed."""

RATED_RPM = 20_000.0
ORDERS = (1, 2)  # of the resonances that the paper found
RAISED = 1e-3  # relative rise of the threshold that counts
NO_SETS = "the stores have not the bifurcation sets that tell it"


def statements(cases: Sequence[PaperCase]) -> list[Row]:
    """A row for every statement of the paper."""
    rows = [_rising_antiresonances(cases), _fewer_doublings(cases), _gain_over_stiffness(cases)]
    rows += _single_bifurcations(cases)
    rows += _gain_over_displacement(cases)
    rows += [_zones(case) for case in cases if case.stored is not None]
    largest = [case_of(cases, stiffness) for stiffness in ANTIRESONANCES]
    rows += [row for case in largest for row in (_predicted(case), _fast_enough(case))]
    return [*rows, *_elsewhere()]


def _statement(
    quantity: str,
    source: str,
    verdict: str,
    told: str,
    stiffness: float | None = None,
    displacement: float | None = None,
) -> Row:
    return Row(quantity, source, stiffness, displacement, None, None, judged=verdict, told=f"{told}.")


def _of_largest(cases: Sequence[PaperCase]) -> list[tuple[float, PaperPlane]]:
    """The sets of the printed stiffnesses at the largest displacement, by rising stiffness."""
    found = [(stiffness, case_of(cases, stiffness).stored) for stiffness in ANTIRESONANCES]
    return [(stiffness, plane) for stiffness, plane in found if plane is not None]


def _gain(stiffness: float, plane: PaperPlane) -> float | None:
    """The gain of a set; None without a maximum or a threshold at the low frequency."""
    low, _ = threshold_at(plane, REFERENCE_FREQUENCY)
    _, (top, _) = nearest_maximum(plane, float(ANTIRESONANCES[stiffness]))
    return None if low is None or top is None else top / low - 1.0


def _rising(values: Sequence[float]) -> str:
    """Met if every value exceeds the one before; nearly if the last exceeds the first."""
    if all(second > first for first, second in pairwise(values)):
        return MET
    return NEARLY if values[-1] > values[0] else NOT_MET


def _rising_antiresonances(cases: Sequence[PaperCase]) -> Row:
    told = [
        (stiffness, nearest_maximum(plane, float(ANTIRESONANCES[stiffness]))[0][0])
        for stiffness, plane in _of_largest(cases)
    ]
    found = [(stiffness, frequency) for stiffness, frequency in told if frequency is not None]
    quantity = "the frequency of the anti-resonance rises with the stiffness of the foil"
    if len(found) < 2:
        return _statement(quantity, "anti-resonance", NOT_COMPARED, NO_SETS)
    words = ", ".join(f"{frequency:.3f} at k_b = {stiffness:g}" for stiffness, frequency in found)
    return _statement(quantity, "anti-resonance", _rising([each for _, each in found]), words)


def _fewer_doublings(cases: Sequence[PaperCase]) -> Row:
    lengths = [
        (stiffness, sum(high - low for low, high in doubling_intervals(plane)))
        for stiffness, plane in _of_largest(cases)
    ]
    quantity = "fewer period doublings with rising stiffness, and none at last"
    if len(lengths) < 2:
        return _statement(quantity, "period doublings", NOT_COMPARED, NO_SETS)
    words = ", ".join(f"{length:.3f} at k_b = {stiffness:g}" for stiffness, length in lengths)
    falling = _rising([-length for _, length in lengths])
    verdict = falling if lengths[-1][1] == 0.0 else NEARLY if falling == MET else NOT_MET
    told = f"excitation frequencies with period doublings have the length {words}"
    return _statement(quantity, "period doublings", verdict, told)


def _single_bifurcations(cases: Sequence[PaperCase]) -> Iterator[Row]:
    """No period doubling below the threshold at the printed frequencies of all foils but the softest."""
    for stiffness, printed in list(ANTIRESONANCES.items())[1:]:
        case, at = case_of(cases, stiffness), float(printed)
        quantity = f"no period doubling below the threshold at excitation frequency {printed}"
        if case.stored is None:
            verdict, told = NOT_COMPARED, case.reason
        else:
            verdict, told = _single(case.stored, at)
        yield _statement(quantity, "only Neimark-Sacker", verdict, told, stiffness, DISPLACEMENT)


def _single(plane: PaperPlane, at: float) -> tuple[str, str]:
    doubling, _ = doubling_at(plane, at)
    threshold, _ = threshold_at(plane, at)
    if doubling is None or (threshold is not None and doubling > threshold):
        where = as_text(doubling_intervals(plane))
        return MET, f"none there, but at {where}" if where else "no period doubling in the plane"
    inside = [(low, high) for low, high in doubling_intervals(plane) if low <= at <= high]
    depth = min(at - low for low, _ in inside) if inside else np.inf
    told = f"one at speed {doubling:.3f}; its tongue begins {depth:.3f} lower in frequency"
    return (NEARLY if depth <= CLOSE else NOT_MET), told


def _gain_over_displacement(cases: Sequence[PaperCase]) -> Iterator[Row]:
    quantity, source = "the gain in threshold speed grows with the displacement of the rings", "displacement"
    for stiffness in ANTIRESONANCES:
        gains = [
            (case.displacement, gain)
            for case in cases
            if case.foil_stiffness == stiffness and case.stored is not None
            if (gain := _gain(stiffness, case.stored)) is not None
        ]
        if len(gains) < 2:
            yield _statement(quantity, source, NOT_COMPARED, NO_SETS, stiffness)
            continue
        words = ", ".join(f"{gain:+.1%} at {displacement:g}" for displacement, gain in gains)
        yield _statement(quantity, source, _rising([gain for _, gain in gains]), words, stiffness)


def _gain_over_stiffness(cases: Sequence[PaperCase]) -> Row:
    told = [(stiffness, _gain(stiffness, plane)) for stiffness, plane in _of_largest(cases)]
    gains = [(stiffness, gain) for stiffness, gain in told if gain is not None]
    quantity = "the gain in threshold speed grows with the stiffness of the foil"
    if len(gains) < 2:
        return _statement(quantity, "stiffness", NOT_COMPARED, NO_SETS, None, DISPLACEMENT)
    words = ", ".join(f"{gain:+.1%} at k_b = {stiffness:g}" for stiffness, gain in gains)
    return _statement(quantity, "stiffness", _rising([gain for _, gain in gains]), words, None, DISPLACEMENT)


def _zones(case: PaperCase) -> Row:
    """Whether somewhere the first bifurcation is a Neimark-Sacker point above that at the low frequency."""
    quantity = "a zone of excitation frequencies with a raised threshold and no other bifurcation"
    where = (case.foil_stiffness, case.displacement)
    assert case.stored is not None
    low, remark = threshold_at(case.stored, REFERENCE_FREQUENCY)
    if low is None:
        return _statement(quantity, "zones", NOT_COMPARED, remark, *where)
    raised = [
        boundary
        for boundary in lower_envelope(case.stored.plane)
        if boundary.bifurcation == "neimark_sacker" and boundary.speed > (1.0 + RAISED) * low
    ]
    if not raised:
        return _statement(quantity, "zones", NOT_MET, f"none above {low:.3f}", *where)
    best = max(raised, key=lambda each: each.speed)
    told = f"{best.speed:.3f} instead of {low:.3f} at excitation frequency {best.abscissa:.3f}"
    return _statement(quantity, "zones", MET, told, *where)


def _predicted(case: PaperCase) -> Row:
    """The anti-resonance beside 2 Omega_j/n and |Omega_j +- Omega_k|/n of the critical speeds."""
    quantity = "the anti-resonance lies where Eq. 22 predicts one"
    where, source = (case.foil_stiffness, case.displacement), "resonances"
    if case.stored is None:
        return _statement(quantity, source, NOT_COMPARED, case.reason, *where)
    (top, remark), _ = nearest_maximum(case.stored, float(ANTIRESONANCES[case.foil_stiffness]))
    if top is None or not case.critical_speeds:
        why = remark if top is None else "no critical speeds are stored"
        return _statement(quantity, source, NOT_COMPARED, why, *where)
    name, frequency = min(_combinations(case.critical_speeds), key=lambda each: abs(each[1] - top))
    told = f"at {top:.3f}; the nearest is {name} = {frequency:.3f}"
    return _statement(quantity, source, verdict_of(frequency - top), told, *where)


def _combinations(speeds: Sequence[float]) -> Iterator[tuple[str, float]]:
    """Excitation frequencies of Eq. 22 by name."""
    for n in ORDERS:
        over = "" if n == 1 else f"/{n}"
        for j, first in enumerate(speeds, start=1):
            yield f"2 Omega_{j}{over}", 2.0 * first / n
            for k, second in enumerate(speeds[j:], start=j + 1):
                yield f"(Omega_{k} + Omega_{j}){over}", (second + first) / n
                yield f"(Omega_{k} - Omega_{j}){over}", (second - first) / n


def _fast_enough(case: PaperCase) -> Row:
    quantity = f"the rotor is stable above {RATED_RPM:g} rpm at the anti-resonance"
    where = (case.foil_stiffness, case.displacement)
    if case.stored is None or case.rpm is None:
        return _statement(quantity, "speed", NOT_COMPARED, case.reason or "no scales are stored", *where)
    (_, _), (speed, remark) = nearest_maximum(case.stored, float(ANTIRESONANCES[case.foil_stiffness]))
    if speed is None:
        return _statement(quantity, "speed", NOT_COMPARED, remark, *where)
    reached = speed * case.rpm
    missed = min(reached / RATED_RPM - 1.0, 0.0)
    return _statement(quantity, "speed", verdict_of(missed), f"up to {reached:.0f} rpm", *where)


def _elsewhere() -> Iterator[Row]:
    """Statements about single cycles and runs, which sets do not hold."""
    yield _statement(
        "stable cycles of twice the period exist over a wide range of speeds beyond the period doubling",
        "doubled cycles",
        NOT_COMPARED,
        "bifurcation sets hold no doubled cycles: see Fig. 4 a and Fig. 5",
        3.0,
        DISPLACEMENT,
    )
    for stiffness in (3.0, 50.0):
        yield _statement(
            "unbalance G 1 and G 6.3 hardly changes the threshold at the anti-resonance",
            "unbalance",
            NOT_COMPARED,
            "bifurcation sets are those of the balanced rotor: see Fig. 6",
            stiffness,
            DISPLACEMENT,
        )
