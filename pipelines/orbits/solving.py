"""Linear equations of a correction, whose matrix may be singular."""

from __future__ import annotations

import numpy as np

from pipelines.orbits.system import Matrix, Vector


def solve_or_none(matrix: Matrix, right: Vector | Matrix) -> Vector | Matrix | None:
    """The solution for one right side (n,) or several (n, m); None when it is not unique or not finite."""
    try:
        solution = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return solution if np.all(np.isfinite(solution)) else None
