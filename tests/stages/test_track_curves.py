"""Curves into a store: rows, joins at resonances, resume, what starts no curve, the ways a curve ends."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.scales import PARAMETERS
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import OtherConfigurationError, open_for_reading
from pipelines.machine.assembly import build_machine
from pipelines.orbits.machine_cycles import cycle_shape
from pipelines.stages.curves.rows import traced
from pipelines.stages.cycles.problem import cycle_problem
from tests.helpers.monodromy import full_monodromy
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

# the Neimark-Sacker curve from the branch at excitation frequency 0.77 to R2 near 0.80, and some way back
PLANE = (
    "excitation.frequency=0.77",
    "continue_cycles.range=[1.2, 1.24]",
    "continue_cycles.start=1.2",
    "track_curves.ranges=[[0.72, 0.82], [1.2, 1.24]]",
    "track_curves.maximum_step=0.04",
    "track_curves.normal_forms=false",
    "numerics.multiplier_tolerance=1e-5",
)
NAMES = ("excitation_frequency", "speed")


def curve(path: Path, name: str) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/{name}")


def names(path: Path, *containers: str) -> list[str]:
    found = (name.split("/", 2)[2] for name in list_groups(open_for_reading(path), "smoke"))
    return [name for name in found if name.split("/")[0] in containers]


@pytest.fixture(scope="module")
def branched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A branch of cycles with its Neimark-Sacker point."""
    path = tmp_path_factory.mktemp("branched") / "a.zarr"
    assert Watched("continue_cycles", tiny_case(*PLANE), path).result.ok
    return path


@pytest.fixture(scope="module")
def tracked(branched: Path) -> Path:
    """The same with its Neimark-Sacker curve."""
    path = branched.with_name("tracked.zarr")
    shutil.copytree(branched, path)
    assert Watched("track_ns", tiny_case(*PLANE), path).result.ok
    return path


@pytest.fixture(scope="module")
def joined(tracked: Path) -> Path:
    """The same with the curve of period doublings on which the first one ends."""
    path = tracked.with_name("joined.zarr")
    shutil.copytree(tracked, path)
    assert Watched("track_pd", tiny_case(*PLANE), path).result.ok
    return path


