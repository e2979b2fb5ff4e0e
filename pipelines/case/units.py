"""Numbers in rpm, Hz, s and um: what `units = "si"` in a configuration means.

The key stands at the top of the file or in a table, and holds for that table and those inside it. Every key
says in its declaration what it measures (`pipelines.case.fields`); one walk over the tables makes the numbers
of those keys dimensionless, with the scales of the first bearing:

    speed n t0 2 pi/60,  frequency f 2 pi t0,  time t/t0,  displacement d/c,  foil stiffness k c/p0.

Where the table has a key in SI units beside the dimensionless one (`speed_rpm`), the number is moved there as
it is: `speed` in SI units and `speed_rpm` are one configuration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, get_origin

from pydantic.fields import FieldInfo

from pipelines.case.fields import SI, SI_UNITS, Path, Table, extra_of, inner_types
from pipelines.case.measuring import UNITS, declared_at, inner_with_units, measures_of, measures_of_key
from pipelines.case.scales import film_time, si_per_unit
from pipelines.case.sweeps import Document, flat, values_at

Scale = Mapping[str, float]
"""What a dimensionless 1 is in the unit of each quantity of `SI_UNITS`."""


@dataclass(frozen=True)
class Written:
    """A value in SI units as the file has it."""

    path: Path
    """Where it stands in the file."""
    value: Any
    measures: tuple[str, ...]
    """What it measures, or what each of its entries does; () where the key in SI units took it as it is."""
    scale: Scale

    def note(self, below: Path) -> str:
        """How the case's numbers at a path ``below`` relate to the file's; "" where they are the same."""
        entry = below[0] if below and isinstance(below[0], int) else 0
        if not self.measures or (not below and len(set(self.measures)) > 1):
            return ""
        measure = self.measures[min(entry, len(self.measures) - 1)]
        return f"1 is {self.scale[measure]:.6g} {SI_UNITS[measure]}"


@dataclass(frozen=True)
class Dimensionless:
    """A configuration whose numbers are dimensionless or those of keys in SI units."""

    document: Document
    """Without `units`, unless the scales are unknown: then it is as it was."""
    written: Mapping[Path, Written] = field(default_factory=dict)
    """What the file says at the paths of ``document`` that were converted."""
    unknown: frozenset[Path] = frozenset()
    """Paths of numbers in SI units that could not be converted, because the scales are unknown."""


def dimensionless(root: type[Table], document: Document) -> Dimensionless:
    """Convert all numbers in SI units of a document of tables below ``root``; a document is not changed.

    What is no number, and what is no key, stays as it is: validation refuses it.
    """
    if not _names_units(document):
        return Dimensionless(document)
    scale = scale_of(document)
    walk = _Walk(root, document, {} if scale is None else scale)
    converted = walk.table(root, document, (), None)
    if scale is None:
        return Dimensionless(document, {}, frozenset(walk.written))
    return Dimensionless(converted, walk.written)


def scale_of(document: Document) -> Scale | None:
    """The scales of a document's first bearing; None where its numbers do not give any."""
    keys = ("gas.viscosity", "gas.ambient_pressure", "bearings.0.radius", "bearings.0.clearance")
    found = [next(values_at(document, key), None) for key in keys]
    numbers = [float(value) for value in found if value is not None and _is_number(value)]
    if len(numbers) < len(keys) or min(numbers) <= 0:
        return None
    viscosity, pressure, radius, clearance = numbers
    try:
        scale = si_per_unit(film_time(viscosity, pressure, radius, clearance), clearance, pressure)
    except (OverflowError, ZeroDivisionError):
        return None
    return scale if all(0 < value < math.inf for value in scale.values()) else None


def _names_units(node: Any) -> bool:
    """Whether any table has the key `units`."""
    if isinstance(node, Mapping):
        return UNITS in node or any(map(_names_units, node.values()))
    return isinstance(node, list | tuple) and any(map(_names_units, node))


