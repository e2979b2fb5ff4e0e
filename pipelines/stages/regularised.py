"""Points of curves that were computed with regularised clipping: number, effect and wording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from pipelines.datasets.curves import CURVE_CONTAINERS
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, local_name

ARRAYS = ("clipping_width", "width_effect")
NAME = "regularised clipping"


class Regularised(NamedTuple):
    """Such points, all points, and the distance of the former from the exact curve.

    ``effect``: the largest one that is known, None without any; ``unknown``: points where it is not.
    """

    points: int
    total: int
    effect: float | None
    unknown: int


def count(groups: Iterable[Group]) -> Regularised:
    """The number of such points of some curves, which must have the arrays ``ARRAYS``."""
    total, effects = 0, [np.zeros(0)]
    for group in groups:
        used = group["clipping_width"] > 0.0
        total += used.size
        effects.append(group["width_effect"][used])
    every = np.concatenate(effects)
    known = every[np.isfinite(every)]
    largest = float(known.max()) if known.size else None
    return Regularised(every.size, total, largest, every.size - known.size)


def count_in(store: Store, groups: Iterable[str]) -> Regularised:
    """The number of such points in some of a store's groups, by full name; only curves count.

    Raises StoreError for one that cannot be read.
    """
    curves = [group for group in groups if local_name(group).split("/")[0] in CURVE_CONTAINERS]
    return count(read_group(store, group, ARRAYS) for group in curves)


def in_words(found: Regularised) -> str:
    """``at 3 of 20 points, up to 0.0012 from the exact curve``; empty if no point is one."""
    if not found.points:
        return ""
    said = f"at {found.points} of {found.total} points"
    if found.effect is not None:
        said += f", up to {found.effect:.2g} from the exact curve"
    return said + (f", at {found.unknown} by an unknown distance" if found.unknown else "")


def as_json(found: Regularised) -> dict[str, int | float | None]:
    """The numbers under the names that ``--json`` gives them."""
    return {"points_with_regularised_clipping": found.points, "largest_width_effect": found.effect}
