"""Peak memory of a short branch on the largest grid, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import Settings

ROOT = Path(__file__).parents[2]
_KIBIBYTE = 1024e-6  # in MB: the unit in which Linux counts ru_maxrss

# A process counts the memory of the one that started it into its own peak: a bare interpreter starts it.
_LAUNCHER = "import subprocess, sys; sys.exit(subprocess.call([sys.executable, '-c', sys.argv[1]]))"
_PROGRAM = """
from resource import RUSAGE_SELF, getrusage
from tests.benchmarks.cycles import prepared, walked_point
print(getrusage(RUSAGE_SELF).ru_maxrss)
walked_point(prepared(({nodes}, {stations})), {points})
print(getrusage(RUSAGE_SELF).ru_maxrss)
"""


def peak_memory(settings: Settings) -> list[Measurement]:
    """Largest resident set before and after a short branch."""
    nodes, stations = settings.walked_grids[-1]
    program = _PROGRAM.format(nodes=nodes, stations=stations, points=settings.branch_points)
    done = subprocess.run(
        [sys.executable, "-c", _LAUNCHER, program], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    imported, peak = (_KIBIBYTE * float(line) for line in done.stdout.split())
    what = f"informative: short branch on {nodes}x{stations}, own process; {imported:.0f} after imports"
    return [Measurement("peak_memory", peak, "MB", what)]
