"""Overrides, inheritance and sweeps: how one TOML document becomes the tables of one or more cases."""

from __future__ import annotations

import copy
import hashlib
import itertools
import math
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipelines.case.fields import ALTERNATIVES, Inconsistency, Path

MOST_CASES = 10_000
LONGEST_ID = 200  # so that every file named after a case keeps below the 255 bytes of a file system
_DIGITS = 12

Document = dict[str, Any]


class MisplacedError(ValueError):
    """A value cannot be put where a dotted path points."""


@dataclass(frozen=True)
class Sweep:
    """Keys that are swept together, most often one, and their values."""

    keys: tuple[str, ...]
    """Dotted paths, as in `--set`."""
    rows: tuple[tuple[Any, ...], ...]
    """One value for each key, by row."""
    source: Path
    """Path of the list in the file; () for an override."""
    labels: tuple[str, ...] = ()
    """Names of the rows in the ids of cases; without them the values of the keys are."""

    @property
    def name(self) -> str:
        """The name as in the file: one key, or several separated by commas."""
        return ", ".join(self.keys)

    def without(self, keys: Collection[str]) -> Sweep | None:
        """The sweep of its other keys, equal rows once; None if no key is left."""
        kept = [column for column, key in enumerate(self.keys) if key not in keys]
        if not kept or len(kept) == len(self.keys):
            return self if kept else None
        rows = [tuple(row[column] for column in kept) for row in self.rows]
        once = {_words(row): row for row in rows}
        return Sweep(tuple(self.keys[column] for column in kept), tuple(once.values()), self.source)

    def names(self, short: Mapping[str, str]) -> list[str]:
        """The part of a case's id by row, from the short names of the keys: `stiffness=3`."""
        if self.labels:
            return list(self.labels)
        rows = (zip(self.keys, _words(row), strict=True) for row in self.rows)
        return ["_".join(f"{short[key]}={word}" for key, word in row) for row in rows]


def inherit_bearing(document: Document) -> None:
    """Copy keys that the second of two [[bearings]] omits from the first, except `node`.

    Tables are merged key by key; a key replaces its alternatives (`areal_stiffness` a `stiffness`).
    """
    bearings = document.get("bearings")
    if isinstance(bearings, list) and len(bearings) == 2 and all(isinstance(item, dict) for item in bearings):
        _fill(bearings[1], {key: value for key, value in bearings[0].items() if key != "node"})


def _fill(table: Document, source: Mapping[str, Any]) -> None:
    given = set(table)
    for key, value in source.items():
        if key not in given:
            if not any(key in group and given & set(group) for group in ALTERNATIVES):
                table[key] = copy.deepcopy(value)
        elif isinstance(value, dict) and isinstance(table[key], dict):
            _fill(table[key], value)


def assign(document: Document, key: str, value: Any) -> list[Path]:
    """Put a value where a dotted path points; a list of tables without index means each of its tables.

    Missing tables are made, and the alternatives of the key (`speed` of `speed_rpm`) are taken away.
    Returns the paths that were set, those of made tables included; raises MisplacedError.
    """
    parts = key.split(".")
    if not all(parts):
        raise MisplacedError("is not a key: write it as table.key, such as gas.viscosity")
    return list(_assign(document, parts, value, ()))


def _assign(node: Any, parts: Sequence[str], value: Any, at: Path) -> Iterator[Path]:
    name, *rest = parts
    if isinstance(node, list):
        if name.isdecimal() and len(name) < 10:
            yield from _assign_item(node, int(name), rest, value, at)
        elif node and all(isinstance(item, dict) for item in node):
            for index, item in enumerate(node):
                yield from _assign(item, parts, value, (*at, index))
        else:
            raise MisplacedError(f"leads through {_dotted(at)}, which is an array of values: give an index")
    elif not isinstance(node, dict):
        raise MisplacedError(f"leads through {_dotted(at)}, which is a value and no table")
    elif rest:
        if name not in node:
            node[name] = {}
            yield (*at, name)
        yield from _assign(node[name], rest, value, (*at, name))
    else:
        for group in ALTERNATIVES:
            if name in group and value is not False:
                for other in group:
                    node.pop(other, None)
        node[name] = copy.deepcopy(value)
        yield (*at, name)


def _assign_item(node: list[Any], index: int, rest: Sequence[str], value: Any, at: Path) -> Iterator[Path]:
    if index >= len(node):
        raise MisplacedError(
            f"names entry {index} of {_dotted(at)}, which has the entries 0 to {len(node) - 1}"
        )
    if rest:
        yield from _assign(node[index], rest, value, (*at, index))
    else:
        node[index] = copy.deepcopy(value)
        yield (*at, index)


def values_at(node: Any, key: str) -> Iterator[Any]:
    """The values where a dotted path points, as `assign` reads it; none where it leads nowhere."""
    name, _, rest = key.partition(".")
    if isinstance(node, list) and not name.isdecimal():
        for item in node:
            yield from values_at(item, key)
        return
    try:
        inner = node[int(name) if isinstance(node, list) else name]
    except (KeyError, IndexError, TypeError):
        return
    yield from values_at(inner, rest) if rest else (inner,)


def flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables; quoted dotted keys and nested tables mean the same."""
    for name, value in content.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _dotted(path: Path) -> str:
    return ".".join(str(part) for part in path)


def parse_override(text: str) -> tuple[str, Any]:
    """Split `key=value`; the value is a TOML value, or a bare word taken as a string.

    Raises MisplacedError.
    """
    key, separator, literal = text.partition("=")
    if not separator or not key.strip():
        raise MisplacedError("is no assignment: write key=value, such as gas.viscosity=1.85e-5")
    literal = literal.strip()
    try:
        document = tomllib.loads(f"value = {literal}")
    except (ValueError, RecursionError):
        document = {}
    if set(document) == {"value"}:
        return key.strip(), document["value"]
    if not re.fullmatch(r"[A-Za-z0-9_./+-][A-Za-z0-9_./+ -]*", literal):
        raise MisplacedError("has a value that is neither a TOML value nor a bare word")
    return key.strip(), literal


def read_sweeps(table: Any, at: Path = ("sweep",), prefix: str = "") -> Iterator[Sweep | Inconsistency]:
    """The sweeps of the [sweep] table; quoted dotted keys and nested tables mean the same.

    A name of several keys with commas between them sweeps these together: its list holds lists, each with
    one value for every key.  What is no such list is yielded as its path and what is wrong with it.
    """
    if not isinstance(table, dict):
        yield at, "must be a table of lists"
        return
    for name, value in table.items():
        path = (*at, name)
        if isinstance(value, dict):
            yield from read_sweeps(value, path, f"{prefix}{name}.")
        else:
            yield from sweep_of([f"{prefix}{key}" for key in split_keys(name)], value, path)


def split_keys(name: str) -> tuple[str, ...]:
    """The keys of a name such as `bearings.foil.stiffness, excitation.frequency`."""
    return tuple(key.strip() for key in name.split(","))


def sweep_of(keys: Sequence[str], values: Any, source: Path) -> Iterator[Sweep | Inconsistency]:
    """The sweep of keys over a list of values, or the paths of what is wrong and the reasons.

    Several keys take lists with a value for each of them.
    """
    if not isinstance(values, list) or not values:
        yield source, "must be a list with at least one value"
        return
    if len(keys) == 1:
        yield Sweep(tuple(keys), tuple((value,) for value in values), source)
        return
    wrong = [index for index, row in enumerate(values) if not isinstance(row, list) or len(row) != len(keys)]
    for index in wrong:
        yield (*source, index), f"must be a list of {len(keys)} values, one for each of {', '.join(keys)}"
    if not wrong:
        yield Sweep(tuple(keys), tuple(tuple(row) for row in values), source)


def combinations(sweeps: Sequence[Sweep]) -> Iterator[tuple[str, tuple[tuple[Any, ...], ...]]]:
    """Case id and a row of every sweep, for all combinations of rows.

    For instance ("stiffness=3_displacement=0.2", ((3,), (0.2,))).

    Raises MisplacedError for too many combinations, a key that is swept twice, or rows that give one id
    twice.
    """
    count = math.prod(len(sweep.rows) for sweep in sweeps)
    if count > MOST_CASES:
        raise MisplacedError(f"makes {count} cases; at most {MOST_CASES} are allowed")
    keys = [key for sweep in sweeps for key in sweep.keys]
    if twice := next((key for key in keys if keys.count(key) > 1), None):
        raise MisplacedError(f"has the key {twice} twice")
    short = dict(zip(keys, short_names(keys), strict=True))
    named = [sweep.names(short) for sweep in sweeps]
    for sweep, names in zip(sweeps, named, strict=True):
        if len(set(names)) != len(names):
            raise MisplacedError(f"lists a value of {sweep.name} twice")
    combined = itertools.product(*(sweep.rows for sweep in sweeps))
    for parts, rows in zip(itertools.product(*named), combined, strict=True):
        yield _fitting("_".join(parts)), rows


def _fitting(case_id: str) -> str:
    """The id, or a shortened id with digits that distinguish it from others with the same beginning."""
    if len(case_id) <= LONGEST_ID:
        return case_id
    digits = hashlib.sha256(case_id.encode()).hexdigest()[:_DIGITS]
    return f"{case_id[: LONGEST_ID - _DIGITS - 1]}-{digits}"


def short_names(keys: Sequence[str]) -> list[str]:
    """The shortest ends of the keys that distinguish them."""
    names = []
    for key in keys:
        parts = key.split(".")
        others = [other.split(".") for other in keys if other != key]
        length = 1
        while length < len(parts) and any(other[-length:] == parts[-length:] for other in others):
            length += 1
        names.append(re.sub(r"[^A-Za-z0-9._-]", "-", ".".join(parts[-length:])))
    return names


def _words(row: Sequence[Any]) -> tuple[str, ...]:
    return tuple(_word(value) for value in row)


def _word(value: Any) -> str:
    """A value as part of a file name."""
    if isinstance(value, float) or (
        isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53
    ):
        return f"{value:.12g}"
    if isinstance(value, list):
        return ",".join(_word(item) for item in value)[:80]
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return re.sub(r"[^A-Za-z0-9.+-]", "-", text)[:80]
