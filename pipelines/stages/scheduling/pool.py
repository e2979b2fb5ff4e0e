"""Where the tasks of a campaign run; imports nothing, so that the command line can use it cheaply."""

from __future__ import annotations

from dataclasses import dataclass


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
