"""Report on a stored calibration: targets, parameters, and combinations that the targets leave open.

With the weighted derivatives J = d r / d x at the found machine, singular values s_k and directions v_k of J:
a change of every target by one of its uncertainties moves the parameters by

    sigma_i^2 = sum_k (v_ki / s_k)^2

and a direction whose s_k is a small part of the largest is not determined by the targets.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.calibrate_settings import CORNERS
from pipelines.case.models import Calibrate, CalibrationTarget, Case
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED, Group
from pipelines.datasets.store import Store, case_group
from pipelines.stages.calibration.calibrate import CONVERGED, GROUP, start_position, value_at, values_at
from pipelines.stages.calibration.onset_speed import FAILED, FOUND, STATUSES, UNDECIDED

UNDETERMINED = 1e-3  # of the largest singular value
PART = 0.1  # smallest component of a direction that is told
AT_BOUND = 1e-3  # of the range
NO_CORNER = (
    "no Neimark-Sacker points were found that end on period doublings: widen frequency_range or speed_range"
)


@dataclass(frozen=True)
class TargetRow:
    """One target with wanted and reached value, in ``unit``; of a ``limit`` one side alone counts.

    ``deviation`` in uncertainties, or times the weight; ``remark`` where the value was not simply found;
    None where it failed.
    """

    target: str
    unit: str
    wanted: float
    limit: str
    reached: float | None
    difference: float | None
    deviation: float | None
    bifurcation: str
    remark: str


@dataclass(frozen=True)
class ParameterRow:
    """One parameter: its keys, values before and after, and the end of its range that it reached.

    ``uncertainty``: standard error by the targets' uncertainties (where only weights are given, by the
    deviations that are left); of a logarithmic parameter as if small.  None where it is not determined or
    cannot be told.  ``sensitivity``: root of the sum of squares of d r_i over the whole range.
    """

    keys: tuple[str, ...]
    before: float
    after: float
    bound: str
    uncertainty: float | None
    sensitivity: float | None


@dataclass(frozen=True)
class Calibration:
    """The state of a calibration; before it has ended, with the best machine so far."""

    case_id: str
    ended: bool
    converged: bool
    stop_reason: str
    machines: int
    sum_of_squares: float | None
    targets: tuple[TargetRow, ...]
    parameters: tuple[ParameterRow, ...]
    undetermined: tuple[dict[str, float], ...]
    """Directions of the parameters, in parts of their ranges, that the targets do not feel."""
    values: dict[str, float]
    """The found value of every calibrated key."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


def read_calibration(store: Store, case_id: str, case: Case) -> Calibration | None:
    """The calibration of a case; None before a machine is computed.

    ``case`` is the configuration that it belongs to.  Raises StoreError for a damaged group.
    """
    settings, name = case.calibrate, case_group(case_id, GROUP)
    if settings is None or not store.has_group(name):
        return None
    group = read_group(store, name)
    if group.n_points == 0:
        return None
    best = int(group.attributes.get("best", _least(group, settings)))
    position = np.asarray(group["position"][best])
    jacobian = group.attributes.get("jacobian")
    slopes = None if jacobian is None else np.array(jacobian)
    targets = tuple(_target_row(target, group, best, n) for n, target in enumerate(settings.targets))
    weighted = [row.deviation for row in targets]
    known = [value for value in weighted if value is not None]
    return Calibration(
        case_id=case_id,
        ended=group.attributes["status"] == ENDED,
        converged=group.attributes["stop_reason"] == CONVERGED,
        stop_reason=group.attributes["stop_reason"],
        machines=group.n_points,
        sum_of_squares=float(np.sum(np.square(known))) if len(known) == len(weighted) else None,
        targets=targets,
        parameters=_parameter_rows(settings, case, position, slopes, known),
        undetermined=() if slopes is None else _undetermined(settings, slopes),
        values=values_at(settings, position),
    )


def _least(group: Group, settings: Calibrate) -> int:
    """The row with the fewest failed targets, and among these with the least sum of squares."""
    deviations = np.array([
        [target.deviation(value) for target, value in zip(settings.targets, row, strict=True)]
        for row in group["reached"].tolist()
    ])  # fmt: skip
    failed = ~np.isfinite(group["reached"])
    squares = np.sum(np.where(failed, 0.0, deviations) ** 2, axis=1)
    return int(np.lexsort((squares, failed.sum(axis=1)))[0])


