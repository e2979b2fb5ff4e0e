"""The map over one period, phi: s(0) -> s(T), with its derivatives applied to blocks of columns.

The derivative with the state is the monodromy matrix M; tau1 = tau / T.

Stroboscopic formulation: T = 2 pi period_multiple / omega is known and the phase is that of the forcing.
Autonomous formulation: T is unknown; a forced system is extended by the oscillator of Eq. 17.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from pipelines.orbits.integration.passes import KEPT_BYTES, Pass, columns_pass, explicit_pass, implicit_pass
from pipelines.orbits.steppers import RK4, ImplicitStepper, Stepper
from pipelines.orbits.system import DynamicalSystem, Matrix, Vector, size_of


class Formulation(StrEnum):
    """Whether the period is that of the forcing or an unknown (Eq. 17-19)."""

    STROBOSCOPIC = "stroboscopic"
    AUTONOMOUS = "autonomous"


@dataclass(frozen=True)
class Inhomogeneity:
    """A column of derivatives of the map with a variable lambda: a parameter, the period, or both.

    ``parameter``: index of the parameter that is lambda, -1 for none; ``period_rate``: dT/dlambda.
    """

    parameter: int = -1
    period_rate: float = 0.0


@dataclass(frozen=True)
class PhaseReference:
    """A cycle that fixes the phase of its neighbours: F = integral of <s - s_ref, g> over tau1 is zero.

    ``gradient`` (samples, size) is g, ds_ref/dtau1 divided by its root mean square over the orbit, so that F
    is the shift along the orbit in the unit of the state; ``offset`` is the integral of <s_ref, g>.
    """

    gradient: Matrix
    offset: float

    @classmethod
    def of(cls, orbit: Matrix, slope: Matrix) -> PhaseReference:
        """The reference of an orbit and a multiple of its slope ds/dtau1, both (samples, size)."""
        gradient = slope / math.sqrt(float(np.mean(np.sum(slope * slope, axis=1))) or 1.0)
        return cls(gradient, float(np.mean(np.sum(gradient * orbit, axis=1))))


class OrbitStart(NamedTuple):
    """All that determines an orbit: ``state`` (size,), ``parameters`` (p,), period and number of steps."""

    state: Vector
    parameters: Vector
    period: float
    steps: int


@dataclass(frozen=True)
class PeriodImage:
    """What one pass over the period returns.

    ``state`` (size,): phi(state) at the end; ``columns`` (size, m): M applied to the block;
    ``inhomogeneous`` (size, k): derivatives of the map; ``orbit`` (samples, size) at tau1 = k/samples;
    ``phase``, ``phase_columns`` (m,), ``phase_inhomogeneous`` (k,): the phase condition and its derivatives,
    zero without a reference; ``finite`` is False when the orbit diverged.  Of an implicit
    stepper, on request and up to 256 MiB each: ``missed`` (stages, size), by how much the guesses of the
    stages missed them, and their ``factors``; store an image ``without_factors``.
    """

    start: OrbitStart
    state: Vector
    columns: Matrix
    inhomogeneous: Matrix
    orbit: Matrix
    phase: float
    phase_columns: Vector
    phase_inhomogeneous: Vector
    finite: bool
    missed: Matrix | None = None
    factors: Matrix | None = None

    def without_factors(self) -> PeriodImage:
        """The same image without the factors, which only further columns need."""
        return replace(self, factors=None)


@dataclass(frozen=True)
class PeriodMap:
    """One period of a system with one stepper.

    ``period_multiple``: forcing periods in the cycle (2 on the branch born at a period doubling);
    ``samples``: equally spaced phases at which the orbit is returned.  ``orbits.time_steps`` reads
    ``minimum_steps``, the fewest steps of an explicit stepper in a forcing period, and ``steps_per_period``,
    a fixed number of steps or None.  Raises ValueError for counts below one, a stroboscopic map of an
    autonomous system, or an implicit stepper with a system that cannot solve its equations.
    """

    system: DynamicalSystem
    stepper: Stepper | ImplicitStepper = RK4
    formulation: Formulation = Formulation.STROBOSCOPIC
    period_multiple: int = 1
    samples: int = 64
    minimum_steps: int = 128
    steps_per_period: int | None = None

    def __post_init__(self) -> None:
        if self.formulation is Formulation.STROBOSCOPIC and self.system.forcing is None:
            raise ValueError("a stroboscopic map needs a forcing frequency; use the autonomous formulation")
        if isinstance(self.stepper, ImplicitStepper) and self.system.shifted is None:
            raise ValueError(
                f"stepper {self.stepper.name!r} needs a system that solves its shifted equations; "
                "use an explicit one"
            )
        for name in ("period_multiple", "samples", "minimum_steps", "steps_per_period"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} is {value}; at least 1 is needed")

    @property
    def autonomous(self) -> bool:
        """True when the period is unknown and the phase condition closes the problem."""
        return self.formulation is Formulation.AUTONOMOUS

    @property
    def extended(self) -> bool:
        """True when the oscillator of Eq. 17 is appended to the state."""
        return self.autonomous and self.system.forcing is not None

    @property
    def size(self) -> int:
        return self.system.size + (2 if self.extended else 0)

    def extend(self, state: Vector) -> Vector:
        """A state of the system at phase zero as a state of this map.

        An extended map appends the oscillator's state (sin 0, cos 0).
        """
        return np.concatenate([state, [0.0, 1.0]]) if self.extended else np.array(state, dtype=float)

    def period(self, parameters: Vector) -> float:
        """T = 2 pi period_multiple / omega of the forcing; ValueError for an autonomous system."""
        if self.system.forcing is None:
            raise ValueError("the period of an autonomous system does not follow from its parameters")
        return 2.0 * math.pi * self.period_multiple / float(parameters[self.system.forcing])

    def parameter_column(self, parameter: int, parameters: Vector) -> Inhomogeneity:
        """The column d phi/d parameter.

        If the period is that of the forcing, its frequency omega also changes T: dT/domega = -T/omega.
        """
        if self.autonomous or parameter != self.system.forcing:
            return Inhomogeneity(parameter)
        return Inhomogeneity(parameter, -self.period(parameters) / float(parameters[parameter]))

    def evaluate(
        self,
        state: Vector,
        parameters: Vector,
        period: float,
        steps: int,
        columns: Matrix | None = None,
        inhomogeneous: tuple[Inhomogeneity, ...] = (),
        reference: PhaseReference | None = None,
        keep_factors: bool = False,
        near: PeriodImage | None = None,
    ) -> PeriodImage:
        """phi(state), M @ columns, the inhomogeneous columns and the phase condition in one pass.

        ``keep_factors``: for further columns along the orbit, see ``with_columns``, and for passes beside it.
        ``near``: a pass of a nearby orbit, from which the stages of an implicit stepper have better guesses.
        Raises ValueError if the stepper is explicit and ``steps`` is not a multiple of ``samples`` (see
        ``rounded_steps``).
        """
        if not isinstance(self.stepper, ImplicitStepper) and steps % self.samples:
            raise ValueError(f"steps is {steps}; it must be a multiple of the {self.samples} samples")
        start = OrbitStart(np.array(state, dtype=float), np.array(parameters, dtype=float), period, steps)
        columns = np.zeros((self.size, 0)) if columns is None else columns
        missed = self._guess_errors(start, keep_factors, near)
        run, factors = self._pass(start, columns, inhomogeneous, reference, missed), None
        with np.errstate(all="ignore"):
            if isinstance(self.stepper, ImplicitStepper):
                finished, factors = implicit_pass(self.system, self.stepper, run, keep_factors)
            else:
                finished = explicit_pass(self.system, self.stepper, run)
        given = columns.shape[1]
        return PeriodImage(
            start=start,
            state=run.state,
            columns=np.ascontiguousarray(run.block[:, :given]),
            inhomogeneous=np.ascontiguousarray(run.block[:, given:]),
            orbit=run.orbit,
            phase=float(run.functional[0]) - (0.0 if reference is None else reference.offset),
            phase_columns=run.functional[1 : 1 + given].copy(),
            phase_inhomogeneous=run.functional[1 + given :].copy(),
            finite=finished and bool(np.all(np.isfinite(run.block)) and np.all(np.isfinite(run.state))),
            missed=run.missed,
            factors=factors,
        )

    def with_columns(
        self, image: PeriodImage, columns: Matrix, reference: PhaseReference | None = None
    ) -> PeriodImage:
        """The image of the same orbit with M @ ``columns`` and their derivatives of the phase condition.

        If the image has factors, this costs a fraction of a pass and gives the same bits.  Otherwise it is a
        pass, and the new image has factors if the stepper is implicit and the map is not extended.
        """
        if image.factors is None:
            passed = self.evaluate(*image.start, columns, (), reference, keep_factors=True)
            finite, factors = passed.finite, passed.factors
            columns, phase_columns = passed.columns, passed.phase_columns
        else:
            assert isinstance(self.stepper, ImplicitStepper)
            missed = np.zeros((0, self.size))
            run, factors = self._pass(image.start, columns, (), reference, missed), image.factors
            run.orbit[:] = image.orbit
            with np.errstate(all="ignore"):
                columns_pass(self.system, self.stepper, run, factors)
            finite = image.finite and bool(np.all(np.isfinite(run.block)))
            columns, phase_columns = run.block, run.functional[1:]
        return replace(image, columns=columns, phase_columns=phase_columns, finite=finite, factors=factors)

    def _guess_errors(self, start: OrbitStart, keep: bool, near: PeriodImage | None) -> Matrix:
        """Those of a pass ``near`` this one, else zeros to ``keep`` this one's in, or no rows."""
        if not isinstance(self.stepper, ImplicitStepper):
            return np.zeros((0, self.size))
        shape = start.steps * (self.stepper.stages - 1), self.size
        if near is not None and near.finite and near.missed is not None and near.missed.shape == shape:
            return near.missed.copy()
        return np.zeros(shape if keep and 8 * shape[0] * shape[1] <= KEPT_BYTES else (0, self.size))

    def _pass(
        self,
        start: OrbitStart,
        columns: Matrix,
        inhomogeneous: tuple[Inhomogeneity, ...],
        reference: PhaseReference | None,
        missed: Matrix,
    ) -> Pass:
        """The arrays of a pass at its start."""
        (size, given), forcing = columns.shape, self.system.forcing
        width = given + len(inhomogeneous)
        block = np.zeros((size, width))
        block[:, :given] = columns
        column_parameter, column_period = np.full(width, -1, dtype=np.int64), np.zeros(width)
        for j, term in enumerate(inhomogeneous, given):
            column_parameter[j], column_period[j] = term.parameter, term.period_rate
        return Pass(
            parameters=start.parameters,
            period=start.period,
            steps=start.steps,
            turn=2.0 * math.pi * self.period_multiple,
            oscillator=-1 if forcing is None or not self.autonomous else forcing,
            state=start.state.copy(),
            block=block,
            column_parameter=column_parameter,
            column_period=column_period,
            orbit=np.full((self.samples, size), np.nan),
            gradient=np.zeros((0, size)) if reference is None else reference.gradient,
            functional=np.zeros(1 + width),
            missed=missed,
        )

    def phase_reference(self, orbit: Matrix, parameters: Vector, period: float) -> PhaseReference:
        """The phase condition that an orbit (samples, size) sets for neighbouring orbits."""
        slope = np.empty_like(orbit)
        for k, state in enumerate(orbit):
            slope[k] = period * self._rates(k, state, parameters)
        return PhaseReference.of(orbit, slope)

    def scale(self, orbit: Matrix) -> float:
        """The largest state of the system on an orbit (samples, size): errors are relative to it."""
        return size_of(orbit[:, : self.system.size])

    def residual(self, state: Vector, image: PeriodImage) -> float:
        """Largest entry of phi(s) - s and of the phase condition, relative to ``scale``.

        The entries of the oscillator of Eq. 17, which are of order one, count as they are.
        """
        mismatch, size = np.abs(image.state - state), self.system.size
        scale = self.scale(image.orbit)
        closure = max(float(np.max(mismatch[:size])), abs(image.phase)) / scale
        return max(closure, float(np.max(mismatch[size:], initial=0.0)))

    def phase_at(self, sample: int, state: Vector) -> float:
        """The phase of the forcing [rad] at a sample of an orbit with its ``state`` (size,)."""
        if self.extended:
            return math.atan2(state[-2], state[-1])
        return 2.0 * math.pi * self.period_multiple * sample / self.samples

    def _rates(self, sample: int, state: Vector, parameters: Vector) -> Vector:
        own = np.ascontiguousarray(state[: self.system.size])
        rates = self.system.rates_at(self.phase_at(sample, state), own, parameters)
        if not self.extended:
            return rates
        s1, s2 = state[-2:]
        omega, radius = parameters[self.system.forcing], s1 * s1 + s2 * s2
        return np.concatenate([rates, [s1 + omega * s2 - s1 * radius, -omega * s1 + s2 - s2 * radius]])

    def rounded_steps(self, steps: float) -> int:
        """At least that many steps, and a multiple of the samples for an explicit stepper."""
        if isinstance(self.stepper, ImplicitStepper):
            return math.ceil(steps)
        return self.samples * math.ceil(steps / self.samples)
