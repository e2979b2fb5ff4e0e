"""The table of the calibration: which keys may change, and which values the machine must reach."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

from pydantic import ValidationInfo, field_validator

from pipelines.case.fields import (
    WANTED_VALUE,
    Inconsistency,
    InconsistentError,
    Number,
    Path,
    UnitsTable,
    choice,
    given,
    positive_range,
    require_one,
    rising,
    table,
)
from pipelines.case.fields import quantity as scalar  # a target has a key `quantity`
from pipelines.case.problems import CaseError
from pipelines.case.sweeps import Document, MisplacedError, assign, flat

Interval = tuple[Number, Number]
Quantity = Literal[
    "onset_speed", "critical_speed", "onset_slope", "doubling_growth", "corner_frequency", "corner_speed"
]
CORNERS = frozenset({"corner_frequency", "corner_speed"})
NO_SPEEDS = {
    "onset_slope": "a slope, d(speed)/d(frequency),",
    "doubling_growth": "a growth rate",
    "corner_frequency": "an excitation frequency",
}
Rebuild = Callable[[Mapping[str, Any]], object]
"""Validates a case with other values at some dotted keys; raises CaseError or MisplacedError."""


class CalibrationParameter(UnitsTable):
    """One unknown of the calibration: a value that one or more keys take."""

    keys: tuple[str, ...] = table(
        "configuration keys that take the same value, as in --set; without an index all tables of an array",
        holds_keys=True,
        min_length=1,
        max_length=50,
        because="a parameter is the value of at least one key",
    )
    range: Interval = table(
        "lowest and highest value, in the unit of the keys", unit="of the keys", measured_by="keys"
    )
    scale: Literal["linear", "log"] = choice("`log`: factors count, not differences", "linear")

    @field_validator("scale")
    @classmethod
    def _ordered(cls, scale: str, info: ValidationInfo) -> str:
        if "range" in info.data:
            check = rising if scale == "linear" else _positive
            try:
                check(info.data["range"])
            except InconsistentError as error:
                raise InconsistentError(f"range {error}") from None
        return scale


def _positive(value: tuple[float, float]) -> tuple[float, float]:
    return positive_range(value, 'with scale = "log"')


class CalibrationTarget(UnitsTable):
    """One value that the machine must reach."""

    quantity: Quantity = choice(
        "`onset_speed`: lowest speed at which the cycle (at displacement 0 the equilibrium) loses stability; "
        "`critical_speed`: critical speed number `number`; `onset_slope`: d(onset speed)/d(excitation "
        "frequency), 0 at the frequency of the highest onset speed; `doubling_growth`: largest growth rate "
        "of period doubling (1/t0) at `speeds`, 0 at a period doubling, negative and continuous where there "
        "is none; `corner_frequency`, `corner_speed`: excitation frequency and speed of the 1:2 resonance in "
        "which Neimark-Sacker points end on a tongue of period doublings, within `frequency_range`",
        "onset_speed",
    )
    value: float | None = scalar(
        "the target value; in SI units a speed in rpm, a `corner_frequency` in Hz; slopes and growth rates "
        "have no unit",
        "1 or rpm, Hz",
        None,
        measured_by="quantity",
        si_key="value_rpm",
    )
    value_rpm: float | None = scalar(
        "the target value as a speed in rpm, whatever the units", "rpm", None, above=0,
        because="a speed is positive",
    )  # fmt: skip
    weight: float | None = scalar(
        "factor on the deviation, in rpm where the value is, else dimensionless; 1 without uncertainty",
        "1", None, above=0, because="a target without weight has no effect",
    )  # fmt: skip
    uncertainty: float | None = scalar(
        "uncertainty of the target value, in its unit", "of the value", None, above=0,
        because="deviations are divided by it", in_unit_of="value",
    )  # fmt: skip
    bifurcation: Literal["any", "neimark_sacker", "period_doubling"] = choice(
        "which loss of stability an onset is; at displacement 0 it is the Hopf point", "any"
    )
    number: int = scalar(
        "which critical speed, counted from 1 by rising speed", "", 1, at_least=1, at_most=100,
        because="they are counted from 1",
    )  # fmt: skip
    limit: Literal["exact", "upper", "lower"] = choice(
        "`upper`: only values above the target value count as deviations, `lower`: only values below it",
        "exact",
    )
    whirl: Literal["any", "forward", "backward"] = choice("which critical speeds are counted", "any")
    difference: float = scalar(
        "half the distance of the two excitation frequencies of an `onset_slope`", default=0.02, above=0,
        at_most=1, because="the slope is their central difference", measures="frequency",
    )  # fmt: skip
    speed_range: Interval | None = table(
        "speeds between which the onset is searched; calibrate.speed_range if not given",
        None,
        measures="speed",
    )
    speeds: tuple[Number, ...] | None = table(
        "speeds of a `doubling_growth`, whose largest growth rate counts", None, measures="speed",
        min_length=1, max_length=100, because="the growth is that at some speed",
    )  # fmt: skip
    frequency_range: Interval | None = table(
        "excitation frequencies between which a corner is searched", None, measures="frequency"
    )
    set: dict[str, Any] = table(
        'configuration keys of this target alone, such as { "excitation.frequency" = 0.2 }',
        {},
        holds_keys=True,
    )

    @field_validator("uncertainty")
    @classmethod
    def _one_weight(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is not None and given(info, ("weight",)):
            raise InconsistentError("give weight or uncertainty, not both")
        return value

    @field_validator("value_rpm")
    @classmethod
    def _one_value(cls, value: float | None, info: ValidationInfo) -> float | None:
        require_one(info, value, WANTED_VALUE, "the wanted value")
        meant = NO_SPEEDS.get(info.data.get("quantity", ""))
        if value is not None and meant is not None:
            raise InconsistentError(f"{meant} is no speed: give value, dimensionless")
        return value

    @field_validator("speed_range")
    @classmethod
    def _speeds(cls, value: Interval | None) -> Interval | None:
        return None if value is None else positive_range(value, "speeds are positive")

    @field_validator("speeds")
    @classmethod
    def _growth_speeds(
        cls, value: tuple[float, ...] | None, info: ValidationInfo
    ) -> tuple[float, ...] | None:
        if value is None and info.data.get("quantity") == "doubling_growth":
            raise InconsistentError("is missing: speeds at which period doublings must grow or not")
        if value is not None and min(value) <= 0.0:
            raise InconsistentError("speeds are positive")
        return value

    @field_validator("frequency_range")
    @classmethod
    def _frequencies(cls, value: Interval | None, info: ValidationInfo) -> Interval | None:
        if value is None and info.data.get("quantity") in CORNERS:
            raise InconsistentError("is missing: excitation frequencies between which the corner is searched")
        return None if value is None else positive_range(value, "frequencies are positive")

    @field_validator("set", mode="before")
    @classmethod
    def _dotted(cls, value: Any) -> Any:
        return dict(flat(value)) if isinstance(value, dict) else value

    @property
    def wanted(self) -> float:
        """The target value in its own unit."""
        value = self.value if self.value is not None else self.value_rpm
        assert value is not None
        return value

    @property
    def scatter(self) -> float:
        """The deviation that counts as one, in the unit of the value."""
        return self.uncertainty if self.uncertainty is not None else 1.0 / (self.weight or 1.0)

    def deviation(self, reached: float) -> float:
        """How far a reached value is off, in `scatter`; zero on the allowed side of a limit."""
        difference = reached - self.wanted
        if self.limit == "upper":
            difference = max(difference, 0.0)
        elif self.limit == "lower":
            difference = min(difference, 0.0)
        return difference / self.scatter


class Calibrate(UnitsTable):
    """Least squares of some keys to target values (`agfb calibrate`)."""

    parameters: tuple[CalibrationParameter, ...] = table(
        "the unknowns", min_length=1, max_length=50, because="something must be free"
    )
    targets: tuple[CalibrationTarget, ...] = table(
        "values that the machine must reach", min_length=1, max_length=200, because="something must be wanted"
    )
    max_evaluations: int = scalar(
        "maximum number of computed machines, including those for differences",
        "",
        60,
        at_least=2,
        at_most=10_000,
        because="each evaluation computes all targets",
    )
    tolerance: float = scalar(
        "ends when a step changes the sum of squares, or the parameters in parts of their ranges, by less",
        "1",
        1e-3,
        at_least=1e-12,
        at_most=0.5,
        because="it is a relative change",
    )
    difference_step: float = scalar(
        "change of a parameter, in parts of its range, for the differences of the targets",
        "1",
        0.01,
        at_least=1e-6,
        at_most=0.2,
        because="it must exceed the noise of the targets and stay local",
    )
    speed_range: Interval = table("speeds between which onsets are searched", (0.3, 1.6), measures="speed")

    @field_validator("speed_range")
    @classmethod
    def _speeds(cls, value: Interval) -> Interval:
        return positive_range(value, "speeds are positive")


def calibration_inconsistencies(
    settings: Calibrate, document: Document, rebuild: Rebuild
) -> Iterator[Inconsistency]:
    """What in a calibration contradicts the case, whose resolved ``document`` is given."""
    seen: set[str] = set()
    for index, parameter in enumerate(settings.parameters):
        at: Path = ("calibrate", "parameters", index)
        for place, key in enumerate(parameter.keys):
            if key in seen:
                yield (*at, "keys", place), f"{key} is calibrated twice"
            seen.add(key)
            refused = [
                ((*at, "keys", place) if problem.startswith("unknown") else (*at, "range"), problem)
                for value in parameter.range
                for problem in _refused(rebuild, {key: value})
            ]
            yield from dict.fromkeys(refused)
            if not refused:
                yield from _start_inconsistencies(parameter, document, key, at, place)
    for index, target in enumerate(settings.targets):
        for key, value in target.set.items():
            for problem in _refused(rebuild, {key: value}):
                yield ("calibrate", "targets", index, "set", key), problem


def _refused(rebuild: Rebuild, assignments: Mapping[str, Any]) -> list[str]:
    """Why a case with other values is invalid; empty if it is valid."""
    ((key, value),) = assignments.items()
    try:
        rebuild(assignments)
    except MisplacedError as error:
        return [f"unknown key: {key} {error}"]
    except CaseError as error:
        told = []
        for problem in error.problems:
            hint = f" (did you mean {problem.suggestion}?)" if problem.suggestion else ""
            unknown = problem.message.startswith("unknown key")
            told.append(
                f"unknown key {problem.key}{problem.message.removeprefix('unknown key')}{hint}"
                if unknown
                else f"{key} = {value}: {problem.message}"
            )
        return list(dict.fromkeys(told))
    return []


def _start_inconsistencies(
    parameter: CalibrationParameter, document: Document, key: str, at: Path, place: int
) -> Iterator[Inconsistency]:
    start = number_at(document, key)
    low, high = parameter.range
    if start is None:
        yield (*at, "keys", place), f"{key} has no number in this configuration: the search starts from it"
    elif place == 0 and not low <= start <= high:
        yield (*at, "range"), f"does not contain the configuration's own {key} = {start:g}, the start"


def number_at(document: Document, key: str) -> float | None:
    """The number at a dotted key of a resolved configuration, the first one below an array without index.

    None where there is none.  Raises MisplacedError for a key that leads nowhere.
    """
    path, *_ = assign(copy.deepcopy(document), key, 0.0)
    value: Any = document
    for part in path:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return None
    return value if isinstance(value, float) else None
