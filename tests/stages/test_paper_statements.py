"""Verdicts on printed numbers and statements, against planes whose curves are known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.branch import write_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store
from pipelines.stages.reports.paper_comparison import compare_paper
from pipelines.stages.reports.paper_planes import read_cases_of_paper
from pipelines.stages.reports.paper_rows import (
    MET,
    NEARLY,
    NOT_COMPARED,
    NOT_MET,
    VERDICTS,
    Row,
    rounding_of,
    verdict_of,
)
from tests.helpers.curves import SCALES, curve_rows, oval, write_curve
from tests.helpers.paper import store_of, write_threshold

FOILS = (3.0, 10.0, 20.0, 50.0)


def planes(path: Path, peaks: tuple[float, ...], tops: tuple[float, ...]) -> Store:
    """The four foils at the largest displacement, each with a parabola of Neimark-Sacker points."""
    store = store_of(path, [(stiffness, 0.2) for stiffness in FOILS])
    for number, (peak, top) in enumerate(zip(peaks, tops, strict=True)):
        write_threshold(store, f"c{number}", peak, top)
    return store


def add_tongue(
    store: Store, case: str, frequency: float, speed: float, width: float, name: str = "t"
) -> None:
    rows = curve_rows(oval(frequency, speed, width, 0.1), (0.0, 2.0 * np.pi), 33)
    write_curve(store, f"cases/{case}/pd/{name}", "period_doubling", rows, "closed")


def told(
    store: Store, quantity: str, stiffness: float | None = None, displacement: float | None = None
) -> Row:
    (found,) = (
        row
        for row in compare_paper(read_cases_of_paper([store]))
        if quantity in row.quantity
        and stiffness in (None, row.foil_stiffness)
        and displacement in (None, row.displacement)
    )
    return found


@pytest.mark.parametrize(
    ("printed", "ours", "verdict"),
    [
        ("1.1", 1.148, MET),  # rounded to tenths: 1.05 to 1.15
        ("1.1", 1.155, NEARLY),
        ("0.95", 0.979, MET),
        ("0.95", 0.985, NEARLY),
        ("0.70", 0.64, NEARLY),
        ("0.70", 0.639, NOT_MET),
        ("0.4", 0.352, MET),
        ("0.4", 0.6, NOT_MET),
    ],
)
def test_the_verdict_on_a_number_follows_from_the_difference_and_the_print(
    printed: str, ours: float, verdict: str
) -> None:
    assert verdict_of(ours - float(printed), rounding_of(printed)) == verdict
    row = Row("a number", "gain", 3.0, 0.2, float(printed), ours, rounding=rounding_of(printed))
    assert row.verdict == verdict
    assert f"{ours:.3f} here, {abs(ours - float(printed)):.3f} " in row.sentence
    assert row.as_dict()["verdict"] == verdict


def test_a_number_that_a_set_has_not_is_not_met_and_one_without_a_set_is_not_compared(tmp_path: Path) -> None:
    store = store_of(tmp_path / "a.zarr", [(3.0, 0.2)])
    write_threshold(store, "c0", 0.63, 1.2)
    rows = compare_paper(read_cases_of_paper([store]))
    doubling = next(row for row in rows if row.quantity.startswith("lowest period doubling at"))
    assert doubling.verdict == NOT_MET
    assert doubling.sentence == "0.4 in print, no number here: no period doubling in the plane."
    stiff = next(row for row in rows if row.foil_stiffness == 50.0 and row.printed is not None)
    assert stiff.verdict == NOT_COMPARED
    met = next(row for row in rows if row.quantity == "threshold at excitation frequency 0.63")
    assert (met.verdict, met.sentence) == (MET, "1.200 here, as in print.")
    judged = [row for row in rows if row.printed is not None or row.is_statement]
    assert {row.verdict for row in judged} <= set(VERDICTS)
    assert all(row.sentence.endswith(".") for row in judged)


@pytest.mark.parametrize(
    ("peaks", "verdict"),
    [
        ((0.63, 0.70, 0.72, 0.74), MET),
        ((0.70, 0.69, 0.72, 0.74), NEARLY),
        ((0.74, 0.73, 0.72, 0.71), NOT_MET),
    ],
)
def test_the_order_of_the_anti_resonances(tmp_path: Path, peaks: tuple[float, ...], verdict: str) -> None:
    row = told(planes(tmp_path / "a.zarr", peaks, (1.2,) * 4), "rises with the stiffness")
    assert row.verdict == verdict
    assert f"{peaks[0]:.3f} at k_b = 3" in row.sentence


@pytest.mark.parametrize(
    ("widths", "verdict"),
    [((0.2, 0.1, 0.05, 0.0), MET), ((0.2, 0.1, 0.05, 0.02), NEARLY), ((0.02, 0.1, 0.2, 0.3), NOT_MET)],
)
def test_fewer_period_doublings_with_rising_stiffness(
    tmp_path: Path, widths: tuple[float, ...], verdict: str
) -> None:
    store = planes(tmp_path / "a.zarr", (0.7,) * 4, (1.2,) * 4)
    for number, width in enumerate(widths):
        if width:
            add_tongue(store, f"c{number}", 1.0, 0.6, width)
    row = told(store, "fewer period doublings")
    assert row.verdict == verdict
    assert f"{2.0 * widths[0]:.3f} at k_b = 3" in row.sentence


@pytest.mark.parametrize(("begin", "verdict"), [(0.72, MET), (0.68, NEARLY), (0.65, NOT_MET)])
def test_a_tongue_over_a_printed_frequency(tmp_path: Path, begin: float, verdict: str) -> None:
    """It begins above, a little below and well below 0.70, where the foil k_b = 10 has none in the paper."""
    store = planes(tmp_path / "a.zarr", (0.7,) * 4, (1.2,) * 4)
    add_tongue(store, "c1", begin + 0.2, 0.6, 0.2)
    row = told(store, "no period doubling below the threshold at excitation frequency 0.70")
    assert row.verdict == verdict
    assert told(store, "no period doubling below the threshold at excitation frequency 0.74").verdict == MET


def test_the_gain_over_stiffness_and_displacement(tmp_path: Path) -> None:
    """A parabola with its top t at the frequency p has the gain t / (t - 0.3 (p - 0.2)^2) - 1."""
    store = store_of(tmp_path / "a.zarr", [(3.0, 0.02), (3.0, 0.2), (50.0, 0.2), (50.0, 0.1)])
    for case, peak in (("c0", 0.5), ("c1", 0.8), ("c2", 1.2), ("c3", 1.3)):
        write_threshold(store, case, peak, 1.2)
    row = told(store, "grows with the stiffness")
    assert row.verdict == MET
    assert f"{1.2 / (1.2 - 0.3) - 1.0:+.1%} at k_b = 50" in row.sentence
    assert told(store, "grows with the displacement", 3.0).verdict == MET
    assert told(store, "grows with the displacement", 50.0).verdict == NOT_MET
    assert told(store, "grows with the displacement", 10.0).verdict == NOT_COMPARED


def test_zones_of_raised_threshold_end_where_period_doublings_cover_all(tmp_path: Path) -> None:
    store = planes(tmp_path / "a.zarr", (0.7,) * 4, (1.2,) * 4)
    flat = curve_rows(lambda f: np.column_stack([f, 0.5 + 0.0 * f]), (0.2, 2.0), 12)
    write_curve(store, "cases/c3/pd/c000", "period_doubling", flat)
    zone = told(store, "a zone of", 3.0)
    assert zone.verdict == MET
    assert zone.sentence.startswith("1.200 instead of 1.125 at excitation frequency 0.700")
    assert told(store, "a zone of", 50.0).verdict == NOT_MET


@pytest.mark.parametrize(("critical", "verdict"), [(0.35, MET), (0.375, NEARLY), (0.42, NOT_MET)])
def test_the_anti_resonance_beside_the_critical_speeds(tmp_path: Path, critical: float, verdict: str) -> None:
    """Twice the only critical speed, and half of it, are the frequencies of Eq. 22."""
    store = planes(tmp_path / "a.zarr", (0.7,) * 4, (1.2,) * 4)
    assert told(store, "Eq. 22", 3.0).verdict == NOT_COMPARED
    sizes = {"speed": 2, "mode": 2, "critical": 1, "prediction": 1}
    arrays = {
        array.name: np.full([sizes.get(name, 2) for name in array.dimensions], array.fill)
        for array in KINDS["criticals"].arrays
    }
    arrays["critical_speed"] = np.array([critical])
    write_group(store, "cases/c0/criticals", "criticals", arrays, {})
    row = told(store, "Eq. 22", 3.0)
    assert row.verdict == verdict
    assert f"2 Omega_1 = {2.0 * critical:.3f}" in row.sentence


@pytest.mark.parametrize(("top", "verdict"), [(1.2, MET), (1.06, NEARLY), (1.0, NOT_MET)])
def test_the_speed_in_revolutions_per_minute(tmp_path: Path, top: float, verdict: str) -> None:
    store = planes(tmp_path / "a.zarr", (0.63, 0.7, 0.72, 0.74), (top,) * 4)
    row = told(store, "is stable above 20000 rpm", 3.0)
    assert row.verdict == verdict
    assert row.sentence == f"up to {top * SCALES['speed_rpm_per_unit']:.0f} rpm."


def test_what_sets_do_not_hold_says_where_to_look(tmp_path: Path) -> None:
    store = planes(tmp_path / "a.zarr", (0.63, 0.7, 0.72, 0.74), (1.2,) * 4)
    assert told(store, "twice the period").verdict == NOT_COMPARED
    assert "Fig. 6" in told(store, "unbalance", 50.0).sentence
