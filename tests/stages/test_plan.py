"""What a dry run foresees: what is there, how much is left, and times that follow what is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.case.reading import NamedCase
from pipelines.case.torus_settings import FEWEST_ANGLES
from pipelines.datasets.store import open_for_reading
from pipelines.stages.refinement.points import stored_points
from pipelines.stages.scheduling import durations
from pipelines.stages.scheduling.durations import Durations
from pipelines.stages.scheduling.plan import Planned, StageStatus, plan
from tests.helpers.tiny import PASSIVE, Watched, tiny_case
from tests.helpers.trees import tree

CHAIN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")


def planned(case: NamedCase, store: Path | None, *stages: str) -> dict[str, Planned]:
    return {each.stage: each for each in plan(stages, [case], store)}


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with linearize and criticals complete and two points of a branch of at most twenty."""
    store = tmp_path_factory.mktemp("plan") / "a.zarr"
    Watched("linearize", tiny_case(), store)
    Watched("criticals", tiny_case(), store)
    Watched("continue_cycles", tiny_case(), store, stop_after=2)
    return store


def test_nothing_is_there(tmp_path: Path) -> None:
    found = planned(tiny_case(), tmp_path / "a.zarr", *CHAIN)
    assert [each.there for each in found.values()] == [StageStatus.NOTHING] * 4
    assert [each.points for each in found.values()] == [0] * 4
    assert [each.most for each in found.values()] == [7, 6, 20, None]
    times = [each.seconds for each in found.values()]
    assert all(seconds > 0.0 for seconds in times)
    assert [each.least_seconds for each in found.values()][:3] == [None] * 3
    least = found["bifurcation_set"].least_seconds
    assert least is not None
    assert 0.0 < least < times[3]
    assert "4 lines" in found["bifurcation_set"].note
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_counted_and_nothing_is_written(begun: Path) -> None:
    before = tree(begun.parent)
    found = planned(tiny_case(), begun, *CHAIN)
    assert tree(begun.parent) == before
    assert found["linearize"] == Planned("smoke", "linearize", StageStatus.COMPLETE, 7, 7, 0.0)
    assert found["criticals"] == Planned("smoke", "criticals", StageStatus.COMPLETE, 6, 6, 0.0)
    cycles = found["continue_cycles"]
    assert (cycles.there, cycles.points, cycles.most) == (StageStatus.PARTIAL, 2, 20)
    assert found["bifurcation_set"].there is StageStatus.NOTHING


def test_other_tables(begun: Path) -> None:
    other = tiny_case("linearize.points=9", "criticals.points=9", "continue_cycles.step=0.01")
    found = planned(other, begun, *CHAIN)
    assert found["linearize"].there is StageStatus.NOTHING, "it is computed anew"
    assert found["criticals"].there is StageStatus.NOTHING, "it is computed anew"
    assert found["linearize"].seconds > 0.0
    assert found["criticals"].seconds > 0.0
    assert found["continue_cycles"].there is StageStatus.DIFFERENT_SETTINGS
    more = planned(tiny_case("continue_cycles.max_points=40"), begun, "continue_cycles")["continue_cycles"]
    assert (more.there, more.points, more.most) == (StageStatus.PARTIAL, 2, 40)


