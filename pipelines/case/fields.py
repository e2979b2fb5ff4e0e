"""How one configuration key is declared, and how a key is found from its path.

Every key of the case models is declared with `quantity`, which attaches to the type and its bounds the unit and the
physical reason of the bounds.  Error messages, the JSON schema and the generated reference are all made from that one
declaration.
"""

from __future__ import annotations

import types
from collections.abc import Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo


class Table(BaseModel):
    """A table of the configuration: frozen, without unknown keys, with finite numbers only."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True, str_max_length=200
    )


class Inconsistent(ValueError):
    """Keys that are well-formed one by one but contradict each other.

    `problems` holds pairs (path below the validated key, what is wrong and what is allowed), so that one check can
    report several places.
    """

    def __init__(self, *problems: tuple[tuple[str | int, ...], str]) -> None:
        self.problems = problems
        super().__init__("; ".join(message for _, message in problems))


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
    **constraints: Any,
) -> Any:
    """Declare one scalar key: its meaning, SI unit ("1": dimensionless), default, bounds and the reason of the bounds.

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
        json_schema_extra={"unit": unit, "because": because},
        **constraints,
    )


def choice(description: str, default: str) -> Any:
    """Declare a key that takes one of a few words."""
    return Field(default, description=description)


def table(
    description: str, default: Any = ..., *, unit: str = "", because: str = "", **constraints: Any
) -> Any:
    """Declare a key that holds a table, an array or an array of tables; see `quantity`."""
    extra: dict[str, Any] = {"unit": unit, "because": because}
    return Field(default, description=description, json_schema_extra=extra, **constraints)


def extra_of(field: FieldInfo, name: str) -> str:
    """The unit ("unit") or the reason of the bounds ("because") of a declared key, "" if it has none."""
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
    """The table type inside an annotation such as `Foil`, `Ring | None`, `tuple[Disc, ...]`, `dict[str, Material]`."""
    for kind in inner_types(annotation):
        if isinstance(kind, type) and issubclass(kind, Table):
            return kind
        if get_origin(kind) in (tuple, dict):
            for part in get_args(kind):
                if part is not Ellipsis and (found := model_of(part)) is not None:
                    return found
    return None


def is_collection(annotation: Any) -> bool:
    """True for arrays and for tables with free names: their next path component is an index or a name."""
    return any(get_origin(kind) in (tuple, dict) for kind in inner_types(annotation))


def field_at(root: type[Table], path: Sequence[str | int]) -> tuple[type[Table] | None, FieldInfo | None]:
    """Follow a path of keys, indices and free names from `root`.

    Returns the table type that owns the last named key and the declaration of that key; (None, None) where the path
    leaves the models, (owner, None) where the last key is unknown to its owner.
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
