"""The smoke configuration on the smallest grid: a point costs a fraction of a second."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from pipelines.case.reading import NamedCase, read_cases
from pipelines.stages.results import Progress, StageResult
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.scheduling.registry import stage_function

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "configs" / "smoke.toml"
PASSIVE = ROOT / "configs" / "passive.toml"
SHARP = "numerics.multiplier_tolerance=1e-6"  # for numbers: the tiny settings serve bookkeeping
TINY = (
    "numerics.circumferential=16",
    "numerics.axial=1",
    "numerics.max_columns=24",
    "numerics.multiplier_tolerance=1e-4",
    "linearize.points=7",
    "linearize.speed_range=[0.7, 1.3]",
    "linearize.eigenvalues=6",
    "criticals.speed_range=[0.3, 1.0]",
    "criticals.points=6",
    "criticals.unbalance_points=3",
    "continue_cycles.start=1.14",
    "continue_cycles.range=[1.05, 1.2]",
    "continue_cycles.step=0.02",
    "continue_cycles.maximum_step=0.02",
)


def tiny_case(*overrides: str, config: Path = CONFIG, stages: Collection[str] | None = None) -> NamedCase:
    """The first case of a configuration with the tiny settings and overrides, checked for ``stages``."""
    named, *_ = read_cases(config.read_text(), config.name, (*TINY, *overrides), stages)
    return named


class Watched:
    """Runs a stage on a case into a store, made if it is not there, and remembers what it told.

    ``stop_after``: ask it to stop once it has told of so many finished units.
    """

    def __init__(self, stage: str, case: NamedCase, store: Path, stop_after: int | None = None) -> None:
        self.reported: list[Progress] = []
        self._stop_after = stop_after
        prepare_store(store, [case], ["agfb", "test"])
        self.result: StageResult = stage_function(stage)(case, store, self.reported.append, self._should_stop)

    @property
    def finished(self) -> int:
        """Units told as finished."""
        return sum(progress.done > 0 for progress in self.reported)

    def _should_stop(self) -> bool:
        return self._stop_after is not None and self.finished >= self._stop_after