def test_a_second_direction_and_doubled_branches_are_still_to_come(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    Watched("continue_cycles", tiny_case("continue_cycles.max_points=2"), store)
    ended = planned(tiny_case("continue_cycles.max_points=2"), store, "continue_cycles")["continue_cycles"]
    assert (ended.there, ended.seconds) == (StageStatus.COMPLETE, 0.0)
    longer = planned(tiny_case("continue_cycles.max_points=3"), store, "continue_cycles")["continue_cycles"]
    assert longer.there is StageStatus.PARTIAL
    doubling = tiny_case("continue_cycles.doublings=1", "continue_cycles.direction='both'")
    found = planned(doubling, None, "continue_cycles")["continue_cycles"]
    assert (found.most, found.note) == (40, "without period-doubled branches")


def test_a_branch_that_cannot_start_has_failed(tmp_path: Path) -> None:
    case = tiny_case("continue_cycles.minimum_film=0.9")
    Watched("continue_cycles", case, tmp_path / "a.zarr")
    found = planned(case, tmp_path / "a.zarr", "continue_cycles")["continue_cycles"]
    assert (found.there, found.points, found.seconds) == (StageStatus.FAILED, 0, 0.0)


def test_stages_whose_length_nobody_knows(begun: Path) -> None:
    case = tiny_case()
    stages = ("track_pd", "track_ns", "track_folds", "refine", "continue_tori")
    found = planned(case, begun, *stages)
    assert [each.seconds for each in found.values()] == [None] * 5
    assert all("a point takes about" in each.note for each in found.values())


def test_bifurcations_that_are_there_are_counted_for_refinement(tmp_path: Path) -> None:
    case = tiny_case()
    Watched("continue_cycles", case, tmp_path / "a.zarr")
    assert len(stored_points(open_for_reading(tmp_path / "a.zarr"), case.case_id, 1)) == 1
    found = planned(case, tmp_path / "a.zarr", "refine")["refine"]
    assert (found.there, found.points, found.most) == (StageStatus.NOTHING, 0, 1)
    assert found.seconds > 0.0


def test_without_excitation_there_is_no_plane_to_search() -> None:
    found = planned(tiny_case(config=PASSIVE), None, "continue_cycles", "bifurcation_set")
    assert found["bifurcation_set"].there is StageStatus.COMPLETE
    assert found["continue_cycles"].seconds > 0.0, "measured at half the speed"


def test_without_an_equilibrium_there_is_nothing_to_measure() -> None:
    case = tiny_case(
        "operation.speed=0.0001", "continue_cycles.start=1.05", "criticals.speed_range=[1e-4, 2e-4]"
    )
    found = planned(case, None, "criticals")["criticals"]
    assert found.seconds is None
    assert "no equilibrium" in found.note


def test_a_run_in_time(tmp_path: Path) -> None:
    case = tiny_case(
        "transient.duration=30", "transient.steps_per_period=60", "transient.checkpoint_samples=16"
    )
    fresh = planned(case, tmp_path / "a.zarr", "transient")["transient"]
    assert fresh.there is StageStatus.NOTHING
    assert fresh.seconds > 0.0
    assert fresh.note.endswith("time steps")
    Watched("transient", case, tmp_path / "a.zarr", stop_after=1)
    begun = planned(case, tmp_path / "a.zarr", "transient")["transient"]
    assert begun.there is StageStatus.PARTIAL
    assert 0 < begun.points < begun.most
    Watched("transient", case, tmp_path / "a.zarr")
    ended = planned(case, tmp_path / "a.zarr", "transient")["transient"]
    assert (ended.there, ended.seconds, ended.points) == (StageStatus.COMPLETE, 0.0, ended.most)
    other = tiny_case("transient.duration=31")
    assert planned(other, tmp_path / "a.zarr", "transient")["transient"].there is StageStatus.NOTHING


def test_cases_of_the_same_grid_are_measured_once() -> None:
    measured = Durations()
    first = measured.of_cycle(tiny_case().case)
    assert measured.of_cycle(tiny_case("continue_cycles.max_points=3").case) == first
    with_forms = measured.of_curve_point(tiny_case().case)
    without = measured.of_curve_point(tiny_case("track_curves.normal_forms=false").case)
    assert with_forms == pytest.approx(3.0 * without)


def test_a_refined_point_takes_a_part_of_every_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(durations, "_pass", lambda machine, case: float(case.numerics.circumferential))
    case = tiny_case("refine.factors=[1.25, 1.5]").case
    grids = 16.0 + 20.0 + 24.0 + 16.0
    assert Durations().of_refined_point(case) == durations.PASSES_PER_LEVEL * grids
    assert Durations().of_torus(case) == durations.PASSES_PER_ANGLE * FEWEST_ANGLES * 16.0


def test_an_explicit_stepper_that_needs_very_many_steps_is_measured_on_few() -> None:
    case = tiny_case("numerics.stepper='rk4'", "bearings.foil.loss_factor=1e-5")
    assert Durations().of_cycle(case.case) > Durations().of_cycle(tiny_case().case)


def test_a_branch_without_rows_is_still_to_come_when_it_is_asked_for_otherwise(tmp_path: Path) -> None:
    store, away = tmp_path / "a.zarr", "continue_cycles.minimum_film=0.99"
    assert not Watched("continue_cycles", tiny_case(away), store).result.ok
    other = tiny_case("continue_cycles.max_points=2")
    found = planned(other, store, "continue_cycles")["continue_cycles"]
    assert (found.there, found.points) == (StageStatus.NOTHING, 0)
    assert Watched("continue_cycles", other, store).result.ok


def test_critical_speeds_that_failed_are_a_failure(tmp_path: Path) -> None:
    heavy = tiny_case("rotor.gravity=1000", "criticals.points=2", "criticals.unbalance_points=2")
    assert not Watched("criticals", heavy, tmp_path / "a.zarr").result.ok
    found = planned(heavy, tmp_path / "a.zarr", "criticals")["criticals"]
    assert (found.there, found.seconds) == (StageStatus.FAILED, 0.0)
