"""What ``vector_lanes`` computes, defined by plain loops; all arrays keep their reference counts."""

from __future__ import annotations

import numpy as np
from numba import njit

LANES = 8  # columns treated together: a bearing's rows and their image stay in the first-level cache
QUAD = 4  # values of a row of a small matrix treated together

# All offsets are unsigned: numba makes the sum of a signed and an unsigned integer a floating-point number.


@njit(fastmath={"contract"})
def set_lanes(out, to, factors, lanes, sources):  # type: ignore[no-untyped-def]
    """out[to + c] = sum_k factors[k] lanes[sources[k] + c] for c < LANES; factors and sources are tuples."""
    for c in range(np.uint64(LANES)):
        total = 0.0
        for k in range(len(factors)):
            total += factors[k] * lanes[np.uint64(sources[k]) + c]
        out[np.uint64(to) + c] = total


@njit(fastmath={"contract"})
def add_lanes(out, to, factor, lanes, source):  # type: ignore[no-untyped-def]
    """out[to + c] += factor lanes[source + c] for c < LANES."""
    for c in range(np.uint64(LANES)):
        out[np.uint64(to) + c] += factor * lanes[np.uint64(source) + c]


@njit(fastmath={"contract"})
def accumulate_lanes(out, to, base, start, factors, first, lanes, source, step, count):  # type: ignore[no-untyped-def]
    """out <- base + sum of ``count`` rows of ``lanes``, ``step`` apart, times factors.

    out[to + c] = base[start + c] + sum_{k < count} factors[first + k] lanes[source + k step + c], c < LANES
    """
    for c in range(np.uint64(LANES)):
        total = base[np.uint64(start) + c]
        for k in range(np.uint64(count)):
            at = np.uint64(source) + k * np.uint64(step)
            total += factors[np.uint64(first) + k] * lanes[at + c]
        out[np.uint64(to) + c] = total


@njit(fastmath={"contract"})
def multiply_quads(quads, rows, a, at_a, row_a, b, at_b, row_b, add, out, at, row):  # type: ignore[no-untyped-def]
    """out <- out + a b if ``add``, else - a b, where b has QUAD rows of ``quads`` times QUAD values.

    ``quads``: a tuple of that length; a and out have ``rows`` rows.  An array is given by its offset and the
    distance of its rows.
    """
    for i in range(np.uint64(rows)):
        for j in range(np.uint64(len(quads) * QUAD)):
            total = 0.0
            for k in range(np.uint64(QUAD)):
                total += a[np.uint64(at_a) + i * row_a + k] * b[np.uint64(at_b) + k * row_b + j]
            to = np.uint64(at) + i * row + j
            out[to] = out[to] + total if add else -total


@njit
def borrowed(array):  # type: ignore[no-untyped-def]
    """The same array."""
    return array
