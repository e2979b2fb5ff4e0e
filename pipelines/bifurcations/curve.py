"""A bifurcation curve: its options, its start, its points, the state that resumes it, its result."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum

import numpy as np

from pipelines.bifurcations.continuation import Result, ResumableState, validate_stepping
from pipelines.bifurcations.critical.critical_cycles import BorderingVectors
from pipelines.bifurcations.detection import DetectionOptions, EventKind, Resonance, strong_resonance
from pipelines.bifurcations.normal_forms.coefficients import NormalForm, NormalFormOptions
from pipelines.bifurcations.plane import Position
from pipelines.orbits.floquet import Complex
from pipelines.orbits.shooting import Cycle
from pipelines.orbits.system import Matrix, Vector


class CurveStop(Enum):
    """Why a curve ended, with advice."""

    RANGE = "the end of the range of a parameter is reached: widen the range to continue"
    CLOSED = "the curve closed on its first point: nothing more to compute"
    RESONANCE_1 = "the multipliers meet at 1 (R1): follow the fold curve through this point"
    RESONANCE_2 = "the multipliers meet at -1 (R2): follow the period-doubling curve through this point"
    MAXIMUM_POINTS = "the maximum number of points is reached: raise max_points to continue"
    MINIMUM_STEP = (
        "the step fell below its minimum: lower minimum_step, tighten the grid, allow more iterations or use "
        "the bordered formulation"
    )
    LIMIT = "a limit set by the caller is reached"
    TRACED = "another curve was traced here before: nothing more to compute"
    LEAVES_BOUNDARY = (
        "the curve leaves the boundary of stable cycles here: agfb track-folds or track-pd follows it further"
    )
    INTERRUPTED = "stopped on request after a complete point: run again to resume"
    START_FAILED = "the first point did not converge: start from a better located bifurcation"

    @property
    def advice(self) -> str:
        return self.value


_FIRST_STEP = 0.1  # of the width of a tongue
_SHORTEST_STEP = 1e-3  # likewise: the ends of a tongue are far sharper than it is wide


class SpecialKind(IntEnum):
    """Points of codimension two on a curve."""

    R1 = 1
    R2 = 2
    R3 = 3
    R4 = 4
    FOLD_FLIP = 5
    FOLD_NEIMARK_SACKER = 6
    FLIP_NEIMARK_SACKER = 7
    DOUBLE_NEIMARK_SACKER = 8
    GENERALISED_FLIP = 9
    CHENCINER = 10
    CUSP = 11


class TongueSide(IntEnum):
    """What a point R1 or R2 on a Neimark-Sacker curve is to the tongue of real multipliers behind it.

    The curve ends at the near side and goes on from the far side; across an unresolved tongue, which the
    error of the multipliers hides, it goes on by itself.
    """

    NEAR = 0
    FAR = 1
    UNRESOLVED = 2


@dataclass(frozen=True)
class CurveOptions:
    """Options of the continuation of a curve.

    ``ranges``: intervals of the two parameters.
    ``direction``: initial sense of the first parameter, 1 up, -1 down.
    ``step``, ``minimum_step``, ``maximum_step``: first, shortest and longest step, in arclength.
    ``max_points``: largest number of points.
    ``target_iterations``: iterations of the corrector at which the step length is kept.
    ``minimum_cosine``: smallest cosine between neighbouring tangents.
    ``parameter_scales``: changes of the parameters that count as one.
    ``event_tolerance``: width of the final bracket of a special point, in arclength.
    ``boundary``: whether the curve ends where other multipliers are unstable, at its first point or in the
    step behind the one in which a special point made them so.
    ``fewer_time_steps``: whether a point may have fewer than the one before; other time steps move the curve.
    ``normal_form``: differences for the critical coefficients; None leaves them out, and with them
    generalised period doublings and Chenciner points.

    Raises ValueError for values out of order.
    """

    ranges: tuple[tuple[float, float], tuple[float, float]]
    direction: int = 1
    step: float = 0.02
    minimum_step: float = 1e-7
    maximum_step: float = 0.05
    max_points: int = 400
    target_iterations: int = 5
    minimum_cosine: float = 0.8
    parameter_scales: tuple[float, float] = (1.0, 1.0)
    event_tolerance: float = 1e-11
    boundary: bool = False
    fewer_time_steps: bool = True
    normal_form: NormalFormOptions | None = field(default_factory=NormalFormOptions)

    def __post_init__(self) -> None:
        validate_stepping(self, self.ranges, self.parameter_scales)
        if not self.event_tolerance > 0.0:
            raise ValueError(f"event_tolerance is {self.event_tolerance}; it must be positive")


def around_tongue(options: CurveOptions, width: float) -> CurveOptions:
    """The options for the curve around a tongue of this width: its first and its shortest steps are shorter.

    It keeps its time steps: with others the tongue may lie beside itself by a part of its width, where no
    short step leads.  Unchanged for a width of NaN, and for a wide tongue.
    """
    if not width > 0.0:
        return options
    shortest = min(options.minimum_step, _SHORTEST_STEP * width)
    step = max(shortest, min(options.step, _FIRST_STEP * width))
    if step == options.step:
        return replace(options, minimum_step=shortest)
    return replace(options, step=step, minimum_step=shortest, fewer_time_steps=False)


@dataclass(frozen=True)
class CurveStart:
    """A guess for the first point of a curve.

    ``state`` (N,), the two parameters, the period when it is unknown and, for a Neimark-Sacker point,
    the ``angle`` of its multipliers (default: of the pair nearest to the circle).  ``width`` of the tongue at
    a strong resonance, in the scaled parameters: see ``around_tongue``.  ``unstable``: number of the other
    multipliers outside the unit circle, if it is known.
    """

    state: Vector
    parameters: tuple[float, float]
    period: float = 0.0
    angle: float | None = None
    width: float = math.nan
    unstable: int | None = None


@dataclass(frozen=True)
class CurveState(ResumableState):
    """Everything that determines the next step, as plain arrays and numbers.

    A curve restarted from a copy of it continues with the same bits.  ``state``, the ``tangent_*``, the
    ``normal_*`` (the second tangent of the surface of cycles, across the curve), the ``gradient_*`` (row of
    the test function) and the ``bend_*`` (change of the tangent per arclength in the last step, zero at
    first) have shape (N,) with (2,) parameters; ``right``, ``left`` (N,), ``right_period``, ``left_phase``,
    ``cos_theta``: the bordering of the test function; ``cos_theta_slope``: its derivative by arclength;
    ``tests`` (11,): values of the special test functions in the order of ``SpecialKind``; ``previous_*`` is
    the point before, NaN at the first one; ``step`` is the next arclength step; ``steps`` are per period and
    leave ``step_error`` in the multipliers, half as many ``coarser_error``; ``start_*``: the first point;
    ``clipping_width``: half width of the regularised map on whose curve the point lies, zero for the exact
    one.
    """

    index: int
    state: Vector
    period: float
    parameters: Vector
    tangent_state: Vector
    tangent_period: float
    tangent_parameters: Vector
    normal_state: Vector
    normal_period: float
    normal_parameters: Vector
    gradient_state: Vector
    gradient_period: float
    gradient_parameters: Vector
    bend_state: Vector
    bend_period: float
    bend_parameters: Vector
    right: Vector
    left: Vector
    right_period: float
    left_phase: float
    cos_theta: float
    cos_theta_slope: float
    tests: Vector
    previous_tests: Vector
    previous_arclength: float
    step: float
    arclength: float
    steps: int
    step_error: float
    coarser_error: float
    basis: Matrix
    start_state: Vector
    start_period: float
    start_parameters: Vector
    clipping_width: float = 0.0

    @property
    def position(self) -> Position:
        return Position(self.state, self.period, self.parameters)

    @property
    def tangent(self) -> Position:
        return Position(self.tangent_state, self.tangent_period, self.tangent_parameters)

    @property
    def normal(self) -> Position:
        return Position(self.normal_state, self.normal_period, self.normal_parameters)

    @property
    def gradient(self) -> Position:
        return Position(self.gradient_state, self.gradient_period, self.gradient_parameters)

    @property
    def bend(self) -> Position:
        return Position(self.bend_state, self.bend_period, self.bend_parameters)

    @property
    def start(self) -> Position:
        return Position(self.start_state, self.start_period, self.start_parameters)

    @property
    def bordering(self) -> BorderingVectors:
        return BorderingVectors(self.right, self.left, self.right_period, self.left_phase, self.cos_theta)


@dataclass(frozen=True)
class CurvePoint:
    """One accepted point of a curve.

    ``cycle``: state, period, orbit, multipliers (its continued parameter is the first of the two);
    ``parameters`` (2,): both free ones; ``cos_theta``: of the critical angle; ``alignment``: cosine between
    left and right null vector; ``right`` (N, m): critical vectors; ``normal_form``: None when not asked for
    or not defined; ``newton_iterations``: before the time steps were refined; ``step_error``: estimated error
    of the multipliers by the time steps, ``coarser_error``: by half as many, NaN where unknown;
    ``residual_norms`` and ``test_values``: history of the corrector; ``unlocated``: special points that were
    detected in the step to this point but could not be located; ``clipping_width``: as in CurveState;
    ``width_effect``: distance of the point from the curve of the exact map, in the plane of the parameters
    divided by their scales, zero where that map was used and NaN where it is unknown.
    """

    kind: EventKind
    cycle: Cycle
    parameters: Vector
    cos_theta: float
    alignment: float
    right: Matrix
    normal_form: NormalForm | None
    residual_norms: tuple[float, ...]
    test_values: tuple[float, ...]
    newton_iterations: int = 0
    step_error: float = math.nan
    coarser_error: float = math.nan
    unlocated: tuple[SpecialKind, ...] = ()
    clipping_width: float = 0.0
    width_effect: float = 0.0

    @property
    def angle(self) -> float:
        """Argument of the critical multiplier in [0, pi]."""
        return float(np.arccos(min(1.0, max(-1.0, self.cos_theta))))

    @property
    def iterations(self) -> int:
        return max(0, len(self.residual_norms) - 1)

    def resonance(self, distance: float = DetectionOptions.resonance_distance) -> Resonance:
        """The strong resonance within ``distance`` rad of a Neimark-Sacker point, if any.

        There d does not decide what is born: resonant terms of the same order join it (R4) or it has
        a pole (R1, R2, R3).
        """
        if self.kind is not EventKind.NEIMARK_SACKER:
            return Resonance.NONE
        return strong_resonance(self.angle, distance)


@dataclass(frozen=True)
class SpecialPoint:
    """A located point of codimension two.

    ``parameters`` (p,): all of them; ``state`` (N,), ``period``, ``multipliers`` (k,) by falling modulus,
    ``cos_theta`` of the critical angle, ``residual``: value of the test function; ``fraction``: position in
    the step of the curve; of R1 and R2 on a Neimark-Sacker curve: the side of the ``tongue`` there and its
    ``width`` in the scaled parameters, at most so much if it is unresolved (NaN: wider than a few steps).
    """

    kind: SpecialKind
    parameters: Vector
    state: Vector
    period: float
    multipliers: Complex
    cos_theta: float
    residual: float
    fraction: float
    steps: int
    tongue: TongueSide | None = None
    width: float = math.nan


CurveResult = Result[CurveState]
