"""Configurations and assignments of every kind: cases that can be stored and built, or problems with a place.

The examples start from the shipped configurations and change a few things, so that a good part of them is
accepted: the share is asserted, or a generator that makes rubbish only would pass.
"""

from __future__ import annotations

import copy
import math
import re
import string
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from pipelines.case.reading import CaseError, NamedCase, read_cases
from pipelines.datasets.branch import sizes_of
from pipelines.datasets.layout import layout
from pipelines.datasets.metadata import encode, group_folder
from pipelines.datasets.records import fit_all
from pipelines.machine.assembly import build_machine
from pipelines.stages.scheduling.preparation import case_attributes, geometry
from tests.helpers.tiny import ROOT

TEXTS = {name: (ROOT / "configs" / f"{name}.toml").read_text() for name in ("smoke", "your_rotor")}
SEVERAL = (  # tables of sweeps, and values whose alternatives are in the file
    "[sweep]\nexcitation.displacement = [0.05, 0.1]\n",
    "[sweep]\nbearings.foil.areal_stiffness = [30e9, 100e9]\nnumerics.scheme = ['central', 'backward']\n",
)
MOST_CASES_BUILT = 3
LONGEST_NAME = 255  # bytes of a name in a folder
Table = dict[str, Any]
Place = tuple[str | int, ...]

LETTERS = string.ascii_letters + string.digits + "_-. \"'\\=[]{}#,é\n"
NUMBERS = st.one_of(
    st.integers(-3, 12),
    st.floats(-2.0, 2.0),
    st.integers(),
    st.floats(),
    st.sampled_from([0, -0.0, 1e-300, 1e300, 2**63, 10**400, math.nan, math.inf, -math.inf]),
)
WORDS = st.sampled_from(
    ["central", "backward", "edge", "periodic", "rk4", "speed", "displacement", "steel", "../x", "", "nan"]
)
SCALARS = st.booleans() | NUMBERS | WORDS | st.text(LETTERS, max_size=8)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(LETTERS, max_size=6), inner, max_size=2)
    ),
    max_leaves=5,
)


def places(value: Any, at: Place = ()) -> Iterator[Place]:
    """Every key, table and entry below a value, by its path."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*at, key)
        yield from places(inner, (*at, key))


def holder(document: Table, place: Place) -> Any:
    """What holds the last part of a path."""
    found: Any = document
    for part in place[:-1]:
        found = found[part]
    return found


def scaled(value: Any, factor: float) -> Any:
    """Numbers times a factor, arrays entry by entry; everything else as it is."""
    if isinstance(value, list):
        return [scaled(item, factor) for item in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return round(value * Fraction(factor)) if isinstance(value, int) else value * factor


def misspelt(draw: st.DrawFn, key: str) -> str:
    position = draw(st.integers(0, len(key)))
    return key[:position] + draw(st.sampled_from(["", "x", "é", "."])) + key[position + 1 :]


CHANGES = ("scale", "scale", "scale", "set", "delete", "misspell", "copy", "bury", "add")
NEW_KEYS = st.sampled_from(["x", "sweep", "count", "start", "rigid", "load", "phases"])


def change(draw: st.DrawFn, document: Table) -> None:
    """Change one thing somewhere in a document."""
    place = draw(st.sampled_from(list(places(document))))
    table, key = holder(document, place), place[-1]
    kind = draw(st.sampled_from(CHANGES))
    if kind == "scale":
        table[key] = scaled(table[key], draw(st.sampled_from([0.5, 0.9, 1.0, 1.01, 1.3, 4.0, -1.0, 1e6])))
    elif kind == "set":
        table[key] = draw(VALUES)
    elif kind == "delete":
        del table[key]
    elif kind == "misspell" and isinstance(key, str):
        table[misspelt(draw, key)] = table.pop(key)
    elif kind == "copy":
        source = draw(st.sampled_from(list(places(document))))
        table[key] = copy.deepcopy(holder(document, source)[source[-1]])
    elif kind == "bury":
        for _ in range(draw(st.sampled_from([1, 3, 120]))):
            table[key] = [table[key]] if draw(st.booleans()) else {"a": table[key]}
    elif isinstance(table, dict):
        table[draw(NEW_KEYS)] = draw(VALUES)


def as_toml(value: Any) -> str:
    """A value in TOML notation."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(key)} = {as_toml(item)}" for key, item in value.items()) + "}"
    return quoted(value) if isinstance(value, str) else repr(value)


def quoted(word: str) -> str:
    return '"' + "".join(f"\\U{ord(letter):08x}" for letter in word) + '"'


