"""A branch of tori: its options, its start, its points, the state that resumes it, its result."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pipelines.bifurcations.continuation import Result, ResumableState, validate_stepping
from pipelines.bifurcations.tori.fourier import Array
from pipelines.bifurcations.tori.invariant_curve import Torus
from pipelines.bifurcations.tori.problem import TorusUnknowns
from pipelines.bifurcations.tori.slow_bases import SlowBases
from pipelines.bifurcations.tori.stability import TorusSpectrum
from pipelines.orbits.system import Matrix, Vector


class TorusStop(Enum):
    """Why a branch of tori ended, with advice."""

    RANGE = "the end of the parameter range is reached: widen the range to continue"
    MAXIMUM_POINTS = "the maximum number of points is reached: raise max_points to continue"
    MINIMUM_STEP = "the step fell below its minimum: lower minimum_step or allow more iterations"
    ROUGH = (
        "the Fourier series of the curve no longer falls below its tolerance: the torus locks or breaks up; "
        "allow more angles, or start again beyond the resonance"
    )
    COLLAPSED = "the torus shrank onto a cycle: follow the cycles through the Neimark-Sacker point"
    LIMIT = "a limit set by the caller is reached"
    INTERRUPTED = "stopped on request after a complete point: run again to resume"
    START_FAILED = "the first torus did not converge: start at another parameter or from a better guess"

    @property
    def advice(self) -> str:
        return self.value


@dataclass(frozen=True)
class TorusOptions:
    """Options of the continuation of a branch of tori.

    ``range``: interval of the parameter.
    ``direction``: initial sense of the parameter, 1 up, -1 down.
    ``step``, ``minimum_step``, ``maximum_step``: first, shortest and longest step, in arclength.
    ``max_points``: largest number of points.
    ``target_iterations``: Newton iterations at which the step length is kept.
    ``minimum_cosine``: smallest cosine between neighbouring tangents.
    ``parameter_scale``: change of the parameter that counts as one.
    ``events``: whether bifurcations are looked for.
    ``event_tolerance``: of the places of bifurcations, in arclength.

    Raises ValueError for values out of order.
    """

    range: tuple[float, float]
    direction: int = 1
    step: float = 0.02
    minimum_step: float = 1e-4
    maximum_step: float = 0.05
    max_points: int = 200
    target_iterations: int = 4
    minimum_cosine: float = 0.8
    parameter_scale: float = 1.0
    events: bool = True
    event_tolerance: float = 1e-6

    def __post_init__(self) -> None:
        validate_stepping(self, (self.range,), (self.parameter_scale,))


@dataclass(frozen=True)
class TorusStart:
    """A guess for the first torus.

    ``states`` (M, N) at equally spaced angles, M odd, the slow ``bases`` there, the parameter, and the
    rotation when it is unknown.
    """

    states: Matrix
    bases: SlowBases
    parameter: float
    rotation: float = 0.0


@dataclass(frozen=True)
class TorusState(ResumableState):
    """Everything that determines the next step, as plain arrays and numbers.

    A branch restarted from a copy of it continues with the same bits.  ``states``, ``tangent_states`` (M, N),
    ``bases`` (M, N, k) with ``leading`` smooth columns; ``moduli`` of the multipliers, of which ``unstable``
    are outside the unit circle, -1 where that is not decided; ``index`` counts the recorded points from zero;
    ``step`` is the next arclength step.
    """

    index: int
    states: Matrix
    rotation: float
    parameter: float
    tangent_states: Matrix
    tangent_rotation: float
    tangent_parameter: float
    step: float
    arclength: float
    bases: Array
    leading: int
    moduli: Vector
    unstable: int

    @property
    def slow_bases(self) -> SlowBases:
        return SlowBases(self.bases, self.leading)

    @property
    def unknowns(self) -> TorusUnknowns:
        return TorusUnknowns(self.states, self.rotation, self.parameter)

    @property
    def tangent(self) -> TorusUnknowns:
        return TorusUnknowns(self.tangent_states, self.tangent_rotation, self.tangent_parameter)


@dataclass(frozen=True)
class TorusPoint:
    """One accepted torus: ``torus`` holds curve, rotation, parameter and the estimated Fourier error.

    ``residual_norms`` and ``update_norms``: history of the corrector, over all numbers of angles it used.
    """

    torus: Torus
    spectrum: TorusSpectrum
    residual_norms: tuple[float, ...]
    update_norms: tuple[float, ...]

    @property
    def iterations(self) -> int:
        return len(self.update_norms)

    @property
    def stable(self) -> bool:
        return self.spectrum.unstable == 0


TorusResult = Result[TorusState]
