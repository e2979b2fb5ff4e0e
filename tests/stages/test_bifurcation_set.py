"""The search of a window of the plane: lines, curves, what it says of its cover, resume."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.bifurcations.detection import EventKind
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.curves.bifurcation_set import (
    Line,
    covered,
    lines_of_round,
    lowest_speed,
    plan_bifurcation_set,
)
from pipelines.stages.curves.rows import CONTAINERS, traced
from pipelines.stages.curves.starts import StartQueue, starts_of
from pipelines.stages.job import Job, Origin
from pipelines.stages.reports.operating_range import set_cautions
from pipelines.stages.scheduling import campaign
from tests.helpers.tiny import PASSIVE, Watched, tiny_case
from tests.helpers.trees import compare_trees
from tests.helpers.virtual_workers import VirtualWorkers

pytestmark = pytest.mark.slow

WINDOW = (
    "excitation.frequency=0.77",
    "continue_cycles.range=[1.2, 1.24]",
    "continue_cycles.start=1.2",
    "track_curves.ranges=[[0.75, 0.82], [1.2, 1.24]]",
    "track_curves.maximum_step=0.04",
    "track_curves.normal_forms=false",
    "bifurcation_set.frequencies=1",
    "bifurcation_set.speeds=1",
    "bifurcation_set.resonances=false",
    "numerics.multiplier_tolerance=1e-4",
)
NAMES = ("excitation_frequency", "speed")


def job(path: Path, *overrides: str) -> Job:
    return Job.of("test", tiny_case(*WINDOW, *overrides), path, lambda progress: None, lambda: False)


def group(path: Path, name: str) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/{name}")


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("searched") / "a.zarr"
    assert Watched("continue_cycles", tiny_case(*WINDOW), path).result.ok
    result = Watched("bifurcation_set", tiny_case(*WINDOW), path).result
    assert result.ok, result.advice
    assert "met no new curve" in result.stop_reason
    return path


def test_every_bifurcation_of_every_line_is_on_a_curve(searched: Path) -> None:
    """And the Neimark-Sacker and the period-doubling curve of the window are there once."""
    at = job(searched)
    for kind, container in CONTAINERS.items():
        curves = [at.read(name) for name in at.groups(container)]
        starts = list(starts_of(at, kind))
        assert all(any(traced(curve, NAMES).holds(start.guess) for curve in curves) for start in starts), kind
        halves = [curve.attributes["half"] for curve in curves]
        assert halves == ([] if kind is EventKind.FOLD else [0, 1])
        assert starts or kind is EventKind.FOLD


def test_it_says_how_it_covered_the_window(searched: Path) -> None:
    found = group(searched, "bifurcation_set")
    assert found.attributes["complete"] is True
    assert found.attributes["rounds"] == 2
    assert found.attributes["covered"] == (
        "2 branches along the speed and 2 along the excitation frequency in 2 rounds; "
        "the last 2 of them met no new curve"
    )
    assert found["line_round"].tolist() == [0, 0, 1, 1]
    assert found.labels("line_complete").tolist() == ["yes"] * 4
    assert found.labels("line_parameter").tolist() == ["excitation_frequency", "speed"] * 2
    assert found["line_new_curves"][2:].tolist() == [0, 0]
    assert found["line_low"] == pytest.approx([0.75, 1.2, 0.75, 1.2])
    assert found["line_high"] == pytest.approx([0.82, 1.24, 0.82, 1.24])
    assert found.attributes["lowest_speed"] == 1.2
    events = [group(searched, f"cycles/s{index:03d}").n_events for index in range(4)]
    assert found["line_events"].tolist() == events


def test_an_interrupted_search_resumes_to_the_same_bytes(searched: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    Watched("continue_cycles", tiny_case(*WINDOW), path)
    for stop in (4, 9, 6):
        stopped = Watched("bifurcation_set", tiny_case(*WINDOW), path, stop_after=stop)
        assert stopped.result.stop_reason == "stopped on request"
    assert Watched("bifurcation_set", tiny_case(*WINDOW), path).result.ok
    assert compare_trees(searched, path) == []
    assert verify(path) == []
    again = Watched("bifurcation_set", tiny_case(*WINDOW), path)
    assert again.reported == []


def test_rounds_halve_the_cells(searched: Path) -> None:
    at = job(searched, "bifurcation_set.frequencies=2", "bifurcation_set.speeds=0")
    low, high = 0.75, 0.82
    positions = [
        [(line.fixed - low) / (high - low) for line in lines_of_round(at, number, 1.2)] for number in range(4)
    ]
    assert positions == [
        pytest.approx([0.25, 0.75]),
        pytest.approx([0.0, 0.5]),
        pytest.approx([0.125, 0.625]),
        pytest.approx([0.375, 0.875]),
    ]


def test_lines_at_predicted_resonances(searched: Path, tmp_path: Path) -> None:
    """Twice a critical speed, unless another line is beside it."""
    overrides = (
        "bifurcation_set.resonances=true", "bifurcation_set.speeds=0", "bifurcation_set.frequencies=2",
        "track_curves.ranges=[[0.2, 2.0], [1.2, 1.24]]",
    )  # fmt: skip
    path = tmp_path / "a.zarr"
    shutil.copytree(searched, path)
    case = tiny_case(*WINDOW, *overrides)
    assert Watched("criticals", case, path).result.ok
    found = [line.fixed for line in lines_of_round(job(path, *overrides), 0, 1.2)]
    resonances = group(path, "criticals")
    principal = 2.0 * resonances["critical_speed"]
    wanted = [*principal, *(0.5 * principal)]
    assert found[:2] == pytest.approx([0.65, 1.55])
    assert len(found) > 2
    for value in found[2:]:
        assert np.min(np.abs(np.array(wanted) - value)) < 1e-12
        assert min(abs(value - other) for other in found if other != value) > 0.02 * 1.8


def test_the_lowest_speed_leaves_the_smallest_film(searched: Path) -> None:
    """Between the ends of the range the film at the lowest speed is the one asked for."""
    at = job(searched, "track_curves.ranges=[[0.75, 0.82], [0.1, 1.24]]", "bifurcation_set.smallest_film=0.3")
    lowest = lowest_speed(at)
    assert lowest is not None
    films = []
    for speed in (lowest - 2e-3, lowest):
        linear = tiny_case(*WINDOW, f"linearize.speed_range=[{speed}, {speed + 0.1}]", "linearize.points=2")
        path = searched.with_name(f"film-{speed}.zarr")
        assert Watched("linearize", linear, path).result.ok
        films.append(group(path, "linear")["minimum_film"][0].min())
    assert films[0] < 0.3 <= films[1]
    assert lowest_speed(job(searched, "bifurcation_set.smallest_film=0.99")) is None


def test_nothing_is_searched_without_excitation(tmp_path: Path) -> None:
    result = Watched("bifurcation_set", tiny_case(config=PASSIVE), tmp_path / "a.zarr").result
    assert result.ok
    assert "without displacement" in result.stop_reason


def test_kinds_that_are_not_asked_for_are_not_followed(tmp_path: Path) -> None:
    search = ("kinds=['period_doubling']", "max_rounds=1", "frequencies=0")
    case = tiny_case(*WINDOW, *(f"bifurcation_set.{setting}" for setting in search))
    result = Watched("bifurcation_set", case, tmp_path / "a.zarr").result
    assert list(result.summary) == ["lines", "pd curves"]
    assert result.summary["pd curves"] > 0
    assert not (tmp_path / "a.zarr/cases/smoke/ns").exists()
    found = read_group(open_for_reading(tmp_path / "a.zarr"), "cases/smoke/bifurcation_set")
    assert found.attributes["kinds"] == ["period_doubling"]
    assert any("folds were not traced" in told for told in set_cautions(found.attributes))


def test_an_incomplete_search_says_so() -> None:
    assert "max_rounds" in covered([Line("speed", 0.5, 0), Line("speed", 0.7, 1)], False)


def test_only_what_bounds_stable_cycles_may_be_followed(tmp_path: Path) -> None:
    """The branch loses stability at a first pair and gets a second unstable one, as its rows count."""
    path = tmp_path / "a.zarr"
    overrides = ("continue_cycles.range=[1.1, 1.35]", "continue_cycles.maximum_step=0.05")
    assert Watched("continue_cycles", tiny_case(*WINDOW, *overrides), path).result.ok
    at = job(path, *overrides, "track_curves.ranges=[[0.2, 2.0], [0.5, 2.0]]")
    branch = at.read("cycles/b000", ("event_after_point", "unstable_count"))
    kind = EventKind.NEIMARK_SACKER
    starts = list(starts_of(at, kind))
    rows = [int(branch["event_after_point"][start.origin.event]) for start in starts]
    counts = [sorted(branch["unstable_count"][row : row + 2].tolist()) for row in rows]
    assert counts == [[0, 2], [2, 4]]
    assert [start.bounds for start in starts] == [True, False]
    on_a_curve = {(kind, starts[0].origin)}
    assert StartQueue(at, (kind,), True, settled=on_a_curve).next() is None
    following = StartQueue(at, (kind,), False, settled=on_a_curve).next()
    assert following is not None
    assert following.start.origin == starts[1].origin


def test_a_curve_that_no_line_meets_starts_where_a_followed_one_crosses_it(tmp_path: Path) -> None:
    """A tongue of period doublings rises over the line of Neimark-Sacker points, which lies above the only
    branch of the search.
    """
    plane = ("excitation.displacement=0.05", "track_curves.ranges=[[0.905, 0.945], [1.07, 1.09]]")
    search = (
        "kinds=['period_doubling', 'neimark_sacker']",
        "max_rounds=1",
        "frequencies=0",
        "boundaries=true",
    )
    overrides = (*plane, *(f"bifurcation_set.{setting}" for setting in search))
    path = tmp_path / "a.zarr"
    assert Watched("bifurcation_set", tiny_case(*WINDOW, *overrides), path).result.ok
    at = job(path, *overrides)
    assert set(at.read("cycles/s000").labels("event_kind")) == {"period_doubling"}
    line = [at.read(name) for name in at.groups("ns")]
    assert [curve.attributes["half"] for curve in line] == [0, 1]
    assert [curve.attributes["stop_reason"] for curve in line] == ["range", "range"]
    origin = Origin.of(line[0].attributes)
    assert origin is not None
    tongue = at.read(origin.group)
    assert tongue.attributes["bifurcation"] == "period_doubling"
    assert tongue.labels("event_kind")[origin.event] == "flip_neimark_sacker"
    for name in NAMES:
        assert line[0][name][0] == pytest.approx(tongue[f"event_{name}"][origin.event], abs=1e-5)
    # the other side of the tongue crosses the same line, which is followed once
    crossings = [label for curve in line for label in curve.labels("event_kind")]
    assert crossings == ["flip_neimark_sacker"]


def test_any_number_of_workers_gives_the_same_bytes(
    searched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On workers that exist in virtual time, where a point takes one unit of time."""
    monkeypatch.setattr(campaign, "Event", lambda name: SimpleNamespace(is_set=lambda: False))
    virtual = VirtualWorkers(tiny_case(*WINDOW), tmp_path, duration=lambda seconds, points: float(points))
    runs = {workers: virtual.run(("continue_cycles", "bifurcation_set"), workers) for workers in (2, 16)}
    for workers, run in runs.items():
        assert all(result.ok for result in run.results)
        assert compare_trees(searched / "cases", tmp_path / f"{workers}.zarr" / "cases") == [], workers
        assert verify(tmp_path / f"{workers}.zarr") == []
    alone = sum(span.end - span.begin for span in runs[2].spans)
    assert alone / runs[2].duration >= 1.7
    assert runs[16].width(0.0) == 5, "the branch, and the lines of both rounds"
    assert max(runs[16].width(span.begin) for span in runs[16].spans) >= 8


def test_what_was_traced_ahead_takes_its_turn(searched: Path, tmp_path: Path) -> None:
    """Whole, interrupted, or not needed: one process goes on to the same bytes."""
    path = tmp_path / "a.zarr"
    shutil.copytree(searched, path)
    for name in ("pd", "ns", "bifurcation_set"):
        shutil.rmtree(path / "cases" / "smoke" / name)
    plan = plan_bifurcation_set(tiny_case(*WINDOW), path, lambda progress: None, lambda: False)
    first, *ahead = plan.parts()
    assert first.group == "pd/c000"
    assert all(part.doubtful and part.group.startswith("ahead/") for part in ahead)
    plan.compute(ahead[0], plan.job)
    plan.compute(ahead[1], replace(plan.job, should_stop=lambda: True))
    plan.compute(ahead[-1], plan.job)
    assert plan.job.groups("ahead") == sorted(part.group for part in (*ahead[:2], ahead[-1]))
    assert verify(path) == []
    assert Watched("bifurcation_set", tiny_case(*WINDOW), path).result.ok
    assert compare_trees(searched, path) == []
