"""The equations that a pass integrates, and their derivatives with the phase and with parameters.

Eq. 17 of the paper turns a forced system into an autonomous one with two more states,

    ds1/dtau = s1 + W s2 - s1 (s1^2 + s2^2),   ds2/dtau = -W s1 + s2 - s2 (s1^2 + s2^2)

whose cycle is (sin W tau, cos W tau), with the forcing frequency W. The phase is then atan2(s1, s2), and the
Jacobian has the additional term df/dphase dphase/ds.

The functions that call ``rates`` are compiled with the loops that call them, and run as plain Python if
``rates`` is a Python function (``system.ode_system``).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import register_jitable

from pipelines.machine.kernels import kernel

_FLOAT = types.float64
_INT = types.int64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]

_PARAMETER_DIFFERENCE = 6e-6  # balances truncation h^2 against rounding eps/h in a central difference
_PHASE_DIFFERENCE = 1e-3  # the same for the five-point formula, h^4 against eps/h
_CHUNK = 1024  # values; keeps the running sum of a stage in the first-level cache


class Equations(NamedTuple):
    """The right-hand side f = ``rates`` and the arrays that it reads.

    ``oscillator``: index of the forcing frequency if the last two states are those of Eq. 17, else -1.
    """

    parameters: Any
    constants: Any
    layout: Any
    work: Any
    oscillator: Any
    rates: Any


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
    """Write the rates of the two states of Eq. 17 into the last two entries of ``out``."""
    n = state.shape[0] - 2
    s1, s2 = state[n], state[n + 1]
    radius = s1 * s1 + s2 * s2
    out[n] = s1 + frequency * s2 - s1 * radius
    out[n + 1] = -frequency * s1 + s2 - s2 * radius


@kernel(types.void(_VECTOR, _MATRIX, _FLOAT, _VECTOR, _MATRIX))
def oscillator_tangent(state, block, frequency, by_phase, out):  # type: ignore[no-untyped-def]
    """Add df/dphase dphase to the rows of the system and write the two rows of Eq. 17."""
    n = state.shape[0] - 2
    s1, s2 = state[n], state[n + 1]
    radius = s1 * s1 + s2 * s2
    for j in range(block.shape[1]):
        d1, d2 = block[n, j], block[n + 1, j]
        phase = (s2 * d1 - s1 * d2) / radius
        for i in range(n):
            out[i, j] += by_phase[i] * phase
        out[n, j] = (1.0 - radius - 2.0 * s1 * s1) * d1 + (frequency - 2.0 * s1 * s2) * d2
        out[n + 1, j] = (-frequency - 2.0 * s1 * s2) * d1 + (1.0 - radius - 2.0 * s2 * s2) * d2


@register_jitable
def system_size(state, oscillator):  # type: ignore[no-untyped-def]
    """Number of states of the system, without those of the oscillator."""
    return state.shape[0] - 2 if oscillator >= 0 else state.shape[0]


@register_jitable
def phase_at(state, oscillator, forced):  # type: ignore[no-untyped-def]
    """The phase of the forcing: that of the oscillator of Eq. 17 if there is one, else ``forced``."""
    n = state.shape[0]
    return np.arctan2(state[n - 2], state[n - 1]) if oscillator >= 0 else forced


@register_jitable
def rates_at(equations, phase, state, out):  # type: ignore[no-untyped-def]
    """Write the rates of the system and of the oscillator into ``out``."""
    parameters, constants, layout, work, oscillator, rates = equations
    n = system_size(state, oscillator)
    rates(phase, state[:n], parameters, constants, layout, work, out[:n])
    if oscillator >= 0:
        oscillator_rates(state, parameters[oscillator], out)


@register_jitable
def phase_slope(equations, phase, state, trial, out):  # type: ignore[no-untyped-def]
    """Write df/dphase, by the five-point formula, into ``out``; zero without an oscillator."""
    parameters, constants, layout, work, oscillator, rates = equations
    n = system_size(state, oscillator)
    out[:] = 0.0
    if oscillator >= 0:
        for shift, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
            at = phase + shift * _PHASE_DIFFERENCE
            rates(at, state[:n], parameters, constants, layout, work, trial[:n])
            for i in range(n):
                out[i] += weight * trial[i] / (12.0 * _PHASE_DIFFERENCE)


@register_jitable
def inhomogeneous_terms(equations, phase, state, parameter, growth, slope, trial, out):  # type: ignore[no-untyped-def]
    """Write df/dlambda + (dT/dlambda) f / T of one column into ``out``.

    ``parameter``: the index of lambda, -1 for none; ``growth``: (dT/dlambda) / T; ``slope``: f.
    """
    parameters, n = equations.parameters, state.shape[0]
    for i in range(n):
        out[i] = growth * slope[i]
    if parameter < 0:
        return
    value = parameters[parameter]
    delta = _PARAMETER_DIFFERENCE * max(1.0, abs(value))
    for sign in (1.0, -1.0):
        parameters[parameter] = value + sign * delta
        rates_at(equations, phase, state, trial)
        for i in range(n):
            out[i] += sign * 0.5 / delta * trial[i]
    parameters[parameter] = value
