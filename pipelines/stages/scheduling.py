"""Running one stage over many cases: one task is one case, plain dictionaries in and out.

A task is idempotent: run again, it goes on from the last row that its case committed. `run_stages` runs the
tasks one after the other in this process; because nothing but dictionaries and strings enters or leaves
`run_task`, `pipelines.stages.campaign` hands the same tasks to other processes.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from pipelines.case.reading import NamedCase
from pipelines.datasets.store import StoreError, open_for_reading
from pipelines.stages.results import FailedBy, Report, ShouldStop, StageResult

STAGES = (
    "linearize",
    "criticals",
    "continue_cycles",
    "track_pd",
    "track_ns",
    "track_folds",
    "bifurcation_set",
    "refine",
    "transient",
    "continue_tori",
    "calibrate",
)


MOTIONS = frozenset(
    {
        "continue_cycles",
        "track_pd",
        "track_ns",
        "track_folds",
        "bifurcation_set",
        "transient",
        "continue_tori",
    }
)
"""Stages that compute motions of the condensed rotor; their results say how far it is off."""


class Stage(Protocol):
    """The signature of every stage function."""

    def __call__(
        self, case: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
    ) -> StageResult:
        """Compute one case into its groups of the store."""


def run_stages(
    stages: Sequence[str],
    cases: Sequence[NamedCase],
    store_path: Path,
    report: Report,
    should_stop: ShouldStop,
) -> Iterator[tuple[str, StageResult]]:
    """Run each of `stages` (of `STAGES`) on every case in order; yield stage and result as soon as known.

    A case that raises yields a failed result and the next case is run; only what no case could survive (a
    full disk, no memory) is raised. When `should_stop` answers True no further case is started.
    """
    for stage in stages:
        for case in cases:
            if should_stop():
                return
            record = run_task(task(stage, case, store_path), report, should_stop)
            yield stage, StageResult.from_dict(record)


def task(stage: str, case: NamedCase, store_path: Path) -> dict[str, Any]:
    """The plain dictionary that says what `run_task` has to do."""
    return {"stage": stage, "case": case.as_dict(), "store": str(store_path)}


def run_task(task: Mapping[str, Any], report: Report, should_stop: ShouldStop) -> dict[str, Any]:
    """Carry out one task and return `StageResult.as_dict`."""
    case, begin = NamedCase.from_dict(task["case"]), time.perf_counter()
    try:
        store = Path(task["store"])
        result = stage_function(task["stage"])(case, store, report, should_stop)
        if task["stage"] in MOTIONS and result.ok and not should_stop():
            result = replace(result, caution=_condensation_caution(case, store))
    except (MemoryError, OSError):
        raise
    except StoreError as error:
        result = _failure(case, error, "store", "the other cases of the store are not affected")
    except Exception as error:
        result = _failure(
            case, error, "bug", "this is a bug: please report it with the output of --traceback"
        )
    return result.as_dict() | {"seconds": time.perf_counter() - begin}


def _condensation_caution(case: NamedCase, store: Path) -> str:
    from pipelines.stages.condensed_modes import condensation_caution  # loads the kernels

    return condensation_caution(case, open_for_reading(store))


def stage_function(stage: str) -> Stage:
    """The function of a stage, imported when it is first needed: the import compiles or loads the kernels."""
    if stage not in STAGES:
        raise ValueError(f"stage {stage!r} is not one of {', '.join(STAGES)}")
    function: Stage = getattr(import_module(f"pipelines.stages.{stage}"), stage)
    return function


def _failure(case: NamedCase, error: Exception, failed_by: FailedBy, advice: str) -> StageResult:
    return StageResult(
        case_id=case.case_id,
        ok=False,
        stop_reason=str(error) if failed_by == "store" else f"unexpected {type(error).__name__}: {error}",
        advice=advice,
        failed_by=failed_by,
        traceback="".join(traceback.format_exception(error)),
    )
