"""The whole monodromy matrix, column by column: a reference, never for a large system."""

from __future__ import annotations

import numpy as np

from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.system import Matrix, Vector

_COLUMNS = 64  # of a pass: bounds the scratch memory


def full_monodromy(
    period_map: PeriodMap, state: Vector, parameters: Vector, period: float, steps: int
) -> Matrix:
    """M (N, N) of a cycle."""
    columns = np.eye(period_map.size)
    blocks = (columns[:, first : first + _COLUMNS] for first in range(0, period_map.size, _COLUMNS))
    parts = [period_map.evaluate(state, parameters, period, steps, block).columns for block in blocks]
    return np.ascontiguousarray(np.hstack(parts))
