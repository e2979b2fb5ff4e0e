"""How one configuration key is declared, and how a key is found from its path.

Every key of the case models is declared with `quantity`, `choice` or `table`, which attach to the type and
its bounds the unit and the physical reason of the bounds.  Error messages, the JSON schema and the generated
reference are all made from that one declaration.
"""

from __future__ import annotations

import math
import types
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
)
from pydantic.fields import FieldInfo

Path = tuple[str | int, ...]
"""Keys, array indices and free names from a table down to a value."""

Inconsistency = tuple[Path, str]
"""Where (a path below the validated key) and what is wrong."""

FOIL_STIFFNESS = ("stiffness", "areal_stiffness", "bump", "rigid")
AMPLITUDE = ("displacement", "load")
FREQUENCY = ("frequency", "frequency_hz")
SPEED = ("speed", "speed_rpm")
SECOND_ELASTIC_CONSTANT = ("poisson_ratio", "shear_modulus")
RATED_SPEED = ("rated_speed", "rated_speed_rpm")
WANTED_VALUE = ("value", "value_rpm")
WEIGHT = ("weight", "uncertainty")
ALTERNATIVES = (
    FOIL_STIFFNESS,
    AMPLITUDE,
    FREQUENCY,
    SPEED,
    SECOND_ELASTIC_CONSTANT,
    RATED_SPEED,
    WANTED_VALUE,
    WEIGHT,
)
"""Groups of keys that say the same thing; at most one of each is given."""

Number = Annotated[float, Field(strict=True)]

Parameter = Literal["speed", "excitation_frequency", "displacement", "foil_stiffness"]
"""What branches and curves are continued in."""

SI = "si"
SI_UNITS = {"speed": "rpm", "frequency": "Hz", "time": "s", "displacement": "um", "foil_stiffness": "N/m3"}
"""What a key can measure, and its unit where `units = "si"` holds; elsewhere it is dimensionless."""
MEASURES = {
    "speed": "speed",
    "excitation_frequency": "frequency",
    "displacement": "displacement",
    "foil_stiffness": "foil_stiffness",
    "onset_speed": "speed",
    "critical_speed": "speed",
    "corner_frequency": "frequency",
    "corner_speed": "speed",
}
"""What the numbers beside such a word measure: a continued parameter, a target of a calibration."""

LONGEST_STEP = 10.0
STEPS = "a branch is followed in steps; arclength is dimensionless, and states and parameters are of size one"
"""Why an arclength step is bounded: in rpm or Hz it would leap over every branch."""


