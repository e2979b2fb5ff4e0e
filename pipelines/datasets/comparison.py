"""Compare two stores: what only one of them has, and how far the rest differs.

Numbers are compared relative to the largest magnitude of their array in either store, so that noise in
components that are nearly zero does not count. Integers and flags are the same or are not. Slots, which serve
going on only, are not compared; residuals and the work they took are, and do not count: they are rounding.

Two runs may place the rows of a bifurcation curve elsewhere along the same curve. Curves whose rows do not
correspond are therefore judged by their geometry and their special points alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from pipelines.case.identity import differences
from pipelines.datasets.curves import BifurcationCurve, read_curve
from pipelines.datasets.metadata import CHECKSUM, GroupMetadata, read_group_metadata
from pipelines.datasets.reading import list_cases, list_groups, read_group
from pipelines.datasets.schema import KINDS, Array, GroupSpec
from pipelines.datasets.store import Store, case_group

# Attributes that say how much room there is, what was asked for and what a curve started from: no results.
NOT_RESULTS = frozenset(
    {"dimensions", "arrays", "request", "ranges", "origin", "half", "stop_advice", "n_points", "n_events"}
) | {CHECKSUM}
DIAGNOSTICS = frozenset(
    {"newton_history", "newton_iterations", "newton_residual", "eigenvalue_residual", "multiplier_residual",
     "event_residual", "step_error", "normal_form_error", "width_effect"}
)  # fmt: skip
SAMPLES_PER_SEGMENT = 8  # places between two rows of a curve at which its distance from the other is taken
NEAREST_STEPS = 8  # Gauss-Newton steps towards the nearest point, from the nearest of the samples


class Verdict(StrEnum):
    """How two arrays compare."""

    IDENTICAL = "identical"
    EQUAL = "equal"
    DIFFERENT = "different"


@dataclass(frozen=True)
class ArrayComparison:
    """One array of both stores.

    ``difference``: the largest one, over the largest magnitude of the array (None for shapes that
    differ, or for arrays that only one store has: see ``reason``); ``place``: its index.
    """

    array: str
    verdict: Verdict
    difference: float | None = 0.0
    place: tuple[int, ...] = ()
    reason: str = ""

    @property
    def is_wrong(self) -> bool:
        """Whether this array makes the results differ."""
        return self.verdict is Verdict.DIFFERENT and self.array not in DIAGNOSTICS


@dataclass(frozen=True)
class EventMatch:
    """A bifurcation located in both stores.

    Rows ``first`` and ``second`` of the events. ``differences``: second minus first value of each
    coordinate; ``distance``: the largest one, over the largest magnitude of that coordinate.
    """

    kind: str
    first: int
    second: int
    differences: Mapping[str, float]
    distance: float


@dataclass(frozen=True)
class CurveDistance:
    """The largest distance of a point of one curve from the other curve, and the parameters of that point.

    In parameters over their largest magnitudes.
    """

    distance: float
    place: Mapping[str, float]


@dataclass(frozen=True)
class GroupComparison:
    """One group of both stores.

    ``attributes``: sentences on those that differ; ``unmatched``: located bifurcations that only one
    store has.
    """

    group: str
    tolerance: float
    arrays: tuple[ArrayComparison, ...] = ()
    attributes: tuple[str, ...] = ()
    matches: tuple[EventMatch, ...] = ()
    unmatched: tuple[str, ...] = ()
    curve: CurveDistance | None = None

    @property
    def verdict(self) -> Verdict:
        """Whether the results agree within the tolerance (see the module)."""
        apart = any(match.distance > self.tolerance for match in self.matches)
        if self.curve is not None:
            apart = apart or self.curve.distance > self.tolerance
        else:
            apart = apart or any(array.is_wrong for array in self.arrays)
        if apart or self.attributes or self.unmatched:
            return Verdict.DIFFERENT
        same = all(array.verdict is Verdict.IDENTICAL for array in self.arrays)
        return Verdict.IDENTICAL if same else Verdict.EQUAL


@dataclass(frozen=True)
class StoreComparison:
    """Two stores.

    ``configuration``: sentences on differences of physics and numerics between cases of equal name,
    which are reported but do not count.
    """

    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    configuration: tuple[str, ...]
    groups: tuple[GroupComparison, ...]

    @property
    def are_equal(self) -> bool:
        """Whether both hold the same results within the tolerance."""
        whole = not self.only_first and not self.only_second
        return whole and all(group.verdict is not Verdict.DIFFERENT for group in self.groups)


def compare_stores(first: Store, second: Store, tolerance: float) -> StoreComparison:
    """Compare the results of two stores. Raises StoreError for a group that cannot be read."""
    mine, yours = _places(first), _places(second)
    only_first, only_second = mine - yours, yours - mine
    common = sorted(name for name in mine & yours if name.count("/") > 1)
    return StoreComparison(
        _outermost(only_first),
        _outermost(only_second),
        tuple(_configurations(first, second)),
        tuple(compare_groups(first, second, group, tolerance) for group in common),
    )


def _places(store: Store) -> set[str]:
    cases = list_cases(store)
    groups = {group for case in cases for group in list_groups(store, case)}
    return groups | {case_group(case) for case in cases}


def _outermost(names: set[str]) -> tuple[str, ...]:
    """Cases, and groups whose case is not among them."""
    return tuple(sorted(n for n in names if "/".join(n.split("/")[:2]) not in names - {n}))


def _configurations(first: Store, second: Store) -> Iterator[str]:
    mine, yours = (store.attributes.get("configuration", {}) for store in (first, second))
    for case in sorted(set(mine) & set(yours)):
        yield from (f"{case}: {sentence}" for sentence in differences(mine[case], yours[case]))


def compare_groups(first: Store, second: Store, group: str, tolerance: float) -> GroupComparison:
    """Compare one group of two stores."""
    mine, yours = (read_group_metadata(store.path, group) for store in (first, second))
    if mine.kind != yours.kind:
        return GroupComparison(group, tolerance, attributes=(f"kind: {mine.kind} / {yours.kind}",))
    spec, arrays = KINDS[mine.kind], []
    for name in sorted(set(mine.arrays) | set(yours.arrays)):
        if name in mine.arrays and name in yours.arrays:
            if mine.arrays[name].role != "slot":
                a, b = (read_group(store, group, (name,))[name] for store in (first, second))
                arrays.append(compare_arrays(name, a, b, tolerance))
        else:
            where = "first" if name in mine.arrays else "second"
            arrays.append(ArrayComparison(name, Verdict.DIFFERENT, None, (), f"only in the {where} store"))
    matches, unmatched = _events(spec, first, second, group)
    apart = any(a.array in spec.coordinates and a.verdict is Verdict.DIFFERENT for a in arrays)
    curve = curve_distance(*_curves(first, second, group)) if mine.kind == "curve" and apart else None
    attributes = tuple(_attributes(mine, yours, tolerance))
    return GroupComparison(group, tolerance, tuple(arrays), attributes, matches, unmatched, curve)


def compare_arrays(name: str, first: Array, second: Array, tolerance: float) -> ArrayComparison:
    """Compare two arrays; NaN in both counts as equal."""
    if first.shape != second.shape:
        reason = f"shape {first.shape} / {second.shape}"
        return ArrayComparison(name, Verdict.DIFFERENT, None, (), reason)
    exact = not np.issubdtype(first.dtype, np.inexact)
    if np.array_equal(first, second, equal_nan=not exact):
        return ArrayComparison(name, Verdict.IDENTICAL)
    same = (first == second) | (np.isnan(first) & np.isnan(second))
    with np.errstate(invalid="ignore"):
        apart = np.where(same, 0.0, np.abs(first - second.astype(np.result_type(second, np.float64))))
    apart = np.where(np.isnan(apart), np.inf, apart)  # a number against none
    place = np.unravel_index(int(np.argmax(apart)), apart.shape)
    difference = float(apart[place] / _magnitude(first, second))
    equal = difference <= tolerance and not exact
    where = tuple(int(index) for index in place)
    values = f"{first[place]} / {second[place]}"
    return ArrayComparison(name, Verdict.EQUAL if equal else Verdict.DIFFERENT, difference, where, values)


def _magnitude(first: Array, second: Array) -> float:
    """The largest finite magnitude in both arrays; 1 if all are zero."""
    both = np.abs(np.concatenate([first.ravel(), second.ravel()]))
    return float(np.max(both[np.isfinite(both)], initial=0.0)) or 1.0


def _attributes(first: GroupMetadata, second: GroupMetadata, tolerance: float) -> Iterator[str]:
    for key in sorted((set(first.attributes) | set(second.attributes)) - NOT_RESULTS):
        mine, yours = first.attributes.get(key), second.attributes.get(key)
        if not _alike(mine, yours, tolerance):
            yield f"{key}: {mine} / {yours}"


def _alike(first: Any, second: Any, tolerance: float) -> bool:
    if isinstance(first, dict) and isinstance(second, dict):
        return set(first) == set(second) and all(_alike(first[k], second[k], tolerance) for k in first)
    if isinstance(first, list) and isinstance(second, list):
        pairs = zip(first, second, strict=False)
        return len(first) == len(second) and all(_alike(a, b, tolerance) for a, b in pairs)
    if isinstance(first, float) or isinstance(second, float):
        numbers = isinstance(first, int | float) and isinstance(second, int | float)
        return numbers and math.isclose(first, second, rel_tol=tolerance)
    return bool(first == second)


def _events(
    spec: GroupSpec, first: Store, second: Store, group: str
) -> tuple[tuple[EventMatch, ...], tuple[str, ...]]:
    """Located bifurcations of both stores in matched pairs, and those without a match.

    Pairs have equal kind; the sum of their distances is smallest. Kinds without events have none.
    """
    places = [f"event_{name}" for name in spec.coordinates]
    names = ("event_kind", *places)
    if not {*names} <= {array.name for array in spec.arrays}:
        return (), ()
    mine, yours = (read_group(store, group, names) for store in (first, second))
    labels = mine.labels("event_kind"), yours.labels("event_kind")
    # coordinates that are no number in both place nothing
    points = [np.nan_to_num(np.column_stack([one[name] for name in places])) for one in (mine, yours)]
    scales = np.array([_magnitude(*column) for column in zip(points[0].T, points[1].T, strict=True)])
    matches, unmatched = [], []
    for kind in sorted({*labels[0], *labels[1]}):
        rows = [np.flatnonzero(label == kind) for label in labels]
        apart = np.abs(points[0][rows[0]][:, None] - points[1][rows[1]]) / scales
        pairs = list(zip(*linear_sum_assignment(apart.max(axis=2)), strict=True))
        for a, b in pairs:
            change = points[1][rows[1][b]] - points[0][rows[0][a]]
            changes = dict(zip(spec.coordinates, change.tolist(), strict=True))
            one = EventMatch(str(kind), int(rows[0][a]), int(rows[1][b]), changes, float(apart[a, b].max()))
            matches.append(one)
        for store, which in (("first", 0), ("second", 1)):
            left = sorted(set(range(len(rows[which]))) - {int(pair[which]) for pair in pairs})
            unmatched += [f"{kind}, event {rows[which][row]}, only in the {store} store" for row in left]
    return tuple(matches), tuple(unmatched)


def _curves(
    first: Store, second: Store, group: str
) -> tuple[BifurcationCurve | None, BifurcationCurve | None]:
    names = (*KINDS["curve"].coordinates, "parameter_tangent", "arclength")
    mine, yours = (
        read_curve(group, (one := read_group(store, group, _present(store, group, names))).arrays,
                   one.attributes)
        for store in (first, second)
    )  # fmt: skip
    return mine, yours


def _present(store: Store, group: str, names: Sequence[str]) -> tuple[str, ...]:
    arrays = read_group_metadata(store.path, group).arrays
    return tuple(name for name in names if name in arrays)


def curve_distance(first: BifurcationCurve | None, second: BifurcationCurve | None) -> CurveDistance | None:
    """The largest distance of either curve from the other (Hausdorff).

    None unless both are curves over the same two parameters.
    """
    if first is None or second is None or first.parameters != second.parameters:
        return None
    scales = np.abs(np.concatenate([first.points, second.points])).max(axis=0)
    scales[scales == 0.0] = 1.0
    found = [_largest_distance(*pair, scales) for pair in ((first, second), (second, first))]
    distance, point = max(found, key=lambda one: one[0])
    return CurveDistance(distance, dict(zip(first.parameters, point.tolist(), strict=True)))


def _largest_distance(curve: BifurcationCurve, other: BifurcationCurve, scales: Array) -> tuple[float, Array]:
    points, there = curve.at(_samples(curve)), _samples(other)
    # the two nearest samples: where a closed curve closes they are one place with a side each
    _, nearest = KDTree(other.at(there) / scales).query(points / scales, k=2)
    arclength, last = there[nearest], len(there) - 1
    low, high = there[np.maximum(nearest - 1, 0)], there[np.minimum(nearest + 1, last)]
    for _ in range(NEAREST_STEPS):  # (B(t) - p) . B'(t) = 0
        gap = (other.at(arclength) - points[:, None]) / scales
        slope = np.stack([spline(arclength, 1) for spline in other.splines], axis=-1) / scales
        squared = np.sum(slope**2, axis=-1)
        step = np.sum(gap * slope, axis=-1) / np.where(squared > 0.0, squared, 1.0)
        arclength = np.clip(arclength - step, low, high)
    gap = (other.at(arclength) - points[:, None]) / scales
    distances = np.hypot(gap[..., 0], gap[..., 1]).min(axis=1)
    worst = int(np.argmax(distances))
    return float(distances[worst]), points[worst]


def _samples(curve: BifurcationCurve) -> Array:
    """Arclengths of the rows and of points between them."""
    rows = np.arange(len(curve.arclength))
    fine = np.linspace(0, rows[-1], SAMPLES_PER_SEGMENT * (len(rows) - 1) + 1)
    return np.interp(fine, rows, curve.arclength)
