"""Signatures of the compiled right-hand sides.

A kernel sees the phase ``phi = 2 pi tau / T`` instead of the time tau, so that one loop integrates any period
over the unit interval.  It owns no memory: constants, integer layout and scratch space are handed in.

``RATES``    ``out = f(phase, state, parameters)``; arguments ``phase, state, parameters, constants, layout,
work, out``. ``TANGENT``  ``out = J(phase, state, parameters) @ block``; ``block`` and ``out`` have shape
``(size, columns)`` with the columns contiguous; arguments ``phase, state, block, parameters, constants,
layout, work, out``.

An implicit stepper also needs the shifted systems (I - shift J) x = b:

``FACTORISE``  fills ``factors`` (zeros before the first call) at a state; arguments ``phase, state,
parameters, shift, constants, layout, work, factors``. ``SOLVE``  replaces b by x in ``lines``, a flat array
with LINE columns row by row; arguments ``factors, constants, layout, work, lines``.

Decorate with ``@njit(RATES, cache=True)``: the explicit signature makes the compilation eager and the
function usable as a first-class value of type ``RATES_POINTER`` in another compiled function, which is then
cached as well.
"""

from __future__ import annotations

from numba import types

_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_LAYOUT = types.int64[::1]

RATES = types.void(types.float64, _VECTOR, _VECTOR, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
TANGENT = types.void(types.float64, _VECTOR, _MATRIX, _VECTOR, _VECTOR, _LAYOUT, _VECTOR, _MATRIX)
FACTORISE = types.void(types.float64, _VECTOR, _VECTOR, types.float64, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
SOLVE = types.void(_VECTOR, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
RATES_POINTER = types.FunctionType(RATES)
TANGENT_POINTER = types.FunctionType(TANGENT)
FACTORISE_POINTER = types.FunctionType(FACTORISE)
SOLVE_POINTER = types.FunctionType(SOLVE)
