"""`agfb track-pd`: period-doubling curves, and those that meet stored curves in special points."""

from __future__ import annotations

from pathlib import Path

from pipelines.bifurcations.detection import EventKind
from pipelines.case.reading import NamedCase
from pipelines.stages.curve_tracking import track_curves
from pipelines.stages.results import Report, ShouldStop, StageResult


def track_pd(case: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``pd/c000``, ... of a case from the bifurcations in its store."""
    return track_curves(EventKind.PERIOD_DOUBLING, case, store_path, report, should_stop)
