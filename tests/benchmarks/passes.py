"""Passes over the period per point of a branch and of a Neimark-Sacker curve, by what they are for.

A pass is one integration over the period: of an orbit with its columns, or of further columns along it.
In units of an orbit without columns one with c of them takes about 1.5 + c/50, further ones c/50 + 1/20.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field, fields, replace
from types import FrameType
from typing import Any

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart
from pipelines.bifurcations.curve import CurveOptions
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.switching import curve_from_event
from pipelines.orbits.period_map import PeriodImage, PeriodMap
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.cycles.problem import NORMAL_FORM, continuation_options, smooth_maps
from tests.benchmarks.cycles import SPEED, Start, prepared
from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import Settings

NAMES = ("excitation_frequency", "speed")
RANGES = ((0.3, 1.2), (0.8, 1.5))

# The outermost of these functions on the stack says what a pass is for.
PURPOSES = {
    "open": "start",
    "with_normal_form": "normal forms",
    "_with_specials": "special points",
    "_land_on_start": "special points",
    "_events": "events",
    "dips_inside": "events",
    "refusal": "acceptance",
    "required_steps_at": "time-step check",
    "critical_derivatives": "slopes of the test function",
    "with_converged_multipliers": "multipliers",
    "_with_converged_multipliers": "multipliers",
    "with_sharp_left": "left vectors",
    "tangent_at": "tangent",
    "correct_critical": "correction",
    "correct": "correction",
    "reference_of": "phase condition",
}
START = "start"


@dataclass
class Tally:
    """Numbers of passes by purpose, and their cost in orbits times time steps."""

    passes: Counter[str] = field(default_factory=Counter)
    cost: Counter[str] = field(default_factory=Counter)

    def add(self, orbits: float, steps: int) -> None:
        """Count a pass of the calling map."""
        purpose = _purpose(sys._getframe(2))
        self.passes[purpose] += 1
        self.cost[purpose] += orbits * steps


def _purpose(frame: FrameType | None) -> str:
    found = "other"
    while frame is not None:
        found = PURPOSES.get(frame.f_code.co_name, found)
        frame = frame.f_back
    return found


@dataclass(frozen=True)
class TalliedMap(PeriodMap):
    """A period map that writes its passes into a tally."""

    tally: Tally = field(default_factory=Tally)

    def evaluate(self, *arguments: Any, **options: Any) -> PeriodImage:
        """A pass with an orbit."""
        image = super().evaluate(*arguments, **options)
        columns = image.columns.shape[1] + image.inhomogeneous.shape[1]
        self.tally.add(1.5 + columns / 50.0 if columns else 1.0, image.start.steps)
        return image

    def with_columns(self, image: PeriodImage, *arguments: Any, **options: Any) -> PeriodImage:
        """A pass of columns alone, if the image has its factors."""
        further = super().with_columns(image, *arguments, **options)
        if image.factors is not None:  # else `evaluate` has told
            self.tally.add(further.columns.shape[1] / 50.0 + 0.05, image.start.steps)
        return further


def passes_per_point(settings: Settings) -> list[Measurement]:
    """A branch along the speed with its bifurcations, and the curve through the first of them.

    The curve without and with normal forms.
    """
    start = prepared(settings.walked_grids[0])
    branch = Tally()
    problem = replace(start.problem, period_map=_tallied(start.problem.period_map, branch))
    events, steps = _branch(start, problem, 4 * settings.branch_points)
    told = _measured("branch", branch, steps, f"a branch with {len(events)} bifurcations, {_grid(settings)}")
    first = next(event for event in events if event.kind is EventKind.NEIMARK_SACKER)
    for name, forms in (("curve", False), ("curve_form", True)):
        curve = Tally()
        steps, specials = _curve(start, curve, first, 4 * settings.branch_points, forms)
        what = f"a Neimark-Sacker curve with {specials} special points, {_grid(settings)}"
        told += _measured(name, curve, steps, f"{what}, with normal forms" if forms else what)
    return told


def _grid(settings: Settings) -> str:
    return "{}x{}".format(*settings.walked_grids[0])


def _tallied(period_map: PeriodMap, tally: Tally) -> TalliedMap:
    known = {item.name: getattr(period_map, item.name) for item in fields(period_map)}
    return TalliedMap(**known, tally=tally)


def _branch(start: Start, problem: CycleProblem, points: int) -> tuple[list[Event], list[int]]:
    """The events of a branch of at least ``points`` points and one event, and its time steps."""
    events: list[Event] = []
    steps: list[int] = []

    def record(point: Any, state: Any, found: tuple[Event, ...]) -> None:
        events.extend(found)
        steps.append(state.steps)

    options = replace(continuation_options(start.description, 1), max_points=40)
    guess = BranchStart(start.guess.state, SPEED)
    continue_branch(problem, guess, options, record, None, lambda: bool(events) and len(steps) > points)
    return events, steps


def _curve(start: Start, tally: Tally, event: Event, points: int, forms: bool) -> tuple[list[int], int]:
    """The time steps of the points of both directions of a curve, and the number of its special points."""
    own = start.problem.period_map
    widths = start.description.track_curves.normal_form_widths if forms else ()
    smooth = tuple(_tallied(each, tally) for each in smooth_maps(start.description, own, widths))
    problem = replace(start.problem, period_map=_tallied(own, tally))
    steps: list[int] = []
    specials: list[Any] = []

    def record(point: Any, state: Any, found: tuple[Any, ...]) -> None:
        specials.extend(found)
        if state.index > 0:
            steps.append(state.steps)

    curves, guess = curve_from_event(problem, event, NAMES, smooth_maps=smooth)
    for direction in (1, -1):
        form = NORMAL_FORM if forms else None
        options = CurveOptions(RANGES, direction, max_points=points + 1, normal_form=form)
        continue_curve(curves, guess, options, record)
    return steps, len(specials)


def _measured(name: str, tally: Tally, steps: list[int], what: str) -> list[Measurement]:
    """Passes and orbits per point without those of the start, and the passes of every purpose."""
    points = len(steps)
    purposes = [purpose for purpose, _ in tally.passes.most_common() if purpose != START]
    shares = ", ".join(f"{purpose} {tally.passes[purpose] / points:.1f}" for purpose in purposes)
    begun = f"start {tally.passes[START]} in all"
    passes = sum(tally.passes[purpose] for purpose in purposes) / points
    orbits = sum(tally.cost[purpose] for purpose in purposes) / (points * float(np.mean(steps)))
    return [
        Measurement(f"passes_per_{name}_point", passes, "1", f"{what}, {points} points: {shares}; {begun}"),
        Measurement(f"orbits_per_{name}_point", orbits, "1", "these in orbits without columns"),
    ]
