"""Certificates: the bifurcation curves of a store against its survey and cycles at random points.

The number of unstable multipliers at a cell is open where there is no usable cycle and below the lowest speed
that was searched.

A certificate is a group of the container ``certificate``. It belongs to the curves whose checksum it holds.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipelines.case.scales import PARAMETERS
from pipelines.datasets.branch import write_group
from pipelines.datasets.curves import (
    CRITICAL_MULTIPLIERS,
    CURVE_CONTAINERS,
    BifurcationCurve,
    curves_of_plane,
)
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import parameter_vector
from pipelines.stages.certificate.agreement import Judge, Places, Verdicts
from pipelines.stages.certificate.asked import Asked
from pipelines.stages.certificate.comparison import (
    POINTS,
    SEED,
    Comparison,
    critical_rows,
    decided,
    membership,
    multiplier_error,
    random_places,
)
from pipelines.stages.certificate.crossings import UNKNOWN, PlaneCurves
from pipelines.stages.certificate.summary import stored_places
from pipelines.stages.job import Job
from pipelines.stages.results import StopRequested
from pipelines.stages.survey.line import Found, SurveyProblem, cycle_at, entries, survey_problem
from pipelines.stages.survey.onsets import GROUP as SURVEY

CONTAINER = "certificate"
SPEED = "speed"


@dataclass(frozen=True)
class Request:
    """What a certificate is about: the lowest ``speed`` that was searched, and which curves were followed.

    ``known``: lines that a search has already.
    """

    lowest_speed: float = 0.0
    kinds: Sequence[str] = tuple(CRITICAL_MULTIPLIERS)
    boundaries: bool = False
    known: Sequence[Asked] = ()

    @classmethod
    def of_search(cls, attributes: Mapping[str, Any]) -> Request:
        """What the attributes of a group ``bifurcation_set`` say of the curves of a case."""
        return cls(
            float(attributes.get("lowest_speed") or 0.0),
            tuple(attributes.get("kinds", tuple(CRITICAL_MULTIPLIERS))),
            bool(attributes.get("boundaries", False)),
        )

    def is_of(self, certificate: Mapping[str, Any]) -> bool:
        """Whether a certificate with these attributes is about the same."""
        asked = self.lowest_speed, list(self.kinds), self.boundaries
        return asked == tuple(certificate[name] for name in ("lowest_speed", "kinds", "boundaries"))


def stored_curves(job: Job) -> tuple[BifurcationCurve, ...]:
    """The curves of the case's plane, for cycles of the excitation period."""
    groups = [_bifurcating(job.read(name)) for name in job.groups(*CURVE_CONTAINERS)]
    return curves_of_plane(groups, job.case.track_curves.parameters)


def _bifurcating(curve: Group) -> Group:
    """A stored curve as far as its rows are critical (`critical_rows`)."""
    kept = critical_rows(curve["multipliers"], curve["angle"])
    if kept == curve["angle"].size:
        return curve
    rows = {name for name in curve.arrays if KINDS["curve"].role(KINDS["curve"].array(name)) == "row"}
    arrays = {name: a[:kept] if name in rows else a for name, a in curve.arrays.items()}
    return replace(curve, arrays=arrays)


def checksum(curves: Sequence[BifurcationCurve]) -> str:
    """A number that changes with any point of the curves."""
    digest = hashlib.sha256()
    for curve in curves:
        digest.update(f"{curve.name} {curve.bifurcation} {curve.stop_reason}".encode())
        for values in (curve.points, curve.slopes, curve.unstable, curve.special):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]


def certify(job: Job, group: str, request: Request, before: str | None = None) -> None:
    """Compare the curves of a case with its survey, which must have all of its lines, and write a group.

    ``before``: an earlier certificate, whose random points are taken over. Raises StopRequested.
    """
    problem = survey_problem(job.machine, job.case, parameter_vector(job.case))
    curves, names = stored_curves(job), (problem.along.parameter, problem.across.parameter)
    judge = Judge(
        PlaneCurves(curves),
        job.case.track_curves.parameters.index(problem.along.parameter),
        request.kinds,
        request.boundaries,
        membership(curves, names, _cycles(job, problem)),
    )
    grid = _cells(job, problem, request)
    earlier = None if before is None else stored_places(job.read(before), "point_")
    points = _random_points(job, problem, request) if earlier is None else earlier
    job.report_progress(0, None, f"{group}: comparing {grid.found.size} cells with {len(curves)} curves")
    comparison = Comparison.of(judge, names, grid, points)
    asked = _asked_arrays(comparison.asked(request.known))
    arrays = _grid_arrays(comparison) | _point_arrays(comparison) | asked
    attributes = {
        "parameters": list(names),
        "ranges": [[axis.low, axis.high] for axis in (problem.along, problem.across)],
        "resolution": list(comparison.resolution),
        "multiplier_error": _error(problem),
        "lowest_speed": request.lowest_speed,
        "kinds": list(request.kinds),
        "boundaries": request.boundaries,
        "seed": SEED,
        "curves": [curve.name for curve in curves],
        "curves_checksum": checksum(curves),
        **comparison.numbers(),
    }
    write_group(job.store, job.path(group), "certificate", arrays, attributes)


