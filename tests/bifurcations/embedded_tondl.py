"""Tondl's system driving a crowd of relaxing states: a large system with the same small bifurcations."""

from __future__ import annotations

import numpy as np
from numba import njit

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem
from tests.systems import tondl_rates, tondl_tangent


@njit(RATES, cache=True)
def rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    tondl_rates(phase, s, p, constants, layout, work, out)
    crowd = s.shape[0] - 4
    for k in range(crowd):
        angle = 2.0 * np.pi * k / crowd
        drive = np.cos(angle) * s[0] + np.sin(2.0 * angle) * s[3] + 0.5 * s[2]
        out[4 + k] = -constants[k] * (s[4 + k] + 0.1 * s[4 + k] * s[4 + k]) + drive
        out[2] += p[2] * np.cos(angle + 0.5) * s[4 + k] / crowd
        out[3] += p[2] * np.sin(2.0 * angle + 0.3) * s[4 + k] / crowd


@njit(TANGENT, cache=True)
def tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    tondl_tangent(phase, s, block, p, constants, layout, work, out)
    crowd = s.shape[0] - 4
    for k in range(crowd):
        angle = 2.0 * np.pi * k / crowd
        rate = constants[k] * (1.0 + 0.2 * s[4 + k])
        for j in range(block.shape[1]):
            drive = np.cos(angle) * block[0, j] + np.sin(2.0 * angle) * block[3, j] + 0.5 * block[2, j]
            out[4 + k, j] = -rate * block[4 + k, j] + drive
            out[2, j] += p[2] * np.cos(angle + 0.5) * block[4 + k, j] / crowd
            out[3, j] += p[2] * np.sin(2.0 * angle + 0.3) * block[4 + k, j] / crowd


def embedded_tondl(crowd: int = 60, rate: float = 1.2) -> DynamicalSystem:
    """State (x1, x2, v1, v2, r_1 ...), parameters (c1, eta, feedback).

    The relaxing states are nonlinear and driven by the oscillators, with rates within one percent of
    ``rate`` and four slower ones.  Without feedback the bifurcations are those of Tondl's system, although
    no eigenvector is; with feedback nothing is known in advance.
    """
    rates_of = rate * (1.0 + 0.01 * np.cos(7.0 * np.arange(crowd)))
    rates_of[:4] = (0.25 * rate * (1.0 + 0.3 * np.arange(4)))[:crowd]
    return DynamicalSystem(
        4 + crowd, rates, tangent, ("c1", "eta", "feedback"), forcing=1, constants=rates_of
    )
