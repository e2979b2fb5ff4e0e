"""One period with an explicit Runge-Kutta method: orbit, tangent columns and parameter columns in one pass.

With tau1 = tau / T in [0, 1] the orbit and a column y of the block obey

    ds/dtau1 = T f(phase, s, lambda)
    dy/dtau1 = T (J y + df/dlambda) + (dT/dlambda) f

where the last two terms are present only in inhomogeneous columns.  The same Runge-Kutta step is applied to
both, so the columns are the exact derivative of the discrete map.  df/dlambda is a central difference of f.

Eq. 17 of the paper turns the forced system into an autonomous one with two more states,

    ds1/dtau = s1 + W s2 - s1 (s1^2 + s2^2),   ds2/dtau = -W s1 + s2 - s2 (s1^2 + s2^2)

whose cycle is (sin W tau, cos W tau); then the phase is atan2(s1, s2) and the columns gain df/dphase
dphase/ds.
"""

from __future__ import annotations

import numpy as np
from numba import types

from pipelines.machine.kernels import RATES_POINTER, TANGENT_POINTER, kernel

_FLOAT = types.float64
_INT = types.int64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_INTEGERS = types.int64[::1]

# Balance truncation h^2 against rounding eps/h in a central difference.
PARAMETER_DIFFERENCE = 6e-6
# The same for the five-point formula, h^4 against eps/h, which the phase derivative uses.
PHASE_DIFFERENCE = 1e-3
_CHUNK = 1024  # values; keeps the running sum of a stage in the first-level cache


@kernel(types.void(_VECTOR, _VECTOR, _FLOAT, _VECTOR, _INT, _MATRIX))
def combine(out, base, factor, weights, count, slopes):  # type: ignore[no-untyped-def]
    """out = base + factor sum_{j < count} weights_j slopes_j."""
    for first in range(0, out.shape[0], _CHUNK):
        last = min(first + _CHUNK, out.shape[0])
        # slices indexed from zero: the compiler vectorises these loops only when no index can be negative
        part, origin = out[first:last], base[first:last]
        for i in range(part.shape[0]):
            part[i] = origin[i]
        for j in range(count):
            if weights[j] != 0.0:
                scaled = factor * weights[j]
                slope = slopes[j, first:last]
                for i in range(part.shape[0]):
                    part[i] += scaled * slope[i]


@kernel(types.void(_VECTOR, _FLOAT, _VECTOR))
def oscillator_rates(state, frequency, out):  # type: ignore[no-untyped-def]
    """Eq. 17 in the last two entries."""
    n = state.shape[0] - 2
    s1, s2 = state[n], state[n + 1]
    radius = s1 * s1 + s2 * s2
    out[n] = s1 + frequency * s2 - s1 * radius
    out[n + 1] = -frequency * s1 + s2 - s2 * radius


@kernel(types.void(_VECTOR, _MATRIX, _FLOAT, _VECTOR, _MATRIX))
def oscillator_tangent(state, block, frequency, phase_slope, out):  # type: ignore[no-untyped-def]
    """Add df/dphase dphase to the rows of the machine and write the two rows of Eq. 17."""
    n = state.shape[0] - 2
    s1, s2 = state[n], state[n + 1]
    radius = s1 * s1 + s2 * s2
    for j in range(block.shape[1]):
        d1, d2 = block[n, j], block[n + 1, j]
        phase = (s2 * d1 - s1 * d2) / radius
        for i in range(n):
            out[i, j] += phase_slope[i] * phase
        out[n, j] = (1.0 - radius - 2.0 * s1 * s1) * d1 + (frequency - 2.0 * s1 * s2) * d2
        out[n + 1, j] = (-frequency - 2.0 * s1 * s2) * d1 + (1.0 - radius - 2.0 * s2 * s2) * d2


@kernel(types.void(_MATRIX, _INT, _FLOAT, _VECTOR))
def _add_to_column(block, column, factor, vector):  # type: ignore[no-untyped-def]
    for i in range(vector.shape[0]):
        block[i, column] += factor * vector[i]


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


