"""The comparison with the paper against planes whose thresholds are known in closed form."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.store import Store, open_for_writing
from pipelines.stages.reports.operating_range import REFERENCE_FREQUENCY
from pipelines.stages.reports.paper_comparison import GAIN, PERIOD_DOUBLING_SPEED, PRINTED, compare_paper
from pipelines.stages.reports.paper_planes import DISPLACEMENT, NOT_COMPLETE, read_cases_of_paper
from pipelines.stages.reports.paper_rows import IN_THE_PAPER, Row
from tests.helpers.curves import curve_rows, oval, write_curve, write_set
from tests.helpers.paper import BEND, store_of, threshold, write_threshold

REFERENCE = Path(__file__).resolve().parents[1] / "reference" / "seed_paper_targets.csv"
PASSIVE = 1.05  # of `write_set`


def rows_of(*stores: Store) -> list[Row]:
    return compare_paper(read_cases_of_paper(stores))


def row(rows: list[Row], quantity: str, stiffness: float | None = 3.0, displacement: float = 0.2) -> Row:
    (found,) = (
        each
        for each in rows
        if each.quantity.startswith(quantity)
        and (stiffness is None or each.foil_stiffness == stiffness)
        and each.displacement in (displacement, None)
    )
    return found


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """k_b = 3 with an anti-resonance at 0.66, the search complete; its smallest displacement; k_b = 10."""
    made = store_of(tmp_path_factory.mktemp("paper") / "a.zarr", [(3.0, 0.2), (3.0, 0.05), (10.0, 0.2)])
    write_threshold(made, "c0", 0.66, 1.3)
    for number, (frequency, speed) in enumerate(((0.9, 0.5), (1.0, 0.6), (1.6, 0.7))):
        rows = curve_rows(oval(frequency, speed, 0.1, 0.15), (0.0, 2.0 * np.pi), 17)
        write_curve(made, f"cases/c0/pd/c{number:03d}", "period_doubling", rows, "closed")
    write_threshold(made, "c1", 0.66, 1.06)
    write_threshold(made, "c2", 0.72, 1.2, complete=False, covered="5 lines")
    return made


def test_the_printed_numbers_are_those_of_the_reference_table() -> None:
    with REFERENCE.open() as file:
        table = list(csv.DictReader(file))
    frequencies = {
        float(each["kb_bar"]): float(each["Omega_ex_bar"])
        for each in table
        if each["quantity"] == "anti-resonance excitation frequency"
    }
    assert frequencies == {printed.foil_stiffness: float(printed.antiresonance) for printed in PRINTED}

    def value(quantity: str, stiffness: str) -> tuple[float, float]:
        (text,) = (
            each["value"] + " " + each["Omega_ex_bar"]
            for each in table
            if each["quantity"].startswith(quantity) and stiffness in each["kb_bar"].split(";")
        )
        numbers = [part.strip("~") for part in text.replace("(c.a.)", "").split()]
        return float(numbers[1]), float(numbers[2].split(";")[0])

    for printed in PRINTED:
        stiffness = f"{printed.foil_stiffness:g}"
        assert value("NS threshold speed reference", stiffness) == (
            float(printed.low_threshold),
            REFERENCE_FREQUENCY,
        )
        assert value("NS threshold speed with PE", stiffness)[0] == float(printed.threshold)
    assert value("PD bifurcation", "3") == (float(PERIOD_DOUBLING_SPEED), float(PRINTED[0].antiresonance))
    (gain,) = (each["value"] for each in table if each["quantity"] == "gain in threshold speed")
    assert gain.startswith(f"up to {float(GAIN):.0%}")
    assert {each["delta_bar"] for each in table if each["Omega_ex_bar"] == "0.63"} == {f"{DISPLACEMENT:g}"}


def test_thresholds_anti_resonance_and_gain_are_those_of_the_curve(store: Store) -> None:
    rows = rows_of(store)
    low = row(rows, "threshold at excitation frequency 0.2")
    at_low = 1.3 - BEND * 0.46**2
    assert low.ours == pytest.approx(at_low, abs=1e-5)
    assert (low.printed, low.difference) == (1.1, pytest.approx(at_low - 1.1, abs=1e-5))
    assert low.relative == pytest.approx((at_low - 1.1) / 1.1, abs=1e-5)
    nearest, highest = row(rows, "anti-resonance: nearest"), row(rows, "anti-resonance: highest")
    assert nearest.ours == pytest.approx(0.66, abs=1e-4)
    assert highest.ours == pytest.approx(0.66, abs=1e-4)
    assert "threshold 1.3" in highest.remark
    assert row(rows, "threshold at the nearest maximum").ours == pytest.approx(1.3, abs=1e-6)
    at_printed = 1.3 - BEND * 0.03**2
    assert row(rows, "threshold at excitation frequency 0.63").ours == pytest.approx(at_printed, abs=1e-5)
    gain = row(rows, "largest gain", None)
    assert (gain.foil_stiffness, gain.printed) == (10.0, 0.30)
    assert gain.ours == pytest.approx(1.2 / (1.2 - BEND * 0.52**2) - 1.0, abs=1e-5)
    assert f"k_b = 3: {1.3 / at_low - 1.0:+.1%}" in gain.remark


def test_the_nearest_maximum_need_not_be_the_highest(tmp_path: Path) -> None:
    store = store_of(tmp_path / "a.zarr", [(3.0, 0.2)])
    write_set(store, "c0")

    slope = -3.0 * np.poly([0.6, 1.0, 1.5])

    def two(f: np.ndarray) -> np.ndarray:
        return np.column_stack([f, 0.6 + np.polyval(np.polyint(slope), f)])

    write_curve(store, "cases/c0/ns/c000", "neimark_sacker", curve_rows(two, (0.3, 1.8), 30))
    rows = rows_of(store)
    assert row(rows, "anti-resonance: nearest").ours == pytest.approx(0.6, abs=1e-4)
    assert row(rows, "anti-resonance: highest").ours == pytest.approx(1.5, abs=1e-4)


def test_period_doublings_do_not_change_the_threshold(store: Store, tmp_path: Path) -> None:
    """A tongue around the whole anti-resonance, as in Fig. 4a: the threshold is that of Neimark-Sacker."""
    rows = curve_rows(oval(0.65, 0.6, 0.2, 0.2), (0.0, 2.0 * np.pi), 33)
    before = row(rows_of(store), "threshold at excitation frequency 0.63")
    shutil.copytree(store.path, tmp_path / "a.zarr")
    store = open_for_writing(tmp_path / "a.zarr", durable=False)
    write_curve(store, "cases/c0/pd/c009", "period_doubling", rows, "closed")
    found = rows_of(store)
    assert row(found, "threshold at excitation frequency 0.63") == before
    exact = 0.6 - 0.2 * np.sqrt(1.0 - (0.02 / 0.2) ** 2)
    assert row(found, "lowest period doubling at excitation").ours == pytest.approx(exact, abs=1e-4)


def test_period_doublings_are_found_and_counted(store: Store) -> None:
    rows = rows_of(store)
    lowest = row(rows, "lowest period doubling of the plane")
    assert lowest.ours == pytest.approx(0.35, abs=1e-6)
    assert lowest.remark.startswith("at excitation frequency 0.9")
    missing = row(rows, "lowest period doubling at excitation frequency 0.63")
    assert missing.ours is None
    assert "none there, but at 0.8 to 1.1, 1.5 to 1.7" in missing.remark
    counted = row(rows, "curves of period doublings")
    assert (counted.ours, counted.printed) == (3.0, None)
    assert row(rows, "excitation frequencies with").ours == pytest.approx(0.3 + 0.2, abs=1e-3)
    smallest = row(rows, "curves of period doublings", displacement=0.05)
    assert (smallest.ours, smallest.printed, smallest.difference) == (0.0, 0.0, 0.0)


def test_the_smallest_displacement_is_compared_with_rest(store: Store) -> None:
    rows = rows_of(store)
    low = row(rows, "change of the threshold by the smallest", displacement=0.05)
    at_low = 1.06 - BEND * 0.46**2
    assert (low.printed, low.ours) == (0.0, pytest.approx(at_low / PASSIVE - 1.0, abs=1e-5))
    largest = row(rows, "the same, largest", displacement=0.05)
    at_high = 1.06 - BEND * 1.34**2
    assert largest.ours == pytest.approx(at_high / PASSIVE - 1.0, abs=1e-5)
    assert largest.remark == "at excitation frequency 2"
    alone = row(rows, "change of the threshold by the smallest", 10.0)
    assert alone.ours is None
    assert "two displacements" in alone.remark


def test_what_the_stores_do_not_tell_says_why(store: Store, tmp_path: Path) -> None:
    rows = rows_of(store, store_of(tmp_path / "b.zarr", [(20.0, 0.2)]))
    assert "no such case" in row(rows, "anti-resonance: nearest", 50.0).remark
    empty = row(rows, "anti-resonance: nearest", 20.0)
    assert empty.ours is None
    assert "agfb run" in empty.remark
    assert NOT_COMPLETE in row(rows, "anti-resonance: nearest", 10.0).remark
    assert NOT_COMPLETE not in row(rows, "anti-resonance: nearest").remark
    assert {each.source for each in rows} <= set(IN_THE_PAPER)


def test_cases_are_gathered_from_several_stores_the_first_counts(store: Store, tmp_path: Path) -> None:
    other = store_of(tmp_path / "b.zarr", [(3.0, 0.2), (50.0, 0.2)])
    write_threshold(other, "c0", 0.9, 1.1)
    write_threshold(other, "c1", 0.76, 1.25)
    rows = rows_of(store, other)
    assert row(rows, "anti-resonance: nearest", 50.0).ours == pytest.approx(0.76, abs=1e-4)
    assert row(rows, "anti-resonance: nearest").ours == pytest.approx(0.66, abs=1e-4)
    assert len(read_cases_of_paper([store, other])) == 4


def test_an_open_threshold_is_a_lower_bound_and_no_number_at_its_frequency(tmp_path: Path) -> None:
    """Between two curves there is no Neimark-Sacker point up to the highest speed, 1.4."""
    store = store_of(tmp_path / "a.zarr", [(3.0, 0.2)])
    write_set(store, "c0")
    for number, ends in enumerate(((0.2, 0.6), (0.7, 2.0))):
        rows = curve_rows(threshold(1.0, 1.1), ends, 12)
        write_curve(store, f"cases/c0/ns/c{number:03d}", "neimark_sacker", rows)
    rows = rows_of(store)
    at = row(rows, "threshold at excitation frequency 0.63")
    assert at.ours is None
    assert "no Neimark-Sacker point up to speed 1.4" in at.remark
    nearest = row(rows, "anti-resonance: nearest")
    assert nearest.ours is not None
    assert 0.6 < nearest.ours < 0.7
    assert nearest.remark.startswith("at least")
    assert row(rows, "threshold at the nearest maximum").ours == 1.4


def straight(level: float, slope: float) -> Callable[[np.ndarray], np.ndarray]:
    """A straight line of points over the excitation frequency."""
    return lambda f: np.column_stack([f, level + slope * f])


@pytest.mark.parametrize("gap", [(0.6, 0.7), (0.645, 0.655)])
def test_a_tongue_and_ends_that_nearly_meet_are_gaps_of_the_threshold(
    tmp_path: Path, gap: tuple[float, float]
) -> None:
    """Its highest edge is the maximum. In the wide gap period doublings bound the speed."""
    store = store_of(tmp_path / "a.zarr", [(3.0, 0.2)])
    write_set(store, "c0")
    edges = (0.2, gap[0], 1.0, 1.1), (gap[1], 2.0, 1.05, 1.0)
    for number, (low, high, begin, end) in enumerate(edges):
        slope = (end - begin) / (high - low)
        rows = curve_rows(straight(begin - slope * low, slope), (low, high), 12)
        write_curve(store, f"cases/c0/ns/c{number:03d}", "neimark_sacker", rows)
    if gap[0] == 0.6:
        rows = curve_rows(straight(0.9, 0.0), gap, 12)
        write_curve(store, "cases/c0/pd/c000", "period_doubling", rows)
    compared = rows_of(store)
    assert row(compared, "anti-resonance: nearest").ours == pytest.approx(gap[0], abs=2e-3)
    assert row(compared, "threshold at the nearest maximum").ours == pytest.approx(1.1, abs=2e-3)
