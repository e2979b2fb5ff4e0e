"""Axes that show a dimensionless quantity and its dimensional counterpart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.patches import Circle, Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

GAP: dict[str, Any] = {"facecolor": "#DDDDDD", "edgecolor": "none", "zorder": 0.5}
TICKS = 6  # at most this many intervals on a second axis: its numbers are long

Conversion = Callable[[ArrayLike], ArrayLike]


@dataclass(frozen=True)
class AxisScales:
    """Dimensional value of one dimensionless unit, as set by the first bearing if not said otherwise."""

    rpm: float  # of a rotating speed [rev/min]
    hertz: float  # of a frequency [Hz]
    micrometres: float  # of a displacement of the rotor [um]
    stiffness: float  # of an areal stiffness [GN/m3]
    bearings_differ: bool = False  # in clearance: then lengths and stiffnesses are said to be of bearing 1
    of_bearings: Mapping[str, NDArray[np.float64]] = field(default_factory=dict, compare=False)
    """Of each bearing itself, by unit: "N/m" of a stiffness, "N s/m" of a damping."""


def seconds(scales: AxisScales) -> float:
    """Seconds in a unit of time."""
    return 1.0 / (2.0 * np.pi * scales.hertz)


@dataclass(frozen=True)
class ParameterAxis:
    """Labels of a continued parameter on an axis."""

    symbol: str
    title: str
    scale: Literal["rpm", "hertz", "micrometres", "stiffness"]  # field of AxisScales
    dimensional_label: str

    def dimensional(self, scales: AxisScales) -> tuple[float, str]:
        """Factor and label of the dimensional axis."""
        label = self.dimensional_label
        if scales.bearings_differ and self.scale in ("micrometres", "stiffness"):
            label = label.replace(" [", ", bearing 1 [")
        return float(getattr(scales, self.scale)), label

    @property
    def unit(self) -> str:
        """Unit of the dimensional axis."""
        return self.dimensional_label.rpartition("[")[2].removesuffix("]")

    @property
    def label(self) -> str:
        """Title and symbol, for the dimensionless axis."""
        return f"{self.title} {self.symbol} [–]"


PARAMETER_AXES = {
    "speed": ParameterAxis(r"$\bar{\Omega}$", "rotating speed", "rpm", "rotating speed [rpm]"),
    "excitation_frequency": ParameterAxis(
        r"$\bar{\Omega}_{ex}$", "excitation frequency", "hertz", "excitation frequency [Hz]"
    ),
    "displacement": ParameterAxis(
        r"$\bar{\delta}$", "ring displacement", "micrometres", "ring displacement [µm]"
    ),
    "foil_stiffness": ParameterAxis(r"$\bar{k}_f$", "foil stiffness", "stiffness", "foil stiffness [GN/m³]"),
}


def add_parameter_axis(
    axes: Axes, parameter: str, scales: AxisScales, bottom: bool = True, top: bool = True
) -> None:
    """Label the x axis with a parameter, and the top axis in dimensional units."""
    axis = PARAMETER_AXES[parameter]
    if bottom:
        axes.set_xlabel(axis.label)
    if top:
        add_top(axes, *axis.dimensional(scales))


def add_top(axes: Axes, factor: float, label: str, ticks: int = TICKS) -> None:
    """Second x axis: ``factor`` times the first."""
    second = axes.secondary_xaxis("top", functions=_proportional(factor))
    second.set_xlabel(label)
    second.xaxis.set_major_locator(MaxNLocator(ticks))


def add_right(axes: Axes, factor: float, label: str, place: float = 1.0) -> None:
    """Second y axis: ``factor`` times the first, at ``place`` of the width of the axes."""
    second = axes.secondary_yaxis(place, functions=_proportional(factor))
    second.set_ylabel(label)


def _proportional(factor: float) -> tuple[Conversion, Conversion]:
    def forward(values: ArrayLike) -> ArrayLike:
        return np.asarray(values, dtype=float) * factor

    def backward(values: ArrayLike) -> ArrayLike:
        return np.asarray(values, dtype=float) / factor

    return forward, backward


def limits(values: ArrayLike, margin: float = 0.05) -> tuple[float, float]:
    """Limits around the finite values; a single value gets room around it, no value the unit interval."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    room = margin * (high - low) if high > low else 0.05 * max(abs(high), 1e-3)
    return low - room, high + room


def coloured_line(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    values: NDArray[np.float64],
    norm: Normalize,
    colours: str | Colormap,
    **options: Any,
) -> LineCollection:
    """Draw a polyline whose segments take their colour from the mean value at their two ends.

    A segment with a NaN end is left out.
    """
    points = np.column_stack([x, y])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    means = 0.5 * (values[:-1] + values[1:])
    known = np.isfinite(segments).all(axis=(1, 2)) & np.isfinite(means)
    lines = LineCollection(list(segments[known]), array=means[known], norm=norm, cmap=colours, **options)
    axes.add_collection(lines)
    return lines


def gaps(x: NDArray[np.float64], present: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Intervals of rising ``x`` without results: from the last point before to the first point after each."""
    known = np.concatenate([[0], np.flatnonzero(present), [len(x) - 1]])
    ends = list(pairwise(known))
    return [
        (float(x[low]), float(x[high]))
        for low, high in ends
        if high > low + 1 or (high > low and not (present[low] and present[high]))
    ]


def shade_gaps(axes: Axes, x: NDArray[np.float64], present: NDArray[np.bool_]) -> None:
    """Shade intervals without results."""
    for low, high in gaps(x, present):
        axes.axvspan(low, high, **GAP)


def gap_handle(label: str) -> Patch:
    """Legend entry for shaded gaps."""
    return Patch(label=label, **GAP)


def clearance_circle(axes: Axes) -> None:
    """Nominal clearance circle of radius one: where a journal would touch an undeformed foil."""
    axes.add_patch(
        Circle((0.0, 0.0), 1.0, fill=False, linestyle=(0, (5, 3)), linewidth=0.9, edgecolor="#444444")
    )
    axes.axhline(0.0, color="#BBBBBB", linewidth=0.5, zorder=0)
    axes.axvline(0.0, color="#BBBBBB", linewidth=0.5, zorder=0)
    axes.set_aspect("equal")
