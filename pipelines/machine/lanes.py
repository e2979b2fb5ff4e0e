"""Sums over lanes: the values that LANES columns have in one row, side by side in a flat array.

    set_lanes         out <- sum of a few rows times factors
    add_lanes         out <- out + a row times a factor
    accumulate_lanes  out <- base + sum of equally spaced rows times factors

``multiply_quads``, the product of small matrices with rows of QUAD values, and ``borrowed``, an array whose
views are not reference-counted: counting would take half of the films' time.

numba does not vectorise such short loops. ``vector_lanes`` generates the vector instructions, through
interfaces of numba and llvmlite that may change with any version. Where they have changed, or with
AGFB_PLAIN_LANES=1 in the environment, the loops of ``plain_lanes`` give the same numbers to rounding and take
twice the time.
"""

from __future__ import annotations

import os
from types import ModuleType

from numba import errors

from . import plain_lanes
from .plain_lanes import LANES, QUAD

__all__ = [
    "LANES",
    "PLAIN",
    "QUAD",
    "accumulate_lanes",
    "add_lanes",
    "borrowed",
    "multiply_quads",
    "set_lanes",
]


def chosen() -> ModuleType:
    """The module whose sums are used."""
    if os.environ.get("AGFB_PLAIN_LANES", "0") != "0":
        return plain_lanes
    try:
        from . import vector_lanes
    except (ImportError, AttributeError, TypeError, RuntimeError, errors.NumbaError):
        return plain_lanes
    return vector_lanes


_SUMS = chosen()
PLAIN = _SUMS is plain_lanes
set_lanes, add_lanes, accumulate_lanes = _SUMS.set_lanes, _SUMS.add_lanes, _SUMS.accumulate_lanes
borrowed, multiply_quads = _SUMS.borrowed, _SUMS.multiply_quads
