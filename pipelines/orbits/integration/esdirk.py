"""One step of a singly diagonally implicit Runge-Kutta method, for an orbit and for its tangent columns.

The diagonal of the tableau is one number g but for the first stage, which is explicit; the last stage is the
new point.  A step of length h from the state s with three stages (those of ``steppers`` have more):

    0   |                   K_1 = f(s), the last slope of the step before
    c_2 | a_21  g           S_2 = R_2 + h g f(S_2),    R_2 = s + h a_21 K_1
    1   | a_31  a_32  g     S_3 = R_3 + h g f(S_3),    R_3 = s + h (a_31 K_1 + a_32 K_2)

where S_3 is the new point.

A stage is solved by Newton's method,

    (I - h g J) d = R_i + h g f(S_i) - S_i,    S_i <- S_i + d,    until d is rounding

from a guess R_i + h g K, with K extrapolated from the slopes of the last step and of this one.  By how much
it misses S_i changes little from an orbit to a nearby one, whose error is added to the guess.  The factors of
an earlier stage are used as long as the method contracts fast.  The slope of a stage follows from its
equation,

    K_i = (S_i - R_i) / (h g)

because f(S_i) would multiply the remaining error of Newton's method by the stiffness of the film.

A column y is the derivative of all this.  With J_i = J(S_i) at the solved stages:

    K'_1 = J(s) y
    (I - h g J_2) Y_2 = R'_2 = y + h a_21 K'_1,                       K'_2 = (Y_2 - R'_2) / (h g)
    (I - h g J_3) Y_3 = R'_3 = y + h (a_31 K'_1 + a_32 K'_2),         Y_3 is the new column

One factorisation in a stage serves all columns, each of which costs one solve, and the first iterations of
Newton's method in the next stage.  An inhomogeneous column has h g (df/dlambda + (dT/dlambda) f / T) on its
right-hand side too.  Between s and S_3 orbit and columns are interpolated by cubic Hermite polynomials.

The part of f that does not depend on the state, such as an unbalance force, is called the load.

Columns stand in chunks of LANES: ``lanes`` (chunks, n * LANES) holds the rows of a chunk one after another.
Scratch space of a step with n states, of the system or with those of Eq. 17, and s stages:

    orbit   | d (n * LANES) | slopes K: last step, this step (2 s, n) | right | stage | load | trial | term
    columns | slopes K' (chunks, s, n * LANES) | stages Y (chunks, n * LANES)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import NDArray

from pipelines.machine.kernels import assign, kernel
from pipelines.machine.lanes import LANES
from pipelines.orbits.integration.equations import (
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

_STAGE_ERROR = 1e-13  # of a stage, relative to max(1, largest entry): far below all tolerances of orbits
_SLOW = 0.3  # contraction of Newton's method above which the matrix is factored anew
_FIRST_CONTRACTION = 0.1  # before it is measured; usually it is far less
_NEWTON_ITERATIONS = 40
_VECTORS = 5  # right, stage, load, trial and term of the scratch space


class Method(NamedTuple):
    """Tableau and predictor of ``ImplicitStepper``, and the solver of the linear equations of its stages."""

    a: Any
    predictor: Any
    factorise: Any
    solve: Any


class Step(NamedTuple):
    """Scratch space of an orbit's step.

    Newton's correction d, slopes of the last step and of this one, R_i, S_i, the load, and two vectors for
    temporary values.
    """

    correction: Any
    slopes: Any
    right: Any
    stage: Any
    load: Any
    trial: Any
    term: Any


class Columns(NamedTuple):
    """Columns at the beginning of a step, slopes of its stages, and Y of the current stage.

    After the last stage, Y are the new columns.
    """

    lanes: Any
    slopes: Any
    stages: Any


def aligned(count: int) -> NDArray[np.float64]:
    """Zeros that begin on a cache line, so that no row of lanes straddles two."""
    values = np.zeros(count + LANES)
    first = -(values.ctypes.data // values.itemsize) % LANES
    return values[first : first + count]


@register_jitable
def step_space_size(size: int, stages: int) -> int:
    """Doubles of the scratch space of an orbit's step."""
    return (LANES + 2 * stages + _VECTORS) * size


def columns_space_size(size: int, chunks: int, stages: int) -> int:
    """Doubles of the scratch space of the columns."""
    return (stages + 1) * chunks * size * LANES