def test_every_row_is_a_critical_cycle(joined: Path) -> None:
    case = tiny_case(*PLANE).case
    machine = build_machine(case)
    period_map = cycle_problem(machine, case).period_map
    assert names(joined, "ns", "pd") == ["ns/c000", "ns/c001", "pd/c000", "pd/c001"]
    for name in names(joined, "ns", "pd"):
        rows = curve(joined, name)
        for index in {0, rows.n_points // 2, rows.n_points - 1}:
            parameters = np.array([rows[parameter][index] for parameter in PARAMETERS])
            state, steps = rows["state"][index], int(rows["steps_per_period"][index])
            image = period_map.evaluate(state, parameters, float(rows["period"][index]), steps)
            assert np.max(np.abs(image.state - state)) < 1e-9
            full = np.linalg.eigvals(
                full_monodromy(period_map, state, parameters, float(rows["period"][index]), steps)
            )
            # near R2 the pair is a double -1, whose distance from it is the root of the test function's error
            tolerance = 1e-7 if abs(rows["kappa"][index]) < 0.99 else 1e-3
            critical = np.exp(1j * rows["angle"][index])
            assert np.min(np.abs(full - critical)) < tolerance, (name, index)
            assert np.cos(rows["angle"][index]) == pytest.approx(rows["kappa"][index], abs=1e-8)
            beyond = int(np.sum(np.abs(full) > 1.0 + 1e-3))
            if abs(rows["alignment"][index]) > 1e-3:  # else the second -1 of R2 may be on either side
                assert int(rows["unstable_count"][index]) == beyond, (name, index)
            shape = cycle_shape(machine, image.orbit, parameters)
            np.testing.assert_allclose(rows["orbit_maximum"][index], shape.maximum, rtol=0, atol=1e-12)
            np.testing.assert_allclose(
                rows["minimum_film"][index], shape.film_trace.min(axis=0), rtol=0, atol=1e-12
            )


def test_tangent_and_arclength_interpolate_the_curve(joined: Path) -> None:
    """Without every second point the cubic through the others passes it nearer than their chord."""
    rows = curve(joined, "pd/c001")
    thinned = {name: array[::2] for name, array in rows.arrays.items() if len(array) == rows.n_points}
    line = traced(Group("thinned", "curve", rows.attributes, thinned), NAMES)
    length = rows["arclength"]
    cubic, linear = [], []
    for middle in range(1, 2 * len(thinned["speed"]) - 2, 2):
        first = middle // 2
        whole = float(length[middle + 1] - length[middle - 1])
        share = float(length[middle] - length[middle - 1]) / whole
        chord = line.parameters[first + 1] - line.parameters[first]
        there = np.array([rows[name][middle] for name in NAMES]) - line.parameters[first] - share * chord
        bend = (1 - share) * (whole * line.tangents[first] - chord)
        bend += share * (chord - whole * line.tangents[first + 1])
        cubic.append(np.linalg.norm(there - share * (1 - share) * bend))
        linear.append(np.linalg.norm(there))
        assert linear[-1] < 0.02 * np.linalg.norm(chord)
    assert np.linalg.norm(cubic) < 0.5 * np.linalg.norm(linear)


def test_curves_meet_at_the_resonance(joined: Path) -> None:
    """The Neimark-Sacker curve ends at R2, and the period doublings go through it in both directions."""
    ended, forth, back = (curve(joined, name) for name in ("ns/c000", "pd/c000", "pd/c001"))
    assert ended.attributes["stop_reason"] == "resonance_2"
    assert ended.labels("event_kind").tolist() == ["R2"]
    assert ended["kappa"][-1] == pytest.approx(-1.0, abs=1e-7)
    resonance = np.array([ended[f"event_{name}"][0] for name in NAMES])
    for half, through in enumerate((forth, back)):
        assert through.attributes["origin"] == {"group": "ns/c000", "event": 0}
        assert through.attributes["half"] == half
        # the time steps of the two curves differ, and with them R2 by their error
        assert [through[name][0] for name in NAMES] == pytest.approx(resonance, abs=2e-5)
        assert through["alignment"][0] == pytest.approx(0.0, abs=1e-3)
        assert through.n_events == 0, "the resonance is told once, by the curve that found it"
    # where it ends the Neimark-Sacker curve touches the period doublings: beyond R2 one more is unstable
    assert {int(forth["unstable_count"][-1]), int(back["unstable_count"][-1])} == {0, 1}


@pytest.mark.parametrize("stops", [[1, 3], [5]])
def test_resuming_gives_the_same_bytes(
    branched: Path, tracked: Path, tmp_path: Path, stops: list[int]
) -> None:
    path = tmp_path / "stopped.zarr"
    shutil.copytree(branched, path)
    for stop in stops:
        stopped = Watched("track_ns", tiny_case(*PLANE), path, stop_after=stop)
        assert stopped.result.ok
        assert "stopped on request" in stopped.result.stop_reason
        assert stopped.finished == stop
    assert Watched("track_ns", tiny_case(*PLANE), path).result.ok
    assert compare_trees(tracked, path) == []
    assert verify(path) == []


def test_nothing_is_traced_twice(joined: Path) -> None:
    """Not what is ended, and not R2 or the event from the other side."""
    for stage in ("track_ns", "track_pd", "track_folds"):
        again = Watched(stage, tiny_case(*PLANE), joined)
        assert again.reported == []
        assert again.result.ok
    assert again.result.stop_reason == "no fold to start from"


def test_a_start_outside_the_plane_is_told(branched: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(branched, path)
    away = (*PLANE, "track_curves.ranges=[[0.2, 0.6], [1.2, 1.24]]")
    result = Watched("track_ns", tiny_case(*away), path).result
    assert result.ok
    assert result.summary["starts outside the plane"] == 1
    assert names(path, "ns") == []


def test_more_points_lengthen_a_curve_and_other_requests_are_refused(branched: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(branched, path)
    few = Watched("track_ns", tiny_case(*PLANE, "track_curves.max_points=2"), path)
    assert "maximum_points" in few.result.stop_reason
    assert "max_points" in few.result.advice
    assert [curve(path, name).n_points for name in names(path, "ns")] == [2, 2]
    more = Watched("track_ns", tiny_case(*PLANE, "track_curves.max_points=3"), path)
    assert more.finished == 2
    with pytest.raises(OtherConfigurationError, match=r"'step': 0\.01"):
        Watched("track_ns", tiny_case(*PLANE, "track_curves.step=0.01"), path)


def test_a_curve_ends_where_the_journal_touches_the_foil(
    branched: Path, tracked: Path, tmp_path: Path
) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(branched, path)
    films = curve(tracked, "ns/c001")["minimum_film"].min(axis=1)
    assert np.all(np.diff(films) < 0.0), "the film shrinks as the excitation frequency falls"
    limit = float(0.5 * (films[1] + films[2]))
    thin = tiny_case(*PLANE, f"continue_cycles.minimum_film={limit}")
    result = Watched("track_ns", thin, path).result
    assert result.ok
    assert "limit" in result.stop_reason
    assert "the journal touches the foil" in result.advice
    np.testing.assert_array_equal(curve(path, "ns/c001")["minimum_film"].min(axis=1), films[:2])


def test_normal_forms_and_the_extended_system_are_stored(branched: Path, tmp_path: Path) -> None:
    """Both formulations find the same second point to the tolerance of the test function, 1e-8."""
    points = []
    for formulation in ("bordered", "extended"):
        path = tmp_path / f"{formulation}.zarr"
        shutil.copytree(branched, path)
        overrides = (*PLANE, f"track_curves.formulation={formulation}", "track_curves.max_points=2")
        asked = tiny_case(*overrides, "track_curves.normal_forms=true")
        assert Watched("track_ns", asked, path).result.ok
        rows = curve(path, "ns/c000")
        points.append([[rows[name][index] for name in NAMES] for index in range(2)])
        assert np.all(np.isfinite(rows["normal_form"]))
        clear = rows["normal_form_error"] < np.abs(rows["normal_form"].real)
        sign = np.where(rows["normal_form"].real < 0.0, "supercritical", "subcritical")
        assert rows.labels("criticality").tolist() == np.where(clear, sign, "unset").tolist()
    assert points[0] == pytest.approx(np.array(points[1]), abs=1e-8)
