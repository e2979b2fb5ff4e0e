"""Fold, period doubling, Neimark-Sacker and branch points between two cycles: detected, located, described.

Test functions over the slow multipliers (the trivial multiplier 1 of an autonomous cycle removed):

    psi_fold = prod (1 - mu_i),   psi_PD = prod (1 + mu_i),   psi_NS = prod_{i<j} (1 - mu_i mu_j)

Multipliers near zero contribute factors near one, so the signs do not depend on how many are kept.  A product
over thousands of pairs leaves the range of doubles, therefore a test function is kept as the sign of its
product times the modulus of its smallest factor: continuous, with the same zeros, linear in the factor that
vanishes, and of moderate size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum
from itertools import pairwise, product

import numpy as np
from scipy.optimize import brentq

from pipelines.bifurcations.cycles.branch_points import cycle_at_branch_point
from pipelines.bifurcations.cycles.crossing_cycles import own_doubling, own_pitchfork, passes_own_doubling
from pipelines.bifurcations.cycles.segment import Segment
from pipelines.orbits.floquet import Complex, nontrivial
from pipelines.orbits.shooting import Cycle, Unknowns, tangent_at
from pipelines.orbits.system import Vector

_OUTSIDE = 1e-9  # the residual asked of a multiplier: nearer to the unit circle is reported as on it
_REAL = 1e-6  # imaginary part, relative to the modulus, below which a multiplier is taken as real
_JUMP = 0.01  # share of its distance at the ends that a multiplier may be from critical where it is located
_DIFFERENCE_FRACTION = 0.05  # of the segment, for the derivative of the modulus


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


class LocationStop(Enum):
    """How the location of a bifurcation ended."""

    LOCATED = "located"
    NEUTRAL_SADDLE = "a real pair with product one: no bifurcation"
    NOT_CONVERGED = "a cycle inside the bracket did not converge: use smaller steps"
    JUMPS = "a multiplier jumps across the unit circle inside the step, from one branch to another"


@dataclass(frozen=True)
class DetectionOptions:
    """``event_tolerance``: width of the final bracket along the branch; ``resonance_distance``: angle in rad
    within which a strong resonance is reported; ``kinds``: what to look for (a conservative system has all
    its multipliers on the unit circle, so that its Neimark-Sacker test is rounding noise: leave that kind
    out).
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
    """Number of multipliers outside the unit circle by more than their residual, the trivial one left
    out.
    """
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
    """Whether a test function changed sign; zero belongs to the side of no crossing, as in ``unstable``."""
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
    """What the ends of a segment tell of the bifurcations on it."""
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
    """The multiplier that crosses, of a pair the one with positive imaginary part; None for a neutral
    saddle.
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


def locate(segment: Segment, kind: EventKind, options: DetectionOptions) -> tuple[LocationStop, Event | None]:
    """Find the zero of the test function of ``kind`` on a segment whose ends have opposite signs.

    Every evaluation is a corrected cycle in the plane of its fraction, so the root is as sharp as the
    corrector.
    """
    turned = segment.start_tangent.parameter * segment.end_tangent.parameter < 0.0
    if kind is EventKind.OWN_PERIOD_DOUBLING or (kind is EventKind.BRANCH_POINT and turned):
        return _locate_birth(segment, kind)
    autonomous = segment.problem.period_map.autonomous
    cycles: dict[float, Cycle] = {}

    def cycle_at(fraction: float) -> Cycle:
        if fraction not in cycles:
            cycle = segment.correct_at(fraction).cycle
            if cycle is None:
                raise _NotConvergedError
            cycles[fraction] = cycle
        return cycles[fraction]

    try:
        fraction = _root(segment, kind, cycle_at, options.event_tolerance / segment.length)
        cycle = cycle_at(fraction)
    except _NotConvergedError:
        beside = _beside_branch_point(segment, cycles) if kind is EventKind.BRANCH_POINT else None
        if beside is None:
            return LocationStop.NOT_CONVERGED, None
        fraction, cycle = beside
    critical = critical_multiplier(kind, cycle.spectrum.multipliers, autonomous)
    if critical is None:
        return LocationStop.NEUTRAL_SADDLE, None
    if _distance(kind, critical) > _JUMP * _largest_distance(segment, kind):
        return LocationStop.JUMPS, None
    angle = abs(math.atan2(critical.imag, critical.real))
    resonance = Resonance.NONE
    if kind is EventKind.NEIMARK_SACKER:
        resonance = strong_resonance(angle, options.resonance_distance)
    return LocationStop.LOCATED, Event(
        kind=kind,
        parameters=cycle.parameters,
        state=cycle.unknowns.state,
        period=cycle.unknowns.period,
        multipliers=cycle.spectrum.multipliers,
        critical=critical,
        angle=angle,
        transversality=_transversality(segment, kind, fraction, critical),
        resonance=resonance,
        residual=_distance(kind, critical),
        fraction=fraction,
        steps=cycle.steps,
        direction=segment.direction(fraction),
    )


def _beside_branch_point(segment: Segment, cycles: dict[float, Cycle]) -> tuple[float, Cycle] | None:
    """The branch point of a segment, from cycles at some distance of it; ``cycles``: some that are known."""
    autonomous = segment.problem.period_map.autonomous

    def beyond_one(multipliers: Complex) -> float:
        critical = critical_multiplier(EventKind.BRANCH_POINT, multipliers, autonomous)
        assert critical is not None
        return critical.real - 1.0

    values = {0.0: beyond_one(segment.start_multipliers), 1.0: beyond_one(segment.end.spectrum.multipliers)}
    values |= {fraction: beyond_one(cycle.spectrum.multipliers) for fraction, cycle in cycles.items()}
    known = sorted(values.items())
    for low, high in pairwise(known):
        if low[1] * high[1] < 0.0:
            return cycle_at_branch_point(
                segment, lambda cycle: beyond_one(cycle.spectrum.multipliers), (low, high)
            )
    return None


def _locate_birth(segment: Segment, kind: EventKind) -> tuple[LocationStop, Event | None]:
    """The point at which a branch was born, found on the cycles of the other branch; the squares of the
    multipliers of simple cycles are those of the doubled one.
    """
    doubled = kind is EventKind.OWN_PERIOD_DOUBLING
    find, turns = (own_doubling, 2) if doubled else (own_pitchfork, 1)
    crossing = find(segment)
    if crossing is None:
        return LocationStop.NOT_CONVERGED, None
    multipliers = crossing.spectrum.multipliers**turns
    critical = critical_multiplier(kind, multipliers, segment.problem.period_map.autonomous)
    assert critical is not None
    return LocationStop.LOCATED, Event(
        kind=kind,
        parameters=crossing.parameters,
        state=crossing.unknowns.state,
        period=turns * crossing.unknowns.period,
        multipliers=multipliers,
        critical=critical,
        angle=0.0,
        transversality=math.nan,
        resonance=Resonance.NONE,
        residual=_distance(kind, critical),
        fraction=0.5,
        steps=turns * crossing.steps,
        direction=segment.direction(0.5),
    )


def _largest_distance(segment: Segment, kind: EventKind) -> float:
    """From the critical multiplier at either end of a segment to where it is critical."""
    autonomous = segment.problem.period_map.autonomous
    ends = (segment.start_multipliers, segment.end.spectrum.multipliers)
    critical = (critical_multiplier(kind, multipliers, autonomous) for multipliers in ends)
    return max((_distance(kind, value) for value in critical if value is not None), default=math.inf)


class _NotConvergedError(Exception):
    """A cycle inside the bracket did not converge."""


def _root(segment: Segment, kind: EventKind, cycle_at: Callable[[float], Cycle], width: float) -> float:
    """Zero of the test function in (0, 1); the known end values are not computed again."""
    known = {
        0.0: _end_value(segment, kind, segment.start_multipliers, segment.start_tangent),
        1.0: _end_value(segment, kind, segment.end.spectrum.multipliers, segment.end_tangent),
    }

    def psi(fraction: float) -> float:
        if fraction in known:
            return known[fraction]
        cycle = cycle_at(fraction)
        if kind is not EventKind.FOLD:
            return _test_value(kind, cycle.spectrum.multipliers, segment.problem.period_map.autonomous)
        tangent = tangent_at(segment.problem, cycle, segment.metric.row(segment.chord), segment.reference)
        if tangent is None:
            raise _NotConvergedError
        return tangent.parameter

    return float(brentq(psi, 0.0, 1.0, xtol=max(width, 1e-14), rtol=4.0 * np.finfo(float).eps))


def _end_value(segment: Segment, kind: EventKind, multipliers: Complex, tangent: Unknowns) -> float:
    if kind is EventKind.FOLD:
        return tangent.parameter
    return _test_value(kind, multipliers, segment.problem.period_map.autonomous)


def _test_value(kind: EventKind, multipliers: Complex, autonomous: bool) -> float:
    values = evaluate_tests(multipliers, autonomous)
    if kind is EventKind.PERIOD_DOUBLING:
        return values.period_doubling
    return values.neimark_sacker if kind is EventKind.NEIMARK_SACKER else values.fold


def _distance(kind: EventKind, critical: complex) -> float:
    if kind is EventKind.PERIOD_DOUBLING:
        return abs(critical + 1.0)
    return abs(abs(critical) - 1.0) if kind is EventKind.NEIMARK_SACKER else abs(critical - 1.0)


def _transversality(segment: Segment, kind: EventKind, fraction: float, critical: complex) -> float:
    """Central difference of the modulus of the critical multiplier along the branch."""
    moduli, places = [], []
    for side in (-_DIFFERENCE_FRACTION, _DIFFERENCE_FRACTION):
        cycle = segment.correct_at(fraction + side).cycle
        if cycle is None:
            return math.nan
        mu = nontrivial(cycle.spectrum.multipliers, segment.problem.period_map.autonomous)
        moduli.append(float(np.abs(mu[np.argmin(np.abs(mu - critical))])))
        arclength = (fraction + side) * segment.length
        places.append(arclength if kind is EventKind.FOLD else cycle.unknowns.parameter)
    return (moduli[1] - moduli[0]) / (places[1] - places[0])
