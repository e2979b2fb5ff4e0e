"""The operating range against curves whose crossings are known in closed form."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.datasets.curves import BifurcationCurve, read_curve
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store
from pipelines.stages.reports import operating_range as stage
from pipelines.stages.reports.first_boundary import SpeedPlane
from pipelines.stages.reports.operating_range import (
    NoSetError,
    OperatingRange,
    operating_range,
    range_over,
    write_operating_range,
)
from tests.helpers.curves import curve_rows, empty_store, oval, write_curve, write_cycles, write_set

CASE = "cases/a"
CENTRE, WIDTH, HEIGHT = (1.2, 0.7), 0.25, 0.3  # of an oval of period doublings


def sloping(f: np.ndarray) -> np.ndarray:
    """A straight line of Neimark-Sacker points."""
    return np.column_stack([f, 0.9 + 0.1 * f])


def bump(f: np.ndarray) -> np.ndarray:
    """Neimark-Sacker points that reach 1.2 at 0.61, which is between rows and off the grid."""
    return np.column_stack([f, 1.2 - 0.3 * (f - 0.61) ** 2])


def lower_half(f: np.ndarray) -> np.ndarray:
    inside = np.clip(1.0 - ((f - CENTRE[0]) / WIDTH) ** 2, 0.0, None)
    return np.where(inside > 0.0, CENTRE[1] - HEIGHT * np.sqrt(inside), np.inf)


FREQUENCIES, SPEEDS = (0.2, 2.0), (0.25, 1.4)
PASSIVE = 1.05
STABLE_CORNER = (0.2, 0.25, 0)  # a stored cycle at the lowest frequency and speed
KIND = {"pd": "period_doubling", "ns": "neimark_sacker", "folds": "fold"}

Path2 = Callable[..., Any]


def curve(
    name: str, path: Path2, ends: tuple[float, float], points: int = 40, **more: Any
) -> BifurcationCurve:
    """A supercritical curve of the kind that its name says; ``unstable``: multipliers outside beside the
    critical ones; ``specials``: frequencies of points of codimension two at speed 0.6.
    """
    specials = np.array(more.pop("specials", ()))
    rows = curve_rows(path, ends, points)
    rows["unstable_count"] = np.broadcast_to(more.pop("unstable", 0), (points,))
    rows["criticality"] = np.full(points, "supercritical")
    attributes = {"parameters": ["excitation_frequency", "speed"], "bifurcation": KIND[name.split("/")[0]],
                  "stop_reason": "range", **more}  # fmt: skip
    before = rows["excitation_frequency"][:, None] < specials
    rows["event_after_point"] = np.argmax(before[:-1] & ~before[1:] | ~before[:-1] & before[1:], axis=0)
    rows["event_excitation_frequency"], rows["event_speed"] = specials, np.full(len(specials), 0.6)
    made = read_curve(name, rows, attributes)
    assert made is not None
    return made


def oval_of(points: int = 60, **more: Any) -> BifurcationCurve:
    return curve("pd/c000", oval(*CENTRE, WIDTH, HEIGHT), (0.0, 2.0 * np.pi), points, **more)


def ranged(
    *curves: BifurcationCurve,
    samples: tuple[tuple[float, float, int], ...] = (STABLE_CORNER,),
    frequencies: tuple[float, float] = FREQUENCIES,
) -> OperatingRange:
    """The operating range of a plane with these curves and stored cycles (frequency, speed, unstable)."""
    known = np.array(samples).reshape(-1, 3)
    plane = SpeedPlane(curves, 0, frequencies, SPEEDS, known[:, :2], known[:, 2].astype(np.int64))
    return range_over(plane, "excitation_frequency", PASSIVE)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A searched plane, stable at its lowest speed, with a sloping line of Neimark-Sacker points."""
    made = empty_store(tmp_path / "a.zarr", "a")
    write_set(made, "a")
    write_cycles(made, f"{CASE}/cycles/s000", "excitation_frequency", np.array([0.2, 0.21]), 0.25, 0)
    rows = curve_rows(sloping, (0.2, 2.0), 4)
    write_curve(made, f"{CASE}/ns/c000", "neimark_sacker", rows)
    return made


def boundary(found: OperatingRange) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.array([each.abscissa for each in found.boundaries]),
        np.array([each.speed for each in found.boundaries]),
    )


