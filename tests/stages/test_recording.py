"""The driver writes down what failed, and only that."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.datasets.failures import read_failures
from pipelines.datasets.store import open_for_reading
from pipelines.stages.results import FailedBy, StageResult
from pipelines.stages.scheduling.tasks import recorded
from tests.helpers.curves import empty_store

STAGE = "continue_cycles"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return empty_store(tmp_path / "store.zarr", "a", "b").path


def failed(case: str, by: FailedBy = "case") -> tuple[str, StageResult]:
    return STAGE, StageResult(case, False, "no_equilibrium", "go faster", failed_by=by)


def write(path: Path, *results: tuple[str, StageResult], stopping: bool = False) -> None:
    assert list(recorded(results, path, lambda: stopping)) == list(results)


def reasons(path: Path) -> list[tuple[str, str, str]]:
    store = open_for_reading(path)
    found = [failure for case in ("a", "b") for failure in read_failures(store, case)]
    return [(failure.case, failure.reason, failure.advice) for failure in found]


def test_a_failure_stays_until_its_case_succeeds(path: Path) -> None:
    write(path, failed("a"), failed("b", "bug"))
    assert reasons(path) == [("a", "no_equilibrium", "go faster"), ("b", "no_equilibrium", "go faster")]
    write(path, (STAGE, StageResult("a", True, "range")), ("criticals", StageResult("b", True, "complete")))
    assert reasons(path) == [("b", "no_equilibrium", "go faster")]


def test_being_stopped_is_no_success(path: Path) -> None:
    write(path, failed("a"))
    write(path, (STAGE, StageResult("a", True, "stopped on request")), stopping=True)
    assert len(reasons(path)) == 1


def test_a_store_that_failed_a_case_is_left_alone(path: Path) -> None:
    write(path, failed("a", "store"))
    assert reasons(path) == []
