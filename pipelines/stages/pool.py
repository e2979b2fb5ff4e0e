"""Where the tasks of a campaign run; imports nothing, so that the command line can ask for it cheaply."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pool:
    """``workers`` processes on this machine, or the Dask cluster whose scheduler has ``address``
    (``tcp://host:port``), whose workers see the store under the same path.
    """

    workers: int = 1
    address: str | None = None
