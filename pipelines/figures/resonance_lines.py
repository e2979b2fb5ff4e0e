"""Predicted parametric resonances as lines over the plane of excitation frequency and speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.campbell import LARGEST_DAMPING
from pipelines.figures.contents import Table
from pipelines.figures.placement import spread

LARGEST_ORDER = 2  # of the resonances drawn: weaker ones were never met
CRITICALS = 4  # lowest critical speeds whose resonances are drawn
STRIP = 0.15  # height of the labels, over that of the axes
LABEL_SIZE, LABEL_GAP = 6.0, 0.0165  # type, and distance of neighbours over the width
LINE_COLOUR, LABEL_COLOUR = "#B4B4B4", "#555555"


@dataclass(frozen=True)
class ResonanceLine:
    """A predicted resonance: excitation frequency and formula."""

    frequency: float
    formula: str


def resonances_of(criticals: Table, low: float, high: float) -> list[ResonanceLine]:
    """Predicted resonances inside an interval, by increasing frequency."""
    if "resonance_frequency" not in criticals:
        return []
    found: list[ResonanceLine] = []
    columns = [criticals[f"resonance_{name}"] for name in ("frequency", "j", "k", "order", "kind")]
    for frequency, j, k, order, kind in sorted(zip(*columns, strict=True), key=lambda row: float(row[0])):
        if not low <= frequency <= high or order > LARGEST_ORDER or max(j, k) > CRITICALS:
            continue
        found.append(ResonanceLine(float(frequency), formula(str(kind), int(j), int(k), int(order))))
    return found


def formula(kind: str, j: int, k: int, order: int) -> str:
    """Formula of a resonance: 2 Omega_j / n, (Omega_j + Omega_k) / n or |Omega_j - Omega_k| / n."""
    first, second = rf"\bar{{\Omega}}_{{{j}}}", rf"\bar{{\Omega}}_{{{k}}}"
    if kind == "principal":
        return f"${first}$" if order == 2 else f"$2{first}$" + ("" if order == 1 else f"/{order}")
    if kind == "sum":
        text = f"${first}+{second}$"
        return text if order == 1 else f"({text})/{order}"
    return rf"$|{first}-{second}|$" + ("" if order == 1 else f"/{order}")


def draw_resonances(axes: Axes, criticals: Table) -> Axes | None:
    """Vertical lines with formulas in a strip above the axes, which is returned; None without any."""
    low, high = axes.get_xlim()
    found = resonances_of(criticals, low, high)
    if not found:
        return None
    strip = axes.inset_axes((0.0, 1.0, 1.0, STRIP))
    strip.set(xlim=(low, high), ylim=(0.0, 1.0))
    strip.axis("off")
    wanted = np.array([(resonance.frequency - low) / (high - low) for resonance in found])
    half = 0.5 * LABEL_GAP
    places = low + (high - low) * spread(wanted, LABEL_GAP, half, 1.0 - half)
    for resonance, place in zip(found, places, strict=True):
        axes.axvline(resonance.frequency, color=LINE_COLOUR, linewidth=0.6, zorder=0.6)
        ends = [resonance.frequency, place, place]
        strip.plot(ends, [0.0, 0.13, 0.17], color=LINE_COLOUR, linewidth=0.6, clip_on=False)
        strip.text(
            place, 0.2, resonance.formula, rotation=90, ha="center", va="bottom", fontsize=LABEL_SIZE,
            color=LABEL_COLOUR,
        )  # fmt: skip
    return strip


def draw_frequencies(axes: Axes, criticals: Table) -> list[Line2D]:
    """The principal resonances with the natural frequencies of every speed, 2 Im lambda_j(Omega) / n."""
    if "frequency" not in criticals or "speed" not in criticals:
        return []
    speed = np.asarray(criticals["speed"], dtype=float)
    frequency = np.asarray(criticals["frequency"], dtype=float)
    frequency = np.where(_weakly_damped(criticals, frequency), frequency, np.nan)
    low, high = axes.get_xlim()
    drawn: list[Line2D] = []
    for mode in frequency.T:
        for order in range(1, LARGEST_ORDER + 1):
            if np.any((2.0 * mode / order > low) & (2.0 * mode / order < high)):
                drawn += axes.plot(2.0 * mode / order, speed, **FREQUENCY_LOOK)
    return drawn


FREQUENCY_LOOK: dict[str, Any] = {"color": style.SKY, "linewidth": 0.7, "alpha": 0.45, "zorder": 0.7}


def _weakly_damped(criticals: Table, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Oscillating modes with weak damping; all of them where damping ratios are not stored."""
    oscillating = frequency > 0.0
    if "damping_ratio" not in criticals:
        return oscillating
    return np.asarray(oscillating & (criticals["damping_ratio"] < LARGEST_DAMPING))


def resonance_handles(lines: bool, frequencies: bool) -> list[Line2D]:
    """Legend entries."""
    handles = []
    if lines:
        handles.append(Line2D([], [], color=LINE_COLOUR, linewidth=0.9, label="predicted resonances"))
    if frequencies:
        label = r"$2\,$Im$\,\lambda_j(\bar{\Omega})/n$, $n=1,2$"
        handles.append(Line2D([], [], color=style.SKY, linewidth=0.9, alpha=0.6, label=label))
    return handles
