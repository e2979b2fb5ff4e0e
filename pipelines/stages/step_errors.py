"""Points whose time-step error is unknown: their number, and its wording in stages, lists and reports."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pipelines.datasets.curves import CURVE_CONTAINERS
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, local_name

STEP_ERROR = "step_error"
NAME = "time-step error unknown"
ADVICE = (
    "passes with fewer and with more steps contradict each other there, as where a film touches the ambient "
    'pressure without a slope; bearings.clipping = "smooth" or a finer grid may avoid that'
)
# of multipliers; that of tori is not estimated with an explicit stepper
_CONTAINERS = frozenset({"cycles", *CURVE_CONTAINERS})

Count = tuple[int, int]
"""Points whose error is unknown, and all points."""


def count(groups: Iterable[Group]) -> Count:
    """Number of such points of some branches and curves."""
    missing = [np.isnan(group[STEP_ERROR]) for group in groups]
    return sum(int(each.sum()) for each in missing), sum(each.size for each in missing)


def count_in(store: Store, groups: Iterable[str]) -> Count:
    """Number of such points in some of a store's groups, by full name; only branches and curves count.

    Raises StoreError for one that cannot be read.
    """
    held = (group for group in groups if local_name(group).split("/")[0] in _CONTAINERS)
    return count(read_group(store, group, (STEP_ERROR,)) for group in held)


def in_words(found: Count) -> str:
    """``for 3 of 20 points``; empty if all errors are known."""
    return "for {} of {} points".format(*found) if found[0] else ""


def caution(found: Count) -> str:
    """The number of such points as a sentence with reason and advice."""
    return f"{NAME} {in_words(found)}: {ADVICE}" if found[0] else ""
