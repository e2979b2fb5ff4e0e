"""What may be computed now, without computing anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipelines.stages.results import StageResult
from pipelines.stages.scheduling.agenda import Agenda, Chain, Work
from tests.helpers.tiny import tiny_case

CASE = tiny_case()
RUN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")


def part(group: str, doubtful: bool = False) -> dict[str, Any]:
    return {"group": group, "arguments": {}, "doubtful": doubtful}


def agenda(*stages: str, cases: int = 1) -> Agenda:
    return Agenda([Chain(CASE, list(stages)) for _ in range(cases)])


def begun(plans: Agenda, most: int = 20) -> list[Work]:
    """Everything that may begin, begun."""
    found = []
    while len(found) < most and (work := plans.begin_next()) is not None:
        found.append(work)
    return found


def tell(plans: Agenda, work: Work, *parts: dict[str, Any]) -> list[tuple[str, StageResult]]:
    """Answer the question for a plan."""
    return list(plans.end(work, {"parts": list(parts), "result": None, "seconds": 1.0}))


def conclude(plans: Agenda, work: Work) -> list[tuple[str, StageResult]]:
    result = StageResult(CASE.case_id, True, "range").as_dict()
    return list(plans.end(work, {"parts": [], "result": result, "seconds": 1.0}))


def done(plans: Agenda, work: Work, stopped: bool = False) -> list[tuple[str, StageResult]]:
    return list(plans.end(work, {"result": None, "stopped": stopped, "seconds": 2.0}))


def test_stages_that_need_nothing_of_each_other_run_side_by_side() -> None:
    plans = agenda(*RUN)
    first = begun(plans)
    assert [work.name for work in first] == ["linearize", "criticals", "continue_cycles"]
    ((stage, _),) = conclude(plans, first[1])
    assert stage == "criticals"
    (search,) = begun(plans)
    assert search.name == "bifurcation_set"
    assert search.message(Path())["settled"] is False


def test_parts_that_are_needed_come_before_cases_and_these_before_doubt() -> None:
    plans = agenda("track_ns", cases=2)
    (plan,) = begun(plans, 1)
    tell(plans, plan, part("ns/c000"), part("ahead/a", True), part("ahead/b", True))
    assert [work.name for work in begun(plans)] == ["ns/c000", "track_ns", "ahead/a", "ahead/b"]


def test_a_plan_is_asked_again_after_each_part_and_nothing_doubtful_begins_meanwhile() -> None:
    plans = agenda("track_ns")
    (plan,) = begun(plans)
    tell(plans, plan, part("ns/c000"), part("ahead/a", True), part("ahead/b", True))
    first, second = begun(plans, 2)
    done(plans, first)
    (again,) = begun(plans)
    assert (again.part, again.message(Path())["alone"]) == (None, False)
    tell(plans, again)
    done(plans, second, stopped=True)
    (last,) = begun(plans)
    assert last.message(Path()) | {"settled": True, "alone": True} == last.message(Path())
    ((stage, result),) = conclude(plans, last)
    assert (stage, result.ok, result.seconds) == ("track_ns", True, 7.0)
    assert plans.chains == []


def test_a_part_that_ended_while_the_plan_was_asked_is_not_computed_again() -> None:
    plans = agenda("track_ns")
    (plan,) = begun(plans)
    tell(plans, plan, part("ns/c000"), part("ahead/a", True))
    first, second = begun(plans)
    done(plans, first)
    (again,) = begun(plans)
    done(plans, second)
    tell(plans, again, part("ahead/a", True))
    assert [work.part for work in begun(plans)] == [None]


def test_a_plan_that_asks_for_what_was_computed_fails() -> None:
    plans = agenda("track_ns")
    (plan,) = begun(plans)
    tell(plans, plan, part("ns/c000"))
    (first,) = begun(plans)
    done(plans, first)
    (again,) = begun(plans)
    ((_, result),) = tell(plans, again, part("ns/c000"))
    assert (result.ok, result.failed_by) == (False, "bug")


def test_a_part_that_fails_fails_its_stage_when_the_others_have_ended() -> None:
    plans = agenda("continue_cycles")
    (plan,) = begun(plans)
    tell(plans, plan, part("cycles/b000"), part("cycles/b001"))
    first, second = begun(plans)
    failed = StageResult(CASE.case_id, False, "no film", "go faster").as_dict()
    assert list(plans.end(first, {"result": failed, "stopped": False})) == []
    assert begun(plans) == []
    ((_, result),) = done(plans, second)
    assert result.stop_reason == "no film"


def test_what_died_waits_again_and_what_is_given_up_takes_the_later_stages_with_it() -> None:
    plans = agenda("track_pd", "track_ns")
    (plan,) = begun(plans)
    tell(plans, plan, part("pd/c000"))
    (first,) = begun(plans)
    plans.again(first)
    (again,) = begun(plans)
    assert again == first
    lost = StageResult(CASE.case_id, False, "died")
    results = list(plans.give_up(again, lost))
    assert [(stage, result.stop_reason) for stage, result in results] == [
        ("track_pd", "died"),
        ("track_ns", "not computed: track_pd did not end"),
    ]
    assert begun(plans) == []
    assert plans.chains == []