class Table(BaseModel):
    """A table of the configuration: frozen, without unknown keys, with finite numbers only."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True, str_max_length=200
    )


class GrownTable(Table):
    """A table whose keys of later versions are written only where they differ from their defaults.

    Without them the resolved configuration of a case, and with it its hash, stays that of earlier versions.
    """

    later_keys: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _without_unused_keys(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields = type(self).model_fields
        return {
            key: value
            for key, value in write(self).items()
            if key not in self.later_keys or value != fields[key].default
        }


Units = Literal["dimensionless", "si"]


def converted(value: Units | None) -> Units | None:
    """Validator of `units`: `pipelines.case.units` has taken it away wherever numbers could be converted."""
    if value == SI:
        raise InconsistentError(
            "needs gas.viscosity, gas.ambient_pressure, and radius and clearance of the first bearing: they "
            "make rpm, Hz, s and um dimensionless"
        )
    return value


class UnitsTable(GrownTable):
    """A table with keys that may be given in SI units; a validated one holds dimensionless numbers."""

    later_keys: ClassVar[frozenset[str]] = frozenset({"units"})

    units: Units | None = Field(
        default=None,
        description="units of this table and those inside it: `dimensionless`, or `si` for the second unit "
        "of keys with two; default: those of the table around it",
    )

    _units = field_validator("units")(converted)


class InconsistentError(ValueError):
    """Keys that are well-formed one by one but contradict each other.

    One check can report several places; a plain message belongs to the validated key itself.
    """

    def __init__(self, *problems: str | Inconsistency) -> None:
        self.problems = tuple(((), problem) if isinstance(problem, str) else problem for problem in problems)
        super().__init__("; ".join(message for _, message in self.problems))


def quantity(
    description: str,
    unit: str = "",
    default: Any = ...,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    because: str = "",
    measures: str = "",
    measured_by: str = "",
    si_key: str = "",
    in_unit_of: str = "",
    **constraints: Any,
) -> Any:
    """Declare one scalar key: meaning, SI unit ("1": dimensionless), default, bounds and their reason.

    ``measures``: one of `SI_UNITS`; the key takes this unit too, and needs no ``unit`` of its own.
    ``measured_by``: the key that says what this one measures, by words of `MEASURES`: of the same table, or
    a dotted path from the top.
    ``si_key``: the key of the same table that a number in SI units becomes, if both measure the same.
    ``in_unit_of``: the key of the same table whose unit this one has.
    Scalars are strict: a number written as a string or a boolean is refused.
    """
    return Field(
        default,
        strict=True,
        gt=above,
        ge=at_least,
        lt=below,
        le=at_most,
        description=description,
        json_schema_extra=_extra(unit, because, measures, measured_by, si_key)
        | ({"in_unit_of": in_unit_of} if in_unit_of else {}),
        **constraints,
    )


def _extra(unit: str, because: str, measures: str, measured_by: str, si_key: str = "") -> dict[str, Any]:
    if measures:
        unit = f"1 or {SI_UNITS[measures]}"
    elif measured_by and not unit:
        unit = f"1 or {', '.join(dict.fromkeys(SI_UNITS[measure] for measure in MEASURES.values()))}"
    named = {"measures": measures, "measured_by": measured_by, "si_key": si_key}
    return {"unit": unit, "because": because} | {name: value for name, value in named.items() if value}


def arclength_step(
    description: str, default: float, because: str = STEPS, *, measured_by: str = "parameter"
) -> Any:
    """Declare the first, shortest or longest step of a continuation.

    ``measured_by``: the key with the parameter, or the first of two, that alone would move by this step.
    """
    return quantity(
        description, default=default, above=0, at_most=LONGEST_STEP, because=because, measured_by=measured_by
    )


def most_points(description: str, default: int) -> Any:
    """Declare the most points of a branch or a curve."""
    return quantity(
        description, "", default, at_least=1, at_most=100_000, because="the store is laid out for them"
    )


def choice(description: str, default: str) -> Any:
    """Declare a key that takes one of a few words."""
    return Field(default, description=description)


def table(
    description: str,
    default: Any = ...,
    *,
    unit: str = "",
    because: str = "",
    measures: str = "",
    measured_by: str = "",
    holds_keys: bool = False,
    **constraints: Any,
) -> Any:
    """Declare a key that holds a table, an array or an array of tables; see `quantity`.

    ``holds_keys``: it lists dotted keys, or values by dotted key, which in SI units mean keys in SI units.
    """
    extra = _extra(unit, because, measures, measured_by) | ({"holds_keys": "yes"} if holds_keys else {})
    return Field(default, description=description, json_schema_extra=extra, **constraints)


def extra_of(field: FieldInfo, name: str) -> str:
    """The unit ("unit") or the reason of the bounds ("because") of a declared key; "" if it has none."""
    extra = field.json_schema_extra
    return str(extra.get(name, "")) if isinstance(extra, dict) else ""


def inner_types(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of an annotation with `Annotated` and `| None` taken off."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return inner_types(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return tuple(
            kind for part in get_args(annotation) if part is not type(None) for kind in inner_types(part)
        )
    return (annotation,)


def model_of(annotation: Any) -> type[Table] | None:
    """The table type inside `Foil`, `Ring | None`, `tuple[Disc, ...]`, `dict[str, Material]`."""
    for kind in inner_types(annotation):
        if isinstance(kind, type) and issubclass(kind, Table):
            return kind
        if get_origin(kind) in (tuple, dict):
            for part in get_args(kind):
                if part is not Ellipsis and (found := model_of(part)) is not None:
                    return found
    return None


def holds_values(annotation: Any) -> bool:
    """True where plain values may stand: not for tables or arrays of tables alone."""
    for kind in inner_types(annotation):
        parts = [part for part in get_args(kind) if part is not Ellipsis]
        if get_origin(kind) is tuple and any(map(holds_values, parts)):
            return True
        if get_origin(kind) is not tuple and model_of(kind) is None:
            return True
    return False


def is_collection(annotation: Any) -> bool:
    """True for arrays and for tables with free names: their next path component is an index or a name."""
    return any(get_origin(kind) in (tuple, dict) for kind in inner_types(annotation))


def keys_of(root: type[Table], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Every key below a table as a dotted path (arrays without index, free names as NAME), declared."""
    for name, field in root.model_fields.items():
        path = prefix + name
        yield path, field
        inner = model_of(field.annotation)
        if inner is not None:
            free = any(get_origin(kind) is dict for kind in inner_types(field.annotation))
            yield from keys_of(inner, f"{path}.NAME." if free else f"{path}.")


