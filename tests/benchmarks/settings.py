"""Grids and numbers of runs: those of the README's table, and small ones that only show that all works."""

from __future__ import annotations

from dataclasses import dataclass

Grid = tuple[int, int]


@dataclass(frozen=True)
class Settings:
    """Grids are N_theta x N_z.

    ``walked_grids``: time per branch point from a short branch of ``branch_points`` points;
    ``composed_grids``: from the passes of the largest walked grid and the time of a step.
    """

    default_grid: Grid = (40, 3)
    backward_grid: Grid = (80, 10)
    reference_grids: tuple[Grid, Grid] = ((288, 4), (576, 4))
    monodromy_grids: tuple[Grid, ...] = ((24, 2), (40, 3))
    walked_grids: tuple[Grid, ...] = ((24, 2), (40, 3), (64, 3))
    composed_grids: tuple[Grid, ...] = ((96, 4), (160, 5))
    columns: int = 32
    tangent_pairs: int = 9
    monodromy_pairs: int = 3
    branch_points: int = 3


FULL = Settings()
QUICK = Settings(
    default_grid=(12, 2),
    backward_grid=(16, 4),
    reference_grids=((24, 2), (48, 2)),
    monodromy_grids=((12, 2),),
    walked_grids=((12, 2), (16, 2)),
    composed_grids=((24, 2),),
    columns=8,
    tangent_pairs=3,
    monodromy_pairs=1,
    branch_points=2,
)
