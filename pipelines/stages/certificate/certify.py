"""Certificates: the bifurcation curves of a store against its survey and cycles at random points.

The number of unstable multipliers at a cell is open where there is no usable cycle, below the lowest speed
that was searched, and where a multiplier is nearer to the unit circle than the survey is accurate.

A certificate is a group of the container ``certificate``. It belongs to the curves whose checksum it holds.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import beta

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
from pipelines.orbits.forced_cycle import ForcedCycle
from pipelines.stages.certificate.agreement import (
    AGREES,
    DISAGREES,
    NOT_DECIDED,
    GridVerdicts,
    Judge,
    Places,
    Verdicts,
    judge_grid,
    judge_points,
)
from pipelines.stages.certificate.asked import Asked, asked_lines
from pipelines.stages.certificate.crossings import UNKNOWN, Crossing, PlaneCurves
from pipelines.stages.job import Job
from pipelines.stages.results import StopRequested
from pipelines.stages.survey.line import SurveyProblem, cycle_at, entries, survey_problem
from pipelines.stages.survey.onsets import GROUP as SURVEY

CONTAINER = "certificate"
SPEED = "speed"
POINTS = 100  # random ones
SEED = 1
CONFIDENCE = 0.95  # of the largest share of the plane that may disagree
_MISSES = 4.0  # times the miss of a cycle: by so much its multipliers may be off
_SAME = 0.02  # distance of a multiplier from the critical one of a curve, below which it is that one


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
    """A stored curve up to the first row without a multiplier at the critical one.

    Beyond R1 and R2 a Neimark-Sacker curve goes on as one of neutral saddles, where no cycle bifurcates.
    """
    critical = np.exp(1j * curve["angle"])[:, None]
    apart = np.abs(curve["multipliers"] - critical)
    false = np.flatnonzero(np.nanmin(apart, axis=1, initial=np.inf) > _SAME)
    if not false.size:
        return curve
    rows = {name for name in curve.arrays if KINDS["curve"].role(KINDS["curve"].array(name)) == "row"}
    arrays = {name: a[: false[0]] if name in rows else a for name, a in curve.arrays.items()}
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
    curves = stored_curves(job)
    judge = Judge(
        PlaneCurves(curves),
        job.case.track_curves.parameters.index(problem.along.parameter),
        request.kinds,
        request.boundaries,
        _membership(job, problem, curves),
    )
    grid = _cells(job, problem, request)
    points = _random_points(job, problem, request) if before is None else _taken_over(job.read(before))
    job.report_progress(0, None, f"{group}: comparing {grid.found.size} cells with {len(curves)} curves")
    verdicts, at_points = judge_grid(judge, grid), judge_points(judge, grid, points)
    names = problem.along.parameter, problem.across.parameter
    asked = asked_lines(names, grid, verdicts.cells, points, at_points, request.known)
    arrays = _grid_arrays(grid, verdicts) | _point_arrays(points, at_points) | _asked_arrays(asked)
    attributes = {
        "parameters": list(names),
        "ranges": [[axis.low, axis.high] for axis in (problem.along, problem.across)],
        "resolution": [float(values[1] - values[0]) for values in (grid.along, grid.across)],
        "multiplier_error": multiplier_error(problem),
        "lowest_speed": request.lowest_speed,
        "kinds": list(request.kinds),
        "boundaries": request.boundaries,
        "seed": SEED,
        "curves": [curve.name for curve in curves],
        "curves_checksum": checksum(curves),
        **_numbers(verdicts, at_points),
    }
    write_group(job.store, job.path(group), "certificate", arrays, attributes)


def _numbers(verdicts: GridVerdicts, at_points: Verdicts) -> dict[str, Any]:
    """How many places agree, disagree and are not decided; and whether the curves are certified.

    ``share_at_most``: of the plane that disagrees, with the confidence of 95 % that the random points give
    (Clopper and Pearson).
    """
    numbers: dict[str, Any] = {}
    for name, verdict in (("agreeing", AGREES), ("disagreeing", DISAGREES), ("not_decided", NOT_DECIDED)):
        numbers |= {
            f"cells_{name}": verdicts.cells.number(verdict),
            f"pairs_{name}": verdicts.pairs(verdict),
            f"points_{name}": at_points.number(verdict),
        }
    wrong, right = numbers["points_disagreeing"], numbers["points_agreeing"]
    share = 1.0 if right == 0 else float(beta.ppf(CONFIDENCE, wrong + 1, right))
    none_wrong = not numbers["pairs_disagreeing"] and not wrong
    return numbers | {"share_at_most": share, "certified": none_wrong and numbers["pairs_agreeing"] > 0}


def multiplier_error(problem: SurveyProblem) -> float:
    """How far the modulus of a multiplier of the survey may be off: by its time steps and by its miss."""
    table = problem.case.survey
    return table.multiplier_tolerance + _MISSES * table.tolerance


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
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(np.log(np.abs(nearest)))
    is_clear = (apart > multiplier_error(problem)) & (speed >= request.lowest_speed)
    return np.where(is_clear, found, UNKNOWN)


def _random_points(job: Job, problem: SurveyProblem, request: Request) -> Places:
    """Cycles at points drawn from the plane with equal probability."""
    axes = (problem.along, problem.across)
    low = np.array([max(axis.low, request.lowest_speed * (axis.parameter == SPEED)) for axis in axes])
    high = np.array([axis.high for axis in axes])
    drawn = low + (high - low) * np.random.default_rng(SEED).random((POINTS, 2))
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


def _taken_over(certificate: Group) -> Places:
    """The random points of an earlier certificate of the case."""
    names = ("along", "across", "found", "nearest")
    along, across, found, nearest = (certificate[f"point_{name}"] for name in names)
    return Places(along, across, found.astype(np.int64), nearest)


def _membership(
    job: Job, problem: SurveyProblem, curves: Sequence[BifurcationCurve]
) -> Callable[[Crossing], bool | None]:
    """Whether the cycle that is found at a crossing is the critical one of the curve.

    Only folds let several cycles of the excitation period coexist: without any nothing is computed.
    """
    if all(curve.bifurcation != "fold" for curve in curves):
        return lambda crossing: True
    known: dict[tuple[str, float], bool | None] = {}

    def belongs(crossing: Crossing) -> bool | None:
        key = crossing.curve.name, crossing.arclength
        if key not in known:
            _stop_if_asked(job)
            along, across = (
                float(crossing.place[crossing.curve.parameters.index(axis.parameter)])
                for axis in (problem.along, problem.across)
            )
            critical = np.exp(1j * crossing.curve.angle_at(crossing.arclength))
            known[key] = _is_critical(cycle_at(problem, along, across), critical)
        return known[key]

    return belongs


def _is_critical(found: Any, critical: complex) -> bool | None:
    """Whether a cycle has a multiplier at the critical one; None without a cycle."""
    if not isinstance(found, ForcedCycle):
        return None
    return bool(np.min(np.abs(found.cycle.spectrum.multipliers - critical)) < _SAME)


def _stop_if_asked(job: Job) -> None:
    if job.should_stop():
        raise StopRequested


def _grid_arrays(grid: Places, verdicts: GridVerdicts) -> dict[str, Any]:
    return {
        "along": grid.along,
        "across": grid.across,
        "pair_along": verdicts.pair_along,
        "pair_across": verdicts.pair_across,
        **_place_arrays("", grid, verdicts.cells),
    }


def _point_arrays(points: Places, verdicts: Verdicts) -> dict[str, Any]:
    places = {"point_along": points.along, "point_across": points.across}
    return places | _place_arrays("point_", points, verdicts)


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
