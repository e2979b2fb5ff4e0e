"""Run stages over many cases, and record in the store how each ended.

One task is one stage on one case, plain dictionaries in and out. A task is idempotent: run again, it resumes
from the last row that its case committed. `run_stages` runs the tasks one after the other in this process.
Several processes divide the stages that consist of parts: `campaign` asks one of them for the plan of a stage
(`ask_plan`) and gives each free one a part (`run_part`); only dictionaries and strings are exchanged.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.case.reading import NamedCase
from pipelines.datasets.failures import Failure, clear_failure, record_failure
from pipelines.datasets.store import StoreError, open_for_reading, open_for_writing
from pipelines.stages.results import FailedBy, Report, ShouldStop, StageResult
from pipelines.stages.scheduling import registry

if TYPE_CHECKING:
    from pipelines.stages.parts import Part, Plan  # loads the kernels

_SECONDS_BETWEEN_DOUBTS = 1.0  # whether what is computed ahead is needed
_SHARE_OF_DOUBTS = 20.0  # times as long as the answer takes, at least


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
    case, store = NamedCase.from_dict(task["case"]), Path(task["store"])
    begin = time.perf_counter()
    result = _guarded(
        case,
        lambda: _with_caution(
            task["stage"],
            case,
            store,
            registry.stage_function(task["stage"])(case, store, report, should_stop),
            should_stop,
        ),
    )
    assert result is not None
    return result.as_dict() | {"seconds": time.perf_counter() - begin}


def ask_plan(
    task: Mapping[str, Any], plan: Plan, settled: bool, alone: bool, should_stop: ShouldStop
) -> dict[str, Any]:
    """The ``parts`` of a plan that may be computed now; if there are none, the ``result`` of the stage.

    There is no result yet unless the stages before it have ended (``settled``) and none of its own parts is
    being computed (``alone``). A plan that fails has a result.
    """
    case, store = NamedCase.from_dict(task["case"]), Path(task["store"])
    parts: list[Part] = []

    def ask() -> StageResult | None:
        parts.extend(plan.parts(settled))
        if parts or not (settled and alone):
            return None
        return _with_caution(task["stage"], case, store, plan.result(), should_stop)

    result = _guarded(case, ask)
    return {"parts": [asdict(part) for part in parts], "result": None if result is None else result.as_dict()}


def run_part(
    task: Mapping[str, Any], plan: Plan, part: Part, report: Report, should_stop: ShouldStop
) -> dict[str, Any]:
    """Compute one part of a plan; it has a ``result`` if it failed.

    ``stopped``: it was asked to stop, or is not needed any more.
    """
    stop = _UnlessNeeded(plan, part, should_stop) if part.doubtful else should_stop
    job = replace(plan.job, report=report, should_stop=stop, part=part.group)

    def compute() -> None:
        plan.compute(part, job)

    failure = _guarded(NamedCase.from_dict(task["case"]), compute)
    return {"result": None if failure is None else failure.as_dict(), "stopped": stop()}


class _UnlessNeeded:
    """Whether a doubtful part should stop: on request, or when it is not needed any more."""

    def __init__(self, plan: Plan, part: Part, should_stop: ShouldStop) -> None:
        self._plan, self._part, self._should_stop = plan, part, should_stop
        self._needed, self._next = True, 0.0

    def __call__(self) -> bool:
        now = time.monotonic()
        if self._needed and now >= self._next:
            with suppress(StoreError, FileNotFoundError):  # a group takes its turn at this moment
                self._needed = self._plan.is_needed(self._part)
            took = time.monotonic() - now
            self._next = now + took + max(_SECONDS_BETWEEN_DOUBTS, _SHARE_OF_DOUBTS * took)
        return not self._needed or self._should_stop()


def _guarded(case: NamedCase, compute: Callable[[], StageResult | None]) -> StageResult | None:
    """What a computation returns; a failed result if it raises what another case could survive."""
    try:
        return compute()
    except (MemoryError, OSError):
        raise
    except StoreError as error:
        return _failure(case, error, "store", "the other cases of the store are not affected")
    except Exception as error:
        return _failure(case, error, "bug", "this is a bug: please report it with the output of --traceback")


def _with_caution(
    stage: str, case: NamedCase, store: Path, result: StageResult, should_stop: ShouldStop
) -> StageResult:
    if stage not in registry.MOTIONS or not result.ok or should_stop():
        return result
    cautions = (result.caution, _condensation_caution(case, store))
    return replace(result, caution="; ".join(filter(None, cautions)))


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
