"""What the keys of a configuration measure: a speed, a frequency, or what another key says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic.fields import FieldInfo

from pipelines.case.fields import MEASURES, Path, Table, extra_of, model_of
from pipelines.case.sweeps import values_at

UNITS = "units"


def measures_of(
    root: type[Table],
    document: Mapping[str, Any],
    node: Mapping[str, Any],
    model: type[Table],
    key: FieldInfo,
) -> tuple[str, ...]:
    """What a key of a table measures, or what each of its entries does; () for a key with one unit.

    ``node`` is the table and ``document`` the whole configuration, for a key that another one tells about.
    """
    if measures := extra_of(key, "measures"):
        return (measures,)
    name = extra_of(key, "measured_by")
    if not name:
        return ()
    table, _, last = name.rpartition(".")
    owner: Any = next(values_at(document, table), {}) if table else node
    owner_model = model_of(root.model_fields[table].annotation) if table else model
    assert owner_model is not None
    words = owner.get(last) if isinstance(owner, Mapping) else None
    if words is None:
        words = owner_model.model_fields[last].default
    listed = words if isinstance(words, list | tuple) else [words]
    found = [
        measure
        for word in listed
        if isinstance(word, str)
        for measure in ([MEASURES[word]] if word in MEASURES else measures_of_key(root, word))
    ]
    return tuple(found) if len(found) == len(listed) else ()


def measures_of_key(root: type[Table], key: str) -> tuple[str, ...]:
    """What a dotted key measures; () for a key with one unit, or that is told by another key."""
    declared = declared_at(root, key)
    measures = "" if declared is None or extra_of(declared, "si_key") else extra_of(declared, "measures")
    return (measures,) if measures else ()


def declared_at(root: type[Table], key: str) -> FieldInfo | None:
    """The declaration of a dotted key, as in `--set`; None where it leads nowhere."""
    model: type[Table] | None = root
    declared: FieldInfo | None = None
    for part in key.split("."):
        if part.isdecimal():
            continue
        declared = None if model is None else model.model_fields.get(part)
        if declared is None:
            return None
        model = model_of(declared.annotation)
    return declared


@dataclass(frozen=True)
class Measured:
    """A value of a validated case that can be mistaken for another unit."""

    path: Path
    quantity: str
    """One of `SI_UNITS`."""
    numbers: tuple[float, ...]
    in_si: bool
    """Whether its key has the SI unit (`speed_rpm`); else it is dimensionless."""


def measured(root: type[Table], document: Mapping[str, Any], table: str) -> Iterator[Measured]:
    """The values of a table of a resolved document that measure something.

    A value whose entries measure different quantities comes entry by entry.
    """
    model = model_of(root.model_fields[table].annotation)
    if model is not None:
        yield from _measured(root, document, model, document.get(table), (table,))


def _measured(
    root: type[Table], document: Mapping[str, Any], model: type[Table], node: Any, at: Path
) -> Iterator[Measured]:
    if isinstance(node, list):
        for index, item in enumerate(node):
            yield from _measured(root, document, model, item, (*at, index))
    if not isinstance(node, Mapping):
        return
    for name, told in _told(model).items():
        value, path = node.get(name), (*at, name)
        if value is None:
            continue
        if isinstance(told, _Inner):
            yield from _measured(root, document, told.model, value, path)
            continue
        measures = measures_of(root, document, node, model, told.declared)
        rows = isinstance(value, list) and all(isinstance(item, list) for item in value)
        if rows and len(measures) > 1:
            for index, (measure, item) in enumerate(zip(measures, value, strict=True)):
                yield Measured((*path, index), measure, tuple(item), False)
        elif measures:
            numbers = tuple(value) if isinstance(value, list) else (value,)
            yield Measured(path, measures[0], numbers, told.in_si)


@dataclass(frozen=True)
class _Key:
    """The declaration of a key that measures something; of a key in SI units that of the other one."""

    declared: FieldInfo
    in_si: bool


@dataclass(frozen=True)
class _Inner:
    """The table that a key holds."""

    model: type[Table]


@cache
def _told(model: type[Table]) -> Mapping[str, _Key | _Inner]:
    """The keys of a table that measure something, or hold a table with such keys."""
    told: dict[str, _Key | _Inner] = {}
    for name, declared in model.model_fields.items():
        if (inner := inner_with_units(model, name)) is not None:
            told[name] = _Inner(inner)
        elif _measures(declared):
            told[name] = _Key(declared, in_si=False)
            if other := extra_of(declared, "si_key"):
                told[other] = _Key(declared, in_si=True)
    return told


@cache
def inner_with_units(model: type[Table], name: str) -> type[Table] | None:
    """The table that a key holds, if any key in it has two units."""
    inner = model_of(model.model_fields[name].annotation)
    return inner if inner is not None and _has_units(inner) else None


@cache
def _has_units(model: type[Table]) -> bool:
    """Whether a table, or one inside it, has the key `units`."""
    inner = (model_of(each.annotation) for each in model.model_fields.values())
    return UNITS in model.model_fields or any(_has_units(each) for each in inner if each is not None)


def _measures(declared: FieldInfo) -> bool:
    return bool(extra_of(declared, "measures") or extra_of(declared, "measured_by"))
