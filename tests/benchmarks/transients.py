"""A transient run with unbalance and moving rings: the implicit loop against RK4 at equal accuracy.

Error: largest difference of any state after one excitation period, once the run has settled, from that of the
implicit loop with far more steps. RK4 takes what its stability asks for, or more.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.unbalance import UnbalanceMass
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.steppers import RK4
from pipelines.orbits.time_runs.drive import Switching, make_drive
from pipelines.orbits.time_runs.transient import trial_end
from pipelines.orbits.time_steps import spectral_radius, stable_steps
from pipelines.stages.transients.run import driven_machine
from tests.benchmarks.measuring import Measurement, interleaved
from tests.benchmarks.settings import SCHEME, Settings
from tests.helpers.unbalanced_map import UnbalancedMap, unbalanced_map
from tests.machines import case

Array = NDArray[np.float64]

LIMIT = 1e-6
SPEED, DISPLACEMENT = 0.9, 0.1
MASSES = (UnbalanceMass(2, 1e-6), UnbalanceMass(12, 1e-6, 0.5))  # kg m: about G 2.5 at 30 000 rpm
SETTLING, EXACT = 10, 1600  # periods, steps
_FEWEST, _PERIODS = 16, 10


def transient_steps(settings: Settings) -> list[Measurement]:
    """The ratio, and the implicit loop's steps per second."""
    description = case(
        settings.default_grid, speed=SPEED, displacement=DISPLACEMENT, numerics={"scheme": SCHEME}
    )
    machine, parameters = build_machine(description), parameter_vector(description)
    driven, period = driven_machine(machine, MASSES), 2.0 * math.pi / parameters[1]
    turn = SPEED * period
    state = machine_equilibrium(machine, parameters).state

    def implicit(periods: int, steps: int, begin: float = SETTLING * turn) -> Array | None:
        drive = make_drive(
            [0.0], [SPEED], periods * period, Switching(DISPLACEMENT, DISPLACEMENT), parameters[1], begin
        )
        return trial_end(driven, drive, parameters, state, periods * steps)

    settled = implicit(SETTLING, 200, 0.0)
    assert settled is not None
    state = settled
    exact = implicit(1, EXACT)
    assert exact is not None
    steps, error = next(
        (steps, error)
        for steps in range(_FEWEST, EXACT)
        if (error := _difference(implicit(1, steps), exact)) <= LIMIT
    )
    slow = unbalanced_map(machine, MASSES, parameters, EXACT, stepper=RK4)
    slow, slow_error = _enough(slow, state, SETTLING * turn, exact)

    def explicit() -> None:
        start = slow.parameters_at(SETTLING * turn)
        for _ in range(_PERIODS):  # without columns: a run needs none
            slow.period_map.evaluate(state, start, period, slow.steps)

    pair = interleaved(explicit, lambda: implicit(_PERIODS, steps), settings.monodromy_pairs)
    grid = f"{settings.default_grid[0]}x{settings.default_grid[1]}"
    return [
        Measurement(
            "transient_steps_ratio", pair.ratio, "1",
            f"transient with unbalance, {grid}, states within {LIMIT:.0e} after a period: rk4, "
            f"{slow.steps} steps (error {slow_error:.1e}, {1e3 * pair.first / _PERIODS:.3g} ms) / "
            f"esdirk5, {steps} steps "
            f"(error {error:.1e}, {1e3 * pair.second / _PERIODS:.3g} ms)",
        ),
        Measurement(
            "transient_step", 1e3 * pair.second / (_PERIODS * steps), "ms",
            f"informative: one time step of the transient loop, {grid}",
        ),
    ]  # fmt: skip


def _enough(slow: UnbalancedMap, state: Array, angle: float, exact: Array) -> tuple[UnbalancedMap, float]:
    """RK4 with the fewest steps, by doubling from what stability needs, that meet the limit."""
    period_map = slow.period_map
    orbit = np.tile(state, (period_map.samples, 1))
    radius = spectral_radius(period_map, orbit, slow.parameters_at(angle))
    steps = stable_steps(period_map, radius, slow.period)
    while True:
        tried = UnbalancedMap(period_map, slow.parameters, steps)
        image = tried.evaluate(state, angle)
        if image.finite and (error := _difference(image.state, exact)) <= LIMIT:
            return tried, error
        steps *= 2


def _difference(found: Array | None, exact: Array) -> float:
    return math.inf if found is None else float(np.max(np.abs(found - exact)))
