"""Errors of a configuration: place, value, what is allowed and the nearest valid key."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from pipelines.case.fields import InconsistentError, Path, Table, bounds_of, extra_of, field_at, keys_of
from pipelines.case.units import Dimensionless

MOST_PRINTED = 50
LONGEST_VALUE = 60

_MISSING = "is missing"
_WRONG_TYPES = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "finite_number": "must be a finite number",
    "tuple_type": "must be an array",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
}
_OUT_OF_BOUNDS = {
    "greater_than": ("gt", ">"),
    "greater_than_equal": ("ge", ">="),
    "less_than": ("lt", "<"),
    "less_than_equal": ("le", "<="),
}


@dataclass(frozen=True)
class Problem:
    """One error of a configuration."""

    file: str
    """The name of the file, or the command-line override."""
    line: int | None
    """Line of the key, or of the table that should hold it; None for an override."""
    key: str
    """Dotted path of the key; "" for text that is not TOML."""
    value: str
    """The given value, shortened; "" where there is none."""
    message: str
    """What is wrong and what is allowed."""
    suggestion: str = ""
    """The nearest valid key or word, "" without one."""

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        what = f"{self.key} = {self.value}" if self.value else self.key
        hint = f" (did you mean {self.suggestion}?)" if self.suggestion else ""
        return f"{place}: {what}: {self.message}{hint}" if what else f"{place}: {self.message}{hint}"


class CaseError(ValueError):
    """A configuration cannot be used; `problems` lists all errors in the order of the file."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        unique = dict.fromkeys(problems)
        self.problems = tuple(
            sorted(unique, key=lambda problem: (problem.line is None, problem.line or 0, problem.key))
        )
        super().__init__(self.problems)

    def __str__(self) -> str:
        lines = [str(problem) for problem in self.problems[:MOST_PRINTED]]
        if len(self.problems) > MOST_PRINTED:
            lines.append(f"... and {len(self.problems) - MOST_PRINTED} more problems")
        return "\n".join(lines)


@dataclass(frozen=True)
class Places:
    """Where the values of a configuration come from."""

    file: str
    lines: Mapping[Path, int]
    """Lines of the keys in the file."""
    origins: dict[Path, tuple[str, int | None]] = field(default_factory=dict)
    """Places of the values that an override or a sweep has set; they win over the lines."""
    units: Dimensionless = field(default_factory=lambda: Dimensionless({}))
    """What the file has in SI units."""

    def own(self, path: Path) -> tuple[str, int | None] | None:
        """The place of a key that is written in the file; None otherwise."""
        if path in self.origins:
            return self.origins[path]
        return (self.file, self.lines[path]) if path in self.lines else None

    def as_written(self, path: Path, value: str, message: str) -> tuple[Path, str, str]:
        """Path, shown value and message as of the file, for those of a value that was made dimensionless."""
        for length in range(len(path), 0, -1):
            if (written := self.units.written.get(path[:length])) is not None:
                below = path[length:]
                note = written.note(below) if re.search("[1-9]", message) else ""
                told = f"{message} ({note})" if note and note.rpartition(" ")[2] not in message else message
                own = shown(value_at(written.value, below)) if value else ""
                return (*written.path, *below), own, told
        return path, value, message

    def nearest(self, path: Path) -> tuple[str, int | None]:
        """The place of a key, of the key that it inherits from, or of the innermost table around it."""
        for length in range(len(path), 0, -1):
            part = path[:length]
            if (place := self.own(part) or self.own(_in_first_bearing(part))) is not None:
                return place
        return self.file, 1


def problems_of(error: ValidationError, root: type[Table], places: Places) -> list[Problem]:
    """Translate the errors of the models into problems.

    A key that the second bearing inherits is reported once, for the first bearing; a misspelt key is not
    reported as missing too.
    """
    found: dict[tuple[Path, str], Problem] = {}
    for stated_path, stated_value, stated, suggestion in _statements(error, root):
        if any(stated_path[: len(unknown)] == unknown for unknown in places.units.unknown):
            continue  # in SI units that nothing makes dimensionless, which is reported
        path, value, message = places.as_written(stated_path, stated_value, stated)
        file, line = places.nearest(path)
        first = _in_first_bearing(path)
        if first != path and places.nearest(first) == (file, line) and (first, message) in found:
            continue
        if first != path and places.own(path) is None and (first, message) in found:
            continue
        key = ".".join(str(part) for part in path)
        found[path, message] = Problem(file, line, key, value, message, suggestion)
    misspelt = {problem.suggestion for problem in found.values()}
    return [
        problem
        for problem in found.values()
        if not (problem.key in misspelt and problem.message.startswith(_MISSING))
    ]


