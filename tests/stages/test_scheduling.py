"""Tasks are plain dictionaries, and the store of a run is made by the driver alone."""

from __future__ import annotations

import inspect
import json
import math
from pathlib import Path

import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.reading import case_attributes, list_cases, list_groups
from pipelines.datasets.store import NotAStoreError, OtherConfigurationError, open_for_reading
from pipelines.stages.results import Progress, StageResult
from pipelines.stages.scheduling import plan, registry, tasks
from pipelines.stages.scheduling.preparation import prepare_store

ROOT = Path(__file__).resolve().parents[2]
SMOKE = (ROOT / "configs" / "smoke.toml").read_text()


def cases(*overrides: str) -> tuple[NamedCase, ...]:
    return read_cases(SMOKE, "smoke.toml", overrides)


def test_a_result_survives_the_way_to_another_process() -> None:
    result = StageResult("a", False, "no equilibrium", "go faster", {"speed": 0.5, "points": None})
    assert StageResult.from_dict(json.loads(json.dumps(result.as_dict(), allow_nan=False))) == result


def test_a_task_survives_the_way_to_another_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen = []

    def stage(case: NamedCase, store_path: Path, report: object, should_stop: object) -> StageResult:
        seen.append((case, store_path))
        return StageResult(case.case_id, True, "range")

    monkeypatch.setattr(registry, "stage_function", lambda name: stage)
    (named,) = cases()
    sent = json.loads(json.dumps(tasks.task("linearize", named, tmp_path), allow_nan=False))
    assert tasks.run_task(sent, _ignore, _never)["ok"] is True
    assert seen == [(named, tmp_path)]


def test_no_case_is_started_after_a_request_to_stop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started = []

    def stage(case: NamedCase, store_path: Path, report: object, should_stop: object) -> StageResult:
        started.append(case.case_id)
        return StageResult(case.case_id, True, "range")

    monkeypatch.setattr(registry, "stage_function", lambda name: stage)
    swept = cases("sweep.excitation.displacement=[0.05, 0.1, 0.2]")
    results = list(tasks.run_stages(("linearize",), swept, tmp_path, _ignore, lambda: len(started) == 2))
    assert [result.case_id for _, result in results] == started == [named.case_id for named in swept[:2]]


def test_an_unknown_stage_is_refused() -> None:
    with pytest.raises(ValueError, match="not one of linearize"):
        registry.stage_function("track_all")


def test_the_store_holds_every_case_with_its_scales(tmp_path: Path) -> None:
    swept = cases("sweep.excitation.displacement=[0.05, 0.1]")
    prepare_store(tmp_path / "a.zarr", swept, ["agfb", "run"])
    store = open_for_reading(tmp_path / "a.zarr")
    assert list_cases(store) == sorted(named.case_id for named in swept)
    for named in swept:
        attributes = case_attributes(store, named.case_id)
        assert attributes["name"] == named.case_id
        assert attributes["parameters"]["displacement"] == named.case.excitation.displacement
        # Omega = 1 is one radian per film time: t0 = 6 mu R^2/(p0 c^2)
        time = 6 * 1.85e-5 * 0.014**2 / (101325.0 * 20.4e-6**2)
        assert attributes["scales"]["time"] == pytest.approx(time, rel=1e-14)
        rpm = 60 / (2 * math.pi * time)
        assert attributes["scales"]["speed_rpm_per_unit"] == pytest.approx(rpm, rel=1e-14)
        assert list_groups(store, named.case_id) == [f"cases/{named.case_id}/machine"]


def test_a_rigid_foil_has_no_stiffness_in_the_store(tmp_path: Path) -> None:
    text = SMOKE.replace("foil = { stiffness = 10.0, loss_factor = 0.425 }", "foil = { rigid = true }")
    prepare_store(tmp_path / "a.zarr", read_cases(text, "rigid.toml"), ["agfb"])
    attributes = case_attributes(open_for_reading(tmp_path / "a.zarr"), "smoke")
    assert attributes["parameters"]["foil_stiffness"] is None


def test_a_store_is_prepared_once(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    prepare_store(path, cases(), ["agfb", "first"])
    before = (path / "zarr.json").read_bytes()
    prepare_store(path, cases("continue_cycles.max_points=300"), ["agfb", "second"])
    assert (path / "zarr.json").read_bytes() == before
    with pytest.raises(OtherConfigurationError, match=r"numerics\.axial"):
        prepare_store(path, cases("numerics.axial=3"), ["agfb", "third"])


def test_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "notes.txt").touch()
    with pytest.raises(NotAStoreError):
        prepare_store(tmp_path / "a.zarr", cases(), ["agfb"])
    assert [path.name for path in (tmp_path / "a.zarr").iterdir()] == ["notes.txt"]


def _ignore(progress: Progress) -> None:
    """A report that nobody reads."""


def _never() -> bool:
    return False


def test_every_stage_has_a_function_and_is_foreseen() -> None:
    for name in registry.STAGES:
        parameters = inspect.signature(registry.stage_function(name)).parameters
        assert list(parameters) == ["named", "store_path", "report", "should_stop"], name
    assert {*plan._EXTENTS, "transient"} == set(registry.STAGES)
