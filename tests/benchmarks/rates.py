"""Rates of the machine itself: lines of LANES values multiplied and added, from registers and from the cache.

The loops are written in vector instructions, as those of ``pipelines.machine.vector_lanes``: how many sums
they keep at once is tried, because registers are few and an addition takes several cycles.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from pipelines.machine.lanes import LANES
from tests.benchmarks.measuring import cpu_seconds

SUMS = (4, 6, 8, 12)
LINES = 240  # with their factors 17 KiB, which stay in the first-level cache; a multiple of all SUMS
_ALIGNMENT = 64
_LINE_TYPE = ir.VectorType(ir.DoubleType(), LANES)
_operation: Any = intrinsic


def multiply_add_rate(count: int) -> float:
    """Multiply-adds a second of vector registers alone, from ``count`` passes over the lines."""
    return max(_rate(_loop(sums, from_cache=False), count) for sums in SUMS)


def cached_multiply_add_rate(count: int) -> float:
    """Multiply-adds a second when line and factor are both loaded from the first-level cache."""
    return max(_rate(_loop(sums, from_cache=True), count) for sums in SUMS)


def seconds_each(run: Callable[[], object], count: int) -> float:
    """Median CPU time of one of ``count`` repetitions inside a run."""
    run()
    return statistics.median(cpu_seconds(run) for _ in range(7)) / count


def aligned(size: int) -> NDArray[np.float64]:
    """Zeros that start on a cache line."""
    space = np.zeros(size + _ALIGNMENT // 8)
    first = -space.ctypes.data % _ALIGNMENT // 8
    return space[first : first + size]


def _rate(loop: Callable[..., float], count: int) -> float:
    lines, factors = aligned(LINES * LANES), aligned(LINES)
    lines[:], factors[:] = 0.5, 0.5
    return LINES * LANES / seconds_each(lambda: loop(count, lines, factors), count)


def _loop(sums: int, *, from_cache: bool) -> Any:
    """A compiled loop over the lines with so many independent sums; it returns one of their values."""
    one_pass = _passes(sums, from_cache)

    @njit
    def loop(count, lines, factors):  # type: ignore[no-untyped-def]
        return one_pass(count, lines, factors)

    return loop


def _passes(sums: int, from_cache: bool) -> Any:
    """The operation ``count`` times over all lines: sum_k <- sum_k + factor line, or sum_k <- sum_k factor +
    line.
    """

    @_operation
    def passes(typing, count, lines, factors):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            count, lines, factors = arguments
            data = context.make_array(signature.args[1])(context, builder, lines).data
            numbers = context.make_array(signature.args[2])(context, builder, factors).data
            first = _spread(builder, builder.load(numbers))
            totals = [cgutils.alloca_once_value(builder, first) for _ in range(sums)]
            groups = ir.Constant(count.type, LINES // sums)
            with cgutils.for_range(builder, count), cgutils.for_range(builder, groups) as group:
                start = builder.mul(group.index, ir.Constant(count.type, sums))
                for k, total in enumerate(totals):
                    at, value = builder.add(start, ir.Constant(count.type, k)), builder.load(total)
                    if from_cache:
                        value = _add(builder, value, *_operands(builder, data, numbers, at))
                    else:
                        value = _add(builder, first, value, first)
                    builder.store(value, total)
            result = builder.load(totals[0])
            for total in totals[1:]:
                result = builder.fadd(result, builder.load(total))
            return builder.extract_element(result, ir.Constant(ir.IntType(32), 0))

        return types.float64(types.int64, lines, factors), generate

    return passes


def _add(builder: Any, total: Any, factor: Any, line: Any) -> Any:
    return builder.fadd(total, builder.fmul(factor, line, flags=("contract",)), flags=("contract",))


def _operands(builder: Any, data: Any, numbers: Any, at: Any) -> tuple[Any, Any]:
    """A factor in all places of a line, and the line that it multiplies."""
    place = builder.gep(data, [builder.mul(at, ir.Constant(at.type, LANES))])
    line = builder.load(builder.bitcast(place, _LINE_TYPE.as_pointer()), align=8)
    return _spread(builder, builder.load(builder.gep(numbers, [at]))), line


def _spread(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(_LINE_TYPE, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    )
