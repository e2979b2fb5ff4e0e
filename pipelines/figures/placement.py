"""Positions for labels in crowded places: along one edge, and around points of a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

Array = NDArray[np.float64]

DIRECTIONS = 16
DISTANCES = (4.5, 10.0, 17.0, 26.0, 38.0)  # points, from a marker to its label
LEADER_FROM = 12.0  # points: labels farther away are tied to their marker by a line
HALO = 1.5  # points kept free around a label
LABEL_WEIGHT, OUTSIDE_WEIGHT, DISTANCE_WEIGHT = 1e4, 1e6, 0.02  # against one sample of a curve underneath


def spread(wanted: Array, gap: float, low: float, high: float) -> Array:
    """Positions (n,) in order inside [low, high], nearest to increasing ``wanted`` ones.

    They lie at least ``gap`` apart, or equally spaced over the whole interval where they do not fit.
    """
    count = len(wanted)
    if count == 0:
        return np.zeros(0)
    gap = min(gap, (high - low) / max(count - 1, 1))
    steps = gap * np.arange(count)
    level = isotonic_regression(np.asarray(wanted, dtype=float) - steps).x
    return np.asarray(np.clip(level, low, high - steps[-1]) + steps)


@dataclass(frozen=True)
class Label:
    """A text at a point (x, y) of the axes."""

    text: str
    x: float
    y: float


def place_labels(
    axes: Axes, renderer: RendererBase, labels: Sequence[Label], curves: Array, fontsize: float
) -> None:
    """Write every label beside its point where it covers no other label, no marker and few curves.

    ``curves`` (n, 2): samples of what else is drawn.  The layout must be settled: places are measured.
    """
    if not labels:
        return
    scale = axes.figure.dpi / 72.0
    anchors = axes.transData.transform([(label.x, label.y) for label in labels])
    obstacles = axes.transData.transform(curves) if len(curves) else np.zeros((0, 2))
    taken = [Bbox.from_bounds(x - 3 * scale, y - 3 * scale, 6 * scale, 6 * scale) for x, y in anchors]
    for number, (label, anchor) in enumerate(zip(labels, anchors, strict=True)):
        size = _size(axes, renderer, label.text, fontsize)
        others = taken[:number] + taken[number + 1 :]
        offset, box = _best_offset(axes, anchor, size, others, obstacles, scale)
        taken.append(box)
        _write(axes, label, offset, fontsize)


def _size(axes: Axes, renderer: RendererBase, text: str, fontsize: float) -> tuple[float, float]:
    probe = axes.text(0.5, 0.5, text, fontsize=fontsize, transform=axes.transAxes)
    box = probe.get_window_extent(renderer)
    probe.remove()
    return float(box.width), float(box.height)


def _best_offset(
    axes: Axes,
    anchor: Array,
    size: tuple[float, float],
    taken: Sequence[Bbox],
    obstacles: Array,
    scale: float,
) -> tuple[tuple[float, float], Bbox]:
    """Offset of the label's centre in points, and the box that it takes in pixels."""
    width, height = size
    best: tuple[float, tuple[float, float], Bbox] | None = None
    for distance in DISTANCES:
        for angle in 0.25 * np.pi + 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            along = np.array([np.cos(angle), np.sin(angle)])
            beside = np.clip(1.6 * along, -1.0, 1.0)  # the side or corner of the label that faces its point
            centre = anchor + distance * scale * along + 0.5 * beside * [width, height]
            halo = HALO * scale
            box = Bbox.from_bounds(
                centre[0] - 0.5 * width - halo,
                centre[1] - 0.5 * height - halo,
                width + 2 * halo,
                height + 2 * halo,
            )
            cost = _cost(axes, box, taken, obstacles) + DISTANCE_WEIGHT * distance
            if best is None or cost < best[0]:
                x, y = (centre - anchor) / scale
                best = cost, (float(x), float(y)), box
    assert best is not None
    return best[1], best[2]


def _cost(axes: Axes, box: Bbox, taken: Sequence[Bbox], obstacles: Array) -> float:
    inside = (obstacles >= [box.x0, box.y0]) & (obstacles <= [box.x1, box.y1])
    frame = axes.bbox
    leaves = box.x0 < frame.x0 or box.x1 > frame.x1 or box.y0 < frame.y0 or box.y1 > frame.y1
    covered = sum(box.overlaps(other) for other in taken)
    return float(np.all(inside, axis=1).sum() + LABEL_WEIGHT * covered + OUTSIDE_WEIGHT * leaves)


def _write(axes: Axes, label: Label, offset: tuple[float, float], fontsize: float) -> None:
    far = float(np.hypot(*offset)) > LEADER_FROM
    axes.annotate(
        label.text,
        (label.x, label.y),
        xytext=offset,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=fontsize,
        zorder=6,
        path_effects=[withStroke(linewidth=1.5, foreground="white")],
        arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": "#555555", "shrinkA": 1.0, "shrinkB": 2.0}
        if far
        else None,
        in_layout=False,
    )
