"""One period with a diagonally implicit Runge-Kutta method: orbit, tangent columns and parameter columns.

With a singly diagonal tableau (a_ii = gamma, the first stage explicit, the last one the new point) stage i of
the orbit and of a column y solve

    S_i = R_i + h gamma f(phase_i, S_i),                 R_i = s + h sum_{j<i} a_ij K_j
    (I - h gamma J(phase_i, S_i)) Y_i = R'_i + h gamma (df/dlambda + (dT/dlambda) f / T)

the first by Newton's method with the factors of the stage before, the second with factors at S_i itself, so
that the columns are the exact derivative of the discrete map.  A column costs one solve per stage.  See
``propagation`` for the meaning of the inhomogeneous columns and of Eq. 17.

Columns are kept in chunks of LANES: ``lines`` (chunks, size * LANES) holds the rows of a chunk one after
another.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from pipelines.machine.kernels import FACTORISE_POINTER, RATES_POINTER, SOLVE_POINTER, TANGENT_POINTER, kernel
from pipelines.machine.lanes import LANES
from pipelines.orbits.integration.propagation import (
    PARAMETER_DIFFERENCE,
    PHASE_DIFFERENCE,
    combine,
    oscillator_rates,
    oscillator_tangent,
)

_FLOAT = types.float64
_INT = types.int64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_INTEGERS = types.int64[::1]

_STAGE_ERROR = 1e-13  # of a solved stage, relative to max(1, largest entry): far below every tolerance above
_SLOW = 0.3  # contraction of Newton's method above which the matrix is factored anew
_NEWTON_ITERATIONS = 40

# The compiled functions below hand on what they know of the system as one tuple,
# system = (parameters, constants, layout, work, oscillator, rates, tangent, factorise, solve);
# ``oscillator`` as in ``propagation.propagate``.


@kernel()
def _base_size(state, oscillator):  # type: ignore[no-untyped-def]
    """States of the system itself."""
    return state.shape[0] - 2 if oscillator >= 0 else state.shape[0]


@kernel()
def _phase_at(state, oscillator, forced):  # type: ignore[no-untyped-def]
    """The phase of the forcing: that of the oscillator of Eq. 17 if there is one."""
    n = state.shape[0]
    return np.arctan2(state[n - 2], state[n - 1]) if oscillator >= 0 else forced


@kernel()
def _rates_at(system, phase, state, out):  # type: ignore[no-untyped-def]
    """Rates of the system and of the oscillator."""
    parameters, constants, layout, work, oscillator, rates, _, _, _ = system
    n = _base_size(state, oscillator)
    rates(phase, state[:n], parameters, constants, layout, work, out[:n])
    if oscillator >= 0:
        oscillator_rates(state, parameters[oscillator], out)


@kernel()
def _phase_slope(system, phase, state, trial, slope):  # type: ignore[no-untyped-def]
    """df/dphase by the five-point formula; zero without an oscillator."""
    parameters, constants, layout, work, oscillator, rates, _, _, _ = system
    n = _base_size(state, oscillator)
    slope[:] = 0.0
    if oscillator >= 0:
        for shift, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
            at = phase + shift * PHASE_DIFFERENCE
            rates(at, state[:n], parameters, constants, layout, work, trial[:n])
            for i in range(n):
                slope[i] += weight * trial[i] / (12.0 * PHASE_DIFFERENCE)


@kernel()
def _add_inhomogeneous(system, phase, state, weight, growth, slope, trial, lines):  # type: ignore[no-untyped-def]
    """lines += weight (df/dlambda + (dT/dlambda) f / T) in the columns that ask for it.

    ``growth`` = (parameter of each column or -1, dT/dlambda of each, T); ``slope`` is f.
    """
    parameters = system[0]
    column_parameter, column_period, period = growth
    n = state.shape[0]
    for j in range(column_parameter.shape[0]):
        block, c = lines[j // LANES], j % LANES
        p = column_parameter[j]
        if column_period[j] != 0.0:
            for i in range(n):
                block[i * LANES + c] += weight * column_period[j] / period * slope[i]
        if p < 0:
            continue
        value = parameters[p]
        delta = PARAMETER_DIFFERENCE * max(1.0, abs(value))
        for sign in (1.0, -1.0):
            parameters[p] = value + sign * delta
            _rates_at(system, phase, state, trial)
            for i in range(n):
                block[i * LANES + c] += sign * weight * 0.5 / delta * trial[i]
        parameters[p] = value


@kernel(types.void(_VECTOR, _FLOAT, _FLOAT, _VECTOR))
def _oscillator_stage(right, weight, frequency, stage):  # type: ignore[no-untyped-def]
    """The last two entries of a stage: Newton's method on Eq. 17, S = R + weight g(S), from the entries of
    ``stage``.
    """
    n = stage.shape[0] - 2
    for _ in range(_NEWTON_ITERATIONS):
        s1, s2 = stage[n], stage[n + 1]
        radius = s1 * s1 + s2 * s2
        r1 = right[n] + weight * (s1 + frequency * s2 - s1 * radius) - s1
        r2 = right[n + 1] + weight * (-frequency * s1 + s2 - s2 * radius) - s2
        a11 = 1.0 - weight * (1.0 - radius - 2.0 * s1 * s1)
        a22 = 1.0 - weight * (1.0 - radius - 2.0 * s2 * s2)
        a12, a21 = -weight * (frequency - 2.0 * s1 * s2), weight * (frequency + 2.0 * s1 * s2)
        determinant = a11 * a22 - a12 * a21
        stage[n] += (a22 * r1 - a12 * r2) / determinant
        stage[n + 1] += (a11 * r2 - a21 * r1) / determinant
        if max(abs(r1), abs(r2)) <= _STAGE_ERROR:
            return


@kernel(types.void(_VECTOR, _FLOAT, _FLOAT, _VECTOR, _VECTOR))
def _oscillator_lines(stage, weight, frequency, phase_slope, lines):  # type: ignore[no-untyped-def]
    """Solve the two rows of Eq. 17 and put weight df/dphase dphase on the right-hand side of the others."""
    n = stage.shape[0] - 2
    s1, s2 = stage[n], stage[n + 1]
    radius = s1 * s1 + s2 * s2
    a11 = 1.0 - weight * (1.0 - radius - 2.0 * s1 * s1)
    a22 = 1.0 - weight * (1.0 - radius - 2.0 * s2 * s2)
    a12, a21 = -weight * (frequency - 2.0 * s1 * s2), weight * (frequency + 2.0 * s1 * s2)
    determinant = a11 * a22 - a12 * a21
    for c in range(LANES):
        r1, r2 = lines[n * LANES + c], lines[(n + 1) * LANES + c]
        d1, d2 = (a22 * r1 - a12 * r2) / determinant, (a11 * r2 - a21 * r1) / determinant
        lines[n * LANES + c], lines[(n + 1) * LANES + c] = d1, d2
        phase = weight * (s2 * d1 - s1 * d2) / radius
        for i in range(n):
            lines[i * LANES + c] += phase * phase_slope[i]


@kernel()
def _solve_stage(system, phase, weight, factored, right, factors, stage, slope, line):  # type: ignore[no-untyped-def]
    """Newton's method for S = R + weight f(phase, S) from the guess in ``stage``; False if it fails.

    The factors are those of an earlier stage if ``factored``; they are renewed when they contract slowly.
    """
    parameters, constants, layout, work, _, rates, _, factorise, solve = system
    n, last, since = stage.shape[0], np.inf, 0
    for _ in range(_NEWTON_ITERATIONS):
        if not factored:
            factorise(phase, stage, parameters, weight, constants, layout, work, factors)
            factored, since = True, 0
        rates(phase, stage, parameters, constants, layout, work, slope)
        for i in range(n):
            line[i * LANES] = right[i] + weight * slope[i] - stage[i]
        solve(factors, constants, layout, work, line)
        update, size, total = 0.0, 1.0, 0.0
        for i in range(n):
            stage[i] += line[i * LANES]
            update = max(update, abs(line[i * LANES]))
            size = max(size, abs(stage[i]))
            total += abs(stage[i])  # a maximum passes over what is no number
        if not np.isfinite(total):
            return False
        contraction = update / last if since > 0 else 1.0
        if update * min(1.0, contraction / (1.0 - min(contraction, 0.5))) <= _STAGE_ERROR * size:
            return True
        factored = since == 0 or contraction < _SLOW
        last, since = update, since + 1
    return False


@kernel()
def _solve_columns(
    system, tableau, growth, i, phase, factors, lines, line_slopes, stages, stage, slope, spaces
):  # type: ignore[no-untyped-def]
    """Stage ``i`` of every column: ``stages`` receives Y_i, ``line_slopes`` its slope (Y_i - R'_i) /
    weight.
    """
    parameters, constants, layout, work, oscillator, _, _, factorise, solve = system
    a, h = tableau
    weight, n = h * a[i, i], _base_size(stage, oscillator)
    trial, phase_slope = spaces
    factorise(phase, stage[:n], parameters, weight, constants, layout, work, factors)
    for chunk in range(lines.shape[0]):
        combine(line_slopes[chunk, i], lines[chunk], h, a[i], i, line_slopes[chunk])
        stages[chunk] = line_slopes[chunk, i]
    _add_inhomogeneous(system, phase, stage, weight, growth, slope, trial, stages)
    _phase_slope(system, phase, stage, trial, phase_slope)
    for chunk in range(lines.shape[0]):
        own = stages[chunk]
        if oscillator >= 0:
            _oscillator_lines(stage, weight, parameters[oscillator], phase_slope, own)
        solve(factors, constants, layout, work, own[: n * LANES])
        _slopes_of(own, 1.0 / weight, line_slopes[chunk, i])


@kernel()
def _slopes_of(stage, per_weight, slopes):  # type: ignore[no-untyped-def]
    """K' = (Y - R') / weight, where ``slopes`` holds R'."""
    for k in range(stage.shape[0]):
        slopes[k] = (stage[k] - slopes[k]) * per_weight


