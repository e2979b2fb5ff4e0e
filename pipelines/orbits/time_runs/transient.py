"""Time integration of the driven machine: changing speed, unbalance, switched excitation.

The steps are those of ``integration.esdirk``, with a fixed length in every piece of the drive. The unbalance
is the load; speed and ring displacement at the time of a stage are written into the parameter vector that f
reads. A run is a chain of blocks of steps. A block depends only on the state at its beginning and its place
in the run, so that a run resumed at the beginning of a block gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import types
from numpy.typing import NDArray

from pipelines.machine.film import DISPLACEMENT_RATE, SPEED
from pipelines.machine.kernels import (
    ENTRY,
    FACTORISE,
    RATES,
    SOLVE,
    as_factorise,
    as_rates,
    as_solve,
    assign,
    entry_point,
    kernel,
)
from pipelines.machine.unbalance import unbalance_factors
from pipelines.orbits.integration.equations import Equations
from pipelines.orbits.integration.esdirk import (
    Method,
    aligned,
    begin_step,
    interpolate,
    solve_stage,
    start_orbit,
    step_space_size,
    step_views,
)
from pipelines.orbits.steppers import ESDIRK5, ImplicitStepper
from pipelines.orbits.system import DynamicalSystem
from pipelines.orbits.time_runs.drive import BEGIN, LENGTH, Drive, set_drive

Array = NDArray[np.float64]

_FLOAT = types.float64
_INT = types.int64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_INTEGERS = types.int64[::1]

_TIME_ROUNDING = 1e-9  # of a step or a sample interval: times this close count as equal
_STAGES_PER_FACTORS = 3  # measured: a tenth faster than with one factorisation in a step
_FEWEST_STEPS = 32  # per turn; the cubic interpolation of the samples needs them too
_MOST_STEPS = 800  # per turn
_LONGEST_BLOCK = 20_000  # steps, a few seconds: a request to stop is obeyed after a block
_MARGIN = 1.1  # on the estimated number of steps, as for cycles


class Status(IntEnum):
    """How a block ended."""

    DONE = 0
    NEWTON = 1
    LIMIT = 2


# Entries of ``told``, the counts that ``integrate`` returns.
STEPS_DONE, SAMPLES_DONE, LIMIT_HIT = range(3)


@kernel()
def _watch(observed, limits, running):  # type: ignore[no-untyped-def]
    """Update the running minima; returns the index of the first value below its limit, or -1."""
    hit = -1
    for k in range(observed.shape[0]):
        running[k] = min(running[k], observed[k])
        if hit < 0 and not observed[k] >= limits[k]:  # true for NaN
            hit = k
    return hit


@kernel()
def _drive_to(t, piece, parameters, push, push_row, load):  # type: ignore[no-untyped-def]
    """Set parameters and load for the time ``t`` since the beginning of a piece; returns the rings' phase."""
    phase, angle, acceleration = set_drive(piece, t, parameters)
    along, across = unbalance_factors(angle, parameters[SPEED], acceleration)
    for k in range(push.shape[1]):
        load[push_row + k] = along * push[0, k] + across * push[1, k]
    return phase


