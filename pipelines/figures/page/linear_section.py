"""Linear behaviour of a case: instability speed, critical speeds, modes at the operating point, diagrams."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pipelines.figures.bode import draw_bode
from pipelines.figures.campbell import draw_campbell
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.page import elements

SMALL = 1e-12  # of the range of speeds


def linear(view: CaseView, single: Mapping[str, Table]) -> list[str]:
    """What the groups linear, criticals and unbalance_response tell."""
    found = []
    if (table := single.get("linear")) is not None:
        found.append(elements.paragraph(_instability(view, table)))
    if (table := single.get("criticals")) is not None:
        found += [_critical_speeds(view, table), *_modes(view, table)]
        found.append(elements.picture(draw_campbell(view, table), f"Campbell diagram of {view.name}"))
    if (table := single.get("unbalance_response")) is not None:
        drawing = draw_bode(view, table, single.get("linear"))
        found.append(elements.picture(drawing, f"Unbalance response of {view.name}"))
    return found


def _instability(view: CaseView, table: Table) -> str:
    speed = table.attributes.get("instability_speed")
    if speed is None:
        low, high = (
            (float(np.min(table["speed"])), float(np.max(table["speed"]))) if len(table["speed"]) else (0, 0)
        )
        return f"The equilibrium loses its stability nowhere between the speeds {low:.4g} and {high:.4g}."
    return (
        f"The equilibrium loses its stability at the speed {speed:.4f} ({view.scales.rpm * speed:.0f} rpm)."
    )


def _critical_speeds(view: CaseView, table: Table) -> str:
    rows: list[tuple[elements.Cell, ...]] = [
        (
            f"{place + 1}",
            float(speed),
            view.scales.rpm * float(speed),
            view.scales.hertz * float(speed),
            float(table["critical_damping_ratio"][place]),
            str(table["critical_direction"][place]),
        )
        for place, speed in enumerate(table["critical_speed"])
    ]
    header = ("critical speed", "dimensionless", "rpm", "Hz", "damping ratio", "whirl")
    return elements.table(header, rows, "Critical speeds")


def _modes(view: CaseView, table: Table) -> list[str]:
    """Modes at the case's own speed."""
    speed = view.parameters.get("speed")
    if speed is None or not len(table["speed"]):
        return []
    if not table["speed"][0] <= speed <= table["speed"][-1]:
        text = (
            f"The operating speed {speed:.4g} is outside the speeds of the Campbell diagram "
            "(criticals.speed_range): the modes there are not known."
        )
        return [elements.paragraph(text)]
    frequency, damping, direction = modes_at(table, speed)
    rows: list[tuple[elements.Cell, ...]] = [
        (
            f"{number}",
            float(frequency[mode]),
            view.scales.hertz * float(frequency[mode]),
            60.0 * view.scales.hertz * float(frequency[mode]),
            float(damping[mode]),
            logarithmic_decrement(float(damping[mode])),
            str(direction[mode]),
        )
        for number, mode in enumerate(np.argsort(frequency, kind="stable"), start=1)
        if np.isfinite(frequency[mode])
    ]
    header = ("mode", "frequency", "Hz", "cycles/min", "damping ratio", "logarithmic decrement", "whirl")
    at = f"Modes at the operating speed {speed:.4g} ({view.scales.rpm * speed:.0f} rpm)"
    return [elements.table(header, rows, f"{at}, linear between the speeds of the Campbell diagram")]


def modes_at(
    criticals: Table, speed: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.str_]]:
    """Frequency, damping ratio and whirl direction (mode,) at a speed inside the range, linear between rows.

    NaN for a mode that is not known on both sides; the direction is that of the nearer row.
    """
    speeds = np.asarray(criticals["speed"], dtype=float)
    row = int(np.clip(np.searchsorted(speeds, speed, side="right") - 1, 0, max(len(speeds) - 2, 0)))
    beyond = min(row + 1, len(speeds) - 1)
    step = speeds[beyond] - speeds[row]
    share = float((speed - speeds[row]) / step) if step > 0.0 else 0.0
    if min(share, 1.0 - share) * step <= SMALL * np.ptp(speeds):  # at a row, its neighbour does not matter
        row = beyond = beyond if share > 0.5 else row
        share = 0.0
    values = [
        (1.0 - share) * criticals[name][row] + share * criticals[name][beyond]
        for name in ("frequency", "damping_ratio")
    ]
    direction = criticals["direction"][row if share <= 0.5 else beyond]
    return values[0], values[1], direction


def logarithmic_decrement(damping_ratio: float) -> float | None:
    """2 pi D / sqrt(1 - D^2); None for a mode that does not oscillate."""
    if not abs(damping_ratio) < 1.0:
        return None
    return 2.0 * math.pi * damping_ratio / math.sqrt(1.0 - damping_ratio**2)
