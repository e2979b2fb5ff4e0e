"""Where the cases are computed: the options `--workers` and `--scheduler`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from agfb_cli.errors import UsageError
from pipelines.stages.scheduling.pool import ClusterError, Pool

SCHEMES = ("tcp://", "tls://")


def choose_pool(workers: int | None, scheduler: str | None) -> Pool | None:
    """The pool that the options request; None for this process. Raises UsageError if they disagree."""
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


@contextmanager
def settings_of_dask(pool: Pool) -> Iterator[None]:
    """Import Dask and run what uses it; workers of this machine ignore the user's Dask variables.

    Dask reads files of settings when it is imported. Raises ClusterError for those that it cannot use.
    """
    if pool.address is None:
        for name in _variables():
            del os.environ[name]
    try:
        import pipelines.stages.scheduling.campaign  # noqa: F401 - and Dask with it
    except (ImportError, MemoryError, OSError):
        raise
    except Exception as error:
        message = f"Dask cannot use its settings: {type(error).__name__}: {error}"
        raise ClusterError(message, _settings_advice()) from error
    try:
        yield
    except ClusterError as error:
        advice = f"{error.advice}; {_settings_advice()}" if _variables() else error.advice
        raise ClusterError(str(error), advice) from error


def _variables() -> list[str]:
    return sorted(name for name in os.environ if name.startswith("DASK_"))


def _settings_advice() -> str:
    if names := _variables():
        return f"are these variables of the environment right: {', '.join(names)}?"
    return "correct or remove the settings file, or leave out --workers and --scheduler"