@kernel()
def step_views(space, size, oscillator, stages):  # type: ignore[no-untyped-def]
    """The scratch space of an orbit's step, with a load of zero."""
    own = size - 2 if oscillator >= 0 else size
    end = step_space_size(size, stages)
    vectors = space[LANES * size : end].reshape((2 * stages + _VECTORS, size))
    slopes, rest = vectors[: 2 * stages], vectors[2 * stages :]
    step = Step(space[: own * LANES], slopes, rest[0], rest[1], rest[2], rest[3], rest[4])
    step.correction[:] = 0.0
    step.load[:] = 0.0
    return step


@kernel()
def columns_views(lanes, space, stages):  # type: ignore[no-untyped-def]
    """The scratch space of columns."""
    chunks, width = lanes.shape
    end = chunks * stages * width
    slopes = space[:end].reshape((chunks, stages, width))
    return Columns(lanes, slopes, space[end : end + chunks * width].reshape((chunks, width)))


@kernel()
def start_orbit(equations, phase, state, step):  # type: ignore[no-untyped-def]
    """Initialise the slopes of the last step: all of them are the slope at the start."""
    rates_at(equations, phase, state, step.trial)
    stages = step.slopes.shape[0] // 2
    for i in range(stages, 2 * stages):
        _add_load(step.slopes[i], step.trial, step.load)


@kernel()
def _add_load(out, rates, load):  # type: ignore[no-untyped-def]
    """out = rates + load."""
    for k in range(out.shape[0]):
        out[k] = rates[k] + load[k]


@kernel()
def _oscillator_matrix(s1, s2, weight, frequency):  # type: ignore[no-untyped-def]
    """I - weight J of Eq. 17, row by row, and its determinant."""
    radius = s1 * s1 + s2 * s2
    a11 = 1.0 - weight * (1.0 - radius - 2.0 * s1 * s1)
    a22 = 1.0 - weight * (1.0 - radius - 2.0 * s2 * s2)
    a12, a21 = -weight * (frequency - 2.0 * s1 * s2), weight * (frequency + 2.0 * s1 * s2)
    return a11, a12, a21, a22, a11 * a22 - a12 * a21


@kernel()
def begin_step(step):  # type: ignore[no-untyped-def]
    """Make the slopes of this step those of the last one; its last slope is the first of the new step."""
    stages = step.slopes.shape[0] // 2
    for i in range(stages):
        assign(step.slopes[i], step.slopes[stages + i])
    assign(step.slopes[stages], step.slopes[2 * stages - 1])


@kernel()
def solve_stage(equations, method, h, i, forced, state, factored, factors, missed, step):  # type: ignore[no-untyped-def]
    """Write S_i into ``step.stage`` and K_i into the slopes; False if Newton's method fails.

    ``forced``: the phase of the forcing, which an oscillator replaces by its own; ``factored``: use the
    factors of an earlier stage, which are renewed when Newton's method contracts slowly; ``missed``: by how
    much the guess missed S_i on a nearby orbit, replaced by this one's error; empty where nothing is known.
    """
    a, right, stage = method.a, step.right, step.stage
    stages, weight = a.shape[0], h * a[i, i]
    combine(right, state, h, a[i], i, step.slopes[stages:])
    combine(stage, right, weight, method.predictor[i], stages + i, step.slopes)
    for k in range(missed.shape[0]):
        guess = stage[k]
        stage[k] += missed[k]
        missed[k] = -guess
    oscillator = equations.oscillator
    if oscillator >= 0:
        _oscillator_stage(right, weight, equations.parameters[oscillator], stage)
    phase = phase_at(stage, oscillator, forced)
    if not _newton(equations, method, phase, weight, factored, factors, step):
        return False
    slope = step.slopes[stages + i]
    for k in range(slope.shape[0]):
        slope[k] = (stage[k] - right[k]) / weight
    for k in range(missed.shape[0]):
        missed[k] += stage[k]
    return True


@kernel()
def _newton(equations, method, phase, weight, factored, factors, step):  # type: ignore[no-untyped-def]
    """Newton's method for S = R + weight (f(phase, S) + load), from the guess in ``step.stage``."""
    parameters, constants, layout, work, oscillator, rates = equations
    _, _, factorise, solve = method
    n, last, since = system_size(step.stage, oscillator), np.inf, 0
    stage, slope, right, load, line = step.stage[:n], step.trial[:n], step.right, step.load, step.correction
    for _ in range(_NEWTON_ITERATIONS):
        if not factored:
            factorise(phase, stage, parameters, weight, constants, layout, work, factors)
            factored, since = True, 0
        rates(phase, stage, parameters, constants, layout, work, slope)
        for i in range(n):
            line[i * LANES] = right[i] + weight * (slope[i] + load[i]) - stage[i]
        solve(factors, constants, layout, work, line)
        update, size, total = 0.0, 1.0, 0.0
        for i in range(n):
            stage[i] += line[i * LANES]
            update = max(update, abs(line[i * LANES]))
            size = max(size, abs(stage[i]))
            total += abs(stage[i])  # max() ignores NaN
        if not np.isfinite(total):
            return False
        contraction = update / last if since > 0 else _FIRST_CONTRACTION
        if update * min(1.0, contraction / (1.0 - min(contraction, 0.5))) <= _STAGE_ERROR * size:
            return True
        factored = since == 0 or contraction < _SLOW
        last, since = update, since + 1
    return False


