"""The map over one period, phi: s(0) -> s(T), with its derivatives applied to blocks of columns.

Stroboscopic formulation: T = 2 pi turns / omega is known and the phase is that of the forcing.
Autonomous formulation: T is unknown; a forced system is extended by the oscillator of Eq. 17.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.lanes import LANES
from pipelines.orbits.integration.esdirk import aligned
from pipelines.orbits.integration.implicit import propagate_columns, propagate_implicit, workspace_sizes
from pipelines.orbits.integration.propagation import propagate, workspace_size
from pipelines.orbits.steppers import RK4, ImplicitStepper, Stepper
from pipelines.orbits.system import DynamicalSystem, Matrix, Vector, size_of

_KEPT_BYTES = 256 * 1024**2  # of factors that are kept for further passes along the same orbit
_POWER_PHASES = 8  # phases at which the spectral radius is sampled
_FIRST_POWER_STEPS = 60
_POWER_STEPS = 15
_POWER_WINDOW = 5  # growth factors in the geometric mean: a complex pair makes single ones oscillate
_RADIUS_MARGIN = 1.15  # the power iteration approaches the radius from below


class Formulation(StrEnum):
    """Whether the period is that of the forcing, or an unknown (Eq. 17-19)."""

    STROBOSCOPIC = "stroboscopic"
    AUTONOMOUS = "autonomous"


@dataclass(frozen=True)
class Inhomogeneity:
    """The forcing of an inhomogeneous column: d/dparameter and the growth of T with the column's variable."""

    parameter: int = -1
    period_rate: float = 0.0


@dataclass(frozen=True)
class PhaseReference:
    """A cycle that fixes the phase of its neighbours: F = integral of <s - s_ref, g> over tau1 is zero.

    ``gradient`` (samples, size) is g, ds_ref/dtau1 divided by its root mean square over the orbit, so that F
    is the way along the orbit in the unit of the state; ``offset`` is the functional of the reference itself.
    """

    gradient: Matrix
    offset: float

    @classmethod
    def of(cls, orbit: Matrix, slope: Matrix) -> PhaseReference:
        """The reference of an orbit and a multiple of its slope ds/dtau1, both (samples, size)."""
        gradient = slope / math.sqrt(float(np.mean(np.sum(slope * slope, axis=1))) or 1.0)
        return cls(gradient, float(np.mean(np.sum(gradient * orbit, axis=1))))


@dataclass(frozen=True)
class PeriodImage:
    """What one pass over the period returns.

    ``state`` (size,), ``columns`` (size, m): M applied to the block; ``inhomogeneous`` (size, k): derivatives
    of the map; ``orbit`` (samples, size) at tau1 = k/samples; ``phase``, ``phase_columns`` (m,),
    ``phase_inhomogeneous`` (k,): the phase condition and its derivatives, zero without a reference;
    ``finite`` is False when the orbit diverged.
    """

    state: Vector
    columns: Matrix
    inhomogeneous: Matrix
    orbit: Matrix
    phase: float
    phase_columns: Vector
    phase_inhomogeneous: Vector
    finite: bool


@dataclass(frozen=True)
class _Run:
    """What a loop advances in place, and what it reads of the columns; shapes as in
    ``propagation.propagate``.
    """

    state: Vector
    block: Matrix
    orbit: Matrix
    functional: Vector
    gradient: Matrix
    column_parameter: NDArray[np.int64]
    column_period: Vector


@dataclass
class _KeptOrbit:
    """The last orbit along which columns were propagated, with the factors of every stage (stages, factors).

    Picard sweeps send block after block through the same orbit: with these a block costs its solves only.
    """

    place: tuple[Vector, Vector, float, int] | None = None
    factors: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    end: Vector = field(default_factory=lambda: np.zeros(0))
    samples: Matrix = field(default_factory=lambda: np.zeros((0, 0)))

    def is_at(self, state: Vector, parameters: Vector, period: float, steps: int) -> bool:
        """Whether it is the orbit from there, exactly."""
        if self.place is None or self.place[2:] != (period, steps):
            return False
        return np.array_equal(self.place[0], state) and np.array_equal(self.place[1], parameters)

    def space(self, rows: int, size: int) -> Matrix:
        """Where the factors of another orbit go; what was there is lost."""
        self.place = None
        if self.factors.shape != (rows, size):
            self.factors = np.empty((rows, size))
        return self.factors


