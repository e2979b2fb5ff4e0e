"""Eight cases of the same cost: in one process, and on two workers."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipelines.case.reading import NamedCase, read_cases
from pipelines.stages.results import Progress, StageResult
from pipelines.stages.scheduling.campaign import run_campaign
from pipelines.stages.scheduling.pool import Pool
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.scheduling.tasks import run_stages
from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import SCHEME, Settings

SMOKE = Path(__file__).parents[2] / "configs/smoke.toml"
STAGES = ("continue_cycles",)
BRANCH = (
    "continue_cycles.start=0.4",
    "continue_cycles.range=[0.4, 1.3]",
    "continue_cycles.maximum_step=0.02",
)


def campaign(settings: Settings) -> list[Measurement]:
    """Wall-clock time on one process over that on two workers, whose start counts."""
    count = settings.campaign_cases
    displacements = np.linspace(0.19, 0.2, count).round(6).tolist()
    circumferential, axial = settings.default_grid
    overrides = (
        f"sweep.excitation.displacement={displacements}",
        f"continue_cycles.max_points={settings.campaign_points}",
        f"numerics.circumferential={circumferential}",
        f"numerics.axial={axial}",
        f"numerics.scheme={SCHEME}",
    )
    cases = read_cases(SMOKE.read_text(), SMOKE.name, (*overrides, *BRANCH))
    alone = _seconds(cases, 0)
    pair = _seconds(cases, 2)
    told = (
        f"{count} branches of equal cost on {circumferential}x{axial}, wall clock: one process "
        f"({alone:.0f} s) / two workers with their start ({pair:.0f} s)"
    )
    return [Measurement("campaign_ratio", alone / pair, "1", told)]


def _seconds(cases: tuple[NamedCase, ...], workers: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "a.zarr"
        prepare_store(store, cases, ["benchmark"])
        start = time.monotonic()
        results = list(_run(cases, store, workers))
        seconds = time.monotonic() - start
        assert len(results) == len(cases), results
        return seconds


def _run(cases: tuple[NamedCase, ...], store: Path, workers: int) -> Iterator[tuple[str, StageResult]]:
    if workers:
        yield from run_campaign(STAGES, cases, store, Pool(workers), _ignore, _never)
    else:
        yield from run_stages(STAGES, cases, store, _ignore, _never)


def _ignore(progress: Progress) -> None:
    """Nobody watches."""


def _never() -> bool:
    return False
