"""The stored cycles that a page holds: journal orbits and multipliers, thinned to a bounded size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, local_name
from pipelines.figures.contents import CaseView

SAMPLES = 48  # points of an orbit
MULTIPLIERS = 12  # of a cycle, the largest
ARRAYS = (
    *("speed", "excitation_frequency", "displacement", "foil_stiffness"),
    *("unstable_count", "multipliers", "orbit", "minimum_film"),
)
PLACE_DIGITS, DIGITS = 7, 5  # significant digits of parameters; decimals of orbits and multipliers


@dataclass(frozen=True)
class StoredCycles:
    """Cycles in the plane of two parameters as plain data, and how many the store holds there."""

    cycles: list[dict[str, Any]]
    total: int


def stored_cycles(store: Store, view: CaseView, case: str, plane: tuple[str, str], most: int) -> StoredCycles:
    """At most ``most`` cycles of the branches along either parameter, evenly from all of them.

    A cycle: ``branch`` and ``row``, ``x`` and ``y``, ``turns`` (excitation periods), ``unstable`` multipliers
    outside the circle, ``multipliers`` [re, im], ``orbits`` of the journals (x, y, x, y, ... over their own
    clearance), ``film`` smallest thickness of each bearing.
    """
    found = {name: read_group(store, name, ()) for name in cycle_groups(store, case)}
    inside = [
        (name, row)
        for name, group in found.items()
        if group.attributes.get("parameter") in plane
        for row in range(group.n_points)
    ]
    chosen: dict[str, list[int]] = {}
    count = min(most, len(inside))
    for place in np.unique(np.round(np.linspace(0, len(inside) - 1, count)).astype(int)) if count else ():
        name, row = inside[place]
        chosen.setdefault(name, []).append(row)
    cycles: list[dict[str, Any]] = []
    for name, rows in chosen.items():
        held = found[name].attributes["arrays"]
        group = read_group(store, name, [array for array in ARRAYS if array in held])
        cycles += [cycle_data(view, group, row, plane) for row in rows if _has_place(group, row, plane)]
    return StoredCycles(cycles, len(inside))


def cycle_groups(store: Store, case: str) -> list[str]:
    """Full names of the branches of cycles of a case."""
    return [name for name in list_groups(store, case) if local_name(name).startswith("cycles/")]


def _has_place(group: Group, row: int, plane: tuple[str, str]) -> bool:
    return all(np.isfinite(group[name][row]) for name in plane)


def cycle_data(view: CaseView, group: Group, row: int, plane: tuple[str, str]) -> dict[str, Any]:
    """One cycle as plain data (see `stored_cycles`)."""
    multipliers, films = (_row(group, name, row) for name in ("multipliers", "minimum_film"))
    known = multipliers[np.isfinite(multipliers)][:MULTIPLIERS]
    return {
        "branch": local_name(group.name),
        "row": row,
        "x": _significant(group[plane[0]][row]),
        "y": _significant(group[plane[1]][row]),
        "turns": int(group.attributes.get("turns", 1)),
        "unstable": int(group["unstable_count"][row]),
        "multipliers": [[_rounded(value.real), _rounded(value.imag)] for value in known],
        "orbits": _orbits(view, _row(group, "orbit", row)),
        "film": [_rounded(value) if np.isfinite(value) else None for value in films],
    }


def _row(group: Group, name: str, row: int) -> NDArray[Any]:
    """A row of an array; nothing where the group has no such array."""
    return group[name][row] if name in group else np.zeros(0)


def _orbits(view: CaseView, orbit: NDArray[np.float64]) -> list[list[float]]:
    """Journal orbits (x, y, ...) of every bearing; none where the orbit was not stored."""
    if not np.isfinite(orbit).all() or not len(orbit) or "bearing_node" not in view.machine:
        return []
    samples = thinned(len(orbit))
    return [
        [_rounded(value) for value in view.journal(orbit[samples], bearing).ravel()]
        for bearing in range(view.bearings)
    ]


def thinned(samples: int) -> NDArray[np.int64]:
    """At most SAMPLES of the samples of a period, evenly."""
    count = min(samples, SAMPLES)
    return np.arange(count) * samples // count


def _rounded(value: float) -> float:
    return round(float(value), DIGITS) + 0.0  # no negative zero


def _significant(value: float) -> float:
    return float(f"{value:.{PLACE_DIGITS}g}")
