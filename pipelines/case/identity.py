"""Identity of a case: a hash of everything that determines the numbers, and how two configurations differ."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipelines.case.models import Case

PHYSICS = ("gas", "rotor", "bearings", "excitation", "operation", "numerics")
"""Tables of a case that determine the numbers; the others name it, or say what to compute from it."""


def physics_hash(case: Case) -> str:
    """SHA-256 (64 hexadecimal digits) of physics and numerics in canonical JSON.

    The name and the stage tables do not enter, and neither do order and notation of the keys in the file;
    `speed` and `speed_rpm` of the same speed are different configurations.
    """
    physics = case.model_dump(mode="json", include=set(PHYSICS))
    canonical = json.dumps(physics, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def differences(
    first: Mapping[str, Any], second: Mapping[str, Any], tables: Sequence[str] = PHYSICS
) -> list[str]:
    """Say in which keys two resolved configurations differ, such as `numerics.axial: 3 / 2`.

    `first` and `second` are dictionaries of JSON types (`NamedCase.resolved`, or as read back from a store);
    `tables` are the tables that count: `PHYSICS`, with "continue_cycles" for a branch.  A key that one of
    the configurations lacks counts as null.
    """
    left = dict(_values({name: first.get(name) for name in tables}))
    right = dict(_values({name: second.get(name) for name in tables}))
    keys = dict.fromkeys([*left, *right])
    return [
        f"{key}: {json.dumps(left.get(key))} / {json.dumps(right.get(key))}"
        for key in keys
        if left.get(key) != right.get(key)
    ]


def _values(node: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of nested tables and arrays with its dotted key; an empty array counts as a value."""
    if isinstance(node, Mapping):
        for name, value in node.items():
            yield from _values(value, f"{key}.{name}" if key else str(name))
    elif isinstance(node, list | tuple) and node:
        for index, value in enumerate(node):
            yield from _values(value, f"{key}.{index}")
    else:
        yield key, list(node) if isinstance(node, tuple) else node