@kernel(
    types.int64(
        ENTRY, ENTRY, ENTRY, ENTRY, _MATRIX, _VECTOR, _MATRIX,
        _VECTOR, _FLOAT, _INT, _INT, _VECTOR, _VECTOR, _INTEGERS, _VECTOR, _VECTOR, _VECTOR,
        _MATRIX, _INT, _INT, _VECTOR, _VECTOR, _FLOAT, _INT, _MATRIX, _MATRIX, _VECTOR, _INTEGERS,
    ),
)  # fmt: skip
def integrate(  # type: ignore[no-untyped-def]
    rates, factorise, solve, observe, a, c, predictor,
    piece, h, first, steps, parameters, constants, layout, work, factors, state,
    push, push_row, record_row, limits, running, interval, next_sample, samples, extremes, space, told,
):  # fmt: skip
    """Advance ``state`` (size,) in place by ``steps`` steps of length ``h`` from step ``first`` of a piece.

    ``push`` (2, k): A_c and A_s of the unbalance (see ``machine.unbalance``), which accelerate the k states
    from ``push_row``. ``observe`` has the signature RATES and is called at the ends of the steps; the minima
    of the values that it writes are kept in ``running``, and the block ends where a value falls below its
    entry of ``limits``. Sample j lies at the time j * interval of the run. ``samples`` (m, r) receives the r
    states from ``record_row`` at the samples from ``next_sample``, interpolated within the steps by cubic
    Hermite polynomials; ``extremes`` receives the running minima since the sample before. ``told`` receives
    the numbers of steps and samples done, and the index of the limit that was passed.

    Returns a value of ``Status``.
    """
    rates, observe = as_rates(rates), as_rates(observe)
    equations = Equations(parameters, constants, layout, work, -1, rates)
    method, stages = Method(a, predictor, as_factorise(factorise), as_solve(solve)), a.shape[0]
    own, observed = (
        step_views(space, state.shape[0], -1, stages),
        space[step_space_size(state.shape[0], stages) :],
    )
    told[STEPS_DONE], told[SAMPLES_DONE], told[LIMIT_HIT] = 0, 0, -1

    phase = _drive_to(first * h, piece, parameters, push, push_row, own.load)
    observe(phase, state, parameters, constants, layout, work, observed)
    told[LIMIT_HIT] = _watch(observed, limits, running)
    if told[LIMIT_HIT] >= 0:
        return 2
    start_orbit(equations, phase, state, own)

    sample = 0
    for step in range(first, first + steps):
        begin_step(own)
        for i in range(1, stages):
            phase = _drive_to((step + c[i]) * h, piece, parameters, push, push_row, own.load)
            factored = i % _STAGES_PER_FACTORS != 1
            if not solve_stage(equations, method, h, i, phase, state, factored, factors, state[:0], own):
                return 1
        observe(phase, own.stage, parameters, constants, layout, work, observed)
        told[LIMIT_HIT] = _watch(observed, limits, running)
        end = piece[BEGIN] + (step + 1 + _TIME_ROUNDING) * h
        last = step + 1 == first + steps
        while sample < samples.shape[0] and ((next_sample + sample) * interval <= end or last):
            x = ((next_sample + sample) * interval - piece[BEGIN]) / h - step
            interpolate(min(1.0, max(0.0, x)), h, state, own, record_row, samples[sample])
            assign(extremes[sample], running)
            assign(running, observed)
            sample += 1
        assign(state, own.stage)
        told[STEPS_DONE] += 1
        told[SAMPLES_DONE] = sample
        if told[LIMIT_HIT] >= 0:
            return 2
    return 0


@dataclass(frozen=True)
class DrivenSystem:
    """The system of a transient, its unbalance, and what is recorded.

    ``system`` reads speed, excitation frequency, displacement and its rate from its parameters (the order of
    ``machine.film``). ``push`` (2, k) holds A_c and A_s, the accelerations by the unbalance of the k states
    from ``push_row``. ``observe`` has the signature RATES and writes ``observed`` values whose minima are
    kept. ``recorded``: the states that are sampled.
    """

    system: DynamicalSystem
    push: Array
    push_row: int
    recorded: slice
    observe: Callable[..., None]
    observed: int


