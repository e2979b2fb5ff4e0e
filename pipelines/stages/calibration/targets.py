"""The values that a machine reaches for the targets of a calibration.

A target at an excitation frequency of highest onset speed is met through the slope of the onset speed over
the frequency, a central difference of two onsets.  The frequency of the highest onset itself, say by a
parabola through three onsets, would cost one onset more and has a pole where the curvature vanishes; the
slope is as smooth as the onsets are, and its zero is the same frequency.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipelines.case.calibrate_settings import CORNERS
from pipelines.case.models import Calibrate, CalibrationTarget, Case
from pipelines.case.problems import CaseError
from pipelines.machine import film
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.campbell import campbell_diagram
from pipelines.orbits.equilibria.critical_speeds import critical_speeds
from pipelines.stages.calibration.doubling import Corner, corner_near, doubling_growth, first_corner
from pipelines.stages.calibration.onset_nearby import Cycles, Undecided
from pipelines.stages.calibration.onset_speed import (
    CENSORED_ABOVE,
    FAILED,
    FOUND,
    INVALID,
    NO_CYCLE,
    NO_EQUILIBRIUM,
    UNDECIDED,
    Onset,
    onset_speed,
)
from pipelines.stages.results import ShouldStop, StopRequested

WHIRL_DIRECTIONS = {"any": (1, -1, 0), "forward": (1,), "backward": (-1,)}


@dataclass(frozen=True)
class Reached:
    """The value that a machine reaches for a target.

    In the target's own unit (NaN where it failed), how the search ended (of `STATUSES`), the onset speed
    behind it (dimensionless, NaN without one) and its bifurcation.
    """

    status: str
    value: float = math.nan
    onset: float = math.nan
    bifurcation: str = "unset"


Expected = float | Corner | None
"""What a machine nearby reaches: an onset speed, or a corner; None to search without knowing any."""
Corners = dict[str, Corner | None]
"""The corners of one machine that are known already, by the keys that their targets set."""


def reached(
    case: Case,
    values: Mapping[str, float],
    target: CalibrationTarget,
    settings: Calibrate,
    expected: Expected,
    should_stop: ShouldStop,
    corners: Corners | None = None,
) -> Reached:
    """The value of a target that the case with other ``values`` at some keys reaches.

    ``expected``: what a machine nearby reaches; ``corners``: of this machine, for two targets of the same
    corner.  Raises StopRequested.
    """
    try:
        own = case.with_values({**values, **target.set})
        if target.quantity == "critical_speed":
            return _in_unit(_critical_speed(own, target, should_stop), own, target)
        if target.quantity == "doubling_growth":
            return _doubling_growth(own, target, should_stop)
        interval = target.speed_range or settings.speed_range
        if target.quantity in CORNERS:
            known = {} if corners is None else corners
            if corner_key(target) not in known:
                known[corner_key(target)] = _corner(own, target, interval, expected, should_stop)
            return _of_corner(known[corner_key(target)], own, target)
        near = None if isinstance(expected, Corner) else expected
        if target.quantity == "onset_speed":
            found = onset_speed(own, interval, target.bifurcation, near, should_stop)
            return _in_unit(found, own, target)
        return _slope(own, target, interval, near, should_stop)
    except CaseError:
        return Reached(INVALID)


def corner_key(target: CalibrationTarget) -> str:
    """What tells the corners of two targets apart."""
    return repr((sorted(target.set.items()), target.frequency_range, target.speed_range))


def _in_unit(found: Onset, case: Case, target: CalibrationTarget) -> Reached:
    value = found.speed if target.value_rpm is None else case.scales.speed_rpm(found.speed)
    onset = math.nan if target.quantity == "critical_speed" else found.speed
    return Reached(found.status, value, onset, found.bifurcation)


def _cycles(case: Case, should_stop: ShouldStop) -> Cycles:
    return Cycles(build_machine(case), case, parameter_vector(case), (), should_stop)


def _doubling_growth(case: Case, target: CalibrationTarget, should_stop: ShouldStop) -> Reached:
    """The largest growth of period doubling at the speeds of a target."""
    cycles = _cycles(case, should_stop)
    try:
        growths = [doubling_growth(cycles.at(speed)) for speed in target.speeds or ()]
    except Undecided:
        return Reached(NO_CYCLE)
    return Reached(FOUND, max(growths), bifurcation="period_doubling" if max(growths) > 0.0 else "unset")


def _corner(
    case: Case,
    target: CalibrationTarget,
    speeds: tuple[float, float],
    expected: Expected,
    should_stop: ShouldStop,
) -> Corner | None:
    """The corner near an expected one, or else the one at the lowest frequency of the range."""
    cycles, frequencies = _cycles(case, should_stop), target.frequency_range
    assert frequencies is not None
    near = corner_near(cycles, expected) if isinstance(expected, Corner) else None
    return near or first_corner(cycles, frequencies, speeds)


def _of_corner(corner: Corner | None, case: Case, target: CalibrationTarget) -> Reached:
    if corner is None:
        return Reached(UNDECIDED)
    if target.quantity == "corner_frequency":
        return Reached(FOUND, corner.frequency, corner.speed)
    return _in_unit(Onset(FOUND, corner.speed), case, target)


def _slope(
    case: Case,
    target: CalibrationTarget,
    interval: tuple[float, float],
    expected: float | None,
    should_stop: ShouldStop,
) -> Reached:
    """d(onset)/d(Omega_ex) = (onset(Omega_ex + d) - onset(Omega_ex - d)) / 2d."""
    frequency = float(parameter_vector(case)[film.EXCITATION_FREQUENCY])
    onsets = []
    for side in (-target.difference, target.difference):
        beside = case.with_values({"excitation.frequency": frequency + side})
        onsets.append(onset_speed(beside, interval, target.bifurcation, expected, should_stop))
        if onsets[-1].status in FAILED:
            return Reached(onsets[-1].status)
    below, above = onsets
    status = next((onset.status for onset in onsets if onset.status != FOUND), FOUND)
    slope = (above.speed - below.speed) / (2.0 * target.difference)
    return Reached(status, slope, 0.5 * (below.speed + above.speed), above.bifurcation)


def _critical_speed(case: Case, target: CalibrationTarget, should_stop: ShouldStop) -> Onset:
    """The critical speed with a number; the highest speed of [criticals] if there are fewer."""

    def visit(index: int) -> None:
        if should_stop():
            raise StopRequested

    machine, parameters, table = build_machine(case), parameter_vector(case), case.criticals
    speeds = np.linspace(*table.speed_range, table.points)
    diagram = campbell_diagram(machine, parameters, speeds, visit, table.max_damping_ratio)
    if len(diagram.missing) == len(diagram.speeds):
        return Onset(NO_EQUILIBRIUM)
    result = critical_speeds(machine, parameters, diagram, table.max_damping_ratio)
    found = [one.speed for one in result.found if one.direction in WHIRL_DIRECTIONS[target.whirl]]
    wanted = found[target.number - 1] if len(found) >= target.number else math.inf
    if any(one.matters and one.low < wanted for one in result.undecided):
        return Onset(UNDECIDED)
    return Onset(FOUND, wanted) if math.isfinite(wanted) else Onset(CENSORED_ABOVE, float(speeds[-1]))