@kernel(
    types.int64(
        RATES_POINTER, TANGENT_POINTER, _MATRIX, _VECTOR, _VECTOR, _INT, _FLOAT, _FLOAT, _INT,
        _VECTOR, _VECTOR, _INTEGERS, _VECTOR, _VECTOR, _MATRIX, _INTEGERS, _VECTOR, _MATRIX, _MATRIX,
        _VECTOR, _VECTOR,
    ),
)  # fmt: skip
def propagate(  # type: ignore[no-untyped-def]
    rates, tangent, a, b, c, steps, turn, period, oscillator,
    parameters, constants, layout, work, state, block, column_parameter, column_period, samples, gradient,
    functional, workspace,
):  # fmt: skip
    """Advance ``state`` (size,) and ``block`` (size, columns) in place over one period; -1, or the step that
    failed.

    ``turn``: increase of the phase over the period.  ``oscillator``: index of the forcing frequency when the
    last two states are those of Eq. 17, else -1.  Column j has the inhomogeneous terms of parameter
    ``column_parameter[j]`` (-1: none) and of a period that grows with ``column_period[j]`` per unit.
    ``samples`` (K, size) receives the orbit at tau1 = k / K; ``steps`` must be a multiple of K.  With
    ``gradient`` (K, size), ``functional`` (1 + columns) receives sum_k <gradient_k, .>/K of orbit and
    columns; with shape (0, size) it is left at zero.
    """
    n, m, stages, base = state.shape[0], block.shape[1], b.shape[0], state.shape[0]
    if oscillator >= 0:
        base = n - 2
    stride = steps // samples.shape[0]
    h = period / steps

    end = stages * n
    slopes = workspace[:end].reshape((stages, n))
    stage = workspace[end : end + n]
    upper = workspace[end + n : end + 2 * n]
    lower = workspace[end + 2 * n : end + 3 * n]
    phase_slope = workspace[end + 3 * n : end + 4 * n]
    shifted = workspace[end + 4 * n : end + 4 * n + parameters.shape[0]]
    end += 4 * n + parameters.shape[0]
    block_slopes = workspace[end : end + stages * n * m].reshape((stages, n * m))
    end += stages * n * m
    block_stage = workspace[end : end + n * m].reshape((n, m))
    shifted[:] = parameters
    functional[:] = 0.0

    for step in range(steps):
        if step % stride == 0:
            k = step // stride
            if not _all_finite(state):
                return step
            samples[k] = state
            if gradient.shape[0] > 0:
                _accumulate_phase(state, block, gradient[k], 1.0 / gradient.shape[0], functional)
        for i in range(stages):
            combine(stage, state, h, a[i], i, slopes)
            slope = slopes[i]
            phase = turn * (step + c[i]) / steps
            if oscillator >= 0:
                phase = np.arctan2(stage[base], stage[base + 1])
                oscillator_rates(stage, parameters[oscillator], slope)
            rates(phase, stage[:base], parameters, constants, layout, work, slope[:base])
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
                phase_slope[:base] = 0.0
                for shift, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                    rates(
                        phase + shift * PHASE_DIFFERENCE,
                        stage[:base],
                        parameters,
                        constants,
                        layout,
                        work,
                        upper[:base],
                    )
                    for row in range(base):
                        phase_slope[row] += weight * upper[row] / (12.0 * PHASE_DIFFERENCE)
                oscillator_tangent(stage, block_stage, parameters[oscillator], phase_slope, block_slope)
            for j in range(m):
                p = column_parameter[j]
                if p >= 0:
                    delta = PARAMETER_DIFFERENCE * max(1.0, abs(parameters[p]))
                    shifted[p] = parameters[p] + delta
                    rates(phase, stage[:base], shifted, constants, layout, work, upper[:base])
                    shifted[p] = parameters[p] - delta
                    rates(phase, stage[:base], shifted, constants, layout, work, lower[:base])
                    if oscillator >= 0:
                        oscillator_rates(stage, parameters[oscillator] + delta * (p == oscillator), upper)
                        oscillator_rates(stage, parameters[oscillator] - delta * (p == oscillator), lower)
                    shifted[p] = parameters[p]
                    _add_to_column(block_slope, j, 0.5 / delta, upper)
                    _add_to_column(block_slope, j, -0.5 / delta, lower)
                if column_period[j] != 0.0:
                    _add_to_column(block_slope, j, column_period[j] / period, slope)
        combine(state, state, h, b, stages, slopes)
        if m > 0:
            combine(block.reshape(n * m), block.reshape(n * m), h, b, stages, block_slopes)
    return -1 if _all_finite(state) else steps
