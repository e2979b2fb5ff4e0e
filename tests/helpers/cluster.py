"""A Dask cluster on the loopback interface in forked children: a dead worker is replaced at once."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from distributed import Scheduler, Worker

from tests.helpers import forked


@dataclass
class Cluster:
    """A scheduler, its address and its workers."""

    scheduler: ForkServerProcess
    address: str
    folder: Path
    workers: list[ForkServerProcess] = field(default_factory=list)

    def add_worker(self) -> None:
        self.workers.append(forked.fork(_work, self.address, self.folder))

    def kill_worker(self, number: int) -> None:
        """Kill a worker and start another one."""
        victim = self.workers.pop(number)
        victim.kill()
        victim.join()
        self.add_worker()


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A cluster that ends with the context; its files are in ``folder``."""
    file = folder / "address"
    scheduler = forked.fork(_schedule, file)
    while not file.exists():
        assert scheduler.exitcode is None
        time.sleep(0.01)
    made = Cluster(scheduler, file.read_text(), folder)
    try:
        for _ in range(workers):
            made.add_worker()
        yield made
    finally:
        for process in (*made.workers, scheduler):
            process.kill()
            process.join()


def _schedule(file: Path) -> None:
    async def serve() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
            partial = file.with_suffix(".partial")
            partial.write_text(scheduler.address)
            partial.rename(file)
            await scheduler.finished()

    asyncio.run(serve())


def _work(address: str, folder: Path) -> None:
    options = {"host": "127.0.0.1", "nthreads": 1, "memory_limit": 0, "dashboard": False}

    async def serve() -> None:
        async with Worker(address, local_directory=str(folder), **options) as worker:
            await worker.finished()

    asyncio.run(serve())
