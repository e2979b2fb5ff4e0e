"""Transients for the figures: samples, analysis, what they are drawn over and their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import AxisScales, add_parameter_axis, add_top, seconds
from pipelines.figures.contents import MissingDataError, Table

SAME_SPEED = 1e-9
# Part of the analysis by the first word of its arrays.
PARTS: Mapping[str, str] = MappingProxyType(
    {
        "window": "envelope",
        "envelope": "envelope",
        "mode": "modal_energy",
        "kinetic": "modal_energy",
        "strain": "modal_energy",
        "ring": "ring_section",
        "rotation": "rotation_section",
        "frequency": "spectrum",
        "spectrum": "spectrum",
        "piece": "waterfall",
        "waterfall": "waterfall",
    }
)
RUN_ARRAYS = ("time", "speed", "journal", "ring_displacement")  # of the samples, which are many


@dataclass(frozen=True)
class RunView:
    """A transient: name of its groups (``t000``), its analysis and its samples."""

    name: str
    analysis: Table
    run: Table

    @property
    def speed_changes(self) -> bool:
        """Whether the rotating speed of the run changes."""
        speed = self.run["speed"]
        return bool(np.ptp(speed) > SAME_SPEED * np.max(speed))

    @property
    def over_speed(self) -> bool:
        """Whether the run is drawn over the speed, which then only rises or only falls.

        A run that stays at one speed for more than half of its samples is drawn over time.
        """
        speed = self.run["speed"]
        steps, stays = np.diff(speed), np.unique(speed, return_counts=True)[1].max()
        one_way = bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))
        return self.speed_changes and one_way and bool(stays <= len(speed) / 2)

    def along(self, part: str) -> NDArray[np.float64]:
        """Speed or time of the ``window`` or ``piece`` of the analysis, whichever the run is drawn over."""
        return np.asarray(self.needed(f"{part}_{'speed' if self.over_speed else 'time'}"))

    def needed(self, name: str) -> NDArray[Any]:
        """An array of the analysis; raises MissingDataError with the stored reason if it is missing."""
        if name in self.analysis:
            return self.analysis[name]
        part = PARTS.get(name.split("_")[0], name)
        raise MissingDataError(self.skipped.get(part, f"the array {name!r} is not in the store"))

    @property
    def skipped(self) -> dict[str, str]:
        """Why parts of the analysis are missing."""
        return dict(self.analysis.attributes.get("skipped", {}))

    @property
    def excitation_frequency(self) -> float | None:
        """Frequency of the rings; None if they rest all the time."""
        moves = bool(np.any(self.run["ring_displacement"] > 0.0))
        return float(self.run.attributes["parameters"][1]) if moves else None

    @property
    def unbalance(self) -> str:
        """Unbalance of the run in words."""
        table = self.run.attributes["request"]["unbalance"]
        if table is None:
            return "balanced"
        if table["grade"] is not None:
            return f"G {table['grade']:g}"
        return f"U = {sum(plane['moment'] or 0.0 for plane in table['planes']):g} g mm"

    @property
    def speed_text(self) -> str:
        """The speeds of the run, for titles."""
        first, last = self.run["speed"][[0, -1]]
        value = f"{first:.4g}" if not self.speed_changes else f"{first:.4g} to {last:.4g}"
        return rf"$\bar{{\Omega}}$ = {value}"

    @property
    def title(self) -> str:
        """Name, unbalance and speeds, and why the run ended early."""
        reason = self.run.attributes.get("stop_reason")
        early = f"\nended early: {reason}" if reason in ENDED_EARLY else ""
        return f"run {self.name}, {self.unbalance}, {self.speed_text}{early}"

    @property
    def motion(self) -> str:
        """The kind of motion at the steady end of the run; empty if it is not known."""
        if "motion" not in self.analysis or self.analysis["motion"][0] == "unset":
            return ""
        word = str(self.analysis["motion"][0])
        return f"{word.split('_')[1]}T periodic" if word.startswith("period_") else word.replace("_", "-")


def label_along(
    axes: Axes, over_speed: bool, scales: AxisScales, bottom: bool = True, top: bool = True
) -> None:
    """Label the x axis of a run with speed or time, and the top axis in dimensional units."""
    if over_speed:
        add_parameter_axis(axes, "speed", scales, bottom, top)
        return
    if bottom:
        axes.set_xlabel(r"time $\tau$ [–]")
    if top:
        add_top(axes, seconds(scales), "time [s]")


def bearing_title(bearing: int) -> str:
    """Name of a bearing above its panel."""
    return f"bearing {bearing + 1}"


ENDED_EARLY = ("touch", "vacuum", "newton")  # reasons in the store that end a run before its time
AXIS_LABELS = (r"horizontal $\bar{x}_j$ [–]", r"vertical $\bar{y}_j$ [–]")
AXIS_COLOURS = (style.VERMILION, style.BLUE)