def bounds_of(field: FieldInfo) -> str:
    """The bounds of a scalar key, such as `> 0 and <= 1`; "" without any."""
    signs = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))
    return " and ".join(
        f"{sign} {getattr(constraint, name):g}"
        for name, sign in signs
        for constraint in field.metadata
        if getattr(constraint, name, None) is not None
    )


def field_at(root: type[Table], path: Path) -> tuple[type[Table] | None, FieldInfo | None]:
    """Follow a path of keys, indices and free names from `root`.

    Returns the table type that owns the last named key and the declaration of that key; (None, None) where
    the path leaves the models, (owner, None) where the last key is unknown to its owner.
    """
    owner: type[Table] | None = root
    field: FieldInfo | None = None
    entered = False
    for component in path:
        if field is not None and is_collection(field.annotation) and not entered:
            entered = True
            continue
        if field is not None:
            owner = model_of(field.annotation)
        if owner is None:
            return None, None
        field, entered = owner.model_fields.get(str(component)), False
        if field is None:
            return owner, None
    return owner, field


def given(info: ValidationInfo, keys: tuple[str, ...]) -> list[str] | None:
    """Those of `keys` that are set; None if one of them is itself invalid (it is reported elsewhere)."""
    if any(key not in info.data for key in keys):
        return None
    return [key for key in keys if info.data[key] is not None and info.data[key] is not False]


def require_one(info: ValidationInfo, value: Any, keys: tuple[str, ...], what: str) -> None:
    """Refuse a group of alternative keys unless exactly one is set; `value` is that of the last key."""
    chosen = given(info, keys[:-1])
    if chosen is None:
        return
    if value is not None and value is not False:
        chosen.append(keys[-1])
    if len(chosen) != 1:
        raise InconsistentError(
            f"give exactly one of {', '.join(keys)} for {what}; given: {', '.join(chosen) or 'none'}"
        )


def rising(value: tuple[float, float]) -> tuple[float, float]:
    """Validator of a range."""
    if not value[0] < value[1]:
        raise InconsistentError(f"must be [low, high] with low < high, given [{value[0]:g}, {value[1]:g}]")
    return value


def positive_range(value: tuple[float, float], because: str) -> tuple[float, float]:
    """Validator of a range of positive values."""
    if value[0] <= 0:
        raise InconsistentError(((0,), f"must be > 0: {because}"))
    return rising(value)


def parameter_range(value: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
    """Validator of the `range` of a continued `parameter`."""
    if info.data.get("parameter") != "displacement":
        return positive_range(value, "this parameter is positive")
    if value[0] < 0 or value[1] >= 1:
        raise InconsistentError("must lie within 0 <= displacement < 1: the ring closes the film otherwise")
    return rising(value)


def inside_range(value: float | None, info: ValidationInfo) -> float | None:
    """Validator of a `start` beside a `range`."""
    low, high = info.data.get("range", (-math.inf, math.inf))
    if value is not None and not low <= value <= high:
        raise InconsistentError(f"must lie inside range = [{low:g}, {high:g}]")
    return value


def steps_in_order(value: float, info: ValidationInfo) -> float:
    """Validator of a `maximum_step` beside `minimum_step` and `step`."""
    minimum, step = info.data.get("minimum_step", 0.0), info.data.get("step", value)
    if not minimum <= step <= value:
        raise InconsistentError(
            f"minimum_step <= step <= maximum_step must hold, given {minimum:g}, {step:g}, {value:g}"
        )
    return value
