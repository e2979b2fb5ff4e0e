"""The stages that trace a curve through every stored bifurcation of a kind that is on no curve yet.

``pipelines.stages.curves.starts`` gives the starts, one after the other, so that the curves of a case do not
depend on interruptions. Further branches in a store add curves and do not change the existing ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.bifurcations.curve import CurveStop
from pipelines.bifurcations.detection import EventKind
from pipelines.case.reading import NamedCase
from pipelines.stages import regularised, step_errors
from pipelines.stages.curves.parts import compute_curve, curve_is_needed, curve_parts
from pipelines.stages.curves.rows import CONTAINERS, special_labels
from pipelines.stages.curves.starts import StartQueue
from pipelines.stages.ending import is_success
from pipelines.stages.job import Job
from pipelines.stages.parts import Part, Plan, compute_alone, discard_all
from pipelines.stages.results import Report, ShouldStop, StageResult

COMPLETE = frozenset(
    {
        CurveStop.RANGE,
        CurveStop.CLOSED,
        CurveStop.RESONANCE_1,
        CurveStop.RESONANCE_2,
        CurveStop.MAXIMUM_POINTS,
        CurveStop.LIMIT,
        CurveStop.TRACED,
        CurveStop.LEAVES_BOUNDARY,
    }
)


def track_pd(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``pd/c000``, ... of a case; resumes after the last stored point."""
    return compute_alone(plan_track_pd(named, store_path, report, should_stop))


def track_ns(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``ns/c000``, ... of a case; resumes after the last stored point."""
    return compute_alone(plan_track_ns(named, store_path, report, should_stop))


def track_folds(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the groups ``folds/c000``, ... of a case; resumes after the last stored point."""
    return compute_alone(plan_track_folds(named, store_path, report, should_stop))


def plan_track_pd(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> CurvesPlan:
    """The period-doubling curves of a case; each direction of a curve is a part."""
    job = Job.of("track-pd", named, store_path, report, should_stop)
    return CurvesPlan(job, StartQueue(job, (EventKind.PERIOD_DOUBLING,)))


def plan_track_ns(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> CurvesPlan:
    """The Neimark-Sacker curves of a case; each direction of a curve is a part."""
    job = Job.of("track-ns", named, store_path, report, should_stop)
    return CurvesPlan(job, StartQueue(job, (EventKind.NEIMARK_SACKER,)))


def plan_track_folds(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> CurvesPlan:
    """The fold curves of a case; each direction of a curve is a part."""
    job = Job.of("track-folds", named, store_path, report, should_stop)
    return CurvesPlan(job, StartQueue(job, (EventKind.FOLD,)))


@dataclass(frozen=True)
class CurvesPlan(Plan):
    """All curves of the kind of a ``queue``."""

    job: Job
    queue: StartQueue

    def parts(self, settled: bool = True) -> Iterator[Part]:
        """The curves that are missing."""
        return curve_parts(self.queue)

    def compute(self, part: Part, job: Job) -> None:
        """Trace one curve in one direction."""
        compute_curve(job, part)

    def is_needed(self, part: Part) -> bool:
        """Whether no earlier curve has come to the start of this one."""
        return curve_is_needed(self.job, part)

    def result(self) -> StageResult:
        """How the curves ended."""
        if not self.job.should_stop():
            discard_all(self.job)
        (kind,) = self.queue.kinds
        return curves_result(self.job, kind, self.queue.outside, self.queue.refused)


def curves_result(job: Job, kind: EventKind, outside: int = 0, refused: int = 0) -> StageResult:
    """The result of tracing the curves of a kind: a success if all of them are complete.

    ``outside``: starts outside the plane; ``refused``: starts beyond the largest number of curves.
    """
    names = ("event_kind", "event_tongue", step_errors.STEP_ERROR, *regularised.ARRAYS)
    curves = [job.read(group, names) for group in job.groups(CONTAINERS[kind])]
    ok = not refused and all(is_success(curve, COMPLETE) for curve in curves)
    specials: list[str] = []
    for curve in curves:
        specials += special_labels(curve)
    summary: dict[str, Any] = {"curves": len(curves), "points": sum(curve.n_points for curve in curves)}
    summary |= {name: specials.count(name) for name in dict.fromkeys(specials)}
    if outside:
        summary["starts outside the plane"] = outside
    unknown = step_errors.count(curves)
    if where := step_errors.in_words(unknown):
        summary[step_errors.NAME] = where
    if where := regularised.in_words(regularised.count(curves)):
        summary[regularised.NAME] = where
    reasons = [curve.attributes["stop_reason"] for curve in curves if curve.attributes["stop_reason"]]
    if job.should_stop():
        reasons.append("stopped on request")
    advice = [curve.attributes["stop_advice"] for curve in curves]
    if refused:
        advice.append(f"{refused} more curves were not traced: raise track_curves.max_curves")
    reason = ", ".join(dict.fromkeys(reasons)) or f"no {kind.name.lower().replace('_', ' ')} to start from"
    sentences, doubt = "; ".join(dict.fromkeys(filter(None, advice))), step_errors.caution(unknown)
    return StageResult(job.case_id, ok, reason, sentences, summary, caution=doubt)
