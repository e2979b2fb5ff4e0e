"""The first run compiles the kernels, the next ones load them: seconds of both."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import Settings

ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "agfb_cli", "continue", "configs/smoke.toml")
FIRST_POINT = ("--set", "continue_cycles.max_points=1")
_PROGRESS = "continue-cycles "


@dataclass(frozen=True)
class _Run:
    """Wall-clock seconds from the start of the process to its first line of progress and to its end, and its
    CPU seconds.
    """

    progress: float
    end: float
    cpu: float


def cold_start(settings: Settings) -> list[Measurement]:
    """Compilation, and the way of a cached run to its first point.

    Without ``fresh_cache`` the kernels are those that the caller's cache has.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        if settings.fresh_cache:
            environment["NUMBA_CACHE_DIR"] = str(Path(folder) / "cache")
        whole = () if settings.fresh_cache else FIRST_POINT
        first, second, short = (
            _run([*COMMAND, *options, "-o", str(Path(folder) / f"{number}.zarr")], environment)
            for number, options in enumerate((whole, whole, FIRST_POINT))
        )
    return [
        Measurement(
            "compile_time", first.end - second.end, "s",
            "informative: `agfb continue configs/smoke.toml`, run that compiles - run that finds its kernels "
            f"({first.cpu - second.cpu:.3g} CPU s)",
        ),
        Measurement(
            "cached_start", second.progress, "s",
            f"informative: start of the cached process to its first line of progress; {short.end:.3g} s to "
            f"its end when it stops after the first point, {second.end:.3g} s for the whole branch",
        ),
    ]  # fmt: skip


def _run(command: list[str], environment: dict[str, str]) -> _Run:
    """Run a command that must succeed."""
    before, start, progress = _children_seconds(), time.monotonic(), None
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        told = []
        for line in process.stderr:
            told.append(line)
            if progress is None and line.startswith(_PROGRESS):
                progress = time.monotonic() - start
    end = time.monotonic() - start
    if process.returncode or progress is None:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}: {''.join(told)}")
    return _Run(progress, end, _children_seconds() - before)


def _children_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
