"""One period with an explicit Runge-Kutta method: orbit, tangent columns and parameter columns in one pass.

With tau1 = tau / T in [0, 1] the orbit and a column y of the block obey

    ds/dtau1 = T f(phase, s, lambda)
    dy/dtau1 = T (J y + df/dlambda) + (dT/dlambda) f

where the last two terms are present only in inhomogeneous columns, with lambda a parameter.  The same
Runge-Kutta step is applied to both, so the columns are the exact derivative of the discrete map.  df/dlambda
is a central difference of f.  See ``equations`` for the oscillator of Eq. 17.
"""

from __future__ import annotations

import numpy as np
from numba import types

from pipelines.machine.kernels import as_rates, as_tangent, assign, kernel
from pipelines.orbits.integration.equations import (
    Equations,
    combine,
    inhomogeneous_terms,
    oscillator_tangent,
    phase_at,
    phase_slope,
    rates_at,
    system_size,
)

_FLOAT = types.float64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]


@kernel(types.void(_VECTOR, _MATRIX, _VECTOR, _FLOAT, _VECTOR))
def _accumulate_phase(state, block, gradient, weight, functional):  # type: ignore[no-untyped-def]
    """functional += weight [<gradient, s>, <gradient, y_1>, <gradient, y_2>, ...]."""
    for i in range(state.shape[0]):
        scaled = weight * gradient[i]
        functional[0] += scaled * state[i]
        for j in range(block.shape[1]):
            functional[1 + j] += scaled * block[i, j]


@kernel(types.boolean(_VECTOR))
def _all_finite(state):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(state.shape[0]):
        total += abs(state[i])
    return np.isfinite(total)


def workspace_size(size: int, columns: int, stages: int, parameters: int) -> int:
    """Length of the scratch vector that ``propagate`` needs."""
    return (stages + 1) * size * (1 + columns) + 3 * size + parameters


@kernel()  # compiled at its first call: the default stepper is implicit
def propagate(  # type: ignore[no-untyped-def]
    rates, tangent, a, b, c, steps, turn, period, oscillator,
    parameters, constants, layout, work, state, block, column_parameter, column_period, samples, gradient,
    functional, workspace,
):  # fmt: skip
    """Advance ``state`` (size,) and ``block`` (size, columns) in place over one period.

    ``turn``: increase of the phase over the period.  ``oscillator``: index of the forcing frequency if the
    last two states are those of Eq. 17, else -1.  Column j has the inhomogeneous terms of the parameter
    ``column_parameter[j]`` (-1: none) and of dT/dlambda = ``column_period[j]``.  ``samples`` (K, size)
    receives the orbit at tau1 = k / K; ``steps`` must be a multiple of K.  With ``gradient`` (K, size),
    ``functional`` (1 + columns) receives sum_k <gradient_k, .>/K of orbit and columns; with shape (0, size)
    it is left at zero.

    Returns -1, or the step that failed.
    """
    rates, tangent = as_rates(rates), as_tangent(tangent)
    n, m, stages, base = state.shape[0], block.shape[1], b.shape[0], system_size(state, oscillator)
    stride = steps // samples.shape[0]
    h = period / steps

    end = (stages + 4) * n
    vectors = workspace[:end].reshape((stages + 4, n))
    slopes, stage, trial, term, by_phase = (
        vectors[:stages], vectors[stages], vectors[stages + 1], vectors[stages + 2], vectors[stages + 3]
    )  # fmt: skip
    shifted = workspace[end : end + parameters.shape[0]]
    end += parameters.shape[0]
    block_slopes = workspace[end : end + stages * n * m].reshape((stages, n * m))
    end += stages * n * m
    block_stage = workspace[end : end + n * m].reshape((n, m))
    assign(shifted, parameters)  # central differences with a parameter change this copy
    equations = Equations(shifted, constants, layout, work, oscillator, rates)
    functional[:] = 0.0

    for step in range(steps):
        if step % stride == 0:
            k = step // stride
            if not _all_finite(state):
                return step
            assign(samples[k], state)
            if gradient.shape[0] > 0:
                _accumulate_phase(state, block, gradient[k], 1.0 / gradient.shape[0], functional)
        for i in range(stages):
            combine(stage, state, h, a[i], i, slopes)
            phase = phase_at(stage, oscillator, turn * (step + c[i]) / steps)
            rates_at(equations, phase, stage, slopes[i])
            if m == 0:
                continue
            combine(block_stage.reshape(n * m), block.reshape(n * m), h, a[i], i, block_slopes)
            block_slope = block_slopes[i].reshape((n, m))
            tangent(
                phase,
                stage[:base],
                block_stage[:base],
                parameters,
                constants,
                layout,
                work,
                block_slope[:base],
            )
            if oscillator >= 0:
                phase_slope(equations, phase, stage, trial, by_phase)
                oscillator_tangent(stage, block_stage, parameters[oscillator], by_phase, block_slope)
            for j in range(m):
                if column_parameter[j] >= 0 or column_period[j] != 0.0:
                    growth = column_period[j] / period
                    inhomogeneous_terms(
                        equations, phase, stage, column_parameter[j], growth, slopes[i], trial, term
                    )
                    for row in range(n):
                        block_slope[row, j] += term[row]
        combine(state, state, h, b, stages, slopes)
        if m > 0:
            combine(block.reshape(n * m), block.reshape(n * m), h, b, stages, block_slopes)
    return -1 if _all_finite(state) else steps
