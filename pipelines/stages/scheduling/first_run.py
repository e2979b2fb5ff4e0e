"""The first run compiles the kernels: two processes share what takes one of them a minute."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

BESIDE = "import pipelines.orbits.integration.passes"
"""Loops over a period, which call the machine through addresses and compile without it."""


@contextmanager
def compiling_beside() -> Iterator[None]:
    """Compile the loops over a period in a second process while the block compiles the machine.

    Nothing happens if the kernels are compiled already, or on one core. The second process only fills numba's
    cache on the disk: whatever it fails to compile, this process compiles when it is needed.
    """
    beside = _started() if _is_first() and (os.cpu_count() or 1) > 1 else None
    try:
        yield
    except BaseException:
        if beside is not None:
            beside.kill()
        raise
    finally:
        if beside is not None:
            beside.wait()


def _started() -> subprocess.Popen[bytes] | None:
    nothing = subprocess.DEVNULL
    with suppress(OSError):
        return subprocess.Popen([sys.executable, "-c", BESIDE], stdin=nothing, stdout=nothing, stderr=nothing)
    return None


def _is_first() -> bool:
    """Whether a small kernel had to be compiled: the cache of all belongs to the sources of all."""
    from pipelines.orbits.integration.equations import combine

    stats = getattr(combine, "stats", None)  # a plain function with NUMBA_DISABLE_JIT
    return stats is not None and sum(stats.cache_misses.values()) > 0
