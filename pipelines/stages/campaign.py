"""The stages of many cases on the workers of a Dask cluster.

One task is one stage of one case. The stages of a case form a chain, so that curves find the cycles that they
start from; chains of different cases run side by side. A worker that dies costs nothing that was committed:
its task is given to another one, which goes on behind the last row. A task that kills its worker every time
fails its case alone.
"""

from __future__ import annotations

import queue
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dask
from distributed import Client, Event, Future, LocalCluster, Worker, WorkerPlugin, get_worker

from pipelines.case.reading import NamedCase
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult
from pipelines.stages.scheduling import run_task, task

_TOPIC = "agfb-progress"
_STOP = "agfb-stop"
_SECONDS_BETWEEN_REPORTS = 0.5
_SECONDS_BETWEEN_QUESTIONS = 0.5  # whether to stop; each is a message to the scheduler
_SECONDS_BETWEEN_LOOKS = 0.05
_DEATHS = 2  # of workers with the same task, after which it is not tried again
_CONNECTION_TIMEOUT = 15  # s

SETTINGS = {
    "distributed.scheduler.allowed-failures": _DEATHS,
    "distributed.scheduler.work-stealing": False,  # tasks are long: moving them is no gain
    "distributed.worker.memory.terminate": False,
    "distributed.worker.memory.pause": False,
    "distributed.admin.log-format": "%(message)s",
    "logging": {"distributed": "critical", "tornado": "critical"},
}


class ClusterError(RuntimeError):
    """There is no cluster at the address."""


@dataclass(frozen=True)
class Pool:
    """Where tasks run: ``workers`` processes on this machine, or the cluster whose scheduler has ``address``
    (``tcp://host:port``), whose workers see the store under the same path.
    """

    workers: int = 1
    address: str | None = None


def run_campaign(
    stages: Sequence[str],
    cases: Sequence[NamedCase],
    store_path: Path,
    pool: Pool,
    report: Report,
    should_stop: ShouldStop,
) -> Iterator[tuple[str, StageResult]]:
    """Run every stage on every case and yield stage and result as they arrive.

    Each stage of a case waits for the one before. When `should_stop` answers True, running tasks end at their
    next commit and no other is started. Raises ClusterError, and OSError and MemoryError as `run_cases` does.
    """
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SETTINGS))
        client = stack.enter_context(_client(pool, len(cases), stack))
        client.register_plugin(_IgnoreInterrupts(), name="agfb-interrupts")
        events: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        client.subscribe_topic(_TOPIC, lambda event: events.put(event[1]))
        stack.callback(client.unsubscribe_topic, _TOPIC)
        campaign = _Campaign(client, Event(_STOP, client=client), _told(events, report), should_stop)
        campaign.stop.clear()
        campaign.submit(stages, cases, store_path.resolve())
        yield from campaign.results()


def _client(pool: Pool, cases: int, stack: ExitStack) -> Client:
    if pool.address is None:
        cluster = LocalCluster(
            n_workers=min(pool.workers, cases),
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=None,
            silence_logs=50,
        )
        return Client(stack.enter_context(cluster))
    try:
        return Client(pool.address, timeout=_CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Dask scheduler answers at {pool.address}: {error}") from error


class _IgnoreInterrupts(WorkerPlugin):
    """Ctrl-C reaches every process of a terminal: the driver alone decides what it means."""

    def setup(self, worker: Worker) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _told(events: queue.SimpleQueue[dict[str, Any]], report: Report) -> Callable[[], None]:
    """Pass on the progress that arrived since the last call, in the caller's thread."""

    def tell() -> None:
        while not events.empty():
            report(Progress(**events.get()["progress"]))

    return tell


@dataclass
class _Campaign:
    """The tasks under way, in the order in which they were submitted."""

    client: Client
    stop: Event
    tell: Callable[[], None]
    should_stop: ShouldStop
    pending: dict[Future[Any], tuple[str, str]] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)  # case -> stage whose workers died

    def submit(self, stages: Sequence[str], cases: Sequence[NamedCase], store_path: Path) -> None:
        for case in cases:
            before: Future[Any] | None = None
            for stage in stages:
                work = task(stage, case, store_path)
                before = self.client.submit(_on_worker, work, before, pure=False)
                self.pending[before] = (stage, case.case_id)

    def results(self) -> Iterator[tuple[str, StageResult]]:
        stopping = False
        while self.pending:
            self.tell()
            if not stopping and self.should_stop():
                stopping = True
                self.stop.set()
            ended = [future for future in self.pending if future.done()]
            for future in ended:
                stage, case_id = self.pending.pop(future)
                result = self._result(future, stage, case_id)
                self.tell()
                if result is not None:
                    yield stage, result
            if not ended:
                time.sleep(_SECONDS_BETWEEN_LOOKS)

    def _result(self, future: Future[Any], stage: str, case_id: str) -> StageResult | None:
        """What became of a task; None when it was not started because of a request to stop."""
        if future.status == "finished":
            record = future.result()
            return None if record is None else StageResult.from_dict(record)
        if case_id in self.lost:
            reason = f"not computed: {self.lost[case_id]} did not end"
            return StageResult(case_id, False, reason, "run the command again to try once more")
        self.lost[case_id] = stage
        error = future.exception()
        if isinstance(error, OSError | MemoryError):
            raise error
        if type(error).__name__ == "KilledWorker":
            return StageResult(
                case_id,
                False,
                f"the process that computed it died {_DEATHS + 1} times",
                "everything committed is kept; with less memory per case (fewer workers, a coarser grid) run "
                "the command again",
            )
        return StageResult(
            case_id,
            False,
            f"its worker failed: {type(error).__name__}: {error}",
            "every worker needs the same version of agfb and the store under the same path",
        )


def _on_worker(work: Mapping[str, Any], before: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """One task, in the process of a worker; ``before`` is there to be waited for."""
    should_stop = _Asked(Event(_STOP).is_set)
    if should_stop():
        return None
    return run_task(work, _Sender(), should_stop)


class _Asked:
    """An answer that is asked for at most every half second, and stays once it is yes."""

    def __init__(self, question: Callable[[], bool]) -> None:
        self._question, self._answer, self._next = question, False, 0.0

    def __call__(self) -> bool:
        now = time.monotonic()
        if not self._answer and now >= self._next:
            self._answer, self._next = self._question(), now + _SECONDS_BETWEEN_QUESTIONS
        return self._answer


class _Sender:
    """Sends progress to the driver, not more often than somebody can read; the last of a stage always."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        if now < self._next and progress.done != progress.total:
            return
        self._next = now + _SECONDS_BETWEEN_REPORTS
        get_worker().log_event(_TOPIC, {"progress": vars(progress)})
