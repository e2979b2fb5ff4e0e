"""Run the stages of many cases on the workers of a Dask cluster.

One task is a part of a stage, or a whole stage that has no parts. The plan of a stage that has parts is asked
for on a worker as well, and again after each part that has ended (`pipelines.stages.parts`). Stages that need
nothing of each other, and different cases, run side by side. A worker that dies costs nothing that was
committed: its task is given to another one, which goes on behind the last row. A task that kills its worker
every time fails its case alone: Dask itself would suspect every task that waits on the same worker, so tasks
are handed out here, one to a worker.
"""

from __future__ import annotations

import json
import logging
import math
import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import dask
from distributed import Client, Event, Future, KilledWorker, LocalCluster, Worker, WorkerPlugin, get_worker
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError

from pipelines.case.reading import NamedCase
from pipelines.datasets.watching import totals, watch
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult
from pipelines.stages.scheduling.agenda import Agenda, Chain, Deaths, Work
from pipelines.stages.scheduling.pool import ENVIRONMENT, ClusterError, Pool, prepare_workers
from pipelines.stages.scheduling.registry import modules, plan_function
from pipelines.stages.scheduling.tasks import ask_plan, run_part, run_task

if TYPE_CHECKING:
    from pipelines.stages.parts import Plan  # loads the kernels

_SECONDS_BETWEEN_REPORTS = 0.5
_SECONDS_BETWEEN_QUESTIONS = 0.5  # whether to stop; each is a message to the scheduler
_SECONDS_BETWEEN_LOOKS = 0.05
_SECONDS_BETWEEN_COUNTS = 0.5  # of the workers; each is a message to the scheduler
_DEATHS = 3  # of workers with the same task, without a point committed in between
_STARTS = 3  # of the workers on this machine
_WITHOUT_WORKERS = 120  # s
_CONNECTION_TIMEOUT = 15  # s
_PLANS = 8  # that a worker keeps, each with its machine

SETTINGS: Mapping[str, Any] = MappingProxyType(
    {
        "distributed.scheduler.allowed-failures": 0,  # a dead worker's task comes back here at once
        **{f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in ENVIRONMENT.items()},
        "distributed.worker.multiprocessing-method": "forkserver",
        # what Dask watches for a dashboard that is off took 7 % of two cores from their cases
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "5s",
        "logging": {"distributed": "critical", "tornado": "critical", "asyncio": "critical"},
    }
)


def run_campaign(
    stages: Sequence[str],
    cases: Sequence[NamedCase],
    store_path: Path,
    pool: Pool,
    report: Report,
    should_stop: ShouldStop,
) -> Iterator[tuple[str, StageResult]]:
    """Run every stage on every case and yield stage and result as they arrive.

    When `should_stop` answers True, running tasks end at their next commit and no other is started; a stage
    that has not ended has no result. Raises ClusterError, and OSError and MemoryError as `run_stages` does.
    """
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_settings(pool)))
        for name, level in SETTINGS["logging"].items():  # what goes wrong is told as a ClusterError
            logging.getLogger(name).setLevel(level.upper())
        stack.enter_context(_lost_connections(pool))
        if pool.address is None:
            prepare_workers(modules(stages))
        client = _client(pool, should_stop, stack)
        if client is None:
            return
        name = f"agfb-{uuid4().hex}"  # other campaigns on the cluster have their own progress and stop alone
        events: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        client.subscribe_topic(name, lambda event: events.put(event[1]))
        stack.callback(client.unsubscribe_topic, name)
        stop = Event(name, client=client)
        agenda = Agenda([Chain(case, list(stages)) for case in cases])
        yield from _Campaign(
            client, pool, stop, _event_reporter(events, report), should_stop, store_path.resolve(), agenda
        ).results()


def _settings(pool: Pool) -> dict[str, Any]:
    """Dask's settings: a cluster uses those of its site; workers of this machine only Dask's defaults."""
    site = {} if pool.address is not None else dask.config.merge(*dask.config.defaults)
    return {**site, **SETTINGS}


def _advice(pool: Pool) -> str:
    resumes = "committed points are kept; the same command resumes"
    if pool.address is None:
        return f"choose fewer --workers, or leave the option out: memory or processes ran short; {resumes}"
    return f"`dask scheduler` prints its address, `dask worker ADDRESS` adds a worker; {resumes}"


@contextmanager
def _lost_connections(pool: Pool) -> Iterator[None]:
    """Turn a lost Dask connection into a ClusterError.

    To Dask a lost connection, or one that is not made in time, is an error of the operating system;
    unlike errors of the disk it has no number.
    """
    lost = "the connection to the cluster is lost" if pool.address else "the workers are lost"
    try:
        yield
    except FutureCancelledError as error:  # nothing else cancels what is still asked for
        raise ClusterError(f"{lost}: {error}", _advice(pool)) from error
    except OSError as error:
        if error.errno is not None and not isinstance(error, CommClosedError):
            raise
        raise ClusterError(f"{lost}: {error}", _advice(pool)) from error


