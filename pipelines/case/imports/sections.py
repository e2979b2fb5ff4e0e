"""Shaft sections from a CSV table: length, diameters, material.

The header names the columns; a unit may follow in brackets, as in `length [mm]`. Numbers without unit are in
metres. Columns are separated by commas, semicolons or tabulators; between semicolons and tabulators a comma
may be the decimal sign. Empty lines and lines that begin with # are skipped.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from pipelines.case.imports.parts import Findings, Imported, Part
from pipelines.case.rotor import MAXIMUM_ELEMENTS, STEEL, Element

UNITS: Mapping[str, Callable[[float], float]] = MappingProxyType(
    {
        "m": lambda value: value,
        "cm": lambda value: value / 100.0,
        "mm": lambda value: value / 1000.0,
        "in": lambda value: value * 25.4 / 1000.0,
    }
)
LENGTHS = ("length", "outer_diameter", "outer_diameter_right", "inner_diameter", "inner_diameter_right")
NEEDED = ("length", "outer_diameter")
COLUMNS = (*LENGTHS, "material", "count")
MOST_PARTS = 200
"""Elements into which sections without `count` are divided in all, at most about so many."""


def read_sections(text: str, file: str) -> Imported:
    """The shaft of a table; raises CaseError with the line of every problem."""
    findings = Findings(file)
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        findings.refuse(1, "", "holds no table: the first line names the columns, such as length [mm]")
        findings.close()
    delimiter = max(",;\t", key=lines[0][1].count)
    rows = [(number, next(csv.reader([line], delimiter=delimiter))) for number, line in lines]
    columns = _columns(rows[0][1], rows[0][0], findings)
    findings.close()
    if len(rows) == 1:
        findings.refuse(rows[0][0], "", "has a header, but no section")
    read = [_section(cells, columns, delimiter, number, findings) for number, cells in rows[1:]]
    findings.close()
    elements = _divided([(element, given) for element, given in filter(None, read)])
    names = dict.fromkeys(element.material for element in elements)
    materials = {name: STEEL if name == "steel" else None for name in names}
    found = Imported(file, materials, tuple(Part(element) for element in elements))
    return findings.check(found)


def _columns(header: Sequence[str], line: int, findings: Findings) -> list[tuple[str, str]]:
    """Name and unit of every column."""
    columns: list[tuple[str, str]] = []
    for cell in header:
        words = re.fullmatch(r"\s*([^\[(]*?)\s*(?:[\[(]\s*(\w+)\s*[\])])?\s*", cell)
        name = re.sub(r"[\s-]+", "_", words[1].lower()) if words else cell
        name = name.removesuffix("_left")
        unit = (words[2] or "") if words else ""
        if name not in COLUMNS:
            findings.refuse(line, cell.strip(), f"unknown column; allowed are {', '.join(COLUMNS)}")
        elif name in (known for known, _ in columns):
            findings.refuse(line, cell.strip(), "this column is there twice")
        elif unit and (name not in LENGTHS or unit not in UNITS):
            units = ", ".join(UNITS) if name in LENGTHS else "none"
            findings.refuse(line, cell.strip(), f"unknown unit; allowed here: {units}")
        columns.append((name, unit or "m"))
    names = [name for name, _ in columns]
    for needed in NEEDED:
        if needed not in names and not findings.problems:
            findings.refuse(line, needed, "is missing: this column is needed")
    return columns


def _section(
    cells: Sequence[str], columns: Sequence[tuple[str, str]], delimiter: str, line: int, findings: Findings
) -> tuple[Element, bool] | None:
    """The section of a line as one element or as `count` of them, and whether `count` was given."""
    if len(cells) > len(columns):
        findings.refuse(line, "", f"has {len(cells)} cells, but the header has {len(columns)}")
        return None
    values: dict[str, float | int | str] = {}
    for (name, unit), cell in zip(columns, cells, strict=False):
        word = cell.strip()
        if not word:
            continue
        if name == "material":
            values[name] = "steel" if word.lower() == "steel" else word
            continue
        number = _number(word, delimiter)
        if number is None or (name == "count" and not number.is_integer()):
            kind = "a whole number" if name == "count" else "a finite number"
            findings.refuse(line, name, f"must be {kind}", word[:40])
            return None
        values[name] = int(number) if name == "count" else UNITS[unit](number)
    count = values.get("count")
    if isinstance(count, int) and count > 0 and isinstance(values.get("length"), float):
        values["length"] = float(values["length"]) / count  # of one element
    element = findings.table(Element, values, line, "section")
    return None if element is None else (element, count is not None)


def _number(word: str, delimiter: str) -> float | None:
    try:
        value = float(word if delimiter == "," else word.replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _divided(sections: Sequence[tuple[Element, bool]]) -> list[Element]:
    """Sections without a given count, divided into elements about as long as they are thick.

    No element is made shorter than the shaft's length over ``MOST_PARTS``.
    """
    total = sum(element.length * element.count for element, _ in sections)
    elements = []
    for element, given in sections:
        thickness = max(element.outer_diameter, element.right_diameters[0], total / MOST_PARTS)
        count = min(math.ceil(element.length / thickness * (1 - 1e-9)), MAXIMUM_ELEMENTS)
        divided = {"length": element.length / count, "count": count}
        elements.append(element if given else element.model_copy(update=divided))
    return elements
