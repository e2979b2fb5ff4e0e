"""Compiled systems from Python functions: many times faster than ``ode_system``, with implicit steppers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import is_jitted

from pipelines.machine.inverse import invert
from pipelines.machine.kernels import FACTORISE, RATES, SOLVE, TANGENT, kernel
from pipelines.machine.lanes import LANES
from pipelines.orbits.system import DynamicalSystem, Matrix, ShiftedSolver, Vector

_MATRIX = types.float64[:, ::1]


def compiled_system(
    rates: Callable[[float, Vector, Vector, Vector], None],
    jacobian: Callable[[float, Vector, Vector, Matrix], None],
    size: int,
    parameter_names: tuple[str, ...],
    forcing: str | None = None,
) -> DynamicalSystem:
    """Compile a system from functions that numba understands.

    ``rates(phase, s, parameters, out)`` writes f into ``out`` (size,), ``jacobian(phase, s, parameters,
    out)`` writes df/ds into ``out`` (size, size), which holds zeros; ``forcing`` as in ``ode_system``.  The
    shifted equations of implicit steppers are solved with dense matrices, which suits up to about a hundred
    states.  Raises ValueError if ``forcing`` is unknown, and numba's error if it cannot compile a function.
    """
    if forcing is not None and forcing not in parameter_names:
        raise ValueError(f"forcing is {forcing!r}; it must be one of {', '.join(parameter_names)}")
    write_rates, write_jacobian = _compiled(rates), _compiled(jacobian)

    @njit(RATES)
    def rates_kernel(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
        write_rates(phase, state, parameters, out)

    @njit(TANGENT)
    def tangent_kernel(phase, state, block, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
        matrix = work[: size * size].reshape((size, size))
        matrix[:] = 0.0
        write_jacobian(phase, state, parameters, matrix)
        for i in range(size):
            for j in range(block.shape[1]):
                total = 0.0
                for k in range(size):
                    total += matrix[i, k] * block[k, j]
                out[i, j] = total

    return DynamicalSystem(
        size=size,
        rates=rates_kernel,
        tangent=tangent_kernel,
        parameter_names=parameter_names,
        forcing=None if forcing is None else parameter_names.index(forcing),
        work_size=size * size,
        shifted=dense_shifted(tangent_kernel, size),
    )


def dense_shifted(tangent: Any, size: int) -> ShiftedSolver:
    """The solver of (I - shift J) x = b for a small compiled system, by the inverse matrix."""

    @njit(FACTORISE)
    def factorise(phase, state, parameters, shift, constants, layout, work, factors):  # type: ignore[no-untyped-def]
        identity, jacobian = np.zeros((size, size)), np.zeros((size, size))
        for i in range(size):
            identity[i, i] = 1.0
        tangent(phase, state, identity, parameters, constants, layout, work, jacobian)
        for i in range(size):
            for j in range(size):
                jacobian[i, j] = identity[i, j] - shift * jacobian[i, j]
        invert(jacobian, factors.reshape((size, size)))

    return ShiftedSolver(factorise, _solve_dense, size * size)


@kernel(SOLVE)
def _solve_dense(factors, constants, layout, work, lanes):  # type: ignore[no-untyped-def]
    """lanes = factors @ lanes; ``factors`` hold the inverse matrix."""
    size = lanes.shape[0] // LANES
    inverse, right = factors.reshape((size, size)), lanes.copy().reshape((size, LANES))
    solution = lanes.reshape((size, LANES))
    solution[:] = 0.0
    for i in range(size):
        for k in range(size):
            for j in range(LANES):
                solution[i, j] += inverse[i, k] * right[k, j]


def _compiled(function: Callable[..., None]) -> Any:
    return function if is_jitted(function) else njit(function)