def _client(pool: Pool, should_stop: ShouldStop, stack: ExitStack) -> Client | None:
    """The cluster; None if it was asked to stop before it was connected."""
    if pool.address is not None:
        client = _connected(pool, should_stop)
        return None if client is None else stack.enter_context(client)
    client = stack.enter_context(Client(stack.enter_context(_own_cluster(pool, pool.workers))))
    client.register_plugin(_IgnoreInterrupts(), name="agfb-interrupts")
    return client


def _own_cluster(pool: Pool, workers: int) -> LocalCluster:
    """Workers on this machine. One that dies during the start is no reason to give up."""
    _wait_for_imports()
    for attempt in range(1, _STARTS + 1):
        try:
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                # Dask would take the port of dashboards for what it serves without one
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                memory_limit=None,
                silence_logs=50,
            )
        except Exception as error:  # Dask wraps whatever it was
            if attempt == _STARTS:
                raise ClusterError(f"the workers do not start: {error}", _advice(pool)) from error
    raise AssertionError


def _wait_for_imports() -> None:
    """Until workers can be made: on the first run kernels are compiled, and Dask would not wait so long."""
    first = multiprocessing.get_context("forkserver").Process(target=int)
    first.start()
    first.join()


def _connected(pool: Pool, should_stop: ShouldStop) -> Client | None:
    """The cluster at an address. Raises ClusterError if there is none.

    A server that is not Dask's may leave a connection open for ever: another thread waits for it.
    """
    made: queue.SimpleQueue[Client | Exception] = queue.SimpleQueue()
    threading.Thread(target=_connect, args=(pool.address, made), daemon=True).start()
    end = time.monotonic() + _CONNECTION_TIMEOUT + 1  # Dask itself says more about the reason
    while not should_stop():
        with suppress(queue.Empty):
            found = made.get(timeout=_SECONDS_BETWEEN_LOOKS)
            if isinstance(found, Client):
                return found
            why = f"no Dask scheduler answers at {pool.address}: {type(found).__name__}: {found}"
            raise ClusterError(why, _advice(pool)) from found
        if time.monotonic() > end:
            raise ClusterError(
                f"no Dask scheduler answers at {pool.address} within {_CONNECTION_TIMEOUT} s", _advice(pool)
            )
    return None


def _connect(address: str, made: queue.SimpleQueue[Client | Exception]) -> None:
    try:
        made.put(Client(address, timeout=_CONNECTION_TIMEOUT))
    except Exception as error:  # also what its settings bring about
        made.put(error)


class _IgnoreInterrupts(WorkerPlugin):
    """Let workers ignore Ctrl-C, which reaches every process of a terminal: the driver decides for them."""

    def setup(self, worker: Worker) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _event_reporter(events: queue.SimpleQueue[dict[str, Any]], report: Report) -> Callable[[], None]:
    """Pass on the progress that arrived since the last call, in the caller's thread."""

    def report_events() -> None:
        while not events.empty():
            report(Progress(**events.get()["progress"]))

    return report_events


@dataclass(frozen=True)
class _Running:
    """A task on its worker."""

    future: Future[Any]
    work: Work


@dataclass
class _Campaign:
    """One task at a time on every worker, so that it is known with which task a worker died."""

    client: Client
    pool: Pool
    stop: Event
    report_events: Callable[[], None]
    should_stop: ShouldStop
    store_path: Path
    agenda: Agenda
    running: dict[str, _Running] = field(default_factory=dict)  # by the address of the worker
    woken: threading.Event = field(default_factory=threading.Event)

    def results(self) -> Iterator[tuple[str, StageResult]]:
        stopping, counted, present = False, -math.inf, time.monotonic()
        while self.running or (self.agenda.chains and not stopping):
            self.report_events()
            if not stopping and self.should_stop():
                stopping = True
                self.stop.set()
            some_ended = any(run.future.done() for run in self.running.values())
            if some_ended or time.monotonic() - counted > _SECONDS_BETWEEN_COUNTS:
                counted, workers = time.monotonic(), self._workers()
                present = counted if workers else present
                for address in [each for each in self.running if self._has_ended(each, workers)]:
                    yield from self._end(self.running.pop(address))
                if not stopping:
                    self._assign(workers - set(self.running))
            if time.monotonic() - present > _WITHOUT_WORKERS:
                raise ClusterError(f"there has been no worker for {_WITHOUT_WORKERS} s", _advice(self.pool))
            self.woken.wait(_SECONDS_BETWEEN_LOOKS)
            self.woken.clear()

    def _workers(self) -> set[str]:
        """The addresses of all workers. Raises TimeoutError if the scheduler does not respond."""
        scheduler: Any = self.client.scheduler
        return set(self.client.sync(scheduler.ncores, callback_timeout=_CONNECTION_TIMEOUT))

    def _assign(self, free: set[str]) -> None:
        for address in sorted(free):
            if (work := self.agenda.begin_next()) is None:
                return
            message = work.message(self.store_path)
            future = self.client.submit(_on_worker, message, self.stop.name, pure=False, workers=[address])
            future.add_done_callback(lambda _: self.woken.set())
            self.running[address] = _Running(future, work)

    def _has_ended(self, address: str, workers: set[str]) -> bool:
        return self.running[address].future.done() or address not in workers

    def _end(self, run: _Running) -> Iterator[tuple[str, StageResult]]:
        """Results that follow from a task that has ended; one whose worker died waits again."""
        self.report_events()
        work = run.work
        answer = _answer(run.future)
        if answer is not None:
            yield from self.agenda.end(work, answer)
            return
        error = _error(run.future)
        if isinstance(error, OSError | MemoryError):
            raise error
        if error is None and self._deaths(work) < _DEATHS:
            self.agenda.again(work)
            return
        yield from self.agenda.give_up(work, _lost(work.chain.named.case_id, error))

    def _deaths(self, work: Work) -> int:
        """How many workers have died with a task since it committed its newest point, including this one.

        Workers that live shorter than their task are no reason to give up.
        """
        states = [state for state in watch(self.store_path) if state.case == work.chain.named.case_id]
        if work.part is not None:
            states = [state for state in states if state.group == work.part["group"]]
        committed, known = totals(states).points, work.stage.deaths.get(work.name, Deaths())
        deaths = Deaths(known.count + 1 if committed <= known.committed else 1, committed)
        work.stage.deaths[work.name] = deaths
        return deaths.count


