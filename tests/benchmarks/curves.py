"""Time per point of a Neimark-Sacker curve, in cycle corrections: in points of a branch on the same grid."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchState
from pipelines.bifurcations.curve import CurveOptions, CurvePoint, CurveState, SpecialPoint
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.switching import curve_from_event
from pipelines.orbits.period_map import PeriodMap
from pipelines.stages.cycles.problem import NORMAL_FORM, continuation_options, smooth_maps
from tests.benchmarks.cycles import SPEED, Start, prepared, walked_point
from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import Settings

NAMES = ("excitation_frequency", "speed")
RANGES = ((0.2, 2.0), (0.8, 1.5))
STEP = 0.02


def curve_point(settings: Settings) -> list[Measurement]:
    """With and without the normal form that is stored at every point."""
    grid = settings.monodromy_grids[-1]
    start = prepared(grid)
    event, (correction, _) = _neimark_sacker(start), walked_point(start, settings.branch_points)
    widths = start.description.track_curves.normal_form_widths
    smooth = smooth_maps(start.description, start.problem.period_map, widths)
    plain = _seconds(start, event, (), None, settings.branch_points)
    whole = _seconds(start, event, smooth, NORMAL_FORM, settings.branch_points)
    what = f"time per point of a Neimark-Sacker curve / per point of a branch, {grid[0]}x{grid[1]}"
    return [
        Measurement("curve_point_ratio", plain / correction, "1", what),
        Measurement(
            "curve_point_ratio_normal_form",
            whole / correction,
            "1",
            f"{what}, with its normal forms from {len(widths)} regularised maps",
        ),
    ]


def _neimark_sacker(start: Start) -> Event:
    """The first Neimark-Sacker point on the branch along the speed."""
    found: list[Event] = []

    def record(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        found.extend(event for event in events if event.kind is EventKind.NEIMARK_SACKER)

    options = replace(continuation_options(start.description, 1), max_points=40)
    guess = BranchStart(start.guess.state, SPEED)
    continue_branch(start.problem, guess, options, record, None, lambda: bool(found))
    return found[0]


def _seconds(
    start: Start,
    event: Event,
    smooth: tuple[PeriodMap, ...],
    normal_form: NormalFormOptions | None,
    points: int,
) -> float:
    marks: list[float] = []

    def record(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        marks.append(time.process_time())

    problem, first = curve_from_event(start.problem, event, NAMES, smooth_maps=smooth)
    options = CurveOptions(
        RANGES, step=STEP, maximum_step=STEP, max_points=points + 1, normal_form=normal_form
    )
    continue_curve(problem, first, options, record)
    assert len(marks) == points + 1
    return float(np.median(np.diff(marks)))
