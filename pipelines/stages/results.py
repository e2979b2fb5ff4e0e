"""Reports of a stage while it runs and when it ends: plain data that can cross process borders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from pipelines.case.fields import SI_UNITS
from pipelines.case.units import Scale

Scalar = str | int | float | bool | None
FailedBy = Literal["case", "store", "bug"]


@dataclass(frozen=True)
class Progress:
    """One step of a stage on one case.

    `done` of `total` units are finished; `total` is None when it cannot be known, and an upper bound where a
    branch may end earlier. `message` says in a few words what the numbers cannot, for instance the parameter
    value just reached. ``part`` is the group that is being written where several parts of the stage are
    computed side by side. ``work`` of the whole stage: what is done, and what is left at least and at
    most, in any unit.
    """

    stage: str
    case_id: str
    done: int
    total: int | None = None
    message: str = ""
    part: str = ""
    work: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class StageResult:
    """How one stage ended on one case.

    `ok` is False when the case could not be computed as asked; `stop_reason` then names why and `advice` is
    a sentence that tells the user what to change. `caution` says of a result that was computed how far it is
    not to be trusted, and what to do about it. `summary` holds the few numbers worth a line on the
    terminal (plain scalars only; NaN is not allowed, None stands for a missing number), `tables` rows of
    such numbers by title. `failed_by` tells a
    case that cannot be computed from a store that cannot be read and from an error of this program, whose
    `traceback` is kept. The scheduling fills in these, and the `seconds` that the stage took.
    """

    case_id: str
    ok: bool
    stop_reason: str
    advice: str = ""
    summary: Mapping[str, Scalar] = field(default_factory=dict)
    failed_by: FailedBy = "case"
    traceback: str = ""
    seconds: float = 0.0
    caution: str = ""
    tables: Mapping[str, Sequence[Mapping[str, Scalar]]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The result as plain dictionaries and scalars, for JSON and other processes.

        Of a success without what belongs to failures.
        """
        record = asdict(self) | {"summary": dict(self.summary)}
        return {k: v for k, v in record.items() if not (self.ok and k in ("failed_by", "traceback"))}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> StageResult:
        """Rebuild a result from `as_dict`."""
        return cls(**record)


def in_both_units(name: str, quantity: str, value: float | None, scale: Scale) -> dict[str, Scalar]:
    """A number of a summary, dimensionless under its name and in SI units under `name [rpm]`."""
    if value is None:
        return {name: None}
    return {name: value, f"{name} [{SI_UNITS[quantity]}]": value * scale[quantity]}


Report = Callable[[Progress], None]
ShouldStop = Callable[[], bool]


class StopRequested(Exception):  # noqa: N818
    """The user asked to stop before the result was known."""