def test_oval_and_line_match_the_closed_form_to_the_order_of_the_cubics() -> None:
    errors, tips = [], []
    for points in (17, 33, 65, 129):
        abscissa, speed = boundary(ranged(curve("ns/c000", sloping, (0.2, 2.0), 5), oval_of(points)))
        exact = np.minimum(lower_half(abscissa), sloping(abscissa)[:, 1])
        # beside the tips the speed of a crossing has the error's square root
        inside = np.abs(np.abs(abscissa - CENTRE[0]) - WIDTH) > 0.1 * WIDTH
        errors.append(np.abs(speed - exact)[inside].max())
        jumps = abscissa[1:][np.abs(np.diff(speed)) > 0.1]
        tips.append(np.abs(jumps - [CENTRE[0] - WIDTH, CENTRE[0] + WIDTH]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7)  # fourth; the next term still shows on the coarsest
    assert errors[-1] < 1e-7
    assert max(tips) < 1e-8  # rows lie on the tips: found to the resolution


def test_what_lies_above_the_first_boundary_does_not_matter() -> None:
    line, tongue_above = curve("ns/c000", sloping, (0.2, 2.0)), oval(0.6, 1.15, 0.1, 0.1)
    above = curve("pd/c001", tongue_above, (0.0, 6.0), stop_reason="minimum_step")
    found = ranged(line, oval_of(), above)
    parts = found.stretches()
    assert [part.first.bifurcation for part in parts] == [
        "neimark_sacker",
        "period_doubling",
        "neimark_sacker",
    ]
    assert {part.criticalities for part in parts} == {("supercritical",)}
    assert [part.first.base for part in parts] == ["stable"] * 3
    assert parts[1].lowest == pytest.approx(CENTRE[1] - HEIGHT, abs=1e-6)
    assert found.curves[parts[1].first.curve] == "pd/c000"
    assert not any(found.caution)
    assert found.cautions == ()


def test_unstable_cycles_bound_nothing() -> None:
    assert all(each.is_open for each in ranged(oval_of(unstable=2)).boundaries)


def test_the_best_frequency_is_found_between_rows_and_grid() -> None:
    found = ranged(curve("ns/c000", bump, (0.2, 2.0), 30))
    assert found.best is not None
    # a parabola is a cubic of its abscissa, and the arclength nearly one where the slope is small
    assert found.best.boundary.abscissa == pytest.approx(0.61, abs=1e-4)
    assert found.best.boundary.speed == pytest.approx(1.2, abs=1e-7)
    reach = np.sqrt((1.2 - PASSIVE) / 0.3)  # where it falls to the speed of the passive machine
    assert found.best.interval == pytest.approx((0.2, 0.61 + reach), abs=1e-5)
    assert found.passive_gain == pytest.approx(1.2 / PASSIVE - 1.0, abs=1e-6)
    assert found.reference is not None
    assert found.reference.abscissa == 0.2
    assert found.reference_gain == pytest.approx(1.2 / (1.2 - 0.3 * 0.41**2) - 1.0, abs=1e-6)


def test_two_curves_that_cross_take_over_from_each_other() -> None:
    found = ranged(
        curve("ns/c000", lambda f: np.column_stack([f, 0.6 + 0.3 * f]), (0.2, 2.0)),
        curve("pd/c000", lambda f: np.column_stack([f, 1.3 - 0.4 * f]), (0.2, 2.0)),
    )
    assert [part.first.bifurcation for part in found.stretches()] == ["neimark_sacker", "period_doubling"]
    assert found.best is not None
    assert found.best.boundary.abscissa == pytest.approx(1.0, abs=1e-8)
    assert found.best.boundary.speed == pytest.approx(0.9, abs=1e-8)


@pytest.mark.parametrize("gap", [1e-8, 8e-4])
def test_curves_that_meet_in_one_point_leave_no_gap(gap: float) -> None:
    """To which a resonance is located, and of which coarse time steps leave it."""
    found = ranged(curve("ns/c000", sloping, (0.2, 1.1 - gap)), curve("pd/c000", sloping, (1.1 + gap, 2.0)))
    assert [part.first.bifurcation for part in found.stretches()] == ["neimark_sacker", "period_doubling"]


def test_a_narrow_tongue_is_a_boundary() -> None:
    """Of the same width as a gap that is none."""
    needle = curve("pd/c000", oval(1.1, 0.6, 8e-4, 0.2), (0.0, 2.0 * np.pi), 60)
    parts = ranged(curve("ns/c000", sloping, (0.2, 2.0)), needle).stretches()
    assert [part.first.bifurcation for part in parts] == [
        "neimark_sacker",
        "period_doubling",
        "neimark_sacker",
    ]


HALF = float(np.sqrt(0.7 / 0.8))  # of the tongue at the bottom of the plane


def tongue(a: np.ndarray) -> np.ndarray:
    """Period doublings around 1.2, up to 0.9, open at the bottom of the plane."""
    return np.column_stack([1.2 + 0.25 * a, 0.9 - 0.8 * a**2])


def test_a_tongue_at_the_lowest_speed_leaves_no_range() -> None:
    """Its upper end is a bifurcation too, but of an unstable cycle."""
    walls = curve("pd/c000", tongue, (-HALF, HALF))
    parts = ranged(walls).stretches()
    assert [part.first.base for part in parts] == ["stable", "unstable", "stable"]
    half = 0.25 * np.sqrt(0.65 / 0.8)  # at the lowest speed 0.25
    assert (parts[1].first.abscissa, parts[1].last.abscissa) == pytest.approx(
        (1.2 - half, 1.2 + half), abs=1e-5
    )
    assert parts[1].highest == 0.25
    assert parts[0].first.is_open


def test_where_no_stored_cycle_tells_the_lowest_speed_is_taken_as_stable() -> None:
    found = ranged(curve("pd/c000", tongue, (-HALF, HALF)), samples=())
    assert {each.base for each in found.boundaries} == {"unset"}
    assert found.stretches()[1].highest == pytest.approx(0.9, abs=1e-5)
    assert any("assumed stable" in caution for caution in found.cautions)


def level(f: np.ndarray) -> np.ndarray:
    return np.column_stack([f, 0.6 + 0.0 * f])


def test_stability_is_carried_through_curves_from_any_stored_cycle() -> None:
    """From one cycle above a Neimark-Sacker line and inside a tongue, with 2 + 1 unstable multipliers."""
    frequency, speed = np.linspace(0.2, 2.0, 41), tongue(np.linspace(-HALF, HALF, 41))[:, 1]
    meet = 1.2 + np.array([-0.25, 0.25]) * np.sqrt(0.3 / 0.8)  # PD-NS
    # inside the tongue the line belongs to a cycle with one multiplier outside, and above the line the walls
    # of the tongue to one with two
    line = curve(
        "ns/c000",
        level,
        (0.2, 2.0),
        41,
        unstable=np.where((frequency > meet[0]) & (frequency < meet[1]), 1, 0),
        specials=meet,
    )
    walls = curve("pd/c000", tongue, (-HALF, HALF), 41, unstable=np.where(speed > 0.6, 2, 0), specials=meet)
    parts = ranged(line, walls, samples=((1.2, 0.8, 3),)).stretches()
    assert [part.first.base for part in parts] == ["stable", "unstable", "stable"]
    assert parts[0].highest == pytest.approx(0.6, abs=1e-9)
    # a number that cannot belong to the cycle at that place is no evidence
    assert {each.base for each in ranged(line, walls, samples=((1.2, 0.8, 7),)).boundaries} == {"unset"}


def test_where_nothing_bounds_the_range_it_is_open() -> None:
    found = ranged(curve("ns/c000", sloping, (0.2, 0.8)))
    opened = found.stretches()[-1]
    assert opened.first.is_open
    assert (opened.first.abscissa, opened.last.abscissa) == pytest.approx((0.8, 2.0), abs=1e-6)
    assert opened.highest == 1.4
    assert found.best is not None
    assert found.best.boundary.is_open
    assert found.best.interval == pytest.approx((0.8, 2.0), abs=1e-6)
    assert found.best.boundary.abscissa == pytest.approx(1.4, abs=0.01)


def test_every_frequency_unstable_has_no_best() -> None:
    found = ranged(samples=((0.2, 0.25, 2),))
    assert found.best is None
    assert found.passive_gain is None
    assert found.attributes()["best"] is None


@pytest.mark.parametrize(("speed", "concerned"), [(0.7, True), (1.3, False)])
def test_an_incomplete_curve_is_a_caution_only_below_the_boundary(speed: float, concerned: bool) -> None:
    loose = curve(
        "ns/c001", lambda f: np.column_stack([f, speed + 0.0 * f]), (0.5, 0.6), stop_reason="minimum_step"
    )
    found = ranged(curve("ns/c000", sloping, (0.2, 2.0)), loose)
    assert any("ns/c001 stopped (minimum step)" in caution for caution in found.cautions) is concerned
    near = np.abs(boundary(found)[0] - 0.6) <= 0.05 * 1.8
    np.testing.assert_array_equal(found.caution, near & concerned)


def test_the_reference_is_the_lowest_frequency_of_a_plane_above_it() -> None:
    found = ranged(curve("ns/c000", sloping, (0.5, 2.0)), samples=((0.5, 0.25, 0),), frequencies=(0.5, 2.0))
    assert found.reference is not None
    assert found.reference.abscissa == 0.5
    assert found.reference.speed == pytest.approx(0.95)


def test_an_open_reference_has_no_gain() -> None:
    assert ranged(curve("ns/c000", sloping, (0.6, 2.0))).reference_gain is None


def test_other_planes_doubled_cycles_and_other_branches_are_left_alone(store: Store) -> None:
    rows = curve_rows(oval(0.5, 0.5, 0.05, 0.1), (0.0, 6.0), 5)
    write_curve(store, f"{CASE}/pd/c000", "period_doubling", rows, parameters=["displacement", "speed"])
    write_curve(store, f"{CASE}/pd/c001", "period_doubling", rows, turns=2)
    write_cycles(store, f"{CASE}/cycles/b000", "displacement", 0.7, np.full(2, 0.26), 5)
    write_cycles(store, f"{CASE}/cycles/d000", "speed", 0.7, np.linspace(0.25, 0.3, 2), 5, turns=2)
    found = operating_range(store, "a")
    assert found.curves == ("ns/c000",)
    assert {each.base for each in found.boundaries} == {"stable"}
    assert found.speeds == (0.25, 1.4)


def test_a_plane_without_speed_or_without_anything_has_no_range(tmp_path: Path) -> None:
    store = empty_store(tmp_path / "a.zarr", "a", "b")
    with pytest.raises(NoSetError):
        operating_range(store, "b")
    write_set(store, "a", parameters=["excitation_frequency", "displacement"])
    with pytest.raises(NoSetError, match="over the rotating speed"):
        operating_range(store, "a")


def test_curves_without_a_search_are_reported_with_a_caution(tmp_path: Path) -> None:
    store = empty_store(tmp_path / "a.zarr", "a")
    write_curve(store, f"{CASE}/ns/c000", "neimark_sacker", curve_rows(sloping, (0.2, 2.0), 4))
    found = operating_range(store, "a")
    assert found.speeds == (0.2, 1.4)
    assert found.passive is None
    assert "was not searched" in found.cautions[0]


def test_it_is_written_as_data_and_replaced(store: Store) -> None:
    first = operating_range(store, "a")
    assert write_operating_range(store, "a", first)
    rows = curve_rows(oval(*CENTRE, WIDTH, HEIGHT), (0.0, 2.0 * np.pi), 13)
    write_curve(store, f"{CASE}/pd/c000", "period_doubling", rows, "closed")
    second = operating_range(store, "a")
    assert write_operating_range(store, "a", second)
    group = read_group(store, f"{CASE}/operating_range")
    abscissa, speed = boundary(second)
    np.testing.assert_array_equal(group["abscissa"], abscissa)
    np.testing.assert_array_equal(group["speed"], speed)
    assert set(group.labels("bifurcation")) == {"neimark_sacker", "period_doubling"}
    assert set(group.labels("criticality")) == {"supercritical"}
    assert set(group.labels("base")) == {"stable"}
    np.testing.assert_allclose(group["angle"], 2.0)
    kinds = np.array(group.attributes["curves"])[group["curve"]]
    np.testing.assert_array_equal(kinds == "pd/c000", group.labels("bifurcation") == "period_doubling")
    assert group.attributes["best"]["curve"] == "ns/c000"
    assert group.attributes["passive_gain"] == pytest.approx(1.1 / 1.05 - 1.0, abs=1e-9)
    # the curves are made up: the branches that they name are not there
    assert {finding.path.name for finding in verify(store)} <= {"c000"}


def test_the_range_does_not_depend_on_an_older_one(store: Store) -> None:
    first = operating_range(store, "a")
    write_operating_range(store, "a", first)
    assert operating_range(store, "a") == first


@pytest.mark.parametrize("code", [errno.EACCES, errno.EROFS])
def test_a_store_that_cannot_be_written_is_told(
    store: Store, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(code, "refused", str(store.path))

    monkeypatch.setattr(stage, "open_for_writing", refuse)
    assert not write_operating_range(store, "a", operating_range(store, "a"))


def test_a_full_disk_is_an_error(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "full", str(store.path))

    monkeypatch.setattr(stage, "write_group", refuse)
    with pytest.raises(OSError, match="full"):
        write_operating_range(store, "a", operating_range(store, "a"))
