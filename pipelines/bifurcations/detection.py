"""Bifurcations between two cycles, by their test functions: folds, period doublings, Neimark-Sacker points.

Branch points, and the own period doubling of doubled cycles, likewise.

Test functions over the slow multipliers (the trivial multiplier 1 of an autonomous cycle removed):

    psi_fold = prod (1 - mu_i),   psi_PD = prod (1 + mu_i),   psi_NS = prod_{i<j} (1 - mu_i mu_j)

Multipliers near zero contribute factors near one, so the signs do not depend on how many are kept.  A product
over thousands of pairs leaves the range of doubles, therefore a test function is kept as the sign of its
product times the modulus of its smallest factor: continuous, with the same zeros, linear in the factor that
vanishes, and of moderate size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from itertools import product

import numpy as np

from pipelines.bifurcations.cycles.crossing_cycles import passes_own_doubling
from pipelines.bifurcations.cycles.segment import Segment
from pipelines.orbits.floquet import Complex, nontrivial
from pipelines.orbits.shooting import Unknowns
from pipelines.orbits.system import Vector

_OUTSIDE = 1e-9  # the residual asked of a multiplier: nearer to the unit circle is reported as on it
_REAL = 1e-6  # imaginary part, relative to the modulus, below which a multiplier is taken as real


class EventKind(IntEnum):
    """Bifurcations of cycles on a branch.

    ``OWN_PERIOD_DOUBLING``: of the cycle of half the period, which a branch of doubled cycles comes from or
    comes back to.
    """

    FOLD = 1
    PERIOD_DOUBLING = 2
    NEIMARK_SACKER = 3
    BRANCH_POINT = 4
    OWN_PERIOD_DOUBLING = 5


class Resonance(IntEnum):
    """Strong resonances of a Neimark-Sacker point: theta = 0, pi, 2 pi/3, pi/2."""

    NONE = 0
    R1 = 1
    R2 = 2
    R3 = 3
    R4 = 4


@dataclass(frozen=True)
class DetectionOptions:
    """Options of the detection and location of bifurcations on a branch.

    ``event_tolerance``: width of the final bracket along the branch; ``resonance_distance``: angle in
    rad within which a strong resonance is reported; ``kinds``: what to look for.  A conservative system
    has all its multipliers on the unit circle, so that its Neimark-Sacker test is rounding noise: leave
    that kind out.
    """

    event_tolerance: float = 1e-10
    resonance_distance: float = 0.05
    kinds: tuple[EventKind, ...] = (
        EventKind.FOLD,
        EventKind.PERIOD_DOUBLING,
        EventKind.NEIMARK_SACKER,
        EventKind.BRANCH_POINT,
        EventKind.OWN_PERIOD_DOUBLING,
    )

    def __post_init__(self) -> None:
        if not self.event_tolerance > 0.0:
            raise ValueError(f"event_tolerance is {self.event_tolerance}; it must be positive")
        if not 0.0 < self.resonance_distance < math.pi / 6:
            raise ValueError(
                f"resonance_distance is {self.resonance_distance}; it must lie in (0, pi/6), "
                "or two resonances overlap"
            )


@dataclass(frozen=True)
class BifurcationTests:
    """The test functions of one cycle and the number of its multipliers outside the unit circle.

    ``unstable`` counts every multiplier beyond the circle, however near, so that it changes where a test
    function changes sign and nowhere else.
    """

    fold: float
    period_doubling: float
    neimark_sacker: float
    unstable: int


@dataclass(frozen=True)
class Event:
    """A located bifurcation.

    ``parameters`` (p,), ``state`` (N,), ``multipliers`` (k,) by falling modulus, ``critical`` the multiplier
    on the unit circle, ``angle`` its argument in [0, pi].  ``transversality``: d abs(critical)/d parameter
    along the branch; for a fold, where that is infinite, d abs(critical)/d arclength; NaN when a neighbouring
    cycle did not converge. ``residual``: distance of the critical multiplier from 1 (fold, branch point), -1
    or the unit circle; divided by the transversality it is the error of the parameter.  ``fraction``:
    position in the step of the branch.  ``direction`` of the branch there; None for a stored event.
    """

    kind: EventKind
    parameters: Vector
    state: Vector
    period: float
    multipliers: Complex
    critical: complex
    angle: float
    transversality: float
    resonance: Resonance
    residual: float
    fraction: float
    steps: int
    direction: Unknowns | None = None


def unstable_count(multipliers: Complex, autonomous: bool) -> int:
    """Number of nontrivial multipliers outside the unit circle by more than their residual."""
    return int(np.sum(np.abs(nontrivial(multipliers, autonomous)) > 1.0 + _OUTSIDE))


def evaluate_tests(multipliers: Complex, autonomous: bool) -> BifurcationTests:
    """psi_fold, psi_PD and psi_NS of a cycle."""
    mu = nontrivial(multipliers, autonomous)
    first, second = np.triu_indices(len(mu), k=1)
    return BifurcationTests(
        fold=signed_smallest(1.0 - mu),
        period_doubling=signed_smallest(1.0 + mu),
        neimark_sacker=signed_smallest(1.0 - mu[first] * mu[second]),
        unstable=int(np.sum(np.abs(mu) > 1.0)),
    )


def signed_smallest(factors: Complex) -> float:
    """Sign of the product times the modulus of the smallest factor; 1 for an empty product.

    Complex factors come in conjugate pairs, so the product of the phases is 1 or -1.
    """
    if len(factors) == 0:
        return 1.0
    moduli = np.abs(factors)
    smallest = float(np.min(moduli))
    if smallest == 0.0:
        return 0.0
    return math.copysign(smallest, float(np.prod(factors / moduli).real))


def _changes_sign(before: float, after: float) -> bool:
    """Whether a test function changed sign; zero counts as positive, and so as stable."""
    return (before < 0.0) != (after < 0.0)


def detect(before: BifurcationTests, after: BifurcationTests, turned: bool) -> tuple[EventKind, ...]:
    """Kinds whose test function changed sign.  ``turned``: the parameter reversed its direction.

    A multiplier through +1 is a fold where the parameter turns and a branch point where it does not.
    """
    kinds = []
    if turned:
        kinds.append(EventKind.FOLD)
    elif _changes_sign(before.fold, after.fold):
        kinds.append(EventKind.BRANCH_POINT)
    if _changes_sign(before.period_doubling, after.period_doubling):
        kinds.append(EventKind.PERIOD_DOUBLING)
    if _changes_sign(before.neimark_sacker, after.neimark_sacker):
        kinds.append(EventKind.NEIMARK_SACKER)
    return tuple(kinds)


def kinds_between(
    segment: Segment, before: BifurcationTests, after: BifurcationTests
) -> tuple[EventKind, ...]:
    """Which bifurcations lie on a segment, judged from its two ends."""
    turned = segment.start_tangent.parameter * segment.end_tangent.parameter < 0.0
    kinds = detect(before, after, turned)
    at_one = {EventKind.FOLD, EventKind.BRANCH_POINT}
    if at_one.isdisjoint(kinds):
        return kinds
    others = tuple(kind for kind in kinds if kind not in at_one)
    if passes_own_doubling(segment):
        return (EventKind.OWN_PERIOD_DOUBLING, *others)
    # the parameter turns, but no multiplier crosses 1: the branch was born there, at a pitchfork
    return (EventKind.BRANCH_POINT, *others) if _born(before, after, kinds) else kinds


def _born(before: BifurcationTests, after: BifurcationTests, kinds: tuple[EventKind, ...]) -> bool:
    return EventKind.FOLD in kinds and not _changes_sign(before.fold, after.fold)


def explains(
    before: BifurcationTests, after: BifurcationTests, kinds: tuple[EventKind, ...], confirmed: bool = False
) -> bool:
    """Whether the events found can account for the change in the number of unstable multipliers.

    A fold, branch point or period doubling moves one multiplier across the circle, a Neimark-Sacker point two
    and a neutral saddle, which the same test function reports until it is located (``confirmed``), none; nor
    does the point at which a branch was born, a pitchfork or the period doubling of half the period.  If they
    cannot, two events lie between the cycles and the step is too long.
    """
    if _born(before, after, kinds):
        return False
    crosses = _changes_sign(before.fold, after.fold)
    moves = {
        EventKind.NEIMARK_SACKER: (-2, 2) if confirmed else (-2, 0, 2),
        EventKind.BRANCH_POINT: (-1, 1) if crosses else (0,),
        EventKind.OWN_PERIOD_DOUBLING: (0,),
    }
    choices = product(*(moves.get(kind, (-1, 1)) for kind in kinds))
    return after.unstable - before.unstable in {sum(choice) for choice in choices}


def strong_resonance(angle: float, distance: float) -> Resonance:
    """The strong resonance within ``distance`` rad of an angle in [0, pi]."""
    for resonance, exact in (
        (Resonance.R1, 0.0),
        (Resonance.R2, math.pi),
        (Resonance.R3, 2.0 * math.pi / 3.0),
        (Resonance.R4, math.pi / 2.0),
    ):
        if abs(angle - exact) <= distance:
            return resonance
    return Resonance.NONE


def critical_multiplier(kind: EventKind, multipliers: Complex, autonomous: bool) -> complex | None:
    """The multiplier that crosses the unit circle; None for a neutral saddle.

    Of a pair the one with positive imaginary part.
    """
    mu = nontrivial(multipliers, autonomous)
    if kind is EventKind.PERIOD_DOUBLING:
        return complex(mu[np.argmin(np.abs(mu + 1.0))])
    if kind is not EventKind.NEIMARK_SACKER:
        return complex(mu[np.argmin(np.abs(mu - 1.0))])
    first, second = np.triu_indices(len(mu), k=1)
    nearest = int(np.argmin(np.abs(1.0 - mu[first] * mu[second])))
    pair = complex(mu[first[nearest]])
    return None if abs(pair.imag) <= _REAL * abs(pair) else complex(pair.real, abs(pair.imag))
