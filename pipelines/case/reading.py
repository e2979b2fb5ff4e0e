"""From TOML text to cases: parse, inherit, override, sweep, validate; all problems are reported at once."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from pydantic import ValidationError

from pipelines.case.fields import Path
from pipelines.case.locating import key_lines
from pipelines.case.models import Case, Rotor, misplaced_journals
from pipelines.case.problems import CaseError, Places, Problem, problems_of, shown, value_at
from pipelines.case.sampling import NAME, Sampled, sample_sweep
from pipelines.case.stage_checks import STAGE_TABLES, machine_inconsistencies, stage_inconsistencies
from pipelines.case.sweeps import (
    Document,
    MisplacedError,
    Sweep,
    assign,
    combinations,
    inherit_bearing,
    parse_override,
    read_sweeps,
    split_keys,
    sweep_of,
)
from pipelines.case.units import dimensionless

__all__ = ["CaseError", "NamedCase", "Problem", "parse_toml", "read_cases", "stage_problems"]

_NOWHERE = Places("", {})


@dataclass(frozen=True)
class NamedCase:
    """A validated case and its name within the store."""

    case_id: str
    """Safe as a file name; the case's `name`, or the swept values such as `stiffness=3_displacement=0.2`."""
    case: Case
    resolved: dict[str, Any]
    """The whole configuration with defaults, of JSON types only; `Case.model_validate` reads it back."""
    places: Places = field(default=_NOWHERE, compare=False, repr=False)
    """Where its values stand, for messages; not known of a case that was not read from a file."""

    @classmethod
    def of(cls, case_id: str, case: Case, places: Places = _NOWHERE) -> Self:
        """Name a case."""
        return cls(case_id, case, case.model_dump(mode="json"), places)

    def as_dict(self) -> dict[str, Any]:
        """A plain dictionary to send to another process."""
        return {"case_id": self.case_id, "resolved": self.resolved}

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> Self:
        """The inverse of `as_dict`."""
        return cls.of(str(plain["case_id"]), Case.model_validate(plain["resolved"]))


def read_cases(
    text: str, name: str, overrides: Sequence[str] = (), stages: Collection[str] | None = None
) -> tuple[NamedCase, ...]:
    """Read a configuration from its TOML text.

    `name` is the name of the file in messages; `overrides` are assignments `key=value` that replace what the
    file says (a key without index of an array of tables means every table).  Lists in [sweep] and the
    machines of [sample] expand to one case per combination.  An override of a swept key replaces its list, or
    ends the sweep of that key if it is a single value; a key that was swept or sampled together with others
    leaves them.

    `stages` are those whose `stage_problems` count; by default all whose table is written down.

    Raises CaseError with all problems.
    """
    document = parse_toml(text, name)
    places = Places(name, key_lines(text))
    problems: list[Problem] = []
    sweeps = _sweeps(document, places, problems)
    inherit_bearing(document)
    sweeps, fixed = _override(document, sweeps, overrides, places, problems)
    sweeps += _sample(document, fixed, places, problems)
    try:
        named = list(combinations(sweeps))
    except MisplacedError as error:
        problems.append(_problem(places, sweeps[-1].source[:1], str(error)))
        named = []
    cases = [
        case
        for case_id, rows in named
        if (case := _case(document, sweeps, case_id, rows, places, problems, stages)) is not None
    ]
    if problems:
        raise CaseError(problems)
    return tuple(cases)


