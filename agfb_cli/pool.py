"""Where the cases are computed: the options `--workers` and `--scheduler`."""

from __future__ import annotations

import os

from agfb_cli.errors import UsageError
from pipelines.stages.pool import Pool

SCHEMES = ("tcp://", "tls://")


def choose_pool(workers: int | None, scheduler: str | None) -> Pool | None:
    """The pool that the options ask for; None for this process. Raises UsageError where they disagree."""
    if scheduler is None:
        return None if workers in (None, 1) else Pool(workers)
    if scheduler == "sync":
        if workers not in (None, 1):
            raise UsageError(
                f"--scheduler sync has one process, not {workers}", "leave --scheduler out, or say local"
            )
        return None
    if scheduler == "local":
        return Pool(workers or os.cpu_count() or 1)
    if not scheduler.startswith(SCHEMES):
        raise UsageError(
            f"--scheduler {scheduler}: not sync, local or an address",
            "the address of a Dask scheduler reads tcp://HOST:PORT; `dask scheduler` prints it",
        )
    if workers is not None:
        raise UsageError(
            "--workers belongs to this machine: the cluster has its own workers",
            "leave --workers out, or --scheduler",
        )
    return Pool(address=scheduler)
