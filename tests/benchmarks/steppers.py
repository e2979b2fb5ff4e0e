"""The default stepper against RK4 at equal accuracy: time of the orbit with tangent columns over one period.

Error: max |delta mu| over |mu| > 0.1 of the eigenvalues of V'MV, V the slow basis of one cycle, against RK4
with four times as many steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import Cycle
from pipelines.orbits.time_steps import spectral_radius, stable_steps
from tests.benchmarks.cycles import prepared
from tests.benchmarks.measuring import Measurement, interleaved
from tests.benchmarks.settings import Grid, Settings

Array = NDArray[np.float64]

LIMIT = 1e-6
_SLOW = 0.1
_FEWEST = 16
_REFINEMENT = 4


def stepper_ratios(settings: Settings) -> list[Measurement]:
    """One ratio for each grid."""
    return [_ratio(grid, settings) for grid in settings.stepper_grids]


def _ratio(grid: Grid, settings: Settings) -> Measurement:
    implicit = prepared(grid)
    cycle, fast = implicit.cycle(), implicit.problem.period_map
    slow = prepared(grid, "rk4").problem.period_map
    radius = spectral_radius(slow, np.ascontiguousarray(cycle.image.orbit), cycle.parameters)
    stable = stable_steps(slow, radius, cycle.unknowns.period)
    exact = _multipliers(slow, cycle, _REFINEMENT * stable)
    exact = exact[np.abs(exact) > _SLOW]
    slow_steps, slow_error = _enough(slow, cycle, exact, range(stable, _REFINEMENT * stable, slow.samples))
    fast_steps, fast_error = _enough(fast, cycle, exact, range(_FEWEST, stable))
    block = deterministic_block(slow.size, settings.columns)

    def run(period_map: PeriodMap, steps: int) -> object:
        at = cycle.unknowns
        return period_map.evaluate(at.state, cycle.parameters, at.period, steps, block)

    pair = interleaved(lambda: run(slow, slow_steps), lambda: run(fast, fast_steps), settings.tangent_pairs)
    return Measurement(
        f"stepper_ratio_{grid[0]}x{grid[1]}", pair.ratio, "1",
        f"orbit + {settings.columns} tangent columns, errors of {exact.size} multipliers up to {LIMIT:.0e}: "
        f"rk4, {slow_steps} steps (error {slow_error:.1e}, {1e3 * pair.first:.3g} ms) / "
        f"esdirk5, {fast_steps} steps (error {fast_error:.1e}, {1e3 * pair.second:.3g} ms)",
    )  # fmt: skip


def _enough(
    period_map: PeriodMap, cycle: Cycle, exact: NDArray[np.complex128], tried: range
) -> tuple[int, float]:
    """The first number of steps that meets the limit, and its error."""
    for steps in tried:
        error = _error(_multipliers(period_map, cycle, steps), exact)
        if error <= LIMIT:
            return steps, error
    raise RuntimeError(f"{period_map.stepper.name} misses {LIMIT} with any number of steps in {tried}")


def _multipliers(period_map: PeriodMap, cycle: Cycle, steps: int) -> NDArray[np.complex128]:
    """Eigenvalues of V'MV; infinite where the orbit diverged."""
    at = cycle.unknowns
    image = period_map.evaluate(at.state, cycle.parameters, at.period, steps, cycle.basis)
    if not image.finite:
        return np.full(cycle.basis.shape[1], complex(np.inf))
    return np.linalg.eigvals(cycle.basis.T @ image.columns).astype(complex)


def _error(found: NDArray[np.complex128], exact: NDArray[np.complex128]) -> float:
    return float(np.max(np.min(np.abs(found[None, :] - exact[:, None]), axis=1)))
