"""A branch of cycles: its options, its start, its points, the state that resumes it, its result."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from pipelines.bifurcations.continuation import Result, ResumableState, validate_stepping
from pipelines.bifurcations.detection import DetectionOptions, EventKind
from pipelines.orbits.floquet import Complex
from pipelines.orbits.shooting import Cycle, Unknowns
from pipelines.orbits.system import Matrix, Vector


class BranchStop(Enum):
    """Why a branch ended, with advice."""

    RANGE = "the end of the parameter range is reached: widen the range to continue"
    CLOSED = "the branch closed on its first point: nothing more to compute"
    MAXIMUM_POINTS = "the maximum number of points is reached: raise max_points to continue"
    MINIMUM_STEP = (
        "the step fell below its minimum: lower minimum_step, tighten the grid or allow more iterations"
    )
    LIMIT = "a limit set by the caller is reached"
    INTERRUPTED = "stopped on request after a complete point: run again to resume"
    START_FAILED = "the first cycle did not converge: start at another parameter or from a better guess"

    @property
    def advice(self) -> str:
        return self.value


@dataclass(frozen=True)
class ContinuationOptions:
    """Options of the continuation of a branch.

    ``range``: interval of the parameter.
    ``direction``: initial sense of the parameter, 1 up, -1 down.
    ``step``, ``minimum_step``, ``maximum_step``: first, shortest and longest step, in arclength.
    ``max_points``: largest number of points.
    ``target_iterations``: Newton iterations at which the step length is kept.
    ``minimum_cosine``: smallest cosine between neighbouring tangents.
    ``parameter_scale``: change of the parameter that counts as one.
    ``detection``: options of the location of bifurcations.

    Arclength has the unit of the state: in another unit scale the steps and the inverse of
    ``parameter_scale`` like it.  Raises ValueError for values out of order.

    ``maximum_step`` must be below the width of the narrowest tongue that matters: a multiplier that leaves
    the unit circle and returns within one step is found only where the last three spectra let it be expected.
    """

    range: tuple[float, float]
    direction: int = 1
    step: float = 0.02
    minimum_step: float = 1e-5
    maximum_step: float = 0.05
    max_points: int = 200
    target_iterations: int = 4
    minimum_cosine: float = 0.8
    parameter_scale: float = 1.0
    detection: DetectionOptions = field(default_factory=DetectionOptions)

    def __post_init__(self) -> None:
        validate_stepping(self, (self.range,), (self.parameter_scale,))


@dataclass(frozen=True)
class BranchStart:
    """A guess for the first cycle: ``state`` (N,), the parameter, and the period when it is unknown."""

    state: Vector
    parameter: float
    period: float = 0.0


@dataclass(frozen=True)
class BranchState(ResumableState):
    """Everything that determines the next step, as plain arrays and numbers.

    A branch restarted from a copy of it continues with the same bits.  ``state``, ``tangent_state``,
    ``start_state`` (N,), ``basis`` (N, k), ``multipliers`` (m,) complex; ``index`` counts the recorded points
    from zero; ``step`` is the next arclength step; ``steps`` are per period and leave ``step_error`` in the
    multipliers, half as many ``coarser_error``; ``previous_*`` is the point before, at the first one that
    itself, without multipliers; ``start_*`` is the first point, for closed curves.
    """

    index: int
    state: Vector
    period: float
    parameter: float
    tangent_state: Vector
    tangent_period: float
    tangent_parameter: float
    step: float
    arclength: float
    steps: int
    step_error: float
    coarser_error: float
    basis: Matrix
    multipliers: Complex
    previous_state: Vector
    previous_period: float
    previous_parameter: float
    previous_tangent_state: Vector
    previous_tangent_period: float
    previous_tangent_parameter: float
    previous_multipliers: Complex
    previous_arclength: float
    start_state: Vector
    start_period: float
    start_parameter: float

    @property
    def unknowns(self) -> Unknowns:
        return Unknowns(self.state, self.period, self.parameter)

    @property
    def tangent(self) -> Unknowns:
        return Unknowns(self.tangent_state, self.tangent_period, self.tangent_parameter)

    @property
    def previous(self) -> tuple[Unknowns, Unknowns]:
        """The point before, with its tangent."""
        return (
            Unknowns(self.previous_state, self.previous_period, self.previous_parameter),
            Unknowns(
                self.previous_tangent_state, self.previous_tangent_period, self.previous_tangent_parameter
            ),
        )

    @property
    def start(self) -> Unknowns:
        return Unknowns(self.start_state, self.start_period, self.start_parameter)


@dataclass(frozen=True)
class BranchPoint:
    """One accepted cycle: ``cycle`` holds state, period, orbit samples, multipliers and their residuals.

    ``residual_norms`` and ``update_norms``: history of the corrector; ``step_error``: estimated error of the
    multipliers by the time steps, ``coarser_error``: by half as many, NaN where unknown; ``unlocated``:
    events that were detected in the step to this point but could not be located even with the smallest step;
    ``unexplained``: the events of that smallest step, located or not, do not account for the change of its
    unstable count, so some are missing.
    """

    cycle: Cycle
    unstable: int
    residual_norms: tuple[float, ...]
    update_norms: tuple[float, ...]
    step_error: float = math.nan
    coarser_error: float = math.nan
    unlocated: tuple[EventKind, ...] = ()
    unexplained: bool = False

    @property
    def iterations(self) -> int:
        return len(self.update_norms)


BranchResult = Result[BranchState]
