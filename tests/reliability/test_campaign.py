"""Cases side by side: the same bytes as one after the other, whatever dies on the way."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import pytest
from distributed import Client, wait
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.integrity import verify
from pipelines.stages.scheduling import campaign
from pipelines.stages.scheduling.agenda import Agenda, Chain, StageRun, Work
from pipelines.stages.scheduling.pool import ClusterError, Pool
from pipelines.stages.scheduling.tasks import task
from tests.helpers import forked
from tests.helpers.cluster import cluster as small_cluster
from tests.helpers.poison import POISONED
from tests.helpers.tiny import CONFIG, ROOT, TINY, tiny_case
from tests.helpers.trees import compare_trees

DISPLACEMENTS = (0.05, 0.1, 0.2)
OVERRIDES = (
    *TINY,
    f"sweep.excitation.displacement={list(DISPLACEMENTS)}",
    "continue_cycles.range=[1.05, 1.5]",
    "continue_cycles.max_points=5",
)
CASES = [f"displacement={value:g}" for value in DISPLACEMENTS]
WORDS = ["continue", str(CONFIG), "-o", "run.zarr"]
WORDS += [word for override in OVERRIDES for word in ("--set", override)]
PAIR = [*WORDS, "--workers", "2"]


def points(folder: Path) -> list[int]:
    """Committed points of every case."""
    found = []
    for case in CASES:
        metadata = folder / "run.zarr" / "cases" / case / "cycles/b000/zarr.json"
        known = metadata.exists()
        found.append(json.loads(metadata.read_text())["attributes"]["n_points"] if known else 0)
    return found


def start(
    folder: Path, words: Sequence[str], count: int, prelude: Callable[[], None] | None = None
) -> ForkServerProcess:
    """A run, after ``prelude()``, that has committed so many points."""
    process = forked.start(folder, words, prelude)
    forked.wait_for(lambda: sum(points(folder)) >= count, process)
    assert process.exitcode is None, forked.messages(folder)
    return process


def finish(folder: Path) -> None:
    """What is left, in one process."""
    assert forked.run(folder, WORDS) == 0, forked.messages(folder)


def assert_same(first: Path, second: Path) -> None:
    assert compare_trees(first / "run.zarr" / "cases", second / "run.zarr" / "cases") == []
    assert verify(second / "run.zarr") == []


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("alone")
    finish(folder)
    return folder


def test_two_processes_write_the_same_bytes(tmp_path: Path, alone: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "agfb_cli", *PAIR, "--json"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert sorted(result["case_id"] for result in results) == sorted(CASES)
    assert all(result["seconds"] > 0.0 for result in results)
    assert_same(alone, tmp_path)


def test_workers_keep_freed_memory_and_one_thread() -> None:
    """What Dask sets otherwise costs a quarter of the time."""
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(dict(campaign.SETTINGS)))
        client = campaign._client(Pool(workers=1), lambda: False, stack)
        assert client is not None
        (environment,) = client.run(lambda: dict(os.environ)).values()
        (watched,) = client.run(lambda: dask.config.get("distributed.worker.profile.enabled")).values()
    assert int(environment["MALLOC_TRIM_THRESHOLD_"]) >= 1 << 26
    assert int(environment["MALLOC_MMAP_THRESHOLD_"]) >= 1 << 22
    assert environment["OPENBLAS_NUM_THREADS"] == environment["OMP_NUM_THREADS"] == "1"
    assert not watched


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_stopped_campaign_goes_on(tmp_path: Path, alone: Path, number: int, code: int) -> None:
    process = start(tmp_path, PAIR, 2)
    os.kill(process.pid, number)
    assert forked.finish(process) == code, forked.messages(tmp_path)
    assert "To resume" in forked.messages(tmp_path)
    assert "Traceback" not in forked.messages(tmp_path)
    assert sum(points(tmp_path)) < 5 * len(CASES), "it stopped before the end"
    finish(tmp_path)
    assert_same(alone, tmp_path)


def test_a_killed_driver_leaves_no_worker_and_a_store_that_goes_on(tmp_path: Path, alone: Path) -> None:
    process = start(tmp_path, PAIR, 2)
    process.kill()
    forked.finish(process)
    end = time.monotonic() + 60.0
    # the orphaned workers notice that their driver is gone, and give their cases free
    while (code := forked.run(tmp_path, WORDS)) == 4 and time.monotonic() < end:
        assert "is being written by" in forked.messages(tmp_path)
    assert code == 0, forked.messages(tmp_path)
    assert_same(alone, tmp_path)


def test_a_case_that_kills_its_process_fails_alone(tmp_path: Path, alone: Path) -> None:
    assert forked.run(tmp_path, PAIR, poison_workers) == 3, forked.messages(tmp_path)
    why = f"continue-cycles {POISONED}: failed: the process that computed it died 3 times"
    assert why in forked.messages(tmp_path)
    assert points(tmp_path) == [5 if case != POISONED else 0 for case in CASES]
    assert why in status(tmp_path)
    finish(tmp_path)  # without the poison
    assert "failed" not in status(tmp_path)
    assert_same(alone, tmp_path)


def poison_workers() -> None:
    preload = {"distributed.worker.preload": [str(ROOT / "tests/helpers/poison.py")]}
    campaign.SETTINGS = campaign.SETTINGS | preload


def status(folder: Path) -> str:
    done = CliRunner().invoke(app, ["status", str(folder / "run.zarr")])
    assert done.exit_code == 0
    return done.stdout


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a scheduler on the loopback interface, and its two workers."""
    with ExitStack() as stack:
        environment = os.environ | {"PYTHONPATH": str(ROOT)}

        def process(name: str, *words: str) -> subprocess.Popen[bytes]:
            log = stack.enter_context((tmp_path / "cluster.log").open("ab"))
            command = [sys.executable, "-m", f"distributed.cli.{name}", *words]
            started = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
            stack.callback(started.wait)
            stack.callback(started.kill)
            return started

        file = tmp_path / "scheduler.json"
        common = ("--scheduler-file", str(file), "--no-dashboard", "--host", "127.0.0.1")
        process("dask_scheduler", *common, "--port", "0")
        single = ("--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path))
        workers = [process("dask_worker", *common, *single) for _ in range(2)]
        while not file.exists():
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], workers


