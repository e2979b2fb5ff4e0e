"""The onset speed of a machine: the lowest speed at which its equilibrium or forced cycle loses stability.

At displacement 0 that is the first Hopf point of the equilibrium, otherwise the first bifurcation on a branch
of cycles along the rising speed at which a multiplier leaves the unit circle.  The branch begins at the
lowest speed.  Near an expected onset a few cycles found alone bracket it; where they do not, the branch
begins a little below it.  An instability below these speeds is not seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchResult, BranchState, BranchStop
from pipelines.bifurcations.detection import DetectionOptions, Event, EventKind
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import Equilibrium
from pipelines.orbits.equilibria.linear import at_speed, linear_point
from pipelines.orbits.machine_cycles import cycle_shape, unphysical
from pipelines.stages.calibration.onset_nearby import Cycles, onset_nearby
from pipelines.stages.cycles.problem import continuation_options, cycle_problem
from pipelines.stages.cycles.start import Guard, NoStart, first_cycles, first_hopf
from pipelines.stages.linear.linearize import leading_growth
from pipelines.stages.results import ShouldStop, StopRequested

BELOW = (0.93, 0.8)  # of an expected onset: where a branch begins, the nearest first
AROUND = (0.9, 1.1)  # of an expected onset: where a Hopf point is sought first, seen from so many speeds:
NEAR_POINTS = 5
STEP_TOLERANCE = 1e-5  # of the time steps in the multipliers, unless the case allows more
EVENT_TOLERANCE = 1e-6  # of the bracket along the branch: well below what differences of onsets tell

FOUND, CENSORED_BELOW, CENSORED_ABOVE = "found", "censored_below", "censored_above"
NO_EQUILIBRIUM, NO_CYCLE, BRANCH_LOST = "no_equilibrium", "no_cycle", "branch_lost"
FILM_LIMIT, INVALID, UNDECIDED = "film_limit", "invalid_machine", "undecided"
STATUSES = {
    FOUND: "found",
    CENSORED_BELOW: "unstable from the lowest speed of the range: the onset is at most that speed",
    CENSORED_ABOVE: "none up to the highest speed of the range: it is at least that speed",
    NO_EQUILIBRIUM: "there is no equilibrium",
    NO_CYCLE: "no cycle was found to start from: raise the lowest speed of the range",
    BRANCH_LOST: "the branch could not be followed: lower continue_cycles.maximum_step or minimum_step",
    FILM_LIMIT: "the film touches the foil before an onset: see continue_cycles.minimum_film",
    INVALID: "these values give no valid machine",
    UNDECIDED: "critical speeds below it may be missing: agfb criticals shows where and why",
}
FAILED = frozenset({NO_EQUILIBRIUM, NO_CYCLE, BRANCH_LOST, FILM_LIMIT, INVALID, UNDECIDED})
HOPF = "hopf"
KINDS_OF = {
    "any": frozenset(EventKind),
    "neimark_sacker": frozenset({EventKind.NEIMARK_SACKER}),
    "period_doubling": frozenset({EventKind.PERIOD_DOUBLING}),
}


@dataclass(frozen=True)
class Onset:
    """The onset speed of a machine, and how its search ended.

    One of `STATUSES`, the dimensionless speed (the end of the range where censored, NaN where it failed)
    and the bifurcation ("unset" where there is none).
    """

    status: str
    speed: float = math.nan
    bifurcation: str = "unset"


def onset_speed(
    case: Case,
    interval: tuple[float, float],
    bifurcation: str = "any",
    expected: float | None = None,
    should_stop: ShouldStop = lambda: False,
) -> Onset:
    """The onset speed of a case between two dimensionless speeds.

    ``bifurcation``: a key of `KINDS_OF`; ``expected``: the onset of a machine nearby.  Steps along the branch
    and the thinnest film are those of [continue_cycles].  Raises StopRequested.
    """
    machine, parameters = build_machine(case), parameter_vector(case)
    if parameters[film.DISPLACEMENT] == 0.0:
        return _hopf_onset(machine, parameters, interval, expected)
    if expected is not None:
        near = _onset_near(machine, case, interval, bifurcation, expected, should_stop)
        if near is not None:
            return near
    found = Onset(NO_CYCLE)
    for start in _starts(interval, expected):
        found = _onset_above(machine, case, interval, start, KINDS_OF[bifurcation], should_stop)
        if found.status not in (CENSORED_BELOW, NO_CYCLE):
            break
    return found


def _onset_near(
    machine: Machine,
    case: Case,
    interval: tuple[float, float],
    bifurcation: str,
    expected: float,
    should_stop: ShouldStop,
) -> Onset | None:
    """The onset near the expected one from cycles found alone; None where only a branch can tell."""
    kinds = {kind.name.lower() for kind in KINDS_OF[bifurcation]}
    found = onset_nearby(
        Cycles(machine, case, parameter_vector(case), kinds, should_stop), interval, expected
    )
    return None if found is None else Onset(FOUND, *found)


def _starts(interval: tuple[float, float], expected: float | None) -> list[float]:
    low, high = interval
    near = [] if expected is None else [factor * expected for factor in BELOW]
    return [*(speed for speed in near if low < speed < high), low]


def _hopf_onset(
    machine: Machine, parameters: Array, interval: tuple[float, float], expected: float | None
) -> Onset:
    """The first Hopf point, searched around the expected one first."""
    low, high = interval
    if expected is not None:
        below, above = (min(max(factor * expected, low), high) for factor in AROUND)
        hopf = first_hopf(machine, parameters, below, above, NEAR_POINTS) if below < above else None
        if hopf is not None:
            return Onset(FOUND, hopf.speed, HOPF)
    hopf = first_hopf(machine, parameters, low, high)
    if hopf is not None:
        return Onset(FOUND, hopf.speed, HOPF)
    for speed, status, sign in ((low, CENSORED_BELOW, 1.0), (high, CENSORED_ABOVE, -1.0)):
        point = linear_point(machine, at_speed(parameters, speed), 4)
        if not isinstance(point, Equilibrium):
            growth = float(leading_growth(point.eigenpairs.values[None, :])[0])
            if sign * growth > 0.0:
                return Onset(status, speed)
    return Onset(NO_EQUILIBRIUM)


def _onset_above(
    machine: Machine,
    case: Case,
    interval: tuple[float, float],
    start: float,
    kinds: frozenset[EventKind],
    should_stop: ShouldStop,
) -> Onset:
    """The first onset above a speed at which the cycle must be stable."""
    table = case.continue_cycles.model_copy(
        update={"parameter": "speed", "range": (start, interval[1]), "start": start}
    )
    loose = max(case.numerics.multiplier_tolerance, STEP_TOLERANCE)
    numerics = case.numerics.model_copy(update={"multiplier_tolerance": loose})
    case = case.model_copy(update={"continue_cycles": table, "numerics": numerics})
    problem = cycle_problem(machine, case)
    options = continuation_options(case, 1)
    options = replace(options, detection=DetectionOptions(event_tolerance=EVENT_TOLERANCE))
    walk = _Walk(machine, table.minimum_film, kinds, should_stop)
    for guess in first_cycles(machine, case, problem, Guard(walk.limit, should_stop)):
        if should_stop():
            raise StopRequested
        if isinstance(guess, NoStart):
            continue
        result = continue_branch(problem, guess.start, options, walk.record, walk.limit, walk.ends)
        if result.stop is not BranchStop.START_FAILED:
            return _onset_of(result, walk, start, interval[1])
    return Onset(NO_CYCLE)


class _Walk:
    """Follows a branch with rising speed until its first onset."""

    def __init__(
        self, machine: Machine, minimum_film: float, kinds: frozenset[EventKind], should_stop: ShouldStop
    ) -> None:
        self._machine, self._minimum_film, self._kinds, self._should_stop = (
            machine,
            minimum_film,
            kinds,
            should_stop,
        )
        self.unstable_start = False
        self.onset: Event | None = None

    def limit(self, point: BranchPoint) -> str | None:
        cycle = point.cycle
        return unphysical(cycle_shape(self._machine, cycle.image.orbit, cycle.parameters), self._minimum_film)

    def record(self, point: BranchPoint, state: BranchState, events: Sequence[Event]) -> None:
        if state.index == 0:
            self.unstable_start = point.unstable > 0
        leaving = (event for event in events if event.kind in self._kinds and _destabilises(event))
        self.onset = next(leaving, None)

    def ends(self) -> bool:
        return self.unstable_start or self.onset is not None or self._should_stop()


def _destabilises(event: Event) -> bool:
    """Whether the critical multiplier leaves the circle as the speed rises; a fold ends the stable cycle."""
    return event.kind is EventKind.FOLD or not event.transversality < 0.0


def _onset_of(result: BranchResult, walk: _Walk, start: float, highest: float) -> Onset:
    if walk.unstable_start:
        return Onset(CENSORED_BELOW, start)
    if walk.onset is not None:
        speed = float(walk.onset.parameters[film.SPEED])
        return Onset(FOUND, speed, walk.onset.kind.name.lower())
    if result.stop is BranchStop.INTERRUPTED:
        raise StopRequested
    if result.stop is BranchStop.LIMIT:
        return Onset(FILM_LIMIT)
    reached = result.stop is BranchStop.RANGE
    return Onset(CENSORED_ABOVE, highest) if reached else Onset(BRANCH_LOST)