@kernel()
def _starting_lines(system, growth, phase, state, slope, lines, line_slopes, spaces):  # type: ignore[no-untyped-def]
    """Slopes of the columns at the start, where no stage has left them."""
    parameters, constants, layout, work, oscillator, _, tangent, _, _ = system
    n = _base_size(state, oscillator)
    trial, phase_slope = spaces
    _phase_slope(system, phase, state, trial, phase_slope)
    for chunk in range(lines.shape[0]):
        block = lines[chunk].reshape((state.shape[0], LANES))
        out = line_slopes[chunk].reshape((state.shape[0], LANES))
        tangent(phase, state[:n], block[:n], parameters, constants, layout, work, out[:n])
        if oscillator >= 0:
            oscillator_tangent(state, block, parameters[oscillator], phase_slope, out)
    _add_inhomogeneous(system, phase, state, 1.0, growth, slope, trial, line_slopes)


@kernel()
def _hermite(x, h):  # type: ignore[no-untyped-def]
    """Weights of the values and slopes at both ends of a step, at the fraction x of it."""
    y = 1.0 - x
    return y * y * (1.0 + 2.0 * x), x * y * y * h, x * x * (1.0 + 2.0 * y), -x * x * y * h


@kernel()
def _accumulate(weights, gradient, share, point, lines, line_slopes, stages, functional):  # type: ignore[no-untyped-def]
    """functional += share <gradient, y> for y the ``point`` of the orbit and every column, interpolated
    within a step.
    """
    for k in range(gradient.shape[0]):
        functional[0] += share * gradient[k] * point[k]
    value, slope, end_value, end_slope = weights
    last = line_slopes.shape[1] - 1
    for chunk in range(lines.shape[0]):
        for i in range(gradient.shape[0]):
            for c in range(LANES):
                k = i * LANES + c
                column = value * lines[chunk, k] + slope * line_slopes[chunk, 0, k]
                column += end_value * stages[chunk, k] + end_slope * line_slopes[chunk, last, k]
                functional[1 + chunk * LANES + c] += share * gradient[i] * column


