"""``python -m tests.benchmarks [--quick] [-o PATH] [NAME...]``: measure, print the table, write JSON."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.benchmarks.arithmetic import solve_arithmetic
from tests.benchmarks.brusselator import brusselator
from tests.benchmarks.campaign import campaign
from tests.benchmarks.cold_start import cold_start
from tests.benchmarks.commits import commits
from tests.benchmarks.curves import curve_point
from tests.benchmarks.cycles import (
    branch_point,
    full_monodromy,
    further_columns,
    growth,
    shared_work,
    tangent_batch,
)
from tests.benchmarks.instability import backward_error
from tests.benchmarks.measuring import Measurement, markdown_table, recorded_values, write_json
from tests.benchmarks.memory import peak_memory
from tests.benchmarks.passes import passes_per_point
from tests.benchmarks.settings import FULL, QUICK, Settings
from tests.benchmarks.steppers import stepper_ratios
from tests.benchmarks.surveys import survey_cell
from tests.benchmarks.transients import transient_steps

ENTRIES: dict[str, Callable[[Settings], list[Measurement]]] = {
    "tangent_batch_ratio": tangent_batch,
    "further_columns_ratio": further_columns,
    "shared_work": shared_work,
    "stepper_ratio": stepper_ratios,
    "branch_point_ratio": branch_point,
    "full_monodromy_ratio": full_monodromy,
    "backward_error_ratio": backward_error,
    "growth_exponent": growth,
    "curve_point_ratio": curve_point,
    "survey_cell_ratio": survey_cell,
    "passes_per_point": passes_per_point,
    "transient_steps_ratio": transient_steps,
    "commit_ratio": commits,
    "campaign_ratio": campaign,
    "peak_memory": peak_memory,
    "arithmetic": solve_arithmetic,
    "brusselator": brusselator,
    "cold_start": cold_start,
}


PAGE = Path(__file__).parents[2] / "configs" / "performance.md"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the named entries, or all; the table goes to stdout, progress to stderr."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ENTRIES)}; default: all")
    parser.add_argument("--quick", action="store_true", help="small grids: shows that it works, not how fast")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("build/bench.json"), help="JSON file to write"
    )
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - ENTRIES.keys():
        parser.error(f"unknown {', '.join(sorted(unknown))}; known are {', '.join(ENTRIES)}")
    found: list[Measurement] = []
    for name in options.names or ENTRIES:
        start = time.monotonic()
        sys.stderr.write(f"{name} ... ")
        sys.stderr.flush()
        found += ENTRIES[name](QUICK if options.quick else FULL)
        sys.stderr.write(f"{time.monotonic() - start:.0f} s\n")
    sys.stdout.write(markdown_table(found, recorded_values(PAGE.read_text())))
    write_json(options.output, found)


if __name__ == "__main__":
    main()