def _target_row(target: CalibrationTarget, group: Group, row: int, column: int) -> TargetRow:
    status = str(group.labels("status")[row, column])
    value = None if status in FAILED else float(group["reached"][row, column])
    difference = None if value is None else value - target.wanted
    return TargetRow(
        target=_name(target),
        unit="1" if target.value_rpm is None else "rpm",
        wanted=target.wanted,
        limit=target.limit,
        reached=value,
        difference=difference,
        deviation=None if value is None else target.deviation(value),
        bifurcation=str(group.labels("bifurcation")[row, column]),
        remark=_remark(target, status),
    )


def _remark(target: CalibrationTarget, status: str) -> str:
    """Why a value was not simply found."""
    if status == UNDECIDED and target.quantity in CORNERS:
        return NO_CORNER
    return "" if status == FOUND else STATUSES[status]


def _name(target: CalibrationTarget) -> str:
    """A target in a few words."""
    words = target.quantity.replace("_", " ")
    if target.quantity == "critical_speed":
        words += f" {target.number}" + ("" if target.whirl == "any" else f" {target.whirl}")
    elif target.quantity == "doubling_growth":
        words += " at speed " + ", ".join(f"{speed:g}" for speed in target.speeds or ())
    elif target.bifurcation != "any":
        words += f" ({target.bifurcation.replace('_', ' ')})"
    return ", ".join([words, *(f"{key} = {value}" for key, value in target.set.items())])


def _parameter_rows(
    settings: Calibrate, case: Case, position: Array, slopes: Array | None, deviations: list[float]
) -> tuple[ParameterRow, ...]:
    errors = None if slopes is None else _errors(settings, slopes, deviations)
    start = start_position(case, settings)
    rows = []
    for index, parameter in enumerate(settings.parameters):
        place = float(position[index])
        after, (low, high) = value_at(parameter, place), parameter.range
        error = None if errors is None or not np.isfinite(errors[index]) else float(errors[index])
        if error is not None:  # d value / d x
            error *= after * float(np.log(high / low)) if parameter.scale == "log" else high - low
        rows.append(
            ParameterRow(
                keys=parameter.keys,
                before=value_at(parameter, float(start[index])),
                after=after,
                bound="lowest" if place < AT_BOUND else "highest" if place > 1.0 - AT_BOUND else "",
                uncertainty=error,
                sensitivity=None if slopes is None else float(np.linalg.norm(slopes[:, index])),
            )
        )
    return tuple(rows)


def _errors(settings: Calibrate, slopes: Array, deviations: list[float]) -> Array | None:
    """Standard errors of the positions (n,), infinite where undetermined; None if they cannot be computed."""
    spare = slopes.shape[0] - slopes.shape[1]
    scale = 1.0
    if any(target.uncertainty is None for target in settings.targets):
        if spare <= 0 or len(deviations) < slopes.shape[0]:
            return None
        scale = float(np.sum(np.square(deviations))) / spare
    values, directions, open_directions = _spectrum(slopes)
    squares = np.sum((directions / values[:, None]) ** 2, axis=0)
    errors = np.sqrt(scale * squares)
    errors[np.any(np.abs(open_directions) > PART, axis=0)] = np.inf
    return np.asarray(errors)


def _spectrum(slopes: Array) -> tuple[Array, Array, Array]:
    """Singular values (k,) and directions (k, n) that the targets determine, and those that they do not."""
    _, values, directions = np.linalg.svd(slopes, full_matrices=True)
    felt = int(np.sum(values > UNDETERMINED * values[0])) if values[0] > 0.0 else 0
    return values[:felt], directions[:felt], directions[felt:]


def _undetermined(settings: Calibrate, slopes: Array) -> tuple[dict[str, float], ...]:
    """Open directions by the first key of each parameter, their largest component positive."""
    names = [parameter.keys[0] for parameter in settings.parameters]
    undetermined = []
    for direction in _spectrum(slopes)[2]:
        sign = np.sign(direction[np.argmax(np.abs(direction))])
        parts = {name: float(sign * part) for name, part in zip(names, direction, strict=True)}
        undetermined.append({name: part for name, part in parts.items() if abs(part) > PART})
    return tuple(undetermined)
