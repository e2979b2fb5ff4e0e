"""Where the time of a campaign went."""

from __future__ import annotations

import pytest

from agfb_cli.console import Console
from agfb_cli.progress import CASES_SHOWN, ProgressReporter, describe, seconds_spent, where_time_went
from pipelines.stages.results import Progress, StageResult


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


def test_a_stage_of_parts_tells_the_time_left_of_all_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    """By the work done since the first report, of all parts together, whoever computes them."""
    now = [100.0]
    reporter = ProgressReporter(Console(), clock=lambda: now[0])

    def report(part: str, done: int, work: tuple[float, float, float]) -> None:
        reporter(Progress("bifurcation-set", "k=3", done, 2000, part, part, work))

    report("cycles/s000", 1, (50.0, 200.0, 1000.0))
    now[0] = 110.0
    report("cycles/s001", 1, (70.0, 180.0, 980.0))
    now[0] = 120.0
    report("cycles/s000", 9, (90.0, 160.0, 960.0))
    first, second, third = capsys.readouterr().err.splitlines()
    assert "left" not in first, "nothing is known of the pace yet"
    assert second.endswith("1/2000, 1 min 30 s to 8 min 10 s left, cycles/s001")
    assert third.endswith("9/2000, 2.5 s each, 1 min 20 s to 8 min 00 s left, cycles/s000")
    reporter.ended("bifurcation_set", "k=3")
    report("cycles/s000", 10, (90.0, 160.0, 960.0))
    assert "left" not in capsys.readouterr().err


def test_a_branch_alone_tells_its_own_time_at_most() -> None:
    told = describe(Progress("continue-cycles", "k=3", 5, 20), 4, 8.0)
    assert told == "continue-cycles k=3: 5/20, 2 s each, at most 30 s left"