@dataclass(frozen=True)
class Plan:
    """Steps, blocks and samples of a run, all fixed beforehand.

    ``piece_steps`` (pieces,): number of equal steps of every piece; samples lie at the multiples of
    ``interval``; a block ends after ``block_steps`` steps, or with its piece.
    """

    drive: Drive
    piece_steps: NDArray[np.int64]
    interval: float
    block_steps: int

    @classmethod
    def of(cls, drive: Drive, step: float, interval: float, block_samples: int, most_blocks: int) -> Plan:
        """Steps no longer than ``step``; up to ``most_blocks`` blocks of about ``block_samples`` samples."""
        piece_steps = np.maximum(1, np.ceil(drive.pieces[:, LENGTH] / step - _TIME_ROUNDING)).astype(np.int64)
        wanted = min(_LONGEST_BLOCK, max(1, round(block_samples * interval / step)))
        spare = max(1, most_blocks - 2 * len(piece_steps))
        return cls(drive, piece_steps, interval, max(wanted, -(-int(piece_steps.sum()) // spare)))

    @property
    def steps(self) -> int:
        """Number of steps of the whole run."""
        return int(self.piece_steps.sum())

    @property
    def samples(self) -> int:
        """Number of samples of the whole run, with the one at time 0."""
        return math.floor(self.drive.duration / self.interval + _TIME_ROUNDING) + 1

    @property
    def blocks(self) -> int:
        """Number of blocks of the whole run."""
        return int(np.sum(-(-self.piece_steps // self.block_steps)))

    def place(self, step: int) -> tuple[int, int]:
        """The piece to which a step of the run belongs, and its number within the piece."""
        ends = np.cumsum(self.piece_steps)
        piece = int(np.searchsorted(ends, step, side="right"))
        return piece, step - int(ends[piece] - self.piece_steps[piece])

    def time(self, step: int) -> float:
        """Time at which a step of the run begins; the duration for the step after the last."""
        if step >= self.steps:
            return self.drive.duration
        piece, first = self.place(step)
        return float(self.drive.pieces[piece, BEGIN] + first * self.length(piece))

    def length(self, piece: int) -> float:
        """Length of the steps of a piece."""
        return float(self.drive.pieces[piece, LENGTH] / self.piece_steps[piece])

    def samples_until(self, step: int) -> int:
        """Number of samples that lie before or at the beginning of a step."""
        if step >= self.steps:
            return self.samples
        return min(self.samples, math.floor(self.time(step) / self.interval + _TIME_ROUNDING) + 1)


@dataclass(frozen=True)
class Position:
    """A point at which a run can be resumed.

    ``state`` (size,) at the beginning of ``step``; ``running`` (observed,): minima since the last sample;
    ``samples``: number of samples written so far.
    """

    state: Array
    running: Array
    step: int
    samples: int


@dataclass(frozen=True)
class Block:
    """Result of a block: ``samples`` (m, recorded) and ``extremes`` (m, observed), and where it ends.

    ``limit`` is the index of the observed value that passed its limit, or -1.
    """

    end: Position
    samples: Array
    extremes: Array
    status: Status
    limit: int


def starting_position(driven: DrivenSystem, drive: Drive, parameters: Array, state: Array) -> Position:
    """The beginning of a run, with the sample at time 0 counted as written."""
    extended, system = _extended(parameters), driven.system
    phase, _, _ = set_drive(drive.pieces[0], 0.0, extended)
    running = np.empty(driven.observed)
    work = aligned(system.work_size)
    driven.observe(phase, state, extended, system.constants, system.layout, work, running)
    return Position(np.array(state, dtype=float), running, 0, 1)


def advance(
    driven: DrivenSystem,
    plan: Plan,
    position: Position,
    parameters: Array,
    limits: Array,
    stepper: ImplicitStepper = ESDIRK5,
) -> Block:
    """Integrate the block that begins at ``position``.

    The block ends early where a value passes its limit, or at a step whose equations have no solution.
    ``parameters``: the four of a case; the drive replaces speed and displacement. ``limits`` (observed,).
    Raises ValueError after the last step, or for a system without ``shifted``.
    """
    system = driven.system
    if system.shifted is None or position.step >= plan.steps:
        raise ValueError("a block needs a system that solves its shifted equations, and steps that are left")
    piece, first = plan.place(position.step)
    steps = min(plan.block_steps - first % plan.block_steps, int(plan.piece_steps[piece]) - first)
    wanted = plan.samples_until(position.step + steps) - position.samples
    state, running = position.state.copy(), position.running.copy()
    samples = np.empty((wanted, driven.recorded.stop - driven.recorded.start))
    extremes, told = np.empty((wanted, driven.observed)), np.zeros(3, dtype=np.int64)
    space = aligned(step_space_size(system.size, stepper.stages) + driven.observed)
    try:
        with np.errstate(all="ignore"):
            status = integrate(
                entry_point(system.rates, RATES), entry_point(system.shifted.factorise, FACTORISE),
                entry_point(system.shifted.solve, SOLVE), entry_point(driven.observe, RATES),
                stepper.a, stepper.c, stepper.predictor,
                plan.drive.pieces[piece], plan.length(piece), first, steps, _extended(parameters),
                system.constants, system.layout, aligned(system.work_size),
                aligned(system.shifted.factors_size), state,
                driven.push, driven.push_row, driven.recorded.start, limits, running, plan.interval,
                position.samples, samples, extremes, space, told,
            )  # fmt: skip
    except np.linalg.LinAlgError:  # the factors of a step overflow; the steps before it are done
        status = Status.NEWTON
    done, written = int(told[STEPS_DONE]), int(told[SAMPLES_DONE])
    end = Position(state, running, position.step + done, position.samples + written)
    return Block(end, samples[:written], extremes[:written], Status(status), int(told[LIMIT_HIT]))


def _extended(parameters: Array) -> Array:
    """The case's parameters and a zero for the rate of the displacement."""
    extended = np.zeros(DISPLACEMENT_RATE + 1)
    extended[:DISPLACEMENT_RATE] = parameters[:DISPLACEMENT_RATE]
    return extended


@dataclass(frozen=True)
class StepChoice:
    """Steps per reference period, and the error of the state after one reference period."""

    steps: int
    error: float


def choose_steps(
    driven: DrivenSystem,
    drive: Drive,
    parameters: Array,
    state: Array,
    tolerance: float,
    given: int | None = None,
    turns: int = 1,
    stepper: ImplicitStepper = ESDIRK5,
) -> StepChoice:
    """Choose the steps per reference period so that the error of every state is below ``tolerance``.

    ``drive`` lasts one reference period, with ``turns`` turns of the rotor. With n and 2 n steps of order p
    the error of the latter is estimated by their difference over 2^p - 1. If ``given`` is a number of steps,
    only its error is estimated.
    """
    if given is not None:
        coarse, fine = (trial_end(driven, drive, parameters, state, n, stepper) for n in (given, 2 * given))
        return StepChoice(given, _difference(coarse, fine) / (1.0 - 2.0**-stepper.order))
    fewest, most = turns * _FEWEST_STEPS, turns * _MOST_STEPS
    steps, error = fewest // 2, math.inf
    coarse = trial_end(driven, drive, parameters, state, steps, stepper)
    while steps < most and error > tolerance:
        steps *= 2
        fine = trial_end(driven, drive, parameters, state, steps, stepper)
        error, coarse = _difference(coarse, fine) / (2.0**stepper.order - 1.0), fine
    if not math.isfinite(error):
        return StepChoice(most, error)
    needed = math.ceil(_MARGIN * steps * (error / tolerance) ** (1.0 / stepper.order))
    chosen = min(max(fewest, needed), most)
    return StepChoice(chosen, error * (steps / chosen) ** stepper.order)


def trial_end(
    driven: DrivenSystem,
    drive: Drive,
    parameters: Array,
    state: Array,
    steps: int,
    stepper: ImplicitStepper = ESDIRK5,
) -> Array | None:
    """The state at the end of a drive in about ``steps`` steps, without limits.

    None if the equations of a step have no solution.
    """
    plan = Plan.of(drive, drive.duration / steps, 2.0 * drive.duration, 1, 1 << 30)
    position = starting_position(driven, drive, parameters, state)
    free = np.full(driven.observed, -np.inf)
    while position.step < plan.steps:
        block = advance(driven, plan, position, parameters, free, stepper)
        if block.status is not Status.DONE:
            return None
        position = block.end
    return position.state


def _difference(first: Array | None, second: Array | None) -> float:
    return math.inf if first is None or second is None else float(np.max(np.abs(first - second)))