@kernel(types.void(_VECTOR, _FLOAT, _FLOAT, _VECTOR))
def _oscillator_stage(right, weight, frequency, stage):  # type: ignore[no-untyped-def]
    """Solve Eq. 17 for the last two entries of a stage by Newton's method, S = R + weight g(S).

    The entries of ``stage`` are the guess.
    """
    n = stage.shape[0] - 2
    for _ in range(_NEWTON_ITERATIONS):
        s1, s2 = stage[n], stage[n + 1]
        radius = s1 * s1 + s2 * s2
        r1 = right[n] + weight * (s1 + frequency * s2 - s1 * radius) - s1
        r2 = right[n + 1] + weight * (-frequency * s1 + s2 - s2 * radius) - s2
        a11, a12, a21, a22, determinant = _oscillator_matrix(s1, s2, weight, frequency)
        stage[n] += (a22 * r1 - a12 * r2) / determinant
        stage[n + 1] += (a11 * r2 - a21 * r1) / determinant
        if max(abs(r1), abs(r2)) <= _STAGE_ERROR:
            return


@kernel()
def start_columns(equations, tangent, growth, phase, state, step, columns):  # type: ignore[no-untyped-def]
    """Compute the slopes of the columns at the start, where there is no earlier stage.

    ``growth`` = (parameter of each column or -1, dT/dlambda of each, T).
    """
    parameters, constants, layout, work, oscillator, _ = equations
    size, n, started = state.shape[0], system_size(state, oscillator), columns.stages  # free at the start
    phase_slope(equations, phase, state, step.trial, step.term)
    for chunk in range(started.shape[0]):
        block, out = columns.lanes[chunk].reshape((size, LANES)), started[chunk].reshape((size, LANES))
        tangent(phase, state[:n], block[:n], parameters, constants, layout, work, out[:n])
        if oscillator >= 0:
            oscillator_tangent(state, block, parameters[oscillator], step.term, out)
    slope = step.slopes[step.slopes.shape[0] - 1]
    _add_inhomogeneous(equations, growth, 1.0, phase, state, slope, step, started)
    for chunk in range(started.shape[0]):
        assign(columns.slopes[chunk, columns.slopes.shape[1] - 1], started[chunk])


@kernel()
def begin_columns(columns):  # type: ignore[no-untyped-def]
    """Make the last slopes of a step the first of the next."""
    for chunk in range(columns.slopes.shape[0]):
        assign(columns.slopes[chunk, 0], columns.slopes[chunk, columns.slopes.shape[1] - 1])


@kernel()
def end_columns(columns):  # type: ignore[no-untyped-def]
    """Make the last stage of a step the beginning of the next."""
    for chunk in range(columns.lanes.shape[0]):
        assign(columns.lanes[chunk], columns.stages[chunk])


@kernel()
def linearise_stage(equations, method, h, i, growth, forced, factors, step, columns):  # type: ignore[no-untyped-def]
    """Compute Y_i and K'_i of every column at the stage that ``solve_stage`` has solved, and its factors."""
    parameters, constants, layout, work, oscillator, _ = equations
    a, _, factorise, solve = method
    stage, weight, n = step.stage, h * a[i, i], system_size(step.stage, oscillator)
    phase, slope = phase_at(stage, oscillator, forced), step.slopes[a.shape[0] + i]
    factorise(phase, stage[:n], parameters, weight, constants, layout, work, factors)
    for chunk in range(columns.lanes.shape[0]):
        right_side(columns, chunk, a, h, i)
    _add_inhomogeneous(equations, growth, weight, phase, stage, slope, step, columns.stages)
    phase_slope(equations, phase, stage, step.trial, step.term)
    for chunk in range(columns.lanes.shape[0]):
        if oscillator >= 0:
            _oscillator_lanes(stage, weight, parameters[oscillator], step.term, columns.stages[chunk])
        solve_columns(equations, solve, factors, columns, chunk, n, weight, i)