def _in_first_bearing(path: Path) -> Path:
    """The path that a key of the second bearing is inherited from; other paths as they are."""
    inherited = path[:2] == ("bearings", 1) and path[2:] != ("node",)
    return ("bearings", 0, *path[2:]) if inherited else path


def _statements(error: ValidationError, root: type[Table]) -> Iterator[tuple[Path, str, str, str]]:
    """Path, shown value, message and suggestion of everything in a validation error."""
    for detail in error.errors(include_url=False):
        path: Path = tuple(detail["loc"])
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, InconsistentError):
            for below, message in cause.problems:
                yield (*path, *below), shown(value_at(detail["input"], below)), message, ""
            continue
        if detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]:
            continue  # entries that are themselves refused are not counted
        owner, declared = field_at(root, path)
        if detail["type"] == "extra_forbidden":
            message, suggestion = _unknown(root, owner, path)
        else:
            message, suggestion = _message(detail, declared, isinstance(path[-1], int))
        value = "" if detail["type"] == "missing" else shown(detail["input"])
        yield path, value, message, suggestion


def _message(detail: Mapping[str, Any], declared: FieldInfo | None, is_item: bool) -> tuple[str, str]:
    kind, context = detail["type"], detail.get("ctx", {})
    because = extra_of(declared, "because") if declared is not None else ""
    reason = f": {because}" if because else ""
    if kind == "missing":
        if is_item:
            return f"{_MISSING}: exactly two entries are needed", ""
        return f"{_MISSING}: {_meaning(declared)}", ""
    if kind == "literal_error":
        words = _literals(context["expected"])
        near = difflib.get_close_matches(str(detail["input"])[:100], words, n=1, cutoff=0.4)
        return f"must be one of {', '.join(words)}", near[0] if near else ""
    if kind in _OUT_OF_BOUNDS:
        name, sign = _OUT_OF_BOUNDS[kind]
        bounds = bounds_of(declared) if declared is not None else ""
        return f"must be {bounds or f'{sign} {context[name]:g}'}{reason}", ""
    if kind in _WRONG_TYPES:
        return _WRONG_TYPES[kind] + (f" [{unit}]" if (unit := _unit(declared)) else ""), ""
    if kind == "too_long":
        return f"has more than the {context['max_length']} entries that are allowed{reason}", ""
    if kind == "too_short":
        return f"needs at least {context['min_length']} entries{reason}", ""
    if kind == "string_pattern_mismatch":
        return (
            f"may hold {_meaning(declared).split(';')[-1].strip()}, starting with a letter or digit{reason}",
            "",
        )
    return f"{detail['msg'][:1].lower()}{detail['msg'][1:]}{reason}", ""


def _unknown(root: type[Table], owner: type[Table] | None, path: Path) -> tuple[str, str]:
    """An unknown key: the nearest key of its own table, or a key of that name in another table."""
    allowed = list(owner.model_fields) if owner is not None else []
    name = str(path[-1])[:100]
    everywhere = [key for key, _ in keys_of(root)]
    namesakes = [key for key in everywhere if key.rsplit(".", 1)[-1] == name]
    near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.6)
    if near:
        prefix = ".".join(str(part) for part in path[:-1])
        suggestion = f"{prefix}.{near[0]}" if prefix else near[0]
    else:
        suggestion = namesakes[0] if namesakes else ""
    return f"unknown key; allowed here: {', '.join(allowed)}", suggestion


def value_at(value: Any, path: Path) -> Any:
    """The part of an input at a path; the input itself where the path leads nowhere."""
    for part in path:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return value
    return value


def shown(value: Any) -> str:
    """A value as a user would write it, shortened; tables and nothing as ""."""
    if value is None or isinstance(value, dict) or (isinstance(value, list | tuple) and _holds_tables(value)):
        return ""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (ValueError, RecursionError):
        text = str(type(value).__name__)
    text = text.replace("NaN", "nan").replace("Infinity", "inf")
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def _holds_tables(value: list[Any] | tuple[Any, ...]) -> bool:
    return any(isinstance(item, dict | Table) for item in value)


def _literals(expected: str) -> list[str]:
    """`'a', 'b' or 'c'` as words."""
    return [word.strip("'") for word in expected.replace(" or ", ", ").split(", ")]


def _meaning(declared: FieldInfo | None) -> str:
    if declared is None or not declared.description:
        return "it is needed"
    unit = _unit(declared)
    return declared.description + (f" [{unit}]" if unit else "")


def _unit(declared: FieldInfo | None) -> str:
    return extra_of(declared, "unit") if declared is not None else ""
