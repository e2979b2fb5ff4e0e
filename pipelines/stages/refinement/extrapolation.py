"""Estimate of the exact value from three grids: observed order and extrapolation (Richardson).

With spacings h_0 > h_1 > h_2 and a scheme of formal order q,

    (v_0 - v_1)/(v_1 - v_2) = (h_0^p - h_1^p)/(h_1^p - h_2^p)     gives the observed order p,
    v_i = v + a h_i^q + b h_i^2q                                  gives the extrapolated value v

The second term matters on coarse grids, where the observed order is far from the formal one; the difference
to v_i = v + a h_i^q on the two finest grids tells how much v itself may be wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from pipelines.case.arrays import Array

_ORDERS = (1e-3, 16.0)  # between which the observed order is looked for
_CLEAN = (0.5, 3.0)  # observed order / formal order that counts as convergence of that order


@dataclass(frozen=True)
class Extrapolation:
    """The result of an extrapolation.

    ``order``: observed, NaN where the values do not converge monotonically; ``value``: extrapolated,
    with its uncertainty ``error``; ``clean``: whether the order is near enough to the formal one to rely
    on.
    """

    order: float
    value: float
    error: float
    clean: bool


def extrapolate(spacings: Array, values: Array, formal_order: int) -> Extrapolation:
    """Order and limit of three ``values`` (3,) on falling ``spacings`` (3,).

    Raises ValueError for other shapes or spacings that do not fall.
    """
    if spacings.shape != (3,) or values.shape != (3,) or not np.all(np.diff(spacings) < 0.0):
        raise ValueError(f"three values on falling spacings are needed, given {values} on {spacings}")
    order = observed_order(spacings, values)
    q = float(formal_order)
    terms = np.column_stack([np.ones(3), spacings**q, spacings ** (2.0 * q)])
    value = float(np.linalg.solve(terms, values)[0])
    finest = float(np.linalg.solve(terms[1:, :2], values[1:])[0])
    clean = _CLEAN[0] * q <= order <= _CLEAN[1] * q  # False for NaN
    return Extrapolation(order, value, abs(value - finest), clean)


def observed_order(spacings: Array, values: Array) -> float:
    """The order p of this module's docstring; NaN if no order fits."""
    before, after = values[0] - values[1], values[1] - values[2]
    if after == 0.0 or not math.isfinite(before / after):
        return math.nan
    relative = spacings / spacings[0]

    def mismatch(order: float) -> float:
        powers = relative**order
        return float((powers[0] - powers[1]) / (powers[1] - powers[2]) - before / after)

    if mismatch(_ORDERS[0]) > 0.0 or mismatch(_ORDERS[1]) < 0.0:
        return math.nan
    return float(brentq(mismatch, *_ORDERS))
