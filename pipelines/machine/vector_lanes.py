"""The sums of ``lanes`` in vector registers, and arrays without reference counts.

The compiler unrolls a loop over so few values before it would vectorise it, and the sum becomes scalar.  This
module generates the vector instructions itself; multiplications and additions may be fused.  Its import fails
if numba or llvmlite no longer have the interfaces that it uses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from .plain_lanes import LANES, QUAD

_operation: Any = intrinsic  # numba's annotation counts the typing context among the arguments of a call


def _row_type(width: int) -> Any:
    return ir.VectorType(ir.DoubleType(), width)


def _address(context: Any, builder: Any, array_type: Any, array: Any, offset: Any, width: int = LANES) -> Any:
    """Pointer to the row of ``width`` values that starts at ``offset`` of a flat array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), _row_type(width).as_pointer())


def _filled(builder: Any, value: Any, width: int = LANES) -> Any:
    """A row with one value in every lane."""
    undefined = ir.Constant(_row_type(width), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    every = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
    return builder.shuffle_vector(first, undefined, every)


def _sum(context: Any, builder: Any, total: Any, factors: Any, lanes: Any, sources: Any) -> Any:
    """total + sum_k factor_k row_k; ``lanes`` is the pair of the array's type and value."""
    array_type, array = lanes
    for factor, source in zip(factors, sources, strict=True):
        row = builder.load(_address(context, builder, array_type, array, source), align=8)
        term = builder.fmul(_filled(builder, factor), row, flags=("contract",))
        total = term if total is None else builder.fadd(total, term, flags=("contract",))
    return total


@_operation
def set_lanes(typing, out, to, factors, lanes, sources):  # type: ignore[no-untyped-def]
    """out[to + c] = sum_k factors[k] lanes[sources[k] + c] for c < LANES; factors and sources are tuples."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        out, to, factors, lanes, sources = arguments
        factors, sources = cgutils.unpack_tuple(builder, factors), cgutils.unpack_tuple(builder, sources)
        total = _sum(context, builder, None, factors, (signature.args[3], lanes), sources)
        builder.store(total, _address(context, builder, signature.args[0], out, to), align=8)
        return context.get_dummy_value()

    count = len(factors)
    tuples = types.UniTuple(types.float64, count), types.UniTuple(types.uint64, count)
    return types.void(out, types.uint64, tuples[0], lanes, tuples[1]), generate


@_operation
def add_lanes(typing, out, to, factor, lanes, source):  # type: ignore[no-untyped-def]
    """out[to + c] += factor lanes[source + c] for c < LANES."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        out, to, factor, lanes, source = arguments
        target = _address(context, builder, signature.args[0], out, to)
        total = builder.load(target, align=8)
        total = _sum(context, builder, total, (factor,), (signature.args[3], lanes), (source,))
        builder.store(total, target, align=8)
        return context.get_dummy_value()

    return types.void(out, types.uint64, types.float64, lanes, types.uint64), generate


_UNROLLED = (2, 3, 4, 6, 8, 9, 12)  # numbers of terms of the sums that take most of the time


@_operation
def accumulate_lanes(typing, out, to, base, start, factors, first, lanes, source, step, count):  # type: ignore[no-untyped-def]
    """out <- base + sum of ``count`` rows of ``lanes``, ``step`` apart, times factors.

    out[to + c] = base[start + c] + sum_{k < count} factors[first + k] lanes[source + k step + c], c < LANES

    The sum stays in a register.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        out, to, base, start, factors, first, lanes, source, step, count = arguments
        of = signature.args
        numbers = context.make_array(of[4])(context, builder, factors).data

        def add(total, k):  # type: ignore[no-untyped-def]
            factor = builder.load(builder.gep(numbers, [builder.add(first, k)]))
            at = builder.add(source, builder.mul(k, step))
            row = builder.load(_address(context, builder, of[6], lanes, at), align=8)
            term = builder.fmul(_filled(builder, factor), row, flags=("contract",))
            return builder.fadd(total, term, flags=("contract",))

        def store(total):  # type: ignore[no-untyped-def]
            builder.store(total, _address(context, builder, of[0], out, to), align=8)

        begin = builder.load(_address(context, builder, of[2], base, start), align=8)
        many = builder.append_basic_block("sum.many")
        done = builder.append_basic_block("sum.done")
        switch = builder.switch(count, many)
        for known in _UNROLLED:
            block = builder.append_basic_block(f"sum.{known}")
            switch.add_case(ir.Constant(count.type, known), block)
            builder.position_at_end(block)
            total = begin
            for k in range(known):
                total = add(total, ir.Constant(count.type, k))
            store(total)
            builder.branch(done)
        builder.position_at_end(many)
        total = cgutils.alloca_once(builder, begin.type)
        builder.store(begin, total)
        with cgutils.for_range(builder, count) as loop:
            builder.store(add(builder.load(total), loop.index), total)
        store(builder.load(total))
        builder.branch(done)
        builder.position_at_end(done)
        return context.get_dummy_value()

    at = types.uint64
    return types.void(out, at, base, at, factors, at, lanes, at, at, at), generate


@_operation
def multiply_quads(typing, quads, rows, a, at_a, row_a, b, at_b, row_b, add, out, at, row):  # type: ignore[no-untyped-def]
    """out <- out + a b if ``add``, else - a b, where b has QUAD rows of ``quads`` times QUAD values.

    ``quads``: a tuple of that length.  b stays in registers.
    """
    count = len(quads)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        _, rows, a, at_a, row_a, b, at_b, row_b, add, out, at, row = arguments
        of, width = signature.args, QUAD

        def place(which, array, start, step, k):  # type: ignore[no-untyped-def]
            at = builder.add(start, builder.mul(k, step))
            return _address(context, builder, of[which], array, at, width)

        def number(value):  # type: ignore[no-untyped-def]
            return ir.Constant(rows.type, value)

        def part(pointer, q):  # type: ignore[no-untyped-def]
            return builder.gep(pointer, [ir.Constant(ir.IntType(32), q)])

        known = []
        for k in range(QUAD):
            start = place(5, b, at_b, row_b, number(k))
            known.append([builder.load(part(start, q), align=8) for q in range(count)])
        nothing = ir.Constant(_row_type(width), [0.0] * width)
        numbers = context.make_array(of[2])(context, builder, a).data
        with cgutils.for_range(builder, rows) as loop:
            first = builder.add(at_a, builder.mul(loop.index, row_a))
            factors = [
                _filled(builder, builder.load(builder.gep(numbers, [builder.add(first, number(k))])), width)
                for k in range(QUAD)
            ]
            target = place(9, out, at, row, loop.index)
            for q in range(count):
                total = builder.select(add, builder.load(part(target, q), align=8), nothing)
                for factor, line in zip(factors, known, strict=True):
                    term = builder.fmul(factor, line[q], flags=("contract",))
                    total = builder.fadd(total, term, flags=("contract",))
                total = builder.select(add, total, builder.fsub(nothing, total))
                builder.store(total, part(target, q), align=8)
        return context.get_dummy_value()

    i = types.uint64
    return types.void(quads, i, a, i, i, b, i, i, types.boolean, out, i, i), generate


@_operation
def borrowed(typing, array):  # type: ignore[no-untyped-def]
    """The same array without its reference count, and so are all its views; the caller keeps it alive."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), generate


@njit(types.void(types.float64[::1]), cache=True)
def _take_all(owned):  # type: ignore[no-untyped-def]
    """Compile everything at the import, which then fails in place of a later compilation of a kernel."""
    zero, values = np.uint64(0), borrowed(owned)
    set_lanes(values, zero, (1.0,), values, (zero,))
    add_lanes(values, zero, 1.0, values, zero)
    accumulate_lanes(values, zero, values, zero, values, zero, values, zero, zero, zero)
