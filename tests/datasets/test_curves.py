"""Curves between their rows: the order of the cubic, where a parameter has a value, what holds in between."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.datasets.curves import BifurcationCurve, read_curve
from tests.helpers.curves import curve_rows, oval

PARAMETERS = {"parameters": ["excitation_frequency", "speed"], "bifurcation": "period_doubling"}
CIRCLE = oval(1.0, 1.0, 0.5, 0.5)


def circle(points: int = 25, **changed: object) -> BifurcationCurve:
    rows = curve_rows(CIRCLE, (0.0, 2.0 * np.pi), points)
    rows["criticality"] = np.full(points, "supercritical")
    curve = read_curve("pd/c000", rows | changed, {**PARAMETERS, "stop_reason": "closed"})
    assert curve is not None
    return curve


def test_the_cubic_is_of_fourth_order() -> None:
    errors = []
    for points in (9, 17, 33, 65):
        curve = circle(points)
        between = 0.5 * (curve.arclength[1:] + curve.arclength[:-1])
        errors.append(np.abs(np.hypot(*(curve.at(between) - 1.0).T) - 0.5).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.8)  # h^4 with the next term h^6


def test_a_value_is_met_at_rows_between_rows_and_where_the_curve_closes() -> None:
    curve = circle()
    turn = np.pi  # length of the circle of radius 1/2
    for angle in (np.pi / 6, 0.5, np.pi / 2):  # row 2, between rows, row 6
        found = curve.where(0, 1.0 + 0.5 * np.cos(angle))
        np.testing.assert_allclose(
            found, turn * np.array([angle, 2 * np.pi - angle]) / (2 * np.pi), atol=2e-5
        )
    np.testing.assert_allclose(curve.where(0, 1.5), [0.0, turn], atol=1e-12)  # first row and last
    assert len(curve.where(0, 1.6)) == 0
    assert len(curve.where(1, 1.0)) == 3


def test_turning_points_and_extent() -> None:
    curve = circle()
    np.testing.assert_allclose(curve.extrema[1], [0.25 * np.pi, 0.75 * np.pi], atol=1e-12)
    np.testing.assert_allclose(curve.extent, [[0.5, 0.5], [1.5, 1.5]], atol=1e-12)


def test_the_extent_holds_what_lies_beyond_the_rows() -> None:
    _, largest = circle(8).extent  # no row at the top
    assert largest[1] == pytest.approx(1.5, abs=1e-3)
    assert largest[1] > circle(8).points[:, 1].max() + 0.01


def test_a_number_changes_at_the_special_point_that_tells_where() -> None:
    count = np.where(np.arange(25) < 10, 0, 2)
    place = CIRCLE(np.array([9.25 * np.pi / 12]))[0].real
    event = {
        "event_after_point": np.array([9]),
        "event_excitation_frequency": place[:1],
        "event_speed": place[1:],
    }
    curve = circle(unstable_count=count, **event)
    there = 9.25 * np.pi / 24
    assert curve.special == pytest.approx([there], rel=1e-3)
    assert curve.unstable_at(there - 0.01) == 0
    assert curve.unstable_at(there + 0.01) == 2
    assert circle(unstable_count=count).unstable_at(there + 0.01) == 0  # else the smaller number


def test_the_type_is_unknown_between_rows_that_differ() -> None:
    kinds = np.where(np.arange(25) < 10, "subcritical", "supercritical")
    curve = circle(criticality=kinds)
    middle = 0.5 * (curve.arclength[1:] + curve.arclength[:-1])
    assert [curve.criticality_at(place) for place in middle[8:11]] == [
        "subcritical",
        "unset",
        "supercritical",
    ]


def test_without_tangents_differences_take_their_place() -> None:
    rows = curve_rows(CIRCLE, (0.0, 2.0 * np.pi), 65)
    bare = {name: rows[name] for name in ("excitation_frequency", "speed")}
    curve = read_curve("pd/c000", bare, PARAMETERS)
    assert curve is not None
    between = 0.5 * (curve.arclength[1:] + curve.arclength[:-1])
    assert (
        np.abs(np.hypot(*(curve.at(between) - 1.0).T) - 0.5).max() < 2e-3
    )  # second order, at the ends first
    assert not curve.is_complete
    assert curve.unstable_at(0.1) == -1
    assert curve.criticality_at(0.1) == "unset"


@pytest.mark.parametrize("points", [0, 1])
def test_a_curve_needs_two_points(points: int) -> None:
    rows = {name: values[:points] for name, values in curve_rows(CIRCLE, (0.0, 1.0), 5).items()}
    assert read_curve("pd/c000", rows, PARAMETERS) is None
