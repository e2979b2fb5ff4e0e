"""What walking along a branch of cycles and along a bifurcation curve have in common.

Both are piecewise cubic between corrected points with unit tangents, adapt their step to the effort of the
corrector, and close when they come back to their first point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, Self, cast

import numpy as np

from pipelines.orbits.system import Vector, size_of

STEP_GROWTH = 1.1  # steps per period are raised beyond the need, so that they rarely grow again
_CLOSED = 0.05  # distance of the first point from the interpolated branch, in units of the step
_LONGEST = 0.1  # relative change of the period in a step of the maximum length, at most
_SAME = 0.01  # distance within which two points are one, in units of the step: far above corrector errors


def refuse_misfits(walk: Any, ranges: tuple[tuple[float, float], ...], scales: tuple[float, ...]) -> None:
    """Raise ValueError for ranges, parameter scales or options out of order.

    ``walk``: the options, with ``direction``, ``step``, ``minimum_step``, ``maximum_step``, ``max_points``,
    ``target_iterations`` and ``minimum_cosine``.
    """
    for interval in ranges:
        if not interval[0] < interval[1]:
            raise ValueError(f"range is {interval}; its first value must be below its second")
    if walk.direction not in (-1, 1):
        raise ValueError(f"direction is {walk.direction}; it must be 1 (up) or -1 (down)")
    if not 0.0 < walk.minimum_step <= walk.step <= walk.maximum_step:
        raise ValueError(
            f"minimum_step {walk.minimum_step}, step {walk.step}, maximum_step {walk.maximum_step}; "
            "they must be positive and in this order"
        )
    if walk.max_points < 1 or walk.target_iterations < 1:
        raise ValueError("max_points and target_iterations must be at least 1")
    if not -1.0 <= walk.minimum_cosine < 1.0:
        raise ValueError(f"minimum_cosine is {walk.minimum_cosine}; it must lie in [-1, 1)")
    if not min(scales) > 0.0:
        raise ValueError(f"parameter_scale is {min(scales)}; it must be positive")


def period_scale(state: Vector, period: float, maximum_step: float) -> float:
    """The change of an unknown period that counts as one, from the first point.

    A relative change of the period counts like the same relative change of the state, so that no unit of time
    or state matters; where the first cycle is small, ``_LONGEST`` is a step of the maximum length.
    """
    return period / max(size_of(float(np.sqrt(np.mean(state**2)))), maximum_step / _LONGEST)


def hermite_weights(fraction: float, length: float) -> tuple[float, float, float, float]:
    """Weights of start, start tangent, end and end tangent in the cubic at a fraction of a segment."""
    t = fraction
    return (
        2 * t**3 - 3 * t**2 + 1,
        length * (t**3 - 2 * t**2 + t),
        3 * t**2 - 2 * t**3,
        length * (t**3 - t**2),
    )


def hermite_slopes(fraction: float, length: float) -> tuple[float, float, float, float]:
    """Derivatives of these weights by arclength."""
    t = fraction
    return (
        (6 * t**2 - 6 * t) / length,
        3 * t**2 - 4 * t + 1,
        (6 * t - 6 * t**2) / length,
        3 * t**2 - 2 * t,
    )


def adapted_length(step: float, iterations: int, target: int, shortest: float, longest: float) -> float:
    """The next step: longer when the corrector needed less than ``target`` iterations, shorter when more."""
    factor = 2.0 ** ((target - iterations) / 2.0)
    return min(longest, max(shortest, step * min(2.0, max(0.5, factor))))


def passes_start(
    arclength: float, length: float, fraction: float, distance: Callable[[float], float]
) -> bool:
    """Whether a segment passes through, or stops just before, the first point, which was left before.

    ``fraction``: where on the chord the first point lies; ``distance`` of it from the segment at a fraction.
    """
    if arclength <= 2.0 * length:
        return False
    # what is left to the first point beyond the segment would make a needlessly short step
    if not 0.0 < fraction <= 1.0 + _CLOSED:
        return False
    return distance(fraction) <= _CLOSED * length


def is_start(arclength: float, step: float, distance: float) -> bool:
    """Whether a point at a ``distance`` from the first one is the first point again."""
    return arclength > 2.0 * step and distance <= _SAME * step


class PlainState:
    """A frozen dataclass of arrays and numbers from which a walk goes on with the same bits."""

    def arrays(self) -> dict[str, Any]:
        """Field name to array or number."""
        return {item.name: getattr(self, item.name) for item in fields(cast(Any, self))}

    @classmethod
    def from_arrays(cls, arrays: dict[str, Any]) -> Self:
        """The inverse of ``arrays``; arrays are copied into C order, on which the bits of a product
        depend.
        """
        kinds = {"index": int, "steps": int, "leading": int}
        values: dict[str, Any] = {
            name: np.array(value, order="C") if np.ndim(value) else kinds.get(name, float)(value)
            for name, value in arrays.items()
        }
        return cls(**values)
