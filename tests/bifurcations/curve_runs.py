"""Running curves in tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipelines.bifurcations.curve import (
    CurveOptions,
    CurvePoint,
    CurveResult,
    CurveStart,
    CurveState,
    SpecialPoint,
)
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveFormulation, CurveProblem
from pipelines.orbits.period_map import PeriodImage, PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from tests.bifurcations.explicit_maps import CLOCK, ExplicitMap

FOLD, FLIP, NS = EventKind.FOLD, EventKind.PERIOD_DOUBLING, EventKind.NEIMARK_SACKER


@dataclass
class Run:
    """All that a traced curve recorded."""

    result: CurveResult
    points: list[CurvePoint] = field(default_factory=list)
    states: list[CurveState] = field(default_factory=list)
    specials: list[SpecialPoint] = field(default_factory=list)

    @property
    def parameters(self) -> np.ndarray:
        return np.array([point.parameters for point in self.points])


def trace(curves: CurveProblem, start, options: CurveOptions, **callbacks) -> Run:  # type: ignore[no-untyped-def]
    run = Run(CurveResult(None, None))  # type: ignore[arg-type]

    def record(point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        run.points.append(point)
        run.states.append(state)
        run.specials.extend(specials)

    run.result = continue_curve(curves, start, options, record, **callbacks)
    return run


def map_problem(
    explicit: ExplicitMap,
    kind: EventKind,
    parameters: tuple[float, ...],
    names: tuple[str, str],
    formulation: CurveFormulation = CurveFormulation.BORDERED,
) -> CurveProblem:
    options = ShootingOptions(tolerance=1e-12, multiplier_tolerance=1e-11)
    return CurveProblem(explicit, kind, np.array([*parameters, CLOCK]), names, options, formulation)


def start(state, parameters: tuple[float, float], angle: float | None = None, period: float = 1.0):  # type: ignore[no-untyped-def]
    return CurveStart(np.array(state, dtype=float), parameters, period, angle)


@dataclass(frozen=True)
class CountingMap(PeriodMap):
    """A period map that writes down how many columns each of its passes carried."""

    passes: list[int] = field(default_factory=list)

    def evaluate(self, *arguments: Any, **options: Any) -> PeriodImage:
        image = super().evaluate(*arguments, **options)
        self.passes.append(image.columns.shape[1] + image.inhomogeneous.shape[1])
        return image
