"""The onset speed near that of a machine nearby, from cycles found alone: no branch is followed.

At the onset the leading multiplier of a wanted kind passes the unit circle.  A cycle below with all of them
inside and one above bracket it, and Brent's method finds it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.forced_cycle import ForcedCycle, ForcedCycleOptions, forced_cycle
from pipelines.orbits.shooting import Cycle
from pipelines.stages.results import ShouldStop, StopRequested
from pipelines.stages.survey.cells import bifurcation_of, film_status, forced_cycles, resting_system

BELOW = (0.96, 0.88)  # of the expected onset: where no wanted multiplier may lie outside, the nearest first
ABOVE = (1.02, 1.08, 1.16)  # and where one must
MISS = 1e-4  # of the cycles; onsets then differ from those of branches by less than 1e-5
STEP_TOLERANCE = 1e-4  # of the time steps in the multipliers, unless the case allows more
PLACE = 3e-5  # width of the last bracket, within which the growth is interpolated
CLOSED = 1e-3  # distance of the critical multiplier from the circle at the end


class Undecided(Exception):  # noqa: N818
    """At some speed there is no cycle, or none that can be: a branch must tell."""


@dataclass
class Cycles:
    """The cycles of a machine over speed and excitation frequency; each serves as a guess of the next one."""

    machine: Machine
    case: Case
    parameters: Array
    kinds: Collection[str]
    should_stop: ShouldStop
    _last: ForcedCycle | None = field(default=None, init=False)
    _known: dict[tuple[float, float], Cycle] = field(default_factory=dict, init=False)

    def at(self, speed: float, frequency: float | None = None) -> Cycle:
        """The cycle at a speed, and an excitation frequency: that of ``parameters`` if not given.

        Raises Undecided, StopRequested.
        """
        if self.should_stop():
            raise StopRequested
        parameters = at_speed(self.parameters, speed)
        if frequency is not None:
            parameters[film.EXCITATION_FREQUENCY] = frequency
        place = speed, float(parameters[film.EXCITATION_FREQUENCY])
        if place not in self._known:
            self._known[place] = self._found(parameters)
        return self._known[place]

    def _found(self, parameters: Array) -> Cycle:
        equilibrium = machine_equilibrium(self.machine, parameters)
        if not equilibrium.converged:
            raise Undecided
        allowed = max(self.case.numerics.multiplier_tolerance, STEP_TOLERANCE)
        problem = forced_cycles(self.machine, self.case, parameters, MISS, allowed)
        resting = resting_system(self.machine, equilibrium, parameters)
        found = forced_cycle(problem, resting, ForcedCycleOptions(tolerance=MISS), self._last)
        if not isinstance(found, ForcedCycle):
            raise Undecided
        status, _ = film_status(self.machine, found.cycle, self.case.continue_cycles.minimum_film)
        if status != "found":
            raise Undecided
        self._last = found
        return found.cycle

    def critical(self, speed: float) -> complex:
        """The largest multiplier of the wanted kinds at a speed; zero without one."""
        multipliers = self.at(speed).spectrum.multipliers
        wanted = [complex(one) for one in multipliers if bifurcation_of(complex(one)) in self.kinds]
        return max(wanted, key=abs, default=0j)

    def growth(self, speed: float) -> float:
        """Growth of the critical multiplier: negative where it lies inside the unit circle."""
        return math.log(max(abs(self.critical(speed)), np.finfo(float).tiny))


def onset_nearby(cycles: Cycles, interval: tuple[float, float], expected: float) -> tuple[float, str] | None:
    """The onset near the ``expected`` one, and its bifurcation; None where no bracket tells it.

    Raises StopRequested.
    """
    try:
        falling = (speed for speed in _inside(BELOW, interval, expected) if cycles.growth(speed) < 0.0)
        below = next(falling, None)
        if below is None:
            return None
        rising = (speed for speed in _inside(ABOVE, interval, expected) if cycles.growth(speed) >= 0.0)
        above = next(rising, None)
        if above is None:
            return None
        speed = float(brentq(cycles.growth, below, above, xtol=PLACE))
        critical = cycles.critical(speed)
    except Undecided:
        return None
    if (
        abs(abs(critical) - 1.0) > CLOSED
    ):  # a pair that becomes real within the bracket is no onset of its kind
        return None
    kind = bifurcation_of(critical)
    return speed, "branch_point" if kind == "fold" else kind  # with cycles on both sides it does not turn


def _inside(factors: tuple[float, ...], interval: tuple[float, float], expected: float) -> list[float]:
    low, high = interval
    return [factor * expected for factor in factors if low <= factor * expected <= high]
