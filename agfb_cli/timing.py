"""Where the time of a campaign went."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from agfb_cli.console import table
from agfb_cli.progress import duration

if TYPE_CHECKING:
    from pipelines.stages.results import StageResult

CASES_SHOWN = 20

Results = Sequence[tuple[str, "StageResult"]]


def seconds_spent(results: Results, elapsed: float) -> dict[str, Any]:
    """Seconds passed, and seconds computed by stage and by case (larger with several workers)."""
    stages, cases = _spent(results)
    return {"elapsed": elapsed, "stages": stages, "cases": cases}


def where_time_went(results: Results, elapsed: float) -> str:
    """A table of cases over stages, the slowest cases first."""
    stages, cases = _spent(results)
    single = {(result.case_id, stage): duration(result.seconds) for stage, result in results}
    slowest = sorted(cases, key=lambda case: -cases[case])[:CASES_SHOWN]
    rows = [
        [case, *(single.get((case, stage), "-") for stage in stages), duration(cases[case])]
        for case in slowest
    ]
    rows.append([f"all {len(cases)}", *map(duration, stages.values()), duration(sum(stages.values()))])
    header = ["slowest cases" if len(cases) > len(slowest) else "case"]
    header += [*(stage.replace("_", "-") for stage in stages), "all stages"]
    return f"{table(header, rows)}\ntook {duration(elapsed)}"


def _spent(results: Results) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds by stage, in the order of the stages, and by case."""
    stages: dict[str, float] = defaultdict(float)
    cases: dict[str, float] = defaultdict(float)
    for stage, result in results:
        stages[stage] += result.seconds
        cases[result.case_id] += result.seconds
    return dict(stages), dict(cases)
