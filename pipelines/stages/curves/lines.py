"""The lines along which a search crosses the plane, round by round, and the branches that follow them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipelines.case.models import Case, ContinueCycles
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import parameter_vector
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.stages.cycles.branch import BranchRequest
from pipelines.stages.job import Job

Interval = tuple[float, float]

LINES = "cycles/s"  # beginning of the names of their groups
ASKED = "cycles/sc"  # of those that a certificate has asked for: more rounds may still come
SPEED: Literal["speed"] = "speed"
FREQUENCY: Literal["excitation_frequency"] = "excitation_frequency"
LARGEST_ORDER = 2  # largest n of the principal resonances 2 Omega_j / n at which the first round has lines
APART = 0.02  # of the plane's width: a resonance nearer than this to another line gets no line
LINE_POINTS = 2000
SPEEDS_TRIED = 49  # for the lowest speed with a film


@dataclass(frozen=True)
class Line:
    """A branch along ``parameter`` with the other parameter ``fixed``, made in a ``round`` of the search.

    ``asked``: for by a certificate.
    """

    parameter: Literal["speed", "excitation_frequency"]
    fixed: float
    round: int
    asked: bool = False


def line_groups(lines: Sequence[Line]) -> list[str]:
    """The groups of lines, given in the order of the search: ``cycles/s000``, ..., ``cycles/sc000``, ..."""
    counted = Counter[bool]()
    names = []
    for line in lines:
        names.append(f"{ASKED if line.asked else LINES}{counted[line.asked]:03d}")
        counted[line.asked] += 1
    return names


def plane_range(case: Case, parameter: str) -> Interval:
    """The values of a parameter between which the plane lies."""
    table = case.track_curves
    return table.ranges[table.parameters.index(parameter)]


def lowest_speed(job: Job) -> float | None:
    """The lowest speed of the plane at which the film of the equilibrium is thick enough.

    The rings are at their mean displacement.  None if no speed has a film of
    ``bifurcation_set.smallest_film``.  The speed is found to a thousandth of the range.
    """
    low, high = plane_range(job.case, SPEED)

    def has_film(speed: float) -> bool:
        parameters = at_speed(parameter_vector(job.case), speed)
        found = machine_equilibrium(job.machine, parameters)
        if not found.converged:
            return False
        films = job.machine.minimum_film(MEAN_PHASE, found.state, at_rest(parameters))
        return float(np.min(films)) >= job.case.bifurcation_set.smallest_film

    speeds = [float(speed) for speed in np.linspace(low, high, SPEEDS_TRIED)]
    first = next((index for index, speed in enumerate(speeds) if has_film(speed)), None)
    if first is None or first == 0:
        return None if first is None else low
    below, above = speeds[first - 1], speeds[first]
    while above - below > 1e-3 * (high - low):
        middle = 0.5 * (below + above)
        below, above = (below, middle) if has_film(middle) else (middle, above)
    return above


def lines_of_round(job: Job, number: int, lowest: float) -> list[Line]:
    """The lines of a round: between those of earlier rounds; in the first round also at resonances.

    The resonances are the predicted ones of the group ``criticals``.
    """
    case, search = job.case, job.case.bifurcation_set
    frequencies = spread(search.frequencies, plane_range(case, FREQUENCY), number)
    if number == 0 and search.resonances:
        frequencies += _resonant_frequencies(job, frequencies)
    speeds = spread(search.speeds, (lowest, plane_range(case, SPEED)[1]), number)
    return [Line(FREQUENCY, value, number) for value in speeds] + [
        Line(SPEED, value, number) for value in frequencies
    ]


def spread(count: int, interval: Interval, number: int) -> list[float]:
    """One value in each of ``count`` equal cells: the middle in round 0, other places in later rounds."""
    low, high = interval
    # van der Corput sequence: 1/2, 0, 1/4, 3/4, 1/8, ...
    index = {0: 1, 1: 0}.get(number, number)
    offset = sum(int(digit) / 2.0 ** (place + 1) for place, digit in enumerate(reversed(f"{index:b}")))
    return [low + (high - low) * (cell + offset) / count for cell in range(count)]


def _resonant_frequencies(job: Job, taken: list[float]) -> list[float]:
    """Predicted principal resonances inside the plane that are not beside another line."""
    low, high = plane_range(job.case, FREQUENCY)
    if not job.groups("criticals"):
        return []
    names = ("resonance_frequency", "resonance_order", "resonance_kind")
    arrays = job.read("criticals", names).arrays
    principal = KINDS["criticals"].array("resonance_kind").flag("principal")
    wanted = (arrays["resonance_kind"] == principal) & (arrays["resonance_order"] <= LARGEST_ORDER)
    found: list[float] = []
    for value in np.sort(arrays["resonance_frequency"][wanted]):
        beside = min((abs(value - other) for other in taken + found), default=np.inf)
        if low <= value <= high and beside > APART * (high - low):
            found.append(float(value))
    return found


def line_request(job: Job, line: Line, group: str, lowest: float) -> BranchRequest:
    """The branch of a line, downwards from the upper end, where films are thick and periods short."""
    case = job.case
    low, high = plane_range(case, line.parameter)
    low = max(low, lowest) if line.parameter == SPEED else low
    step = case.bifurcation_set.maximum_step
    table = ContinueCycles(
        parameter=line.parameter,
        range=(low, high),
        start=high,
        formulation=case.continue_cycles.formulation,
        step=min(case.continue_cycles.step, step),
        minimum_step=case.continue_cycles.minimum_step,
        maximum_step=step,
        max_points=LINE_POINTS,
        minimum_film=case.continue_cycles.minimum_film,
        direction="down",
    )
    other = FREQUENCY if line.parameter == SPEED else SPEED
    return BranchRequest(
        group, case.model_copy(update={"continue_cycles": table}), direction=-1, fixed={other: line.fixed}
    )
