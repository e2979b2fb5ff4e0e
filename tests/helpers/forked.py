"""The program in forked children of a server that has imported everything: a start costs milliseconds.

What kills them then hits their work, and not the imports.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path

from agfb_cli.main import app

PRELOADED = (
    "tests.helpers.forked",
    "pipelines.stages.cycles.continue_cycles",
    "pipelines.stages.transients.transient",
)
MESSAGES = "messages.txt"
LONGEST = 150.0  # s that a child may take


def context() -> ForkServerContext:
    """Where children are made. The first call in a test run starts the server."""
    found = multiprocessing.get_context("forkserver")
    found.set_forkserver_preload([*PRELOADED, "distributed", "pipelines.stages.scheduling.campaign"])
    return found


def start(
    folder: Path, words: Sequence[str], prelude: Callable[..., None] | None = None, *arguments: object
) -> ForkServerProcess:
    """`agfb WORDS` in a folder, after ``prelude(*arguments)``; its stderr is added to the file MESSAGES."""
    folder.mkdir(exist_ok=True)
    (folder / MESSAGES).touch()  # a child may be killed before it writes any
    return fork(_run, folder, list(words), prelude, arguments)


def fork(function: Callable[..., None], *arguments: object) -> ForkServerProcess:
    """A child that calls a function."""
    process = context().Process(target=function, args=arguments)
    process.start()
    return process


def finish(process: ForkServerProcess) -> int:
    """Wait for a child; its exit code, or minus the signal that ended it."""
    process.join(LONGEST)
    if process.exitcode is None:
        process.kill()
        raise TimeoutError(f"a child did not end within {LONGEST} s")
    return process.exitcode


def run(
    folder: Path, words: Sequence[str], prelude: Callable[..., None] | None = None, *arguments: object
) -> int:
    return finish(start(folder, words, prelude, *arguments))


def messages(folder: Path) -> str:
    """What the children of a folder have written on stderr."""
    return (folder / MESSAGES).read_text()


def wait_for(reached: Callable[[], bool], process: ForkServerProcess) -> None:
    """Until it is so, or the process has ended."""
    end = time.monotonic() + LONGEST
    while process.exitcode is None and not reached():
        assert time.monotonic() < end, "nothing happens"
        time.sleep(0.001)


def kill_at_random(
    parent: Path,
    words: Sequence[str],
    committed: Callable[[Path], int],
    kills: int,
    further: Sequence[int],
    pause: float,
) -> Iterator[tuple[Path, list[int]]]:
    """Kill one run after the other, each until it is finished; yields its folder, and what was committed at
    each kill.

    A process is killed when so many ``further`` units as are drawn have been committed, and a part of
    ``pause`` [s] has passed.
    """
    moments, left, folders = random.Random(20), kills, 0
    while left:
        folder, at_kills, code = parent / f"killed{folders}", list[int](), None
        folders += 1
        while code != 0:
            process = start(folder, words)
            if left:
                wanted = committed(folder) + moments.choice(further)
                wait_for(lambda folder=folder, wanted=wanted: committed(folder) >= wanted, process)
                time.sleep(moments.uniform(0.0, pause))
                if process.exitcode is None:
                    process.kill()
                    left -= 1
                    at_kills.append(committed(folder))
            code = finish(process)
            assert code in (0, -signal.SIGKILL), messages(folder)
        yield folder, at_kills


def _run(
    folder: Path, words: list[str], prelude: Callable[..., None] | None, arguments: tuple[object, ...]
) -> None:
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    descriptor = os.open(MESSAGES, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    if prelude is not None:
        prelude(*arguments)
    sys.argv = ["agfb", *words]
    app(words, prog_name="agfb")
