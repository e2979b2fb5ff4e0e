"""The machine near 2/3 of its whirl frequency: period doublings around a tongue 3e-4 wide, on its limit."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.detection import EventKind
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.curves.bifurcation_set import plan_bifurcation_set
from pipelines.stages.curves.open_ends import caution, open_ends
from pipelines.stages.curves.parts import compute_curve, curve_parts
from pipelines.stages.curves.starts import StartQueue
from pipelines.stages.job import Job, Origin
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

PLANE = (
    'bearings.clipping="smooth"',  # without kinks
    "bearings.smoothing=0.03",
    "excitation.frequency=0.262",
    "continue_cycles.range=[0.85, 1.1]",
    "continue_cycles.start=0.85",
    "continue_cycles.maximum_step=0.1",
    "continue_cycles.step=0.05",
    "track_curves.ranges=[[0.255, 0.285], [0.85, 1.1]]",
    "track_curves.normal_forms=false",
    "track_curves.minimum_step=5e-4",  # longer than the tongue is wide
    "numerics.multiplier_tolerance=3e-4",
)
WIDE, MIDDLE, NARROW = (f"excitation.displacement={value}" for value in (0.2, 0.16, 0.05))
NAMES = ("excitation_frequency", "speed")


def group(path: Path, name: str) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/{name}")


def groups(path: Path, container: str) -> list[str]:
    found = (name.split("/", 2)[2] for name in list_groups(open_for_reading(path), "smoke"))
    return [name for name in found if name.startswith(f"{container}/")]


def traced(path: Path, displacement: str, *stages: str, more: tuple[str, ...] = ()) -> Path:
    for stage in stages:
        result = Watched(stage, tiny_case(*PLANE, displacement, *more), path).result
        assert result.ok, result.advice
    return path


@pytest.fixture(scope="module")
def limit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Neimark-Sacker curves of the window."""
    path = tmp_path_factory.mktemp("limit") / "a.zarr"
    return traced(path, WIDE, "continue_cycles", "track_ns")


@pytest.fixture(scope="module")
def whole(limit: Path) -> Path:
    """The same with the period doublings."""
    path = limit.with_name("whole.zarr")
    shutil.copytree(limit, path)
    return traced(path, WIDE, "track_pd")


def test_the_limit_goes_on_from_the_far_side(limit: Path) -> None:
    assert groups(limit, "ns") == ["ns/c000", "ns/c001", "ns/c002"]
    first, _, beyond = (group(limit, name) for name in groups(limit, "ns"))
    assert first.attributes["stop_reason"] == "resonance_2"
    assert first.labels("event_kind").tolist() == ["R2", "R2"]
    assert first.labels("event_tongue").tolist() == ["near_side", "far_side"]
    near, far = np.column_stack([first[f"event_{name}"] for name in NAMES])
    assert first["event_width"] == pytest.approx(np.linalg.norm(far - near))
    assert 2e-4 < first["event_width"][0] < 5e-4
    assert beyond.attributes["origin"] == {"group": "ns/c000", "event": 1}
    assert beyond.attributes["stop_reason"] == "range"
    assert beyond["excitation_frequency"][[0, -1]] == pytest.approx([far[0], 0.285], abs=1e-6)


def test_the_period_doublings_close_around_the_tongue(whole: Path) -> None:
    assert groups(whole, "pd") == ["pd/c000"]
    around, first = group(whole, "pd/c000"), group(whole, "ns/c000")
    assert around.attributes["stop_reason"] == "closed"
    assert set(around.labels("event_kind")) == {"R2"}
    width = first["event_width"][0]
    assert np.ptp(around["excitation_frequency"]) < 5.0 * width
    # half of it bounds stable cycles, and both halves meet at the two resonances
    assert set(around["unstable_count"]) == {0, 1}
    for side in range(2):
        there = [first[f"event_{name}"][side] for name in NAMES]
        told = np.column_stack([around[f"event_{name}"] for name in NAMES])
        assert np.min(np.linalg.norm(told - there, axis=1)) < 0.01 * width


def test_no_end_is_open_once_the_period_doublings_are_traced(limit: Path, whole: Path) -> None:
    store = open_for_reading(limit)
    ends = open_ends(store, "smoke")
    assert [(end.curve, end.bounds) for end in ends] == [("ns/c000", True), ("ns/c002", True)]
    assert all("R2" in end.reason and "track-pd" in end.reason for end in ends)
    assert caution(ends).startswith("2 boundaries of stable cycles end inside the plane")
    assert "ns/c000 at 0.274" in caution(ends)
    assert open_ends(open_for_reading(whole), "smoke") == []
    assert caution([]) == ""


