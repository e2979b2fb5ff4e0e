"""Where the time of a campaign went."""

from __future__ import annotations

from agfb_cli.progress import CASES_SHOWN, seconds_spent, where_time_went
from pipelines.stages.results import StageResult


def result(case: str, seconds: float) -> StageResult:
    return StageResult(case, True, "range", seconds=seconds)


RESULTS = [
    ("continue_cycles", result("k=3", 20.0)),
    ("continue_cycles", result("k=50", 70.0)),
    ("bifurcation_set", result("k=50", 230.0)),
]


def test_seconds_by_stage_and_case() -> None:
    assert seconds_spent(RESULTS, 170.0) == {
        "elapsed": 170.0,
        "stages": {"continue_cycles": 90.0, "bifurcation_set": 230.0},
        "cases": {"k=3": 20.0, "k=50": 300.0},
    }


def test_the_table_has_the_slowest_case_first_and_the_sums_below() -> None:
    header, first, second, last, took = where_time_went(RESULTS, 170.0).splitlines()
    assert header.split("  ")[0] == "case"
    assert "continue-cycles  bifurcation-set  all stages" in header
    assert first.split() == ["k=50", "1", "min", "10", "s", "3", "min", "50", "s", "5", "min", "00", "s"]
    assert second.split() == ["k=3", "20", "s", "-", "20", "s"]
    assert last.split()[:2] == ["all", "2"]
    assert last.endswith("5 min 20 s")
    assert took == "took 2 min 50 s"


def test_of_many_cases_only_the_slowest_are_listed() -> None:
    results = [("linearize", result(f"c{number}", float(number))) for number in range(100)]
    header, first, *rest = where_time_went(results, 1.0).splitlines()
    assert header.startswith("slowest cases")
    assert first.startswith("c99")
    assert len(rest) == CASES_SHOWN - 1 + 2
    assert rest[-2].startswith("all 100")
