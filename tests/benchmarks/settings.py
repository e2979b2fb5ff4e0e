"""Grids and numbers of runs: those of configs/performance.md, and small ones that only show that it works."""

from __future__ import annotations

from dataclasses import dataclass

Grid = tuple[int, int]
SCHEME = "fourth_order"  # of the default film, on every grid


@dataclass(frozen=True)
class Settings:
    """Grids are N_theta x N_z.

    ``walked_grids``: time per branch point from a short branch of ``branch_points`` points after the first;
    ``stepper_grids``: the default stepper against RK4; ``chains``: states of the reaction-diffusion chain,
    each followed for ``chain_points``; ``repetitions``: calls in a loop that measures a rate;
    ``campaign_cases`` branches of at most ``campaign_points`` points; ``fresh_cache``: the cold start
    compiles all kernels.
    """

    default_grid: Grid = (32, 4)
    backward_grid: Grid = (80, 10)
    reference_grids: tuple[Grid, Grid] = ((288, 4), (576, 4))
    monodromy_grids: tuple[Grid, ...] = ((24, 2), (32, 4))
    walked_grids: tuple[Grid, ...] = ((24, 2), (32, 4), (64, 4), (96, 4), (160, 5))
    stepper_grids: tuple[Grid, ...] = ((32, 4), (96, 4))
    chains: tuple[int, ...] = (40, 80, 160, 500, 2000)
    columns: int = 32
    tangent_pairs: int = 9
    monodromy_pairs: int = 3
    branch_points: int = 3
    chain_points: int = 8
    repetitions: int = 20_000
    campaign_cases: int = 8
    campaign_points: int = 100
    fresh_cache: bool = True


FULL = Settings()
QUICK = Settings(
    default_grid=(12, 2),
    backward_grid=(16, 4),
    reference_grids=((24, 2), (48, 2)),
    monodromy_grids=((12, 2),),
    walked_grids=((12, 2), (16, 2)),
    stepper_grids=((12, 2),),
    chains=(10, 20),
    columns=8,
    tangent_pairs=3,
    monodromy_pairs=1,
    branch_points=1,
    chain_points=2,
    repetitions=100,
    campaign_cases=2,
    campaign_points=2,
    fresh_cache=False,
)