def aligned(count: int) -> NDArray[np.float64]:
    """Zeros that begin on a line of the cache, so that no line of columns straddles two."""
    values = np.zeros(count + LANES)
    first = -(values.ctypes.data // values.itemsize) % LANES
    return values[first : first + count]


def workspace_sizes(size: int, chunks: int, stages: int) -> tuple[int, int]:
    """Lengths of the two scratch vectors that ``propagate_implicit`` needs: for the orbit, for the
    columns.
    """
    return (2 * stages + 4 + LANES) * size, (stages + 1) * chunks * size * LANES


@kernel(
    types.int64(
        RATES_POINTER, TANGENT_POINTER, FACTORISE_POINTER, SOLVE_POINTER, _MATRIX, _VECTOR, _MATRIX,
        _INT, _FLOAT, _FLOAT, _INT, _VECTOR, _VECTOR, _INTEGERS, _VECTOR, _VECTOR, _VECTOR, _MATRIX,
        _INTEGERS, _VECTOR, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR, _MATRIX,
    ),
)  # fmt: skip
def propagate_implicit(  # type: ignore[no-untyped-def]
    rates, tangent, factorise, solve, a, c, predictor,
    steps, turn, period, oscillator, parameters, constants, layout, work, factors, state, lines,
    column_parameter, column_period, samples, gradient, functional, orbit_space, column_space, kept,
):  # fmt: skip
    """Advance ``state`` (size,) and ``lines`` (chunks, size * LANES) in place over one period; -1, or the
    step that failed.

    ``predictor`` (stages, 2 stages): weights of the slopes of the last step and of this one that
    extrapolate to each stage.  ``samples`` (K, size) receives the orbit at tau1 = k / K, interpolated
    within the steps by cubic Hermite polynomials; the functional (1 + columns) is summed there too.
    ``column_parameter`` and ``column_period`` may be shorter than the columns.  ``kept`` (steps
    (stages - 1), len(factors)), or without rows, receives the factors with which the columns were solved.
    Everything else as in ``propagation.propagate``.
    """
    n, stages, chunks = state.shape[0], a.shape[0], lines.shape[0]
    h, base, width = period / steps, _base_size(state, oscillator), n * LANES
    weight = h * a[1, 1]
    system = (parameters, constants, layout, work, oscillator, rates, tangent, factorise, solve)
    growth = (column_parameter, column_period, period)

    line, rest = orbit_space[: base * LANES], orbit_space[width:]
    slopes = rest[: 2 * stages * n].reshape((2 * stages, n))  # of the last step, then of this one
    current, rest = slopes[stages:], rest[2 * stages * n :]
    right, stage, trial, phase_slope = rest[:n], rest[n : 2 * n], rest[2 * n : 3 * n], rest[3 * n : 4 * n]
    end = chunks * stages * width
    line_slopes = column_space[:end].reshape((chunks, stages, width))
    line_stages = column_space[end : end + chunks * width].reshape((chunks, width))
    line[:] = 0.0
    functional[:] = 0.0

    # The first slopes of a step are the last of the step before.
    phase = _phase_at(state, oscillator, 0.0)
    _rates_at(system, phase, state, trial)
    for i in range(stages):
        current[i] = trial
    if chunks > 0:
        started = line_stages  # not yet in use
        slope = current[0]
        _starting_lines(system, growth, phase, state, slope, lines, started, (trial, phase_slope))
        for chunk in range(chunks):
            line_slopes[chunk, stages - 1] = started[chunk]

    sample, factored = 0, False
    for step in range(steps):
        slopes[:stages] = current
        current[0] = current[stages - 1]
        for chunk in range(chunks):
            line_slopes[chunk, 0] = line_slopes[chunk, stages - 1]
        for i in range(1, stages):
            combine(right, state, h, a[i], i, current)
            combine(stage, right, weight, predictor[i], stages + i, slopes)
            if oscillator >= 0:
                _oscillator_stage(right, weight, parameters[oscillator], stage)
            phase = _phase_at(stage, oscillator, turn * (step + c[i]) / steps)
            factored = factored and (chunks > 0 or i > 1)
            if not _solve_stage(
                system, phase, weight, factored, right, factors, stage[:base], trial[:base], line
            ):
                return step
            factored = True
            for k in range(n):
                current[i, k] = (stage[k] - right[k]) / weight
            if chunks > 0:
                _solve_columns(
                    system, (a, h), growth, i, phase, factors, lines, line_slopes, line_stages, stage,
                    current[i], (trial, phase_slope),
                )  # fmt: skip
                if kept.shape[0] > 0:
                    kept[step * (stages - 1) + i - 1] = factors
        while sample < samples.shape[0] and sample * steps < (step + 1) * samples.shape[0]:
            weights = _hermite(sample * steps / samples.shape[0] - step, h)
            for k in range(n):
                samples[sample, k] = weights[0] * state[k] + weights[1] * current[0, k]
                samples[sample, k] += weights[2] * stage[k] + weights[3] * current[stages - 1, k]
            if gradient.shape[0] > 0:
                _accumulate(
                    weights, gradient[sample], 1.0 / gradient.shape[0], samples[sample],
                    lines, line_slopes, line_stages, functional,
                )  # fmt: skip
            sample += 1
        state[:] = stage
        for chunk in range(chunks):
            lines[chunk] = line_stages[chunk]
    return -1


@kernel(
    types.void(
        RATES_POINTER, TANGENT_POINTER, FACTORISE_POINTER, SOLVE_POINTER, _MATRIX, _INT, _FLOAT, _VECTOR,
        _VECTOR, _INTEGERS, _VECTOR, _MATRIX, _VECTOR, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR,
    ),
)  # fmt: skip
def propagate_columns(  # type: ignore[no-untyped-def]
    rates, tangent, factorise, solve, a, steps, period, parameters, constants, layout, work, kept, state,
    lines, samples, gradient, functional, orbit_space, column_space,
):  # fmt: skip
    """Advance ``lines`` over one period along the orbit through ``state`` that ``kept`` and ``samples`` are
    of, for systems without the oscillator: one solve per stage and chunk, with the same bits as in
    ``propagate_implicit``.
    """
    n, stages, chunks = state.shape[0], a.shape[0], lines.shape[0]
    h, width = period / steps, n * LANES
    system = (parameters, constants, layout, work, -1, rates, tangent, factorise, solve)
    growth = (np.zeros(0, dtype=np.int64), np.zeros(0), period)
    slope, trial, phase_slope = orbit_space[:n], orbit_space[n : 2 * n], orbit_space[2 * n : 3 * n]
    end = chunks * stages * width
    line_slopes = column_space[:end].reshape((chunks, stages, width))
    line_stages = column_space[end : end + chunks * width].reshape((chunks, width))
    functional[:] = 0.0

    _starting_lines(system, growth, 0.0, state, slope, lines, line_stages, (trial, phase_slope))
    for chunk in range(chunks):
        line_slopes[chunk, stages - 1] = line_stages[chunk]
    sample = 0
    for step in range(steps):
        for chunk in range(chunks):
            line_slopes[chunk, 0] = line_slopes[chunk, stages - 1]
        for i in range(1, stages):
            factors = kept[step * (stages - 1) + i - 1]
            for chunk in range(chunks):
                own, slopes = line_stages[chunk], line_slopes[chunk, i]
                combine(slopes, lines[chunk], h, a[i], i, line_slopes[chunk])
                own[:] = slopes
                solve(factors, constants, layout, work, own)
                _slopes_of(own, 1.0 / (h * a[i, i]), slopes)
        while sample < samples.shape[0] and sample * steps < (step + 1) * samples.shape[0]:
            if gradient.shape[0] > 0:
                weights = _hermite(sample * steps / samples.shape[0] - step, h)
                _accumulate(
                    weights, gradient[sample], 1.0 / gradient.shape[0], samples[sample],
                    lines, line_slopes, line_stages, functional,
                )  # fmt: skip
            sample += 1
        for chunk in range(chunks):
            lines[chunk] = line_stages[chunk]
