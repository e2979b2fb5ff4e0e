"""Run stages over many cases, and record in the store how each ended.

One task is one stage on one case, plain dictionaries in and out. A task is idempotent: run again, it resumes
from the last row that its case committed. `run_stages` runs the tasks one after the other in this process;
because nothing but dictionaries and strings enters or leaves `run_task`, `campaign` hands the same tasks to
other processes.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipelines.case.reading import NamedCase
from pipelines.datasets.failures import Failure, clear_failure, record_failure
from pipelines.datasets.store import StoreError, open_for_reading, open_for_writing
from pipelines.stages.results import FailedBy, Report, ShouldStop, StageResult
from pipelines.stages.scheduling import registry


def run_stages(
    stages: Sequence[str],
    cases: Sequence[NamedCase],
    store_path: Path,
    report: Report,
    should_stop: ShouldStop,
) -> Iterator[tuple[str, StageResult]]:
    """Run each of `stages` (names of the registry) on every case in order; yield each result at once.

    A case that raises yields a failed result and the next case is run; only what no case could survive (a
    full disk, no memory) is raised. When `should_stop` answers True no further case is started.
    """
    for stage in stages:
        for case in cases:
            if should_stop():
                return
            record = run_task(task(stage, case, store_path), report, should_stop)
            yield stage, StageResult.from_dict(record)


def task(stage: str, named: NamedCase, store_path: Path) -> dict[str, Any]:
    """The task for `run_task` as a plain dictionary."""
    return {"stage": stage, "case": named.as_dict(), "store": str(store_path)}


def run_task(task: Mapping[str, Any], report: Report, should_stop: ShouldStop) -> dict[str, Any]:
    """Carry out one task and return `StageResult.as_dict`."""
    case, begin = NamedCase.from_dict(task["case"]), time.perf_counter()
    try:
        store = Path(task["store"])
        result = registry.stage_function(task["stage"])(case, store, report, should_stop)
        if task["stage"] in registry.MOTIONS and result.ok and not should_stop():
            cautions = (result.caution, _condensation_caution(case, store))
            result = replace(result, caution="; ".join(filter(None, cautions)))
    except (MemoryError, OSError):
        raise
    except StoreError as error:
        result = _failure(case, error, "store", "the other cases of the store are not affected")
    except Exception as error:
        result = _failure(
            case, error, "bug", "this is a bug: please report it with the output of --traceback"
        )
    return result.as_dict() | {"seconds": time.perf_counter() - begin}


def _condensation_caution(named: NamedCase, store: Path) -> str:
    from pipelines.stages.linear.condensed_modes import condensation_caution  # loads the kernels

    return condensation_caution(named, open_for_reading(store))


def _failure(named: NamedCase, error: Exception, failed_by: FailedBy, advice: str) -> StageResult:
    return StageResult(
        case_id=named.case_id,
        ok=False,
        stop_reason=str(error) if failed_by == "store" else f"unexpected {type(error).__name__}: {error}",
        advice=advice,
        failed_by=failed_by,
        traceback="".join(traceback.format_exception(error)),
    )


def recorded(
    results: Iterable[tuple[str, StageResult]], store_path: Path, should_stop: ShouldStop
) -> Iterator[tuple[str, StageResult]]:
    """Pass on the results of `run_stages` or `run_campaign`; failures stay stored until their stage succeeds.

    A store that failed a case is left alone, and a stage that was asked to stop has neither failed nor
    succeeded. Raises StoreError, OSError.
    """
    store = open_for_writing(store_path)
    for stage, result in results:
        if result.ok and not should_stop():
            clear_failure(store, result.case_id, stage)
        elif not result.ok and result.failed_by != "store":
            record_failure(store, Failure(result.case_id, stage, result.stop_reason, result.advice))
        yield stage, result
