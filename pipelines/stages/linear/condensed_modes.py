"""How far the condensed rotor is off below the highest speed, for the result of `agfb criticals`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.models import Case
from pipelines.case.scales import Scales
from pipelines.machine.assembly import Machine
from pipelines.machine.condensation_error import (
    ALLOWED_ERROR,
    Masters,
    ModeErrors,
    better_masters,
    full_modes,
    mode_errors,
)
from pipelines.machine.rotor_modes import LinearBearing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearBearings:
    """Films linearised at ``speeds`` (dimensionless), ``dimensional`` [rad/s]: coefficients of every bearing
    along them.
    """

    speeds: Array
    dimensional: Array
    bearings: tuple[LinearBearing, ...]


@dataclass(frozen=True)
class CheckedModes:
    """What is stored: arrays of the compared modes, the largest error, a sentence where it is too large."""

    arrays: dict[str, Any]
    error: float
    caution: str


def checked_modes(
    machine: Machine, case: Case, linear: LinearBearings, at_operation: int, critical: Sequence[float]
) -> CheckedModes:
    """Modes up to the upper end of ``criticals.speed_range``, condensed against full, at the operating speed,
    at the highest speed and at the ``critical`` speeds (at the nearest of the linearisation).
    """
    table = case.criticals
    nearest = [int(np.argmin(np.abs(linear.speeds - speed))) for speed in critical]
    highest = table.speed_range[1] / machine.scales.time
    references = [
        full_modes(
            machine.rotor,
            float(linear.dimensional[index]),
            [bearing.at(index) for bearing in linear.bearings],
            highest,
            table.max_damping_ratio,
        )
        for index in sorted({at_operation, len(linear.speeds) - 1, *nearest})
    ]
    masters = Masters(machine.condensed.masters, machine.condensed.slopes)
    errors = mode_errors(machine.rotor, masters, references)
    caution = ""
    if errors.worst > ALLOWED_ERROR:
        better = better_masters(machine.rotor, masters, references)
        caution = _caution(errors, machine.scales, masters, *better)
    arrays = {
        "checked_speed": errors.speed * machine.scales.time,
        "checked_full_frequency": errors.full * machine.scales.time,
        "checked_condensed_frequency": errors.condensed * machine.scales.time,
        "checked_error": errors.relative,
    }
    return CheckedModes(arrays, errors.worst, caution)


def _caution(errors: ModeErrors, scales: Scales, masters: Masters, better: Masters, left: ModeErrors) -> str:
    """Which mode is off by how much, and the masters that mend it."""
    worst = int(np.argmax(errors.relative))
    speed, full, condensed = (
        float(values[worst]) * scales.time for values in (errors.speed, errors.full, errors.condensed)
    )
    place = f"below the highest speed, at the rotating speed {speed:.4g}"
    if np.isfinite(condensed):
        hertz = f"{scales.hertz(condensed):.4g} instead of {scales.hertz(full):.4g} Hz"
        told = f"the condensed rotor has a mode {100.0 * errors.worst:.3g} % off ({hertz}) {place}"
    else:
        told = f"the condensed rotor lacks the mode of {scales.hertz(full):.4g} Hz {place}"
    if better == masters:
        return f"{told}; no further master helps"
    left_over = f"{100.0 * left.worst:.2g} %"
    return f"{told}; with rotor.masters = {written(better)} no mode is more than {left_over} off"


def written(masters: Masters) -> str:
    """Masters as in a configuration file."""
    entries = (f"{{ node = {n}, slopes = true }}" if n in masters.slopes else str(n) for n in masters.nodes)
    return f"[{', '.join(entries)}]"
