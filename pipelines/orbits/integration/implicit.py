"""One period with a diagonally implicit Runge-Kutta method: orbit, tangent columns and parameter columns.

See ``esdirk`` for a step and ``propagation`` for the meaning of the inhomogeneous columns.
"""

from __future__ import annotations

import numpy as np
from numba import types

from pipelines.machine.kernels import ENTRY, as_factorise, as_rates, as_solve, as_tangent, assign, kernel
from pipelines.orbits.integration.equations import Equations, phase_at
from pipelines.orbits.integration.esdirk import (
    Method,
    accumulate,
    begin_columns,
    begin_step,
    columns_space_size,
    columns_views,
    end_columns,
    interpolate,
    linearise_stage,
    right_side,
    solve_columns,
    solve_stage,
    start_columns,
    start_orbit,
    step_space_size,
    step_views,
)

_FLOAT = types.float64
_INT = types.int64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_INTEGERS = types.int64[::1]


def workspace_sizes(size: int, chunks: int, stages: int) -> tuple[int, int]:
    """Lengths of the scratch vectors of ``propagate_implicit``: of the orbit and of the columns."""
    return step_space_size(size, stages), columns_space_size(size, chunks, stages)


@kernel()
def _samples_within(step, steps, count):  # type: ignore[no-untyped-def]
    """The first of ``count`` samples that lies in a step, and the first one after the step."""
    return (step * count + steps - 1) // steps, ((step + 1) * count + steps - 1) // steps


@kernel(
    types.int64(
        ENTRY, ENTRY, ENTRY, ENTRY, _MATRIX, _VECTOR, _MATRIX,
        _INT, _FLOAT, _FLOAT, _INT, _VECTOR, _VECTOR, _INTEGERS, _VECTOR, _VECTOR, _VECTOR, _MATRIX,
        _INTEGERS, _VECTOR, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR, _MATRIX, _MATRIX,
    ),
)  # fmt: skip
def propagate_implicit(  # type: ignore[no-untyped-def]
    rates, tangent, factorise, solve, a, c, predictor,
    steps, turn, period, oscillator, parameters, constants, layout, work, factors, state, lanes,
    column_parameter, column_period, samples, gradient, functional, orbit_space, column_space, missed, kept,
):  # fmt: skip
    """Advance ``state`` (size,) and ``lanes`` (chunks, size * LANES) in place over one period.

    ``predictor`` (stages, 2 stages): weights of the slopes of the last step and of this one that
    extrapolate to each stage.  ``samples`` (K, size) receives the orbit at tau1 = k / K, interpolated
    within the steps by cubic Hermite polynomials; the functional (1 + columns) is summed over the samples.
    ``column_parameter`` and ``column_period`` may be shorter than the columns.  ``missed`` (steps
    (stages - 1), size): errors of the guesses of all stages on a nearby orbit, or zeros; it receives those of
    this one, unless it has no rows.  ``kept`` (steps (stages - 1), len(factors)) receives the factors with
    which the columns were solved, unless it has no rows.  Everything else as in ``propagation.propagate``.

    Returns -1, or the step that failed.
    """
    stages, chunks, h = a.shape[0], lanes.shape[0], period / steps
    rates, tangent = as_rates(rates), as_tangent(tangent)
    equations = Equations(parameters, constants, layout, work, oscillator, rates)
    method = Method(a, predictor, as_factorise(factorise), as_solve(solve))
    growth = (column_parameter, column_period, period)
    own = step_views(orbit_space, state.shape[0], oscillator, stages)
    columns = columns_views(lanes, column_space, stages)
    functional[:] = 0.0

    phase = phase_at(state, oscillator, 0.0)
    start_orbit(equations, phase, state, own)
    if chunks > 0:
        start_columns(equations, tangent, growth, phase, state, own, columns)
    factored = False
    for step in range(steps):
        begin_step(own)
        begin_columns(columns)
        for i in range(1, stages):
            phase = turn * (step + c[i]) / steps
            factored = factored and (chunks > 0 or i > 1)
            row = step * (stages - 1) + i - 1
            errors = missed[row] if missed.shape[0] > 0 else state[:0]
            if not solve_stage(equations, method, h, i, phase, state, factored, factors, errors, own):
                return step
            factored = True
            if chunks > 0:
                linearise_stage(equations, method, h, i, growth, phase, factors, own, columns)
                if kept.shape[0] > 0:
                    assign(kept[row], factors)
        first, behind = _samples_within(step, steps, samples.shape[0])
        for k in range(first, behind):
            x = k * steps / samples.shape[0] - step
            interpolate(x, h, state, own, 0, samples[k])
            if gradient.shape[0] > 0:
                accumulate(x, h, gradient[k], 1.0 / samples.shape[0], samples[k], columns, functional)
        assign(state, own.stage)
        end_columns(columns)
    return -1


@kernel(
    types.void(
        ENTRY, ENTRY, ENTRY, _MATRIX, _INT, _FLOAT, _VECTOR,
        _VECTOR, _INTEGERS, _VECTOR, _MATRIX, _VECTOR, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR,
    ),
)  # fmt: skip
def propagate_columns(  # type: ignore[no-untyped-def]
    rates, tangent, solve, a, steps, period, parameters, constants, layout, work, kept, state,
    lanes, samples, gradient, functional, orbit_space, column_space,
):  # fmt: skip
    """Advance ``lanes`` over one period along the orbit from ``state``, with the factors ``kept``.

    ``kept`` and ``samples`` come from ``propagate_implicit``, without the oscillator.  The columns cost one
    solve per stage and chunk, and have the same bits as there.
    """
    stages, chunks, h = a.shape[0], lanes.shape[0], period / steps
    rates, tangent, solve = as_rates(rates), as_tangent(tangent), as_solve(solve)
    equations = Equations(parameters, constants, layout, work, -1, rates)
    growth = (np.zeros(0, dtype=np.int64), np.zeros(0), period)
    own = step_views(orbit_space, state.shape[0], -1, stages)
    columns = columns_views(lanes, column_space, stages)
    functional[:] = 0.0

    start_columns(equations, tangent, growth, 0.0, state, own, columns)
    for step in range(steps):
        begin_columns(columns)
        for i in range(1, stages):
            factors = kept[step * (stages - 1) + i - 1]
            for chunk in range(chunks):
                right_side(columns, chunk, a, h, i)
                solve_columns(equations, solve, factors, columns, chunk, state.shape[0], h * a[i, i], i)
        if gradient.shape[0] > 0:
            first, behind = _samples_within(step, steps, samples.shape[0])
            for k in range(first, behind):
                x, share = k * steps / samples.shape[0] - step, 1.0 / samples.shape[0]
                accumulate(x, h, gradient[k], share, samples[k], columns, functional)
        end_columns(columns)