@kernel()
def right_side(columns, chunk, a, h, i):  # type: ignore[no-untyped-def]
    """Write R'_i of a chunk into the places of Y_i and of K'_i."""
    slopes = columns.slopes[chunk]
    combine(slopes[i], columns.lanes[chunk], h, a[i], i, slopes)
    assign(columns.stages[chunk], slopes[i])


@kernel()
def solve_columns(equations, solve, factors, columns, chunk, n, weight, i):  # type: ignore[no-untyped-def]
    """Replace R'_i of a chunk, in its two places, by Y_i and by K'_i = (Y_i - R'_i) / weight."""
    own, slopes, per_weight = columns.stages[chunk], columns.slopes[chunk, i], 1.0 / weight
    solve(factors, equations.constants, equations.layout, equations.work, own[: n * LANES])
    for k in range(own.shape[0]):
        slopes[k] = (own[k] - slopes[k]) * per_weight


@kernel(types.void(_VECTOR, _FLOAT, _FLOAT, _VECTOR, _VECTOR))
def _oscillator_lanes(stage, weight, frequency, by_phase, lanes):  # type: ignore[no-untyped-def]
    """Solve the two rows of Eq. 17 and put weight df/dphase dphase on the right-hand side of the others."""
    n = stage.shape[0] - 2
    s1, s2 = stage[n], stage[n + 1]
    a11, a12, a21, a22, determinant = _oscillator_matrix(s1, s2, weight, frequency)
    for c in range(LANES):
        r1, r2 = lanes[n * LANES + c], lanes[(n + 1) * LANES + c]
        d1, d2 = (a22 * r1 - a12 * r2) / determinant, (a11 * r2 - a21 * r1) / determinant
        lanes[n * LANES + c], lanes[(n + 1) * LANES + c] = d1, d2
        phase = weight * (s2 * d1 - s1 * d2) / (s1 * s1 + s2 * s2)
        for i in range(n):
            lanes[i * LANES + c] += phase * by_phase[i]


@kernel()
def _add_inhomogeneous(equations, growth, weight, phase, state, slope, step, lanes):  # type: ignore[no-untyped-def]
    """lanes += weight (df/dlambda + (dT/dlambda) f / T) in the inhomogeneous columns; ``slope`` is f."""
    column_parameter, column_period, period = growth
    for j in range(column_parameter.shape[0]):
        if column_parameter[j] < 0 and column_period[j] == 0.0:
            continue
        rate = column_period[j] / period
        inhomogeneous_terms(equations, phase, state, column_parameter[j], rate, slope, step.trial, step.term)
        block, c = lanes[j // LANES], j % LANES
        for i in range(state.shape[0]):
            block[i * LANES + c] += weight * step.term[i]


@kernel()
def _hermite(x, h):  # type: ignore[no-untyped-def]
    """Hermite weights of value and slope at the beginning and at the end of a step, at the fraction x."""
    y = 1.0 - x
    return y * y * (1.0 + 2.0 * x), x * y * y * h, x * x * (1.0 + 2.0 * y), -x * x * y * h


@kernel()
def interpolate(x, h, state, step, first, out):  # type: ignore[no-untyped-def]
    """Write the states from index ``first``, at the fraction x of a step from ``state``, into ``out``."""
    value, slope, end_value, end_slope = _hermite(x, h)
    last = step.slopes.shape[0] - 1
    begin, end = step.slopes[step.slopes.shape[0] // 2], step.slopes[last]
    for k in range(out.shape[0]):
        row = first + k
        out[k] = value * state[row] + slope * begin[row]
        out[k] += end_value * step.stage[row] + end_slope * end[row]


@kernel()
def accumulate(x, h, gradient, share, point, columns, functional):  # type: ignore[no-untyped-def]
    """functional += share <gradient, y>, for the ``point`` of the orbit and then for every column y.

    All are taken at the fraction x of a step.
    """
    for k in range(gradient.shape[0]):
        functional[0] += share * gradient[k] * point[k]
    value, slope, end_value, end_slope = _hermite(x, h)
    lanes, slopes, stages = columns
    last = slopes.shape[1] - 1
    for chunk in range(lanes.shape[0]):
        for i in range(gradient.shape[0]):
            for c in range(LANES):
                k = i * LANES + c
                column = value * lanes[chunk, k] + slope * slopes[chunk, 0, k]
                column += end_value * stages[chunk, k] + end_slope * slopes[chunk, last, k]
                functional[1 + chunk * LANES + c] += share * gradient[i] * column
