"""How times are taken and compared: CPU seconds of this process, in pairs, by their medians."""

from __future__ import annotations

import json
import re
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Action = Callable[[], object]


@dataclass(frozen=True)
class Measurement:
    """One number of the table; ``unit`` is "1" for ratios, ``what`` says in a sentence what was measured."""

    name: str
    value: float
    unit: str
    what: str


@dataclass(frozen=True)
class Pair:
    """Medians of interleaved runs: of both times [s] and of the ratios within each pair."""

    first: float
    second: float
    ratio: float


def cpu_seconds(action: Action) -> float:
    """CPU time of one run.

    Not the wall clock: it would count the time in which another process had the core.
    """
    start = time.process_time()
    action()
    return time.process_time() - start


def interleaved(first: Action, second: Action, pairs: int, warm_up: bool = True) -> Pair:
    """Run A B A B ..., so that what slows the machine for a while slows both; ratio = A / B."""
    if warm_up:
        first(), second()
    times = np.array([(cpu_seconds(first), cpu_seconds(second)) for _ in range(pairs)])
    return Pair(
        statistics.median(times[:, 0]),
        statistics.median(times[:, 1]),
        statistics.median(times[:, 0] / times[:, 1]),
    )


def growth_exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Slope of the least-squares line through log(time) over log(size)."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def recorded_values(page: str) -> dict[str, str]:
    """The values by name that a page like configs/performance.md records, as it prints them."""
    return dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", page, re.MULTILINE))


def markdown_table(measurements: Sequence[Measurement], recorded: Mapping[str, str]) -> str:
    """A table of what was measured, with the recorded value of each name beside it."""
    rows = [
        f"| `{m.name}` | {m.value:.3g} | {recorded.get(m.name, '')} | {m.unit} | {m.what} |"
        for m in measurements
    ]
    return "\n".join(["| name | value | recorded | unit | what |", "|---|---|---|---|---|", *rows]) + "\n"


def write_json(path: Path, measurements: Sequence[Measurement]) -> None:
    """Write {name: {value, unit, what}}."""
    content = {m.name: {"value": m.value, "unit": m.unit, "what": m.what} for m in measurements}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n")