def test_a_worker_of_a_cluster_is_killed(
    tmp_path: Path, alone: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = cluster
    folder = tmp_path / "driver"
    process = start(folder, [*WORDS, "--scheduler", address], random.Random(3).randint(2, 4))
    workers[0].kill()
    assert forked.finish(process) == 0, forked.messages(folder)
    assert_same(alone, folder)


def test_campaigns_on_one_cluster_leave_each_other_alone(tmp_path: Path, alone: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    with small_cluster(tmp_path, 2) as machines:
        words = [*WORDS, "--scheduler", machines.address]
        running = start(first, words, 1)
        stopped = start(second, [*words, "--case", CASES[0]], 1)  # behind the first case of the other one
        stopped.terminate()
        assert forked.finish(stopped) == 143, forked.messages(second)
        assert forked.finish(running) == 0, forked.messages(first)
    assert_same(alone, first)


def test_a_result_that_died_with_its_worker_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker that stands still is as one whose death is not yet noticed: Dask would wait for ever."""
    monkeypatch.setattr(campaign, "_CONNECTION_TIMEOUT", 1)
    with small_cluster(tmp_path, 1) as machines, Client(machines.address) as client:
        client.wait_for_workers(1)
        (address,) = client.nthreads()
        future = client.submit(dict, pure=False, workers=[address])
        wait(future)
        assert campaign._answer(future) == {}
        assert machines.workers[0].pid is not None
        os.kill(machines.workers[0].pid, signal.SIGSTOP)
        assert campaign._answer(future) is None


def test_killed_drivers_and_workers(tmp_path: Path, alone: Path, kills: int) -> None:
    """Every second kill is one of the driver. A task of a dead driver goes on, and its case is locked until
    it has ended; a case whose workers were killed three times has failed until it is computed again.
    """
    moments, left, folders, codes = random.Random(5), kills, 0, Counter[int]()
    with small_cluster(tmp_path, 2) as machines:
        while left:
            folder, code = tmp_path / f"killed{folders}", None
            folders += 1
            while code != 0:
                process = forked.start(folder, [*WORDS, "--scheduler", machines.address])
                while left and process.exitcode is None:
                    wanted = sum(points(folder)) + moments.choice((0, 1, 1, 2))
                    forked.wait_for(lambda at=folder, wanted=wanted: sum(points(at)) >= wanted, process)
                    time.sleep(moments.uniform(0.0, 0.3))
                    if process.exitcode is None:
                        if left % 2 == 0:
                            process.kill()
                            break
                        machines.kill_worker(moments.randrange(2))
                        left -= 1
                code = forked.finish(process)
                left -= code == -signal.SIGKILL  # and not where it ended just before
                codes[code] += 1
                told = forked.messages(folder)
                assert code in (0, 3, 4, -signal.SIGKILL), told
                assert code != 4 or "is being written by" in told
                assert code != 3 or "the process that computed it died 3 times" in told
            assert_same(alone, folder)
    assert codes[-signal.SIGKILL] == kills // 2


def test_the_scheduler_dies(tmp_path: Path, alone: Path) -> None:
    folder = tmp_path / "driver"
    with small_cluster(tmp_path, 1) as machines:
        process = start(folder, [*WORDS, "--scheduler", machines.address], 2, be_impatient)
        machines.scheduler.kill()
        assert forked.finish(process) == 5, forked.messages(folder)
    assert "the connection to the cluster is lost" in forked.messages(folder)
    finish(folder)
    assert_same(alone, folder)


def test_no_cluster_at_the_address(tmp_path: Path) -> None:
    words = [*WORDS, "--scheduler", "tcp://127.0.0.1:9"]
    assert forked.run(tmp_path, words, be_impatient) == 5
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in forked.messages(tmp_path)
    assert "Traceback" not in forked.messages(tmp_path)


def test_a_server_that_is_not_dask(tmp_path: Path) -> None:
    with silent_server() as address:
        assert forked.run(tmp_path, [*WORDS, "--scheduler", address], be_impatient) == 5
    assert f"no Dask scheduler answers at {address}" in forked.messages(tmp_path)
    assert "Traceback" not in forked.messages(tmp_path)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_the_first_signal_ends_what_waits_for_a_scheduler(tmp_path: Path, number: int, code: int) -> None:
    with silent_server() as address:
        process = forked.start(tmp_path, [*WORDS, "--scheduler", address])
        forked.wait_for(lambda: (tmp_path / "run.zarr").exists(), process)
        time.sleep(1.0)
        begin = time.monotonic()
        os.kill(process.pid, number)
        assert forked.finish(process) == code, forked.messages(tmp_path)
        assert time.monotonic() - begin < campaign._CONNECTION_TIMEOUT - 3.0
    assert "To resume" in forked.messages(tmp_path)


@contextmanager
def silent_server() -> Iterator[str]:
    """The address of a server that takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    "variables",
    [
        {"COMM__REQUIRE_ENCRYPTION": "True", "WORKER__PRELOAD": "nowhere"},
        {"COMM__TIMEOUTS__CONNECT": "1ms"},
        {"COMM__TIMEOUTS__CONNECT": "banana", "COMM__OFFLOAD": "banana"},
    ],
    ids=lambda variables: "-".join(variables),
)
def test_workers_of_this_machine_need_no_settings_of_its_site(
    tmp_path: Path, variables: dict[str, str]
) -> None:
    done = linearize(tmp_path, {f"DASK_DISTRIBUTED__{name}": text for name, text in variables.items()})
    assert done.returncode == 0, done.stderr


def test_a_variable_that_dask_cannot_read_is_named(tmp_path: Path) -> None:
    variable = "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT"
    done = linearize(tmp_path, {variable: "banana"}, "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 5
    assert "no Dask scheduler answers" in done.stderr
    assert variable in done.stderr
    assert "bug" not in done.stderr


def test_a_malformed_file_of_settings_is_named(tmp_path: Path) -> None:
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "dask.yaml").write_text("distributed: [ : }")
    variables = {"DASK_CONFIG": str(tmp_path / "site")}
    done = linearize(tmp_path, variables, "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 5
    assert str(tmp_path / "site" / "dask.yaml") in done.stderr
    assert "DASK_CONFIG" in done.stderr
    assert linearize(tmp_path, variables).returncode == 0


def linearize(folder: Path, variables: dict[str, str], *where: str) -> subprocess.CompletedProcess[str]:
    words = ["linearize", *WORDS[1:], *(where or ("--workers", "2"))]
    return subprocess.run(
        [sys.executable, "-m", "agfb_cli", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | variables,
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )


@pytest.mark.parametrize(("failures", "started"), [(2, True), (3, False)])
def test_workers_that_die_while_they_start(
    monkeypatch: pytest.MonkeyPatch, failures: int, started: bool
) -> None:
    left = [RuntimeError("Nanny failed to start.")] * failures

    def make(**options: object) -> str:
        if left:
            raise left.pop()
        return "cluster"

    monkeypatch.setattr(campaign, "LocalCluster", make)
    if started:
        assert campaign._own_cluster(Pool(2), 2) == "cluster"
        return
    with pytest.raises(ClusterError, match="the workers do not start: Nanny failed") as caught:
        campaign._own_cluster(Pool(2), 2)
    assert "--workers" in caught.value.advice
    assert "--scheduler" not in caught.value.advice


def test_only_deaths_without_progress_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    committed = iter([4, 7, 7, 8, 8, 8])
    monkeypatch.setattr(campaign, "watch", lambda path: [])
    monkeypatch.setattr(campaign, "totals", lambda states: SimpleNamespace(points=next(committed)))
    work = Work(Chain(tiny_case(), ["linearize"]), StageRun("linearize"))
    nothing: Any = None
    run = campaign._Campaign(nothing, Pool(2), nothing, nothing, nothing, tmp_path, Agenda([]))
    assert [run._deaths(work) for _ in range(6)] == [1, 1, 2, 1, 2, 3]


def test_every_free_worker_gets_a_case_of_its_own(tmp_path: Path) -> None:
    handed_out = []

    def submit(function: object, work: object, stop: str, *, pure: bool, workers: list[str]) -> Any:
        handed_out.append((workers, work))
        return SimpleNamespace(add_done_callback=lambda call: None)

    cases = [tiny_case(f"excitation.displacement={value}") for value in (0.1, 0.2, 0.3)]
    client: Any = SimpleNamespace(submit=submit)
    stop: Any = SimpleNamespace(name="stop")
    nothing: Any = None
    agenda = Agenda([Chain(case, ["linearize"]) for case in cases])
    run = campaign._Campaign(client, Pool(2), stop, nothing, nothing, tmp_path, agenda)
    run._assign({"first", "second"})
    expected = [task("linearize", case, tmp_path) for case in cases[:2]]
    assert handed_out == [(["first"], expected[0]), (["second"], expected[1])]
    assert [run.running[name].work.chain.named for name in ("first", "second")] == cases[:2]
    assert [bool(chain.begun) for chain in agenda.chains] == [True, True, False]


def test_the_port_of_dashboards_stays_free() -> None:
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(campaign._settings(Pool(1))))
        cluster = stack.enter_context(campaign._own_cluster(Pool(1), 1))
        assert cluster.scheduler.http_server.port != 8787


def be_impatient() -> None:
    """A second, where an absent scheduler is waited for."""
    campaign._CONNECTION_TIMEOUT = 1
    dask.config.set({"distributed.comm.timeouts.connect": "1s"})
