"""When a continuation accepts a step: the corrected end must agree with the prediction.

Between two points u_0, u_1 with unit tangents t_0, t_1, distance h and chord h c, a smooth curve has

    (t_0 + t_1)/2 - c = h^2 u'''/12 + O(h^3),

which is small where the tangents differ little.  A step that ends on another curve, at a distance d beside
its own, has a defect of about d/h on the left; one that leaves along another curve, at an angle, up to half
of that angle.  In doubt the cubic through both ends is tried at one and at two thirds:
a smooth curve misses it by about h^4 u''''/384, far less than the defect.

Where a curve with a corner, from one branch to another that crosses it, is nearly straight, a step of some
length has no defect at all; where a branch point may lie inside the step, the cubic is tried in any case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_DOUBTFUL_DEFECT = 0.05  # of a step along a smooth curve
_LARGEST_DEFECT = 0.25
_PLACES = (1.0 / 3.0, 2.0 / 3.0)

BENDS = "the curve bends too much within the step, or leaves along another curve that it meets"
LEAVES = "the step ends beside the curve that it began on"


@dataclass(frozen=True)
class StepRule:
    """What a step must meet to be one piece of one curve.

    ``minimum_cosine``: between the tangents at its ends, None where a corner is accepted; ``missed``: share
    of the defect by which the cubic may miss the curve inside the step (at a corner at least 0.06, where the
    curvature jumps up to 0.17, on a smooth curve below 0.04); ``doubtful_defect``: above it the inside is
    looked at; ``largest_defect``: above it the step is refused; ``crossed``: another curve may cross inside
    the step, so that the inside is looked at in any case.
    """

    minimum_cosine: float | None
    missed: float = 0.05
    doubtful_defect: float = _DOUBTFUL_DEFECT
    largest_defect: float = _LARGEST_DEFECT
    crossed: bool = False


def refusal(
    metric: Any,
    start_tangent: Any,
    chord: Any,
    end_tangent: Any,
    rule: StepRule,
    missed_at: Callable[[float], float | None],
) -> str | None:
    """The reason why a step is too long to be one piece of a smooth curve; None if it is accepted.

    ``metric`` measures the vectors; both tangents have unit length; ``missed_at(fraction)``: distance of the
    corrected point at a fraction of the step from the cubic through both ends, None where none converges.
    """
    cosine = metric.inner(start_tangent, end_tangent)
    if rule.minimum_cosine is not None and cosine < rule.minimum_cosine:
        return BENDS
    length = metric.norm(chord)
    mean = start_tangent.plus(end_tangent).scaled(0.5)
    defect = metric.norm(mean.plus(chord, -1.0 / length))
    if defect > rule.largest_defect:
        return LEAVES
    if rule.crossed:
        defect = max(defect, metric.norm(end_tangent.plus(start_tangent, -1.0)))
    elif defect <= rule.doubtful_defect:
        return None
    for place in _PLACES:
        missed = missed_at(place)
        if missed is None or missed > rule.missed * defect * length:
            return LEAVES
    return None
