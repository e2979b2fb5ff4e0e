"""Two stores against each other: every kind of difference is told, and noise below the tolerance is not."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from pipelines.datasets.branch import write_group
from pipelines.datasets.comparison import (
    GroupComparison,
    Verdict,
    compare_arrays,
    compare_stores,
    curve_distance,
)
from pipelines.datasets.curves import BifurcationCurve, read_curve
from pipelines.datasets.metadata import read_group_metadata
from pipelines.datasets.store import Store, open_for_reading, open_for_writing
from tests.figures.synthetic_store import make_store
from tests.helpers.curves import curve_rows, empty_store, oval, write_curve
from tests.helpers.synthetic import CRITICALS, FULL, GROUP, compute

TOLERANCE = 1e-6


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Store:
    return open_for_writing(shutil.copytree(finished, tmp_path / "copy"), durable=False)


def change(store: Store, name: str, place: Any, value: Any) -> None:
    """Set (or, with a function, change) elements of an array of the branch."""
    array = zarr.open_array(store.path / GROUP / name, mode="r+")
    content = array[...]
    content[place] = value(content[place]) if callable(value) else value
    array[...] = content


def of_branch(finished: Path, store: Store) -> GroupComparison:
    compared = compare_stores(open_for_reading(finished), open_for_reading(store.path), TOLERANCE)
    return next(group for group in compared.groups if group.group == GROUP)


def verdicts(group: GroupComparison) -> dict[str, Verdict]:
    return {a.array: a.verdict for a in group.arrays if a.verdict is not Verdict.IDENTICAL}


def test_a_store_is_identical_to_its_copy(finished: Path, copy: Store) -> None:
    compared = compare_stores(open_for_reading(finished), copy, 0.0)
    assert compared.are_equal
    assert {group.verdict for group in compared.groups} == {Verdict.IDENTICAL}
    assert (compared.only_first, compared.only_second, compared.configuration) == ((), (), ())
    assert "basis" not in {array.array for array in compared.groups[-1].arrays}, "a slot is no result"


def test_noise_below_the_tolerance_is_equal_and_above_it_different(finished: Path, copy: Store) -> None:
    change(copy, "period", 3, lambda value: value * (1.0 + 1e-8))
    quiet = of_branch(finished, copy)
    assert verdicts(quiet) == {"period": Verdict.EQUAL}
    assert quiet.verdict is Verdict.EQUAL
    change(copy, "orbit", (17, 2, 5), 999.0)
    loud = of_branch(finished, copy)
    (orbit,) = [array for array in loud.arrays if array.array == "orbit"]
    assert (orbit.verdict, orbit.place) == (Verdict.DIFFERENT, (17, 2, 5))
    assert loud.verdict is Verdict.DIFFERENT


def test_flags_and_counts_are_exact_and_a_number_against_none_is_infinitely_far(
    finished: Path, copy: Store
) -> None:
    change(copy, "multiplier_count", 4, lambda value: value + 1)
    change(copy, "arclength", 2, np.nan)
    group = of_branch(finished, copy)
    assert verdicts(group) == {"multiplier_count": Verdict.DIFFERENT, "arclength": Verdict.DIFFERENT}
    (arclength,) = [array for array in group.arrays if array.array == "arclength"]
    assert arclength.difference == np.inf
    assert arclength.reason.endswith("/ nan")


def test_residuals_are_told_and_do_not_count(finished: Path, copy: Store) -> None:
    change(copy, "event_residual", 0, 1e-3)
    group = of_branch(finished, copy)
    assert verdicts(group) == {"event_residual": Verdict.DIFFERENT}
    assert group.verdict is Verdict.EQUAL


def test_bifurcations_are_matched_by_kind_and_place_whatever_their_order(finished: Path, copy: Store) -> None:
    count = read_group_metadata(finished, GROUP).attributes["n_events"]
    names = [name for name in read_group_metadata(finished, GROUP).arrays if name.startswith("event_")]
    for name in names:
        change(copy, name, slice(0, count), lambda values: values[::-1])
    change(copy, "event_speed", 0, lambda value: value + 1e-3)  # was the last one
    group = of_branch(finished, copy)
    assert group.unmatched == ()
    (moved,) = [match for match in group.matches if match.distance > 0.0]
    assert moved.differences["speed"] == pytest.approx(1e-3)
    assert moved.differences["displacement"] == 0.0


def test_a_bifurcation_of_another_kind_is_matched_with_none(finished: Path, copy: Store) -> None:
    change(copy, "event_kind", 0, 4)
    group = of_branch(finished, copy)
    assert [
        line for line in group.unmatched if line.startswith("neutral_saddle, event 0, only in the second")
    ]
    assert len(group.unmatched) == 2
    assert group.verdict is Verdict.DIFFERENT


def test_more_points_groups_and_attributes_in_one_store(finished: Path, tmp_path: Path) -> None:
    compute(tmp_path / "longer", 24, FULL, durable=False)
    longer = open_for_writing(tmp_path / "longer", durable=False)
    write_group(longer, "cases/synthetic/machine", "machine", {"node_position": [0.0, 1.0]})
    write_group(longer, CRITICALS, "criticals", {"critical_speed": [0.5, 1.25]}, {"note": "another"})
    compared = compare_stores(open_for_reading(finished), longer, TOLERANCE)
    assert not compared.are_equal
    assert (compared.only_first, compared.only_second) == ((), ("cases/synthetic/machine",))
    told = {group.group: group for group in compared.groups}
    assert told[CRITICALS].attributes == ("note: none / another",)
    speed = next(array for array in told[GROUP].arrays if array.array == "speed")
    assert (speed.difference, speed.reason) == (None, "shape (20,) / (24,)")


def test_cases_of_one_store_only_are_told_once(finished: Path, tmp_path: Path) -> None:
    compared = compare_stores(
        open_for_reading(finished), make_store(tmp_path / "other", parts=("machine",)), TOLERANCE
    )
    assert compared.only_first == ("cases/synthetic",)
    assert compared.only_second == ("cases/kb10",)
    assert not compared.are_equal


def ellipse(height: float, points: int, start: float = 0.0) -> BifurcationCurve:
    rows = curve_rows(oval(1.0, 1.0, 0.5, height), (start, start + 2.0 * np.pi), points)
    attributes = {"parameters": ["excitation_frequency", "speed"], "bifurcation": "period_doubling"}
    curve = read_curve("pd/c000", rows, attributes)
    assert curve is not None
    return curve


def test_the_same_curve_with_other_points_is_no_distance_apart() -> None:
    distances = []
    for points in (25, 49, 97):
        found = curve_distance(ellipse(0.3, points), ellipse(0.3, 2 * points, start=0.4))
        assert found is not None
        distances.append(found.distance)
    orders = np.log2(np.array(distances[:-1]) / distances[1:])
    assert np.all(orders > 3.7), "what is left is the cubics' error, of fourth order"
    assert distances[-1] < 1e-6


def test_the_distance_of_two_curves_and_where_it_is_largest() -> None:
    found = curve_distance(ellipse(0.3, 97), ellipse(0.31, 97))
    assert found is not None
    # 0.01 at the top, over the largest speed of both curves
    assert found.distance == pytest.approx(0.01 / 1.31, rel=1e-4)
    assert found.place["excitation_frequency"] == pytest.approx(1.0, abs=1e-6)
    assert abs(found.place["speed"] - 1.0) == pytest.approx(0.3, abs=0.011)


def test_a_part_of_a_curve_is_as_far_apart_as_the_missing_end() -> None:
    half = curve_rows(oval(1.0, 1.0, 0.5, 0.3), (0.0, np.pi), 49)
    attributes = {"parameters": ["excitation_frequency", "speed"], "bifurcation": "period_doubling"}
    found = curve_distance(ellipse(0.3, 97), read_curve("pd/c000", half, attributes))
    assert found is not None
    assert found.distance > 0.2


@pytest.mark.parametrize(("height", "same"), [(0.3, True), (0.3001, False)])
def test_a_curve_with_other_rows_is_judged_by_its_geometry(tmp_path: Path, height: float, same: bool) -> None:
    stores = []
    for number, (tall, points) in enumerate(((0.3, 30), (height, 41))):
        store = empty_store(tmp_path / f"{number}.zarr", "a")
        rows = curve_rows(oval(1.0, 1.0, 0.5, tall), (0.0, 5.0), points)
        special = (("R2", 1.5, 1.0),)
        write_curve(store, "cases/a/pd/c000", "period_doubling", rows, specials=special)
        stores.append(store)
    (group,) = compare_stores(*stores, 1e-5).groups
    assert group.curve is not None
    assert len(group.matches) == 1
    assert (group.verdict is not Verdict.DIFFERENT) is same


def test_arrays_without_elements_and_of_zeros_are_compared() -> None:
    assert compare_arrays("a", np.zeros((0, 3)), np.zeros((0, 3)), 0.0).verdict is Verdict.IDENTICAL
    assert compare_arrays("a", np.zeros(3), np.array([0.0, -0.0, 0.0]), 0.0).verdict is Verdict.IDENTICAL
    assert compare_arrays("a", np.zeros(2), np.array([0.0, 1e-3]), 0.1).difference == 1.0