@dataclass(frozen=True)
class PeriodMap:
    """One period of a system with one stepper.

    ``turns``: forcing periods in the cycle (2 follows the branch born at a period doubling); ``samples``:
    equally spaced phases at which the orbit is returned; ``minimum_steps``: accuracy floor,
    ``steps_per_period``: fixed number that replaces the choice by stability.  Raises ValueError for counts
    below one or a stroboscopic map of an autonomous system.
    """

    system: DynamicalSystem
    stepper: Stepper | ImplicitStepper = RK4
    formulation: Formulation = Formulation.STROBOSCOPIC
    turns: int = 1
    samples: int = 64
    minimum_steps: int = 128
    steps_per_period: int | None = None
    _kept: _KeptOrbit = field(default_factory=_KeptOrbit, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.formulation is Formulation.STROBOSCOPIC and self.system.forcing is None:
            raise ValueError("a stroboscopic map needs a forcing frequency; use the autonomous formulation")
        if isinstance(self.stepper, ImplicitStepper) and self.system.shifted is None:
            raise ValueError(
                f"stepper {self.stepper.name!r} needs a system that solves its shifted equations; "
                "use an explicit one"
            )
        for name in ("turns", "samples", "minimum_steps", "steps_per_period"):
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
        """A state of the system at phase zero as a state of this map: with (sin 0, cos 0) appended if
        extended.
        """
        return np.concatenate([state, [0.0, 1.0]]) if self.extended else np.array(state, dtype=float)

    def period(self, parameters: Vector) -> float:
        """T = 2 pi turns / omega of the forcing; ValueError for an autonomous system."""
        if self.system.forcing is None:
            raise ValueError("the period of an autonomous system does not follow from its parameters")
        return 2.0 * math.pi * self.turns / float(parameters[self.system.forcing])

    def parameter_column(self, parameter: int, parameters: Vector) -> Inhomogeneity:
        """The column d phi/d parameter, with T'(omega) = -T/omega for the forcing frequency of a known
        period.
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
        once: bool = False,
    ) -> PeriodImage:
        """phi(state), M @ columns, the inhomogeneous columns and the phase condition in one pass.

        With an implicit stepper and no oscillator, further columns alone along the orbit of the last pass
        cost a fraction of it; ``once`` tells that none will follow, so that another orbit stays the kept one.
        With an explicit one ``steps`` must be a multiple of ``samples`` (``steps_for`` returns such numbers);
        ValueError otherwise.
        """
        size, given = self.size, 0 if columns is None else columns.shape[1]
        width = given + len(inhomogeneous)
        block = np.zeros((size, width))
        if columns is not None:
            block[:, :given] = columns
        column_parameter = np.full(width, -1, dtype=np.int64)
        column_period = np.zeros(width)
        for j, term in enumerate(inhomogeneous):
            column_parameter[given + j] = term.parameter
            column_period[given + j] = term.period_rate

        run = _Run(
            np.array(state, dtype=float), block, np.full((self.samples, size), np.nan), np.zeros(1 + width),
            np.zeros((0, size)) if reference is None else reference.gradient, column_parameter, column_period,
        )  # fmt: skip
        only_columns = given > 0 and not inhomogeneous
        with np.errstate(all="ignore"):
            failed = self._advance(run, np.array(parameters, dtype=float), period, steps, only_columns, once)
        block = run.block
        return PeriodImage(
            state=run.state,
            columns=np.ascontiguousarray(block[:, :given]),
            inhomogeneous=np.ascontiguousarray(block[:, given:]),
            orbit=run.orbit,
            phase=float(run.functional[0]) - (0.0 if reference is None else reference.offset),
            phase_columns=run.functional[1 : 1 + given].copy(),
            phase_inhomogeneous=run.functional[1 + given :].copy(),
            finite=failed < 0 and bool(np.all(np.isfinite(block)) and np.all(np.isfinite(run.state))),
        )

    def _advance(
        self, run: _Run, parameters: Vector, period: float, steps: int, only_columns: bool, once: bool
    ) -> int:
        """Advance a run in place; -1, or the step that failed."""
        if not isinstance(self.stepper, ImplicitStepper):
            return self._explicit(run, parameters, period, steps)
        if only_columns and self._kept.is_at(run.state, parameters, period, steps):
            return self._along_kept(run, parameters, period, steps)
        return self._implicit(run, parameters, period, steps, once)

    def _explicit(self, run: _Run, parameters: Vector, period: float, steps: int) -> int:
        """Propagate with an explicit stepper."""
        if steps % self.samples:
            raise ValueError(f"steps is {steps}; it must be a multiple of the {self.samples} samples")
        system, stepper = self.system, self.stepper
        assert isinstance(stepper, Stepper)
        size, columns = run.block.shape
        space = np.zeros(workspace_size(size, columns, stepper.stages, len(parameters)))
        loop = propagate if system.compiled else propagate.py_func
        return int(loop(
            system.rates, system.tangent, stepper.a, stepper.b, stepper.c,
            steps, 2.0 * math.pi * self.turns, period, system.forcing if self.extended else -1,
            parameters, system.constants, system.layout, np.zeros(system.work_size), run.state, run.block,
            run.column_parameter, run.column_period, run.orbit, run.gradient, run.functional, space,
        ))  # fmt: skip

    def _implicit(self, run: _Run, parameters: Vector, period: float, steps: int, once: bool) -> int:
        """Propagate with a diagonally implicit stepper, which wants the columns in chunks of LANES."""
        system, stepper = self.system, self.stepper
        assert isinstance(stepper, ImplicitStepper)
        assert system.shifted is not None
        lines, functional, start = _chunked(run.block), _functional(run.block), run.state.copy()
        orbit_space, column_space = map(aligned, workspace_sizes(start.size, len(lines), stepper.stages))
        rows, size = steps * (stepper.stages - 1), system.shifted.factors_size
        keeps = len(lines) > 0 and not (once or self.extended) and 8 * rows * size <= _KEPT_BYTES
        failed = propagate_implicit(
            system.rates, system.tangent, system.shifted.factorise, system.shifted.solve,
            stepper.a, stepper.c, stepper.predictor,
            steps, 2.0 * math.pi * self.turns, period, system.forcing if self.extended else -1,
            parameters, system.constants, system.layout, aligned(system.work_size),
            aligned(size), run.state, lines,
            run.column_parameter, run.column_period, run.orbit, run.gradient, functional,
            orbit_space, column_space, self._kept.space(rows, size) if keeps else np.zeros((0, size)),
        )  # fmt: skip
        if keeps and failed < 0:
            self._kept.end, self._kept.samples = run.state.copy(), run.orbit.copy()
            self._kept.place = start, parameters.copy(), period, steps
        _take(run, lines, functional)
        return int(failed)

    def _along_kept(self, run: _Run, parameters: Vector, period: float, steps: int) -> int:
        """Propagate columns along the orbit that was kept."""
        system, stepper, kept = self.system, self.stepper, self._kept
        assert isinstance(stepper, ImplicitStepper)
        assert system.shifted is not None
        lines, functional = _chunked(run.block), _functional(run.block)
        sizes = workspace_sizes(run.state.size, len(lines), stepper.stages)
        orbit_space, column_space = map(aligned, sizes)
        run.orbit[:] = kept.samples
        propagate_columns(
            system.rates, system.tangent, system.shifted.factorise, system.shifted.solve,
            stepper.a, steps, period, parameters, system.constants, system.layout,
            aligned(system.work_size), kept.factors, run.state, lines, run.orbit, run.gradient, functional,
            orbit_space, column_space,
        )  # fmt: skip
        run.state[:] = kept.end
        _take(run, lines, functional)
        return -1

    def phase_reference(self, orbit: Matrix, parameters: Vector, period: float) -> PhaseReference:
        """The phase condition that an orbit (samples, size) imposes on its neighbours."""
        slope = np.empty_like(orbit)
        for k, state in enumerate(orbit):
            slope[k] = period * self._rates(k, state, parameters)
        return PhaseReference.of(orbit, slope)

    def scale(self, orbit: Matrix) -> float:
        """The size of the system's states on an orbit (samples, size), to which errors are relative."""
        return size_of(orbit[:, : self.system.size])

    def residual(self, state: Vector, image: PeriodImage) -> float:
        """Largest entry of phi(s) - s, or the phase, relative to the largest entry on the orbit.

        The oscillator of Eq. 17 has no unit: its entries are measured by themselves.
        """
        mismatch, size = np.abs(image.state - state), self.system.size
        scale = self.scale(image.orbit)
        closure = max(float(np.max(mismatch[:size])), abs(image.phase)) / scale
        return max(closure, float(np.max(mismatch[size:], initial=0.0)))

    def _rates(self, sample: int, state: Vector, parameters: Vector) -> Vector:
        phase = 2.0 * math.pi * self.turns * sample / self.samples
        if not self.extended:
            return self.system.rates_at(phase, state, parameters)
        s1, s2 = state[-2:]
        omega, radius = parameters[self.system.forcing], s1 * s1 + s2 * s2
        rates = self.system.rates_at(math.atan2(s1, s2), np.ascontiguousarray(state[:-2]), parameters)
        return np.concatenate([rates, [s1 + omega * s2 - s1 * radius, -omega * s1 + s2 - s2 * radius]])

    def spectral_radius(self, orbit: Matrix, parameters: Vector) -> float:
        """Largest modulus of the eigenvalues of J along the first samples of an orbit, by power iteration.

        The start vector is fixed, so that the same orbit always gives the same number.
        """
        size, radius = self.system.size, 0.0
        golden = (math.sqrt(5.0) - 1.0) / 2.0
        vector: Vector = np.mod(np.arange(1, size + 1) * golden, 1.0) - 0.4
        stride = max(1, self.samples // _POWER_PHASES)
        for k in range(0, len(orbit), stride):
            state = np.ascontiguousarray(orbit[k, :size])
            phase = 2.0 * math.pi * self.turns * k / self.samples
            if self.extended:
                phase = math.atan2(orbit[k, -2], orbit[k, -1])
            growth = []
            for _ in range(_FIRST_POWER_STEPS if k == 0 else _POWER_STEPS):
                direction = np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)
                vector = self.system.tangent_at(phase, state, direction[:, None], parameters)[:, 0]
                growth.append(float(np.linalg.norm(vector)))
                if growth[-1] == 0.0 or not math.isfinite(growth[-1]):
                    return radius
            radius = max(radius, math.exp(sum(map(math.log, growth[-_POWER_WINDOW:])) / _POWER_WINDOW))
        return radius

    def steps_for(self, spectral_radius: float, period: float) -> int:
        """Steps per period that keep radius T / steps inside the real stability interval of an explicit
        stepper; a multiple of the samples.
        """
        steps = self.steps_per_period
        if steps is None:
            assert isinstance(self.stepper, Stepper)
            stable = _RADIUS_MARGIN * spectral_radius * period / self.stepper.real_stability_interval
            steps = max(self.minimum_steps * self.turns, math.ceil(stable))
        return self.rounded_steps(steps)

    def rounded_steps(self, steps: float) -> int:
        """At least that many steps, which an explicit stepper can take."""
        if isinstance(self.stepper, ImplicitStepper):
            return math.ceil(steps)
        return self.samples * math.ceil(steps / self.samples)


def _chunked(block: Matrix) -> Matrix:
    """Columns (size, m) in chunks of LANES, (chunks, size * LANES), the last one filled up with zeros."""
    size, width = block.shape
    chunks = -(-width // LANES)
    padded = np.zeros((size, chunks * LANES))
    padded[:, :width] = block
    lines = aligned(chunks * size * LANES).reshape(chunks, size * LANES)
    lines[:] = padded.reshape(size, chunks, LANES).swapaxes(0, 1).reshape(chunks, size * LANES)
    return lines


def _functional(block: Matrix) -> Vector:
    """Room for the functional of the orbit and of every column in chunks."""
    return np.zeros(1 + -(-block.shape[1] // LANES) * LANES)


def _take(run: _Run, lines: Matrix, functional: Vector) -> None:
    """The columns of chunks, and the functional, back into a run."""
    chunks, (size, width) = len(lines), run.block.shape
    run.block[:] = lines.reshape(chunks, size, LANES).swapaxes(0, 1).reshape(size, chunks * LANES)[:, :width]
    run.functional[:] = functional[: 1 + width]
