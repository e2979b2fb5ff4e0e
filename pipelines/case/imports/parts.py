"""An imported rotor: tables of a case with remarks, and what could not be carried over."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from pipelines.case.fields import Table
from pipelines.case.problems import CaseError, Places, Problem, problems_of
from pipelines.case.rotor import STEEL, Disc, Element, Material, Rotor, Support

Kind = TypeVar("Kind", bound=Table)


@dataclass(frozen=True)
class Part(Generic[Kind]):
    """A table of the rotor and what its comment says."""

    table: Kind
    remark: str = ""


@dataclass(frozen=True)
class Imported:
    """A rotor read from elsewhere, in SI units.

    ``materials`` holds None where only the name is known. ``foil_nodes`` are where the foil bearings belong,
    () where nothing tells. ``changed`` says what is approximated, ``lost`` what is left out.
    """

    source: str
    materials: Mapping[str, Material | None]
    elements: tuple[Part[Element], ...]
    discs: tuple[Part[Disc], ...] = ()
    supports: tuple[Part[Support], ...] = ()
    foil_nodes: tuple[int, ...] = ()
    rayleigh_mass: float = 0.0
    rayleigh_stiffness: float = 0.0
    speed_rpm: float | None = None
    changed: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    @property
    def last_node(self) -> int:
        """The node at the right end; the first one is 0."""
        return sum(part.table.count for part in self.elements)

    @property
    def node_positions(self) -> tuple[float, ...]:
        """Axial position of every node [m]."""
        return self.rotor((0, self.last_node)).node_positions()

    def rotor(self, masters: tuple[int, ...]) -> Rotor:
        """The rotor with its supports; materials of which only the name is known count as steel.

        Raises ValidationError where it cannot be.
        """
        return Rotor(
            materials={name: material or STEEL for name, material in self.materials.items()},
            elements=tuple(part.table for part in self.elements),
            discs=tuple(part.table for part in self.discs),
            supports=tuple(part.table for part in self.supports),
            masters=masters,
            rayleigh_mass=self.rayleigh_mass,
            rayleigh_stiffness=self.rayleigh_stiffness,
        )


@dataclass
class Findings:
    """Collects the problems of a file, and what is told about it."""

    file: str
    problems: list[Problem] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    def refuse(self, line: int | None, key: str, message: str, value: str = "") -> None:
        """Note a problem."""
        self.problems.append(Problem(self.file, line, key, value, message))

    def table(self, kind: type[Kind], values: Mapping[str, Any], line: int | None, owner: str) -> Kind | None:
        """The table of these values; None if they are refused, which is a problem of their owner."""
        try:
            return kind.model_validate(dict(values))
        except ValidationError as error:
            for found in problems_of(error, kind, Places(self.file, {})):
                self.refuse(line, f"{owner}: {found.key}" if found.key else owner, found.message, found.value)
            return None

    def number(self, values: Mapping[str, Any], key: str, line: int | None, owner: str) -> float:
        """A finite number of a table, 0 where it is not given; otherwise a problem and 0."""
        value = values.get(key, 0.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.refuse(line, f"{owner}: {key}", "must be a finite number", str(value)[:40])
            return 0.0
        return float(value)

    def close(self) -> None:
        """Raise CaseError if there are problems."""
        if self.problems:
            raise CaseError(self.problems)

    def check(self, rotor: Imported) -> Imported:
        """The rotor, whose parts fit together; raises CaseError otherwise."""
        try:
            rotor.rotor((0, rotor.last_node))
        except ValidationError as error:
            for found in problems_of(error, Rotor, Places(self.file, {})):
                self.refuse(1, found.key, found.message, found.value)
        self.close()
        return rotor


def joined(elements: Iterable[Part[Element]]) -> tuple[Part[Element], ...]:
    """Equal cylinders in a row as one table with their number."""
    rows: list[Part[Element]] = []
    for part in elements:
        before = rows[-1] if rows else None
        if before is not None and not part.table.is_cone and part.remark == before.remark:
            single = before.table.model_copy(update={"count": part.table.count})
            if single == part.table:
                count = before.table.count + part.table.count
                rows[-1] = Part(part.table.model_copy(update={"count": count}), part.remark)
                continue
        rows.append(part)
    return tuple(rows)