def _error(problem: SurveyProblem) -> float:
    table = problem.case.survey
    return multiplier_error(table.multiplier_tolerance, table.tolerance)


def _cycles(job: Job, problem: SurveyProblem) -> Callable[[float, float], Found]:
    """The cycle at any place, until the stage is asked to stop."""

    def at(along: float, across: float) -> Found:
        _stop_if_asked(job)
        return cycle_at(problem, along, across)

    return at


def _cells(job: Job, problem: SurveyProblem, request: Request) -> Places:
    """The cells of the stored survey."""
    rows = job.read(SURVEY)
    along, across = np.meshgrid(rows["along"], rows["across"])
    speed = along if problem.along.parameter == SPEED else across
    open_ = rows.labels("status") != "found"
    found = np.where(open_, UNKNOWN, rows["unstable_count"]).astype(np.int64)
    found = _decided(problem, request, found, rows["nearest_multiplier"], speed)
    return Places(rows["along"], rows["across"], found, rows["nearest_multiplier"])


def _decided(
    problem: SurveyProblem, request: Request, found: np.ndarray, nearest: np.ndarray, speed: np.ndarray
) -> np.ndarray:
    """The numbers ``found``, `UNKNOWN` near the unit circle and below the lowest speed."""
    return np.where(speed >= request.lowest_speed, decided(found, nearest, _error(problem)), UNKNOWN)


def _random_points(job: Job, problem: SurveyProblem, request: Request) -> Places:
    """Cycles at points drawn from the plane with equal probability."""
    axes = (problem.along, problem.across)
    low = np.array([max(axis.low, request.lowest_speed * (axis.parameter == SPEED)) for axis in axes])
    high = np.array([axis.high for axis in axes])
    drawn = random_places(low, high, POINTS)
    found = np.full(POINTS, UNKNOWN)
    nearest = np.full(POINTS, complex(math.nan, math.nan))
    for number, (along, across) in enumerate(drawn.tolist()):
        _stop_if_asked(job)
        told = entries(problem, cycle_at(problem, along, across))
        if told["status"] == "found":
            found[number], nearest[number] = told["unstable_count"], told["nearest_multiplier"]
        job.report_progress(number + 1, POINTS, "random points of the plane")
    found = _decided(problem, request, found, nearest, np.full(POINTS, request.lowest_speed))
    return Places(drawn[:, 0], drawn[:, 1], found, nearest)


def _stop_if_asked(job: Job) -> None:
    if job.should_stop():
        raise StopRequested


def _grid_arrays(comparison: Comparison) -> dict[str, Any]:
    grid, verdicts = comparison.grid, comparison.at_cells
    return {
        "along": grid.along,
        "across": grid.across,
        "pair_along": verdicts.pair_along,
        "pair_across": verdicts.pair_across,
        **_place_arrays("", grid, verdicts.cells),
    }


def _point_arrays(comparison: Comparison) -> dict[str, Any]:
    points = comparison.points
    places = {"point_along": points.along, "point_across": points.across}
    return places | _place_arrays("point_", points, comparison.at_points)


def _place_arrays(prefix: str, places: Places, verdicts: Verdicts) -> dict[str, Any]:
    return {
        f"{prefix}found": places.found,
        f"{prefix}expected": verdicts.expected,
        f"{prefix}verdict": verdicts.verdict,
        f"{prefix}nearest": places.nearest,
    }


def _asked_arrays(asked: Sequence[Asked]) -> dict[str, Any]:
    return {
        "asked_parameter": np.array([PARAMETERS.index(line.parameter) for line in asked], dtype=np.int64),
        "asked_fixed": np.array([line.fixed for line in asked], dtype=float),
    }


def stored_lines(certificate: Group) -> list[Asked]:
    """The lines that a certificate asks for."""
    names, fixed = certificate.labels("asked_parameter"), certificate["asked_fixed"]
    return [Asked(str(name), float(value)) for name, value in zip(names, fixed, strict=True)]
