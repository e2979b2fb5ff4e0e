"""An autonomous system whose cycles, their folds, cusp and Neimark-Sacker points are known in closed form."""

from __future__ import annotations

from numba import njit

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem


@njit(RATES, cache=True)
def rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    excess = s[0] ** 2 + s[1] ** 2 - 1.0
    growth = p[0] + p[1] * excess - excess**3
    turn = 1.0 + p[4] * excess
    damping = p[2] - s[2] ** 2 - s[3] ** 2
    out[0] = growth * s[0] - turn * s[1]
    out[1] = growth * s[1] + turn * s[0]
    out[2] = damping * s[2] - p[3] * s[3]
    out[3] = damping * s[3] + p[3] * s[2]


@njit(TANGENT, cache=True)
def tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    excess = s[0] ** 2 + s[1] ** 2 - 1.0
    growth = p[0] + p[1] * excess - excess**3
    turn = 1.0 + p[4] * excess
    damping = p[2] - s[2] ** 2 - s[3] ** 2
    for j in range(block.shape[1]):
        d = 2.0 * (s[0] * block[0, j] + s[1] * block[1, j])
        dg, dt = (p[1] - 3.0 * excess**2) * d, p[4] * d
        dd = -2.0 * (s[2] * block[2, j] + s[3] * block[3, j])
        out[0, j] = growth * block[0, j] - turn * block[1, j] + dg * s[0] - dt * s[1]
        out[1, j] = growth * block[1, j] + turn * block[0, j] + dg * s[1] + dt * s[0]
        out[2, j] = damping * block[2, j] - p[3] * block[3, j] + dd * s[2]
        out[3, j] = damping * block[3, j] + p[3] * block[2, j] + dd * s[3]


def polar_cycles() -> DynamicalSystem:
    """z' = z (m + n e - e^3 + i (1 + b e)), e = |z|^2 - 1, beside u' = (delta + i omega - |u|^2) u.

    Parameters (m, n, delta, omega, b).  Cycles have m + n e = e^3 and T = 2 pi/(1 + b e); they fold at
    n = 3 e^2, m = -2 e^3 with a cusp at m = n = 0.  With u = 0 the pair is exp((delta +- i omega) T):
    Neimark-Sacker at delta = 0 with theta = omega T.
    """
    return DynamicalSystem(4, rates, tangent, ("m", "n", "delta", "omega", "b"))
