"""A plane of two parameters of equations of one's own, and the cycle at a place of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.forced_cycle import ForcedCycle, ForcedCycleOptions, forced_cycle
from pipelines.orbits.harmonic_balance import resting_near
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.system import Vector
from pipelines.stages.survey.line import Found

Interval = tuple[float, float]
EVERY_KIND = (EventKind.PERIOD_DOUBLING, EventKind.NEIMARK_SACKER, EventKind.FOLD)


@dataclass(frozen=True)
class PlaneProblem:
    """The cycles of a forced system over a plane of two of its parameters.

    ``cycles`` holds the period map, the other parameters and the tolerances; ``names`` of the two parameters,
    with their ``ranges``; ``rest`` (N,): a guess of the state at rest, where the mean of the right-hand side
    over the phase of the forcing vanishes; ``scales``: changes of the parameters that count as one; ``kinds``
    of curves that are followed.  Raises ValueError for an unknown period, unknown or equal names, or a range
    that does not rise.
    """

    cycles: CycleProblem
    names: tuple[str, str]
    ranges: tuple[Interval, Interval]
    rest: Vector
    scales: tuple[float, float] = (1.0, 1.0)
    kinds: tuple[EventKind, ...] = EVERY_KIND

    def __post_init__(self) -> None:
        if self.cycles.period_map.autonomous:
            raise ValueError("a plane is searched for cycles with the period of their forcing")
        if len(set(self.names)) != 2:
            raise ValueError(f"names are {self.names}; two different parameters are needed")
        for name, (low, high) in zip(self.names, self.ranges, strict=True):
            self.cycles.period_map.system.parameter_index(name)
            if not low < high:
                raise ValueError(f"the range of {name} is ({low:g}, {high:g}); it must rise")

    def at(self, place: tuple[float, float]) -> CycleProblem:
        """The cycles at values of both parameters, along the first one."""
        system, parameters = self.cycles.period_map.system, np.array(self.cycles.parameters, dtype=float)
        for name, value in zip(self.names, place, strict=True):
            parameters[system.parameter_index(name)] = value
        return replace(self.cycles, parameters=parameters, parameter=self.names[0])

    def holds(self, place: tuple[float, float]) -> bool:
        """Whether values of both parameters lie in the plane."""
        return all(low <= value <= high for value, (low, high) in zip(place, self.ranges, strict=True))


@dataclass(frozen=True)
class PlaneOptions:
    """How a plane is searched.

    ``lines``: branches of the first round along each parameter.
    ``rounds``: of lines through the places that disagree, at most.
    ``line_step``, ``curve_step``: longest arclength steps of branches and of curves.
    ``max_points``: largest number of points of a branch or curve.
    ``cells``: of the survey along each parameter.
    ``cycle``: how the cycle at a cell is sought.

    Raises ValueError for a negative number of lines or rounds, and for less than two cells.
    """

    lines: tuple[int, int] = (2, 2)
    rounds: int = 4
    line_step: float = 0.05
    curve_step: float = 0.1
    max_points: int = 1000
    cells: tuple[int, int] = (20, 15)
    cycle: ForcedCycleOptions = field(default_factory=lambda: ForcedCycleOptions(tolerance=1e-5))

    def __post_init__(self) -> None:
        if min(*self.lines, self.rounds) < 0:
            raise ValueError(f"lines are {self.lines}, rounds {self.rounds}; they must not be negative")
        if min(self.cells) < 2:
            raise ValueError(f"cells are {self.cells}; at least two along each parameter are needed")


def cycle_at(
    plane: PlaneProblem, options: PlaneOptions, place: tuple[float, float], beside: ForcedCycle | None = None
) -> Found:
    """The cycle at values of both parameters, found alone or from the one ``beside``.

    None where the system has no state at rest.
    """
    problem = plane.at(place)
    resting = resting_near(problem.period_map.system, plane.rest, problem.parameters)
    if resting is None:
        return None
    return forced_cycle(problem, resting, options.cycle, beside)