@st.composite
def documents(draw: st.DrawFn) -> str:
    """A shipped configuration with one to three changes, one key in a line."""
    document = tomllib.loads(draw(st.sampled_from(sorted(TEXTS.values()))))
    for _ in range(draw(st.integers(1, 3))):
        change(draw, document)
    return "".join(f"{quoted(key)} = {as_toml(value)}\n" for key, value in document.items())


@st.composite
def damaged_texts(draw: st.DrawFn) -> str:
    """A shipped configuration with lines taken out, doubled, swapped or overwritten."""
    text = draw(st.sampled_from(sorted(TEXTS.values()))) + draw(st.sampled_from(["", *SEVERAL]))
    lines = text.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        first, second = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
        kind = draw(st.sampled_from(["out", "double", "swap", "cut", "write"]))
        if kind == "out":
            lines[first] = ""
        elif kind == "double":
            lines[second:second] = [lines[first]]
        elif kind == "swap":
            lines[first], lines[second] = lines[second], lines[first]
        elif kind == "cut":
            lines[first] = lines[first][: draw(st.integers(0, 12))]
        else:
            lines[first] += draw(st.text(LETTERS, max_size=6))
    return "\n".join(lines)


KEYS = sorted({".".join(map(str, place)) for text in TEXTS.values() for place in places(tomllib.loads(text))})


@st.composite
def assignments(draw: st.DrawFn) -> tuple[str, list[str]]:
    """A shipped configuration and assignments to keys that exist, are misspelt, or lead through anything."""
    text = draw(st.sampled_from(sorted(TEXTS.values())))
    document, words = tomllib.loads(text), []
    for _ in range(draw(st.integers(1, 3))):
        # mostly what may be accepted: three at a time are seldom all right
        if draw(st.sampled_from([True, True, False])):
            place = draw(st.sampled_from(list(places(document))))
            value = scaled(holder(document, place)[place[-1]], draw(st.sampled_from([0.9, 1.0, 1.05, 2.0])))
            words.append(f"{'.'.join(map(str, place))}={as_toml(value)}")
            continue
        key = draw(st.sampled_from(KEYS))
        parts = key.split(".")
        key = draw(
            st.sampled_from([key, f"sweep.{key}", f"{key}.x", f"{key}.0", ".".join(parts[1:])])
            | st.just(misspelt(draw, key))
            | st.text(LETTERS, max_size=12)
        )
        value = draw(VALUES.map(as_toml) | WORDS | st.text(LETTERS, max_size=10))
        words.append(draw(st.sampled_from(["{}={}", "{}={}", "{} = {}", "{}"])).format(key, value))
    return text, words


def outcome(text: str, overrides: list[str]) -> str:
    """``accepted`` when every case can be stored and built, ``refused`` when every problem has its place."""
    try:
        cases = read_cases(text, "any.toml", overrides)
    except CaseError as error:
        problems = error.problems
    else:
        problems = ()
        assert cases
    for problem in problems:
        check_problem(problem, text)
    if problems:
        return "refused"
    for named in cases[:MOST_CASES_BUILT]:
        check_case(named)
    return "accepted"


def check_problem(problem: Any, text: str) -> None:
    """A line of the file and a key of it (text that is not TOML has no keys), or the assignment."""
    assert problem.message
    if problem.line is None:
        assert problem.file.startswith("--set")
        return
    assert 1 <= problem.line <= text.count("\n") + 1
    assert problem.key or re.match("not TOML|not a configuration", problem.message), str(problem)


def check_case(named: NamedCase) -> None:
    """Everything that a command does with a case before it computes."""
    assert NamedCase.from_dict(named.as_dict()) == named
    assert len(named.case_id.encode()) <= LONGEST_NAME
    group_folder(ROOT, f"cases/{named.case_id}")
    encode(case_attributes(named) | {"configuration": named.resolved})
    arrays, attributes = geometry(named.case)
    fit_all(layout("machine", sizes_of("machine", arrays), tuple(arrays)), arrays, whole=True)
    encode(attributes)
    build_machine(named.case)


def assert_share(
    accepted: float, strategy: st.SearchStrategy[Any], split: Callable[[Any], tuple[str, list[str]]]
) -> None:
    """Run the profile's number of examples; at least so large a share of them must be accepted."""
    counts: Counter[str] = Counter()

    @given(strategy)
    def check(example: Any) -> None:
        counts[outcome(*split(example))] += 1

    check()
    assert counts["refused"] > 0
    assert counts["accepted"] >= accepted * counts.total(), counts


def test_changed_configurations() -> None:
    assert_share(0.2, documents(), lambda text: (text, []))


def test_damaged_texts() -> None:
    assert_share(0.2, damaged_texts(), lambda text: (text, []))


def test_assignments() -> None:
    assert_share(0.2, assignments(), lambda example: example)
