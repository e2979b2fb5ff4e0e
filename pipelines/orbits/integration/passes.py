"""One pass over a period: the arrays of the compiled loops, and their calls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.kernels import FACTORISE, RATES, SOLVE, TANGENT, entry_point
from pipelines.machine.lanes import LANES
from pipelines.orbits.integration.esdirk import aligned
from pipelines.orbits.integration.implicit import propagate_columns, propagate_implicit, workspace_sizes
from pipelines.orbits.integration.propagation import propagate, workspace_size
from pipelines.orbits.steppers import ImplicitStepper, Stepper
from pipelines.orbits.system import DynamicalSystem, Matrix, Vector

KEPT_BYTES = 256 * 1024**2  # largest size of what is kept of one orbit


@dataclass(frozen=True)
class Pass:
    """Input of a compiled loop, and the arrays that it advances in place.

    ``turn``: change of the forcing's phase [rad]; ``oscillator``: index of the frequency of Eq. 17, or -1;
    ``block``: the columns; ``orbit`` (samples, size); ``missed`` (stages, size): errors of the guesses of an
    implicit stepper's stages, or no rows; all other shapes as in ``propagation.propagate``.
    """

    parameters: Vector
    period: float
    steps: int
    turn: float
    oscillator: int
    state: Vector
    block: Matrix
    column_parameter: NDArray[np.int64]
    column_period: Vector
    orbit: Matrix
    gradient: Matrix
    functional: Vector
    missed: Matrix


def explicit_pass(system: DynamicalSystem, stepper: Stepper, run: Pass) -> bool:
    """Integrate orbit and columns with an explicit stepper; False if a step failed."""
    size, columns = run.block.shape
    space = np.zeros(workspace_size(size, columns, stepper.stages, len(run.parameters)))
    loop = propagate if system.compiled else propagate.py_func
    failed = loop(
        entry_point(system.rates, RATES), entry_point(system.tangent, TANGENT),
        stepper.a, stepper.b, stepper.c, run.steps, run.turn, run.period, run.oscillator,
        run.parameters, system.constants, system.layout, np.zeros(system.work_size), run.state, run.block,
        run.column_parameter, run.column_period, run.orbit, run.gradient, run.functional, space,
    )  # fmt: skip
    return bool(failed < 0)


def implicit_pass(
    system: DynamicalSystem, stepper: ImplicitStepper, run: Pass, keep_factors: bool
) -> tuple[bool, Matrix | None]:
    """Integrate orbit and columns with a diagonally implicit stepper; False if a step failed.

    With ``keep_factors`` it also returns the factors (stages, doubles) with which the columns were solved,
    for ``columns_pass``; None if they take too much memory, or with the oscillator, whose rows they lack.
    """
    assert system.shifted is not None
    lines, functional = _chunked(run.block), _functional(run.block)
    orbit_space, column_space = map(aligned, workspace_sizes(run.state.size, len(lines), stepper.stages))
    rows, size = run.steps * (stepper.stages - 1), system.shifted.factors_size
    keeps = keep_factors and len(lines) > 0 and run.oscillator < 0 and 8 * rows * size <= KEPT_BYTES
    kept = np.empty((rows if keeps else 0, size))
    failed = propagate_implicit(
        *_entries(system), stepper.a, stepper.c, stepper.predictor,
        run.steps, run.turn, run.period, run.oscillator,
        run.parameters, system.constants, system.layout, aligned(system.work_size),
        aligned(size), run.state, lines,
        run.column_parameter, run.column_period, run.orbit, run.gradient, functional,
        orbit_space, column_space, run.missed, kept,
    )  # fmt: skip
    _take(run, lines, functional)
    return bool(failed < 0), kept if keeps and failed < 0 else None


def columns_pass(system: DynamicalSystem, stepper: ImplicitStepper, run: Pass, factors: Matrix) -> None:
    """Integrate columns alone along the orbit of a pass that kept its ``factors``.

    ``run.orbit`` holds the samples of that orbit.
    """
    assert system.shifted is not None
    lines, functional = _chunked(run.block), _functional(run.block)
    orbit_space, column_space = map(aligned, workspace_sizes(run.state.size, len(lines), stepper.stages))
    rates, tangent, _, solve = _entries(system)
    propagate_columns(
        rates, tangent, solve, stepper.a, run.steps, run.period, run.parameters,
        system.constants, system.layout, aligned(system.work_size), factors, run.state, lines,
        run.orbit, run.gradient, functional, orbit_space, column_space,
    )  # fmt: skip
    _take(run, lines, functional)


def _entries(system: DynamicalSystem) -> tuple[Any, Any, Any, Any]:
    """Entry points of rates, tangent, factorise and solve."""
    assert system.shifted is not None
    return (
        entry_point(system.rates, RATES),
        entry_point(system.tangent, TANGENT),
        entry_point(system.shifted.factorise, FACTORISE),
        entry_point(system.shifted.solve, SOLVE),
    )


def _chunked(block: Matrix) -> Matrix:
    """Columns (size, m) in chunks of LANES, shape (chunks, size * LANES), the last padded with zeros."""
    size, width = block.shape
    chunks = -(-width // LANES)
    padded = np.zeros((size, chunks * LANES))
    padded[:, :width] = block
    lines = aligned(chunks * size * LANES).reshape(chunks, size * LANES)
    lines[:] = padded.reshape(size, chunks, LANES).swapaxes(0, 1).reshape(chunks, size * LANES)
    return lines


def _functional(block: Matrix) -> Vector:
    """Zeros for the functional of the orbit and of every column of the chunks."""
    return np.zeros(1 + -(-block.shape[1] // LANES) * LANES)


def _take(run: Pass, lines: Matrix, functional: Vector) -> None:
    """Copy the columns of the chunks, and the functional, back into a pass."""
    chunks, (size, width) = len(lines), run.block.shape
    run.block[:] = lines.reshape(chunks, size, LANES).swapaxes(0, 1).reshape(size, chunks * LANES)[:, :width]
    run.functional[:] = functional[: 1 + width]
