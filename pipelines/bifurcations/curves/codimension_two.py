"""Special points along a curve: smooth scalar test functions that change sign there.

With the critical multipliers (and the trivial one of an unknown period) removed from the spectrum, mu_i are
the others:

    R1, R2 on a Neimark-Sacker curve    1 - cos theta, 1 + cos theta             cos theta = (mu_1 + mu_2)/2
    R3, R4                              cos theta + 1/2, cos theta
    R1 on a fold, R2 on a flip curve    cosine between left and right null vector
    fold-flip, fold-NS                  prod (1 - mu_i) or prod (1 + mu_i)
    flip-NS, NS-NS                      prod_{i<j} (1 - mu_i mu_j) or prod (1 + mu_i)
    generalised flip, cusp              b or a, times that cosine
    Chenciner                           Re d

R2 removes the pole of b, so that the cosine keeps the product finite.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from pipelines.bifurcations.critical.critical_cycles import Critical
from pipelines.bifurcations.curve import SpecialKind, SpecialPoint, TongueSide
from pipelines.bifurcations.detection import EventKind, signed_smallest, unstable_count
from pipelines.bifurcations.normal_forms.coefficients import NormalForm
from pipelines.orbits.floquet import Complex, nontrivial
from pipelines.orbits.system import Vector

# The kinds of the two curves that meet in a special point.
MEETING_CURVES: Mapping[SpecialKind, tuple[EventKind, EventKind]] = MappingProxyType(
    {
        SpecialKind.R1: (EventKind.NEIMARK_SACKER, EventKind.FOLD),
        SpecialKind.R2: (EventKind.NEIMARK_SACKER, EventKind.PERIOD_DOUBLING),
        SpecialKind.FOLD_FLIP: (EventKind.FOLD, EventKind.PERIOD_DOUBLING),
        SpecialKind.FOLD_NEIMARK_SACKER: (EventKind.NEIMARK_SACKER, EventKind.FOLD),
        SpecialKind.FLIP_NEIMARK_SACKER: (EventKind.NEIMARK_SACKER, EventKind.PERIOD_DOUBLING),
        SpecialKind.DOUBLE_NEIMARK_SACKER: (EventKind.NEIMARK_SACKER, EventKind.NEIMARK_SACKER),
    }
)
_REAL = 1e-6  # imaginary part, relative to the modulus, below which a multiplier is taken as real
_CIRCLE = 1e-5  # distance from the unit circle within which a located pair counts as on it
_ZERO = 1e-9  # a test function below this is on its special point
_END = 1e-7  # distance of cos_theta from 1 or -1 at which a Neimark-Sacker curve has ended


def other_multipliers(kind: EventKind, multipliers: Complex, cos_theta: float, autonomous: bool) -> Complex:
    """The multipliers except the critical ones and the trivial one of an unknown period."""
    rest = nontrivial(multipliers, autonomous)
    critical = [-1.0 + 0.0j if kind is EventKind.PERIOD_DOUBLING else 1.0 + 0.0j]
    if kind is EventKind.NEIMARK_SACKER:
        root = complex(cos_theta * cos_theta - 1.0) ** 0.5
        critical = [cos_theta + root, cos_theta - root]
    for value in critical:
        rest = np.delete(rest, int(np.argmin(np.abs(rest - value))))
    return rest


def unstable_others(kind: EventKind, multipliers: Complex, cos_theta: float, autonomous: bool) -> int:
    """Number of the other multipliers outside the unit circle."""
    return unstable_count(other_multipliers(kind, multipliers, cos_theta, autonomous), False)


@dataclass(frozen=True)
class SecondBifurcation:
    """What becomes critical at a special point, besides the multipliers of the curve that was followed.

    ``kind`` and critical ``angle`` of the curve that it lies on, and the multipliers that are critical on
    neither, ``others``.
    """

    kind: EventKind
    angle: float
    others: Complex


def second_bifurcation(curve: EventKind, special: SpecialPoint, autonomous: bool) -> SecondBifurcation | None:
    """The bifurcation whose curve meets a curve of kind ``curve`` in a special point; None if there is none.

    At R1 and R2 the Neimark-Sacker curve ends on the other one, with a pair of critical multipliers in all,
    and goes on from the far side of a tongue; elsewhere two curves cross.  R1 of cycles of unknown period is
    a different resonance and gives None, as an unresolved tongue does.
    """
    if special.kind not in MEETING_CURVES or (special.kind is SpecialKind.R1 and autonomous):
        return None
    if special.tongue is TongueSide.UNRESOLVED:
        return None
    first, last = MEETING_CURVES[special.kind]
    kind = last if curve is first else first
    if special.kind in (SpecialKind.R1, SpecialKind.R2):
        if special.tongue is TongueSide.FAR:  # the curves around the tongue start from its near side
            kind = EventKind.NEIMARK_SACKER
        pair = other_multipliers(EventKind.NEIMARK_SACKER, special.multipliers, special.cos_theta, autonomous)
        return SecondBifurcation(kind, 0.0 if special.kind is SpecialKind.R1 else math.pi, pair)
    others = other_multipliers(curve, special.multipliers, special.cos_theta, autonomous)
    angle = {EventKind.FOLD: 0.0, EventKind.PERIOD_DOUBLING: math.pi}.get(kind)
    if angle is None:
        angle = abs(cmath.phase(others[_nearest_pair(others)[0]]))
    return SecondBifurcation(kind, angle, other_multipliers(kind, others, math.cos(angle), False))


def special_tests(
    kind: EventKind,
    multipliers: Complex,
    critical: Critical,
    curvature: float,
    scale: float,
    autonomous: bool,
) -> Vector:
    """Values (11,) in the order of ``SpecialKind``; NaN where a test does not belong to the kind of curve.

    Those of normal forms are left out: see ``with_form_test``.

    ``curvature``: p.B(q, q) times the alignment of a fold; ``scale`` of the states on the orbit, which takes
    the unit from it.
    """
    others = other_multipliers(kind, multipliers, critical.cos_theta, autonomous)
    first, second = np.triu_indices(len(others), k=1)
    folds, flips = signed_smallest(1.0 - others), signed_smallest(1.0 + others)
    pairs = signed_smallest(1.0 - others[first] * others[second])
    cos_theta, aligned = critical.cos_theta, critical.alignment
    tests = {
        EventKind.NEIMARK_SACKER: {
            **resonance_tests(cos_theta),
            SpecialKind.FOLD_NEIMARK_SACKER: folds,
            SpecialKind.FLIP_NEIMARK_SACKER: flips,
            SpecialKind.DOUBLE_NEIMARK_SACKER: pairs,
        },
        EventKind.PERIOD_DOUBLING: {
            SpecialKind.R2: aligned,
            SpecialKind.FOLD_FLIP: folds,
            SpecialKind.FLIP_NEIMARK_SACKER: pairs,
        },
        EventKind.FOLD: {
            SpecialKind.R1: folds if autonomous else aligned,
            SpecialKind.FOLD_FLIP: flips,
            SpecialKind.FOLD_NEIMARK_SACKER: pairs,
            SpecialKind.CUSP: scale * curvature,
        },
    }
    return np.array([tests[kind].get(special, math.nan) for special in SpecialKind])


def with_form_test(
    tests: Vector, kind: EventKind, form: NormalForm | None, alignment: float, scale: float
) -> Vector:
    """The tests with that of the coefficient of a ``form``, made free of its unit by ``scale``.

    Unchanged without a form, and on a fold.
    """
    special = {
        EventKind.NEIMARK_SACKER: SpecialKind.CHENCINER,
        EventKind.PERIOD_DOUBLING: SpecialKind.GENERALISED_FLIP,
    }.get(kind)
    if form is None or special is None:
        return tests
    changed = tests.copy()
    aligned = alignment if special is SpecialKind.GENERALISED_FLIP else 1.0
    changed[special - 1] = scale**2 * form.coefficient.real * aligned
    return changed


def resonance_tests(cos_theta: float) -> dict[SpecialKind, float]:
    """The tests of the strong resonances on a Neimark-Sacker curve."""
    return {
        SpecialKind.R1: 1.0 - cos_theta,
        SpecialKind.R2: 1.0 + cos_theta,
        SpecialKind.R3: 0.5 + cos_theta,
        SpecialKind.R4: cos_theta,
    }


def crossed(before: Vector, after: Vector) -> tuple[SpecialKind, ...]:
    """Special points whose test changed sign; a test must be defined at both ends.

    A curve may start or end on a special point: the step that arrives there has it, the one that leaves does
    not.
    """
    return tuple(
        special
        for special, old, new in zip(
            SpecialKind, without_rounding(before), without_rounding(after), strict=True
        )
        if math.isfinite(old) and math.isfinite(new) and old * new <= 0.0 and old != 0.0
    )


def without_rounding(tests: Vector) -> Vector:
    """The test values, with those that are zero to rounding set to exactly zero."""
    return np.where(np.abs(tests) < _ZERO, 0.0, tests)


def genuine(special: SpecialKind, curve: EventKind, others: Complex, cos_theta: float) -> bool:
    """Whether a located zero is the point it claims to be, not a neutral saddle.

    On a Neimark-Sacker curve cos_theta must not have left [-1, 1]; a further pair with product one must be
    complex.
    """
    if curve is EventKind.NEIMARK_SACKER and abs(cos_theta) > 1.0 + _END:
        return False
    pairs = special is SpecialKind.DOUBLE_NEIMARK_SACKER or (
        special in (SpecialKind.FLIP_NEIMARK_SACKER, SpecialKind.FOLD_NEIMARK_SACKER)
        and curve is not EventKind.NEIMARK_SACKER
    )
    if not pairs:
        return True
    if len(others) < 2:
        return False
    value = others[_nearest_pair(others)[0]]
    return bool(abs(value.imag) > _REAL * abs(value) and abs(abs(value) - 1.0) < _CIRCLE)


def _nearest_pair(others: Complex) -> tuple[int, int]:
    """The two multipliers whose product is nearest to one."""
    first, second = np.triu_indices(len(others), k=1)
    nearest = int(np.argmin(np.abs(1.0 - others[first] * others[second])))
    return int(first[nearest]), int(second[nearest])


def resonant_end(kind: EventKind, cos_theta: float) -> SpecialKind | None:
    """R1 or R2 when a Neimark-Sacker curve has arrived there."""
    if kind is not EventKind.NEIMARK_SACKER or abs(cos_theta) < 1.0 - _END:
        return None
    return SpecialKind.R1 if cos_theta > 0.0 else SpecialKind.R2