def _answer(future: Future[Any]) -> dict[str, Any] | None:
    """What a task returned, nothing if it was asked to stop before it began; None if it did not end.

    A result stays with its worker: one that died after it had computed it never gives it, and Dask would wait
    for that worker for ever.
    """
    if future.status != "finished":
        return None
    try:
        found: dict[str, Any] = future.result(timeout=_CONNECTION_TIMEOUT)
    except TimeoutError:
        return None
    return found


def _error(future: Future[Any]) -> BaseException | None:
    """The error that a task raised; None if its worker died with it."""
    if future.status != "error":
        future.cancel()
        return None
    error = future.exception()
    return None if isinstance(error, KilledWorker) else error


def _lost(case_id: str, error: BaseException | None) -> StageResult:
    if error is None:
        return StageResult(
            case_id,
            False,
            f"the process that computed it died {_DEATHS} times",
            "everything committed is kept; with more memory per case (fewer workers, a coarser grid) run the "
            "command again",
        )
    return StageResult(
        case_id,
        False,
        f"its worker failed: {type(error).__name__}: {error}",
        "every worker needs the same version of agfb and the store under the same path",
    )


def _on_worker(work: Mapping[str, Any], campaign: str) -> dict[str, Any]:
    """One task in the process of a worker; nothing if it was asked to stop before it began."""
    should_stop = _Asked(Event(campaign).is_set)
    return {} if should_stop() else carry_out(work, campaign, _Sender(campaign), should_stop)


def carry_out(
    work: Mapping[str, Any], campaign: str, report: Report, should_stop: ShouldStop
) -> dict[str, Any]:
    """Carry out one task; its answer, with the ``seconds`` that it took."""
    begin = time.perf_counter()
    if "settled" in work:
        plan = _plan(campaign, work["stage"], json.dumps(work["case"]), work["store"])
        answer = ask_plan(work, plan, work["settled"], work["alone"], should_stop)
    elif "part" in work:
        from pipelines.stages.parts import Part  # loads the kernels

        plan = _plan(campaign, work["stage"], json.dumps(work["case"]), work["store"])
        answer = run_part(work, plan, Part(**work["part"]), report, should_stop)
    else:
        answer = {"result": run_task(work, report, should_stop)}
    return answer | {"seconds": time.perf_counter() - begin}


@lru_cache(maxsize=_PLANS)
def _plan(campaign: str, stage: str, case: str, store: str) -> Plan:
    """The plan of a stage of a case, kept by a worker for the next part of it."""
    named = NamedCase.from_dict(json.loads(case))
    should_stop = _Asked(Event(campaign).is_set)
    return plan_function(stage)(named, Path(store), _ignore, should_stop)


def _ignore(progress: Progress) -> None:
    """A plan reports nothing; its parts do."""


class _Asked:
    """A cache of `should_stop`: asked at most twice a second, and kept once it is true."""

    def __init__(self, question: Callable[[], bool]) -> None:
        self._question, self._answer, self._next = question, False, 0.0

    def __call__(self) -> bool:
        now = time.monotonic()
        if not self._answer and now >= self._next:
            self._answer, self._next = self._question(), now + _SECONDS_BETWEEN_QUESTIONS
        return self._answer


class _Sender:
    """Sends progress to the driver at a readable rate; the last report of a stage always."""

    def __init__(self, topic: str) -> None:
        self._topic, self._next = topic, 0.0

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        if now < self._next and progress.done != progress.total:
            return
        self._next = now + _SECONDS_BETWEEN_REPORTS
        get_worker().log_event(self._topic, {"progress": vars(progress)})
