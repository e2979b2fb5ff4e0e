"""Margins of an operating point against distances in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.datasets.case_table import case_table
from pipelines.datasets.curves import BifurcationCurve, read_curve
from pipelines.datasets.store import Store, create_store
from pipelines.stages.reports.first_boundary import SpeedPlane
from pipelines.stages.reports.margin import Margin, margin_of
from pipelines.stages.reports.operating_range import operating_range, write_operating_range
from tests.helpers.curves import SCALES, curve_rows, oval, write_curve, write_cycles, write_set

FREQUENCIES, SPEEDS = (0.2, 2.0), (0.25, 1.4)
POINT = (1.0, 0.5)
CENTRE, RADIUS = (1.3, 0.9), 0.2
STABLE, UNSTABLE = (0.2, 0.25, 0), (1.3, 0.9, 1)
KIND = {"pd": "period_doubling", "ns": "neimark_sacker", "folds": "fold"}


def curve(name: str, rows: dict[str, Any], **more: Any) -> BifurcationCurve:
    attributes = {"parameters": ["excitation_frequency", "speed"], "bifurcation": KIND[name.split("/")[0]],
                  "stop_reason": "range", **more}  # fmt: skip
    rows["criticality"] = np.full(len(rows["speed"]), "supercritical")
    made = read_curve(name, rows, attributes)
    assert made is not None
    return made


def ellipse(points: int, turned: float) -> BifurcationCurve:
    """Where the relative distance from POINT to CENTRE is less by RADIUS: a circle in these coordinates.

    ``turned``: position of its rows, over the angle between two of them.
    """
    begin = turned * 2.0 * np.pi / (points - 1)
    path = oval(*CENTRE, RADIUS * POINT[0], RADIUS * POINT[1])
    return curve("pd/c000", curve_rows(path, (begin, begin + 2.0 * np.pi), points))


def line() -> BifurcationCurve:
    return curve("ns/c000", curve_rows(lambda f: np.column_stack([f, 1.2 - 0.2 * f]), (0.2, 2.0), 4))


def margin(
    *curves: BifurcationCurve,
    point: tuple[float | None, float] = POINT,
    sample: tuple[float, float, int] = STABLE,
) -> Margin | None:
    plane = SpeedPlane(
        curves, 0, FREQUENCIES, SPEEDS, np.array([sample[:2]]), np.array([sample[2]], dtype=np.int64)
    )
    return margin_of(plane, "excitation_frequency", {"excitation_frequency": point[0], "speed": point[1]})


def test_the_nearest_point_converges_with_the_order_of_the_cubics() -> None:
    exact = np.hypot(CENTRE[0] / POINT[0] - 1.0, CENTRE[1] / POINT[1] - 1.0) - RADIUS
    errors = []
    for points in (13, 25, 49, 97):
        distances = []
        for turned in np.arange(8) / 8.0:  # the error vanishes at rows
            found = margin(ellipse(points, turned))
            assert found is not None
            assert found.nearest is not None
            distances.append(found.nearest.distance)
            away = np.array([found.nearest.abscissa, found.nearest.speed]) / POINT - 1.0
            assert np.hypot(*away) == pytest.approx(found.nearest.distance, abs=1e-14)
        errors.append(np.abs(np.array(distances) - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.8), errors
    assert errors[-1] < 1e-7


def test_the_nearest_point_of_a_line_is_exact_wherever_its_rows_are() -> None:
    """u = x - 1, v = y / 0.5 - 1: the line v = 1 - 0.4 u is 1 / sqrt(1.16) away."""
    found = margin(line())
    assert found is not None
    assert found.nearest is not None
    assert found.nearest.distance == pytest.approx(1.0 / np.sqrt(1.16), abs=1e-12)
    foot = 0.4 / 1.16
    assert (found.nearest.abscissa, found.nearest.speed) == pytest.approx(
        (1.0 + foot, 0.5 * (2.0 - 0.4 * foot)), abs=1e-12
    )
    assert found.nearest.bifurcation == "neimark_sacker"
    assert found.nearest.criticality == "supercritical"


def test_distances_along_one_parameter() -> None:
    circle = curve("pd/c000", curve_rows(oval(1.0, 0.8, 0.4, 0.1), (0.0, 2.0 * np.pi), 257))
    found = margin(line(), circle, point=(1.2, 0.75))
    assert found is not None
    root = np.sqrt(0.75) / 10.0  # half the height of the oval at 1.2
    assert found.base == "unstable", "between both branches of the oval, from a stable cycle below it"
    assert found.higher_speed is not None
    assert found.lower_speed is not None
    assert found.higher_speed.distance == pytest.approx(0.8 + root - 0.75, abs=1e-7)
    assert found.lower_speed.distance == pytest.approx(0.75 - 0.8 + root, abs=1e-7)
    assert found.in_speed == found.lower_speed
    across = 0.4 * np.sqrt(0.75)  # half the width at 0.75
    assert found.higher_abscissa is not None
    assert found.lower_abscissa is not None
    assert found.higher_abscissa.distance == pytest.approx(across - 0.2, abs=1e-7)
    assert found.lower_abscissa.distance == pytest.approx(across + 0.2, abs=1e-7)
    assert found.in_abscissa == found.higher_abscissa
    assert found.as_dict()["excitation_frequency_distance"] == found.higher_abscissa.distance


def test_a_point_on_a_curve_has_no_margin_left() -> None:
    found = margin(line(), point=(1.0, 1.0))
    assert found is not None
    assert found.in_speed is not None
    assert found.nearest is not None
    assert found.in_speed.distance == pytest.approx(0.0, abs=1e-12)
    assert found.nearest.distance == pytest.approx(0.0, abs=1e-12)


def test_parts_that_bound_no_stable_cycle_do_not_count() -> None:
    """The left half of the line is of unstable cycles: the nearest point that counts is its end."""
    rows = curve_rows(lambda f: np.column_stack([f, 1.2 - 0.2 * f]), (0.2, 2.0), 10)
    rows["unstable_count"] = np.where(rows["excitation_frequency"] < 1.5, 2, 0)
    found = margin(curve("ns/c000", rows))
    assert found is not None
    assert found.nearest is not None
    first = rows["excitation_frequency"][rows["unstable_count"] == 0][0]
    step = rows["excitation_frequency"][1] - rows["excitation_frequency"][0]
    assert first - step <= found.nearest.abscissa <= first
    assert found.higher_speed is None, "the line has two unstable multipliers there"
    assert margin(curve("ns/c000", rows | {"unstable_count": np.full(10, 2)})).nearest is None  # type: ignore[union-attr]


@pytest.mark.parametrize("point", [(None, 0.5), (2.1, 0.5), (1.0, 0.2)])
def test_outside_the_plane_there_is_none(point: tuple[float | None, float]) -> None:
    assert margin(line(), point=point) is None


def test_nothing_met_and_nothing_known() -> None:
    found = margin(sample=(0.2, 0.25, 1))
    assert found is not None
    assert (found.base, found.nearest, found.in_speed) == ("unstable", None, None)
    assert found.as_dict()["relative_distance"] is None
    plane = SpeedPlane((), 0, FREQUENCIES, SPEEDS, np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
    unknown = margin_of(plane, "excitation_frequency", {"excitation_frequency": 1.0, "speed": 0.5})
    assert unknown is not None
    assert unknown.base == "unset"


def test_a_displacement_of_zero_is_measured_by_the_width_of_the_plane() -> None:
    path = curve_rows(lambda a: np.column_stack([0.3 + 0.0 * a, a]), (0.3, 1.3), 5)
    plane = SpeedPlane((curve("ns/c000", path),), 0, (0.0, 0.6), SPEEDS, np.zeros((0, 2)), np.zeros(0, int))
    found = margin_of(plane, "displacement", {"displacement": 0.0, "speed": 0.5})
    assert found is not None
    assert found.nearest is not None
    assert found.nearest.distance == pytest.approx(0.5, abs=1e-12)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    own = {"excitation_frequency": POINT[0], "speed": POINT[1]}
    case = {"name": "a", "parameters": own, "scales": SCALES, "reconstruction": ""}
    made = create_store(
        tmp_path / "a.zarr", {"a": case}, {"configuration": {}, "configuration_hash": "0"}, durable=False
    )
    write_set(made, "a")
    write_cycles(made, "cases/a/cycles/s000", "excitation_frequency", np.array([0.2, 0.21]), 0.25, 0)
    rows = curve_rows(lambda f: np.column_stack([f, 1.2 - 0.2 * f]), (0.2, 2.0), 4)
    write_curve(made, "cases/a/ns/c000", "neimark_sacker", rows)
    return made


def test_it_is_stored_with_the_range_and_shown_in_the_table(store: Store) -> None:
    found = operating_range(store, "a")
    assert found.margin is not None
    write_operating_range(store, "a", found)
    table = {column.name: column.values[0] for column in case_table(store, ["a"]).outputs}
    assert table["operating_point"] == "stable"
    assert table["margin_speed"] == pytest.approx(0.5)
    assert table["margin_speed_rpm"] == pytest.approx(0.5 * 60.0 / (2.0 * np.pi * SCALES["time"]))
    assert table["margin_relative"] == pytest.approx(1.0 / np.sqrt(1.16))
    assert table["margin_bifurcation"] == "neimark_sacker"
    assert "margin_excitation_frequency" not in table, "no curve is met along the frequency"


def test_the_margin_of_an_unstable_point_is_negative_in_the_table(store: Store) -> None:
    """Along a series of machines it then passes zero where the operating point loses its stability."""
    write_cycles(store, "cases/a/cycles/s001", "speed", POINT[0], np.array([0.48, 0.52]), 2)
    found = operating_range(store, "a")
    assert found.margin is not None
    assert found.margin.base == "unstable"
    assert found.margin.as_dict()["speed_distance"] == pytest.approx(0.5)
    write_operating_range(store, "a", found)
    table = {column.name: column.values[0] for column in case_table(store, ["a"]).outputs}
    assert table["operating_point"] == "unstable"
    assert table["margin_speed"] == pytest.approx(-0.5)
    assert table["margin_relative"] == pytest.approx(-1.0 / np.sqrt(1.16))