def test_the_boundary_is_followed_whatever_kinds_are_asked_for(limit: Path) -> None:
    """The period doublings continue the limit: from the near side, with the width of the tongue."""
    at = Job.of("test", tiny_case(*PLANE, WIDE), limit, lambda progress: None, lambda: False)
    kinds = (EventKind.NEIMARK_SACKER,)
    assert StartQueue(at, kinds).next() is None
    others = (EventKind.PERIOD_DOUBLING, EventKind.FOLD)
    (pending,) = StartQueue(at, kinds, boundaries=True, continued=others).pending()
    assert pending.start.problem.kind is EventKind.PERIOD_DOUBLING
    assert pending.start.origin == Origin("ns/c000", 0)
    assert pending.start.guess.width == group(limit, "ns/c000")["event_width"][0]


@pytest.mark.parametrize("goes_on", [True, False])
def test_whether_a_search_continues_boundaries_is_its_choice(limit: Path, goes_on: bool) -> None:
    words = ('bifurcation_set.kinds=["neimark_sacker"]', f"bifurcation_set.continue_boundaries={goes_on}")
    case = tiny_case(*PLANE, WIDE, *(word.lower() for word in words))
    queue = plan_bifurcation_set(case, limit, lambda progress: None, lambda: False).queue
    pending = [each.start.problem.kind for each in queue.pending()]
    assert pending == ([EventKind.PERIOD_DOUBLING] if goes_on else [])


def test_the_boundary_is_followed_no_further_until_that_is_asked_for(limit: Path, tmp_path: Path) -> None:
    """Above the far R2 the period doublings lie among unstable cycles: `agfb track-pd` follows them there."""
    path = tmp_path / "a.zarr"
    shutil.copytree(limit, path)
    at = Job.of("test", tiny_case(*PLANE, WIDE), path, lambda progress: None, lambda: False)
    others = (EventKind.PERIOD_DOUBLING, EventKind.FOLD)
    queue = StartQueue(at, (EventKind.NEIMARK_SACKER,), boundaries=True, continued=others)
    while (part := next(curve_parts(queue), None)) is not None:
        compute_curve(at, part)
    halves = {name: group(path, name) for name in groups(path, "pd")}
    assert sorted(halves) == ["pd/c000", "pd/c001"]
    assert {half.attributes["stop_reason"] for half in halves.values()} == {"leaves_boundary"}
    (below,) = (name for name, half in halves.items() if half.n_points > 2)
    assert set(halves[below]["unstable_count"][1:-1].tolist()) == {0}
    assert halves[below]["unstable_count"][-1] == 1
    assert halves[below].labels("event_kind")[-1] == "R2"
    assert open_ends(open_for_reading(path), "smoke") == []
    assert queue.next() is None
    traced(path, WIDE, "track_pd")
    assert group(path, "pd/c000").attributes["stop_reason"] == "closed"
    assert open_ends(open_for_reading(path), "smoke") == []


def test_interrupted_curves_resume_to_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    assert Watched("continue_cycles", tiny_case(*PLANE, WIDE), path).result.ok
    for stage, stops in (("track_ns", (2, 1)), ("track_pd", (4, 20))):
        for stop in stops:
            assert "stopped on request" in Watched(
                stage, tiny_case(*PLANE, WIDE), path, stop_after=stop
            ).result.stop_reason  # fmt: skip
        assert Watched(stage, tiny_case(*PLANE, WIDE), path).result.ok
    assert compare_trees(whole, path) == []
    assert verify(path) == []


def test_the_width_is_of_third_order_in_the_displacement(limit: Path, tmp_path: Path) -> None:
    """The third tongue of a parametric resonance, beside terms of the next order."""
    smaller = traced(tmp_path / "a.zarr", MIDDLE, "continue_cycles", "track_ns")
    ratio = group(limit, "ns/c000")["event_width"][0] / group(smaller, "ns/c000")["event_width"][0]
    assert ratio == pytest.approx((0.2 / 0.16) ** 3, rel=0.2)


def test_a_tongue_below_the_error_of_the_time_steps_is_told_and_crossed(tmp_path: Path) -> None:
    """At a quarter of the displacement it is 64 times narrower, and its multipliers 3e-4 apart at most."""
    right = ("track_curves.ranges=[[0.255, 0.31], [0.85, 1.1]]",)
    path = traced(tmp_path / "a.zarr", NARROW, "continue_cycles", "track_ns", "track_pd", more=right)
    assert groups(path, "pd") == []
    first = group(path, "ns/c000")
    assert first.attributes["stop_reason"] == "range"
    assert first["excitation_frequency"][-1] == 0.31
    told = first.labels("event_tongue") == "unresolved"
    assert first.labels("event_kind")[told].tolist() == ["R2"]
    assert 3e-6 < first["event_width"][told][0] < 1e-4
    assert open_ends(open_for_reading(path), "smoke") == []