def parse_toml(text: str, name: str) -> Document:
    """The document of a TOML text; raises CaseError with the line for other text."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error))
        line = int(place[1]) if place and place[1] else text.count("\n") + 1
        what = str(error)[: place.start()] if place else str(error)
        column = f" at column {place[2]}" if place and place[2] else ""
        message = f"not TOML{column}: {what[:1].lower()}{what[1:]}"
    except RecursionError:
        line, message = 1, "not a configuration: arrays or tables are nested too deeply"
    except ValueError as error:
        # For instance an integer with thousands of digits.
        line, message = 1, f"not a configuration: {error}"
    raise CaseError([Problem(name, line, "", "", message)])


def _sweeps(document: Document, places: Places, problems: list[Problem]) -> list[Sweep]:
    sweeps = []
    for item in read_sweeps(document.pop("sweep", {})):
        if isinstance(item, Sweep):
            sweeps.append(item)
        else:
            problems.append(_problem(places, *item))
    return sweeps


def _override(
    document: Document, sweeps: list[Sweep], overrides: Sequence[str], places: Places, problems: list[Problem]
) -> tuple[list[Sweep], set[str]]:
    """Apply the overrides; returns the remaining sweeps, and the keys that have one value now."""
    fixed: set[str] = set()
    for text in overrides:
        source = f"--set {text}"
        try:
            name, value = parse_override(text)
            keys = split_keys(name.removeprefix("sweep."))
            swept = {key for sweep in sweeps for key in sweep.keys}.intersection(keys)
            if name.startswith("sweep.") or len(keys) > 1 or (swept and isinstance(value, list)):
                new = _swept(keys, value)
                places.origins[new.source] = (source, None)
                sweeps = _replaced(sweeps, new)
                continue
            sweeps = _without(sweeps, keys)
            fixed.add(name)
            for path in assign(document, name, value):
                places.origins[path] = (source, None)
        except MisplacedError as error:
            problems.append(Problem("--set", None, text, "", str(error)))
    return sweeps, fixed


def _sample(
    document: Document, fixed: Collection[str], places: Places, problems: list[Problem]
) -> list[Sweep]:
    """The sweep that the table [sample] asks for, if there is one."""
    if NAME not in document:
        return []
    try:
        sample = Sampled.model_validate({NAME: document.pop(NAME)}).sample
    except ValidationError as error:
        problems.extend(problems_of(error, Sampled, places))
        return []
    sweep, wrong = sample_sweep(sample, document, fixed)
    problems.extend(_problem(places, *misfit) for misfit in wrong)
    return [] if sweep is None else [sweep]


def _swept(keys: Sequence[str], values: Any) -> Sweep:
    """The sweep that an override asks for; raises MisplacedError."""
    found = next(sweep_of(keys, values, ("sweep", ", ".join(keys))))
    if isinstance(found, Sweep):
        return found
    raise MisplacedError(f"a sweep {found[1]}")


def _replaced(sweeps: Sequence[Sweep], new: Sweep) -> list[Sweep]:
    """The sweeps with a new one instead of the first that has one of its keys."""
    shared = (place for place, sweep in enumerate(sweeps) if set(sweep.keys) & set(new.keys))
    first = next(shared, len(sweeps))
    return [*sweeps[:first], new, *_without(sweeps[first:], new.keys)]


def _without(sweeps: Sequence[Sweep], keys: Collection[str]) -> list[Sweep]:
    """The sweeps of all other keys."""
    return [left for sweep in sweeps if (left := sweep.without(keys)) is not None]


def _case(
    document: Document,
    sweeps: Sequence[Sweep],
    case_id: str,
    rows: Sequence[Sequence[Any]],
    places: Places,
    problems: list[Problem],
    stages: Collection[str] | None,
) -> NamedCase | None:
    """One case of the sweep; None if it has problems, which are appended."""
    own = copy.deepcopy(document)
    own_places = replace(places, origins=dict(places.origins))
    misplaced = False
    for sweep, row in zip(sweeps, rows, strict=True):
        place = places.nearest(sweep.source)
        for key, value in zip(sweep.keys, row, strict=True):
            try:
                for path in assign(own, key, value):
                    own_places.origins[path] = place
            except MisplacedError as error:
                values = [each[sweep.keys.index(key)] for each in sweep.rows]
                problems.append(Problem(*place, f"{sweep.source[0]}.{key}", shown(values), str(error)))
                misplaced = True
    own_places = replace(own_places, units=dimensionless(Case, own))
    try:
        case = Case.model_validate(own_places.units.document)
    except ValidationError as error:
        problems.extend(problems_of(error, Case, own_places))
        problems.extend(_journal_problems(own, own_places))
        return None
    if misplaced:
        return None
    named = NamedCase.of(case_id or case.name, case, own_places)
    written = [stage for stage, (table, *_) in STAGE_TABLES.items() if table in own]
    problems.extend(stage_problems(named, written if stages is None else stages))
    return named


def stage_problems(named: NamedCase, stages: Iterable[str]) -> list[Problem]:
    """Why stages cannot compute a case, each reason once."""
    written = named.places.units.written
    told = named.resolved, written
    of_stages = (misfit for stage in stages for misfit in stage_inconsistencies(named.case, stage, *told))
    misfits = dict.fromkeys((*machine_inconsistencies(named.case, *told), *of_stages))
    return [_stage_problem(named, path, message) for path, message in misfits]


def _stage_problem(named: NamedCase, path: Path, message: str) -> Problem:
    value = shown(value_at(named.resolved, path))
    path, value, told = named.places.as_written(path, value, message)
    is_default = value and named.places.file and named.places.own(path) is None
    told += " (not given: this is the default)" * bool(is_default)
    return Problem(*named.places.nearest(path), ".".join(map(str, path)), value, told)


def _journal_problems(document: Document, places: Places) -> list[Problem]:
    """Bearings off the shaft, found even if something else is wrong with the bearings."""
    bearings = document.get("bearings")
    if not isinstance(bearings, list) or not all(isinstance(item, dict) for item in bearings):
        return []
    try:
        rotor = Rotor.model_validate(document.get("rotor"))
    except ValidationError:
        return []
    nodes = [item.get("node") for item in bearings[:2]]
    problems = []
    for (index, key), message in misplaced_journals(rotor, nodes):
        file, line = places.nearest(("bearings", index, key))
        problems.append(Problem(file, line, f"bearings.{index}.{key}", shown(nodes[int(index)]), message))
    return problems


def _problem(places: Places, path: Path, message: str) -> Problem:
    file, line = places.nearest(path)
    return Problem(file, line, ".".join(map(str, path)), "", message)
