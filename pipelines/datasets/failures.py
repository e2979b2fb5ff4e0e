"""Why a stage failed on a case: stored in the case's attributes until that stage succeeds.

A process that was killed cannot say why, and messages on a terminal are gone. So the driver of a run, which
hears of every end, writes it down: one atomic replace of the case's ``zarr.json``. A case without failures
has the bytes with which it was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pipelines.datasets.durable import replace_file, sweep_partials
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.metadata import CASE, FAILURES, METADATA, encode_group, read_group_metadata
from pipelines.datasets.store import Store, case_group


@dataclass(frozen=True)
class Failure:
    """A stage that did not succeed on a case, why, and what to change."""

    case: str
    stage: str
    reason: str
    advice: str


def read_failures(store: Store, case: str) -> list[Failure]:
    """The reason of every stage that failed in its last run on a case, sorted by stage; raises StoreError."""
    failed = read_group_metadata(store.path, case_group(case), CASE).attributes.get(FAILURES, {})
    return [Failure(case, stage, **why) for stage, why in sorted(failed.items())]


def record_failure(store: Store, failure: Failure) -> None:
    """Store a failure, replacing an earlier one of this stage. Raises StoreError, OSError."""
    why = {"reason": failure.reason, "advice": failure.advice}
    _replace(store, failure.case, failure.stage, why)


def clear_failure(store: Store, case: str, stage: str) -> None:
    """Remove the failure of a stage that has succeeded, if there is one. Raises StoreError, OSError."""
    _replace(store, case, stage, None)


def _replace(store: Store, case: str, stage: str, why: Mapping[str, str] | None) -> None:
    group = case_group(case)
    with GroupLock(store.path, group, wait=True):
        metadata = read_group_metadata(store.path, group, CASE)
        sweep_partials(metadata.folder, below=False)
        attributes = dict(metadata.attributes)
        failed = {name: each for name, each in attributes.pop(FAILURES, {}).items() if name != stage}
        if why is not None:
            failed[stage] = why
        if failed:
            attributes[FAILURES] = failed
        if attributes != metadata.attributes:
            content = encode_group(CASE, attributes)
            replace_file(metadata.folder / METADATA, content, durable=store.durable)
