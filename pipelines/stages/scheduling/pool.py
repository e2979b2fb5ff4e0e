"""Where the tasks of a campaign run; imports little, so that the command line can use it cheaply."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from multiprocessing import forkserver
from types import MappingProxyType

ENVIRONMENT: Mapping[str, str] = MappingProxyType(
    {
        # with Dask's 64 KiB every larger temporary asks the system for new pages: a quarter more time
        "MALLOC_TRIM_THRESHOLD_": str(1 << 28),
        "MALLOC_MMAP_THRESHOLD_": str(1 << 24),
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
)
"""Variables of the environment of workers on this machine."""


@dataclass(frozen=True)
class Pool:
    """``workers`` processes on this machine, or a Dask cluster.

    The scheduler of the cluster has ``address`` (``tcp://host:port``), and its workers see the store
    under the same path.
    """

    workers: int = 1
    address: str | None = None


class ClusterError(RuntimeError):
    """The workers are not available, or are lost. ``advice`` tells the user what to change."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


def prepare_workers(modules: Iterable[str]) -> None:
    """Begin to import what workers on this machine need, once for all of them, and return at once.

    A process without threads imports it while this one does other things; workers are its forks.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(modules))
    before = dict(os.environ)
    for name in before:
        if name.startswith("DASK_"):  # workers of this machine ignore the settings of its site
            del os.environ[name]
    os.environ.update(ENVIRONMENT)
    os.environ["PYTHONPATH"] = os.pathsep.join(map(os.path.abspath, sys.path))
    try:
        forkserver.ensure_running()
    finally:
        os.environ.clear()
        os.environ.update(before)
