"""When a step of a continuation is accepted: what arrives is what was predicted.

Between two points u_0, u_1 with unit tangents t_0, t_1, distance h and chord h c, a smooth curve has

    (t_0 + t_1)/2 - c = h^2 u'''/12 + O(h^3),

which is small where the tangents differ little.  A step that ends on another curve, at a distance d beside
its own, has a defect of about d/h on the left.  Where the defect leaves a doubt, the middle of the cubic
through both ends decides: on one smooth curve the cubic misses it by h^4 u''''/384, between two curves by
about d/2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_DOUBTFUL_DEFECT = 0.05  # of a step along a smooth curve
_LARGE_DEFECT = 0.25  # above it the middle may not be farther from the cubic than with this one
# Share of the defect by which the cubic may miss the middle: one half for a step to another curve, up to one
# sixth where the curvature jumps, as it does beside a kink of the equations.
_MISSED = 0.25

BENDS = "the curve bends too much within the step, or leaves along another curve that it meets"
LEAVES = "the step ends beside the curve that it began on"


def refusal(
    metric: Any,
    start_tangent: Any,
    chord: Any,
    end_tangent: Any,
    minimum_cosine: float | None,
    missed_middle: Callable[[], float | None],
    doubtful_defect: float = _DOUBTFUL_DEFECT,
) -> str | None:
    """The reason why a step is too long to be one piece of one smooth curve; None accepts it.

    ``metric`` measures the vectors; both tangents have unit length; ``minimum_cosine``: between them, None
    where a corner is accepted; ``missed_middle()``: distance of the corrected middle from the cubic through
    both ends, None when the middle does not converge; ``doubtful_defect``: above it the middle is corrected.
    """
    if minimum_cosine is not None and metric.inner(start_tangent, end_tangent) < minimum_cosine:
        return BENDS
    length = metric.norm(chord)
    mean = start_tangent.plus(end_tangent).scaled(0.5)
    defect = metric.norm(mean.plus(chord, -1.0 / length))
    if defect <= doubtful_defect:
        return None
    missed = missed_middle()
    allowed = _MISSED * min(defect, _LARGE_DEFECT) * length
    return None if missed is not None and missed <= allowed else LEAVES