@dataclass
class _Walk:
    """One walk over the tables of a document; ``written`` collects what was in SI units."""

    root: type[Table]
    document: Document
    scale: Scale
    written: dict[Path, Written] = field(default_factory=dict)

    def table(self, model: type[Table], node: Any, at: Path, units: Any) -> Any:
        """A table of a model and all below it; ``units``: those of the table around it."""
        if not isinstance(node, Mapping):
            return node
        units = node.get(UNITS, units) if UNITS in model.model_fields else units
        converted: Document = {}
        for name, value in node.items():
            declared = model.model_fields.get(name)
            if name == UNITS and declared is not None and value in ("dimensionless", SI):
                continue
            if declared is None:
                converted[name] = value
            elif units == SI and (measures := measures_of(self.root, self.document, node, model, declared)):
                key = _twin(model, declared, measures, node) or name
                converted[key] = self._number(value, measures, (*at, name), (*at, key))
            elif units == SI and (measures := self._measures_of_other(model, declared, node)):
                converted[name] = self._number(value, measures, (*at, name), (*at, name))
            elif units == SI and extra_of(declared, "holds_keys"):
                converted[name] = self._keys(value, (*at, name))
            else:
                inner = inner_with_units(model, name)
                inside = value if inner is None else self._inside(inner, declared, value, (*at, name), units)
                converted[name] = inside
        return converted

    def _measures_of_other(
        self, model: type[Table], declared: FieldInfo, node: Mapping[str, Any]
    ) -> tuple[str, ...]:
        """What the key measures whose unit a key has, unless that one stays in its SI unit."""
        other = extra_of(declared, "in_unit_of")
        if other not in node:
            return ()
        measures = measures_of(self.root, self.document, node, model, model.model_fields[other])
        stays = measures and _twin(model, model.model_fields[other], measures, node)
        return () if stays else measures

    def _inside(self, inner: type[Table], declared: FieldInfo, value: Any, at: Path, units: Any) -> Any:
        """A table, the tables of an array or those with free names."""
        if isinstance(value, list | tuple):
            return [self.table(inner, item, (*at, index), units) for index, item in enumerate(value)]
        if isinstance(value, Mapping) and _has_free_names(declared):
            return {name: self.table(inner, item, (*at, name), units) for name, item in value.items()}
        return self.table(inner, value, at, units)

    def _number(self, value: Any, measures: tuple[str, ...], at: Path, to: Path) -> Any:
        """A number or an array of numbers, dimensionless unless another key takes it as it is."""
        kept = at != to
        rows = isinstance(value, list | tuple) and all(isinstance(item, list | tuple) for item in value)
        measures = () if kept else measures if rows else measures[:1]
        self.written[to] = Written(at, value, measures, self.scale)
        if kept or not self.scale:
            return value
        if rows:
            padded = (*measures, *[measures[-1]] * len(value))
            return [self._divided(item, measure) for item, measure in zip(value, padded, strict=False)]
        return self._divided(value, measures[0])

    def _divided(self, value: Any, measure: str) -> Any:
        if isinstance(value, list | tuple):
            return [self._divided(item, measure) for item in value]
        return value / self.scale[measure] if _is_number(value) else value

    def _keys(self, value: Any, at: Path) -> Any:
        """Dotted keys, or values by dotted key, of the whole configuration: each means its key in SI."""
        if isinstance(value, list | tuple):
            for index, key in enumerate(value):
                self.written[(*at, index)] = Written((*at, index), key, (), self.scale)
            return [self._si_name(key) for key in value]
        if not isinstance(value, Mapping):
            return value
        converted: Document = {}
        for key, number in flat(value):
            name = self._si_name(key)
            measures = () if name != key else measures_of_key(self.root, key)
            self.written[(*at, name)] = Written((*at, key), number, measures, self.scale)
            converted[name] = self._divided(number, measures[0]) if measures and self.scale else number
        return converted

    def _si_name(self, key: Any) -> Any:
        declared = declared_at(self.root, key) if isinstance(key, str) else None
        other = "" if declared is None else extra_of(declared, "si_key")
        return f"{key.rpartition('.')[0]}.{other}" if other else key


def _twin(model: type[Table], declared: FieldInfo, measures: tuple[str, ...], node: Mapping[str, Any]) -> str:
    """The key that holds the same in its SI unit; "" if it has another unit, or is written too."""
    other = extra_of(declared, "si_key")
    if not other or other in node:  # both: the table refuses that
        return ""
    return other if extra_of(model.model_fields[other], "unit") == SI_UNITS[measures[0]] else ""


def in_si(quantity: str, value: float, scale: Scale) -> str:
    """A dimensionless number in its SI unit, for readers: `19948 rpm`."""
    return f"{rounded(value * scale[quantity])} {SI_UNITS[quantity]}"


def rounded(number: float) -> str:
    """A number in SI units with the digits that a reader needs."""
    return f"{number:.0f}" if 1e3 <= abs(number) < 1e7 else f"{number:.4g}"


def in_both(quantity: str, value: float, scale: Scale, form: str = ".6g") -> str:
    """A dimensionless number and the same in its SI unit: `1.0778 (19948 rpm)`."""
    return f"{value:{form}} ({in_si(quantity, value, scale)})"


def _has_free_names(declared: FieldInfo) -> bool:
    return any(get_origin(kind) is dict for kind in inner_types(declared.annotation))


def _is_number(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) < math.inf and (isinstance(value, float) or value.bit_length() < 1000)
