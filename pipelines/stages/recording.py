"""How the stages of a run ended, written into its store by the driver as it hears of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from pipelines.datasets.failures import Failure, clear_failure, record_failure
from pipelines.datasets.store import open_for_writing
from pipelines.stages.results import ShouldStop, StageResult


def recorded(
    results: Iterable[tuple[str, StageResult]], store_path: Path, should_stop: ShouldStop
) -> Iterator[tuple[str, StageResult]]:
    """Pass on the results of `run_stages` or `run_campaign`; failures are kept until their stage succeeds.

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
