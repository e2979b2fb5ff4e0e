"""Lorenz's and Roessler's systems, and cycles whose branches cross at a place known in closed form."""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem, ode_system

_SIGMA, _BETA = 10.0, 8.0 / 3.0


@njit(RATES, cache=True)
def lorenz_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = _SIGMA * (s[1] - s[0])
    out[1] = s[0] * (p[0] - s[2]) - s[1]
    out[2] = s[0] * s[1] - _BETA * s[2]


@njit(TANGENT, cache=True)
def lorenz_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = _SIGMA * (block[1, j] - block[0, j])
        out[1, j] = block[0, j] * (p[0] - s[2]) - s[0] * block[2, j] - block[1, j]
        out[2, j] = block[0, j] * s[1] + s[0] * block[1, j] - _BETA * block[2, j]


def lorenz() -> DynamicalSystem:
    """sigma = 10, b = 8/3, parameter rho; symmetric under (x, y, z) -> (-x, -y, z)."""
    return DynamicalSystem(3, lorenz_rates, lorenz_tangent, ("rho",))


@njit(RATES, cache=True)
def roessler_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = -s[1] - s[2]
    out[1] = s[0] + p[0] * s[1]
    out[2] = p[1] + s[2] * (s[0] - p[2])


@njit(TANGENT, cache=True)
def roessler_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = -block[1, j] - block[2, j]
        out[1, j] = block[0, j] + p[0] * block[1, j]
        out[2, j] = s[2] * block[0, j] + (s[0] - p[2]) * block[2, j]


def roessler() -> DynamicalSystem:
    """Parameters (a, b, c)."""
    return DynamicalSystem(3, roessler_rates, roessler_tangent, ("a", "b", "c"))


def crossing_cycles(power: int) -> DynamicalSystem:
    """z' = z (1 - |z|^2 + i (1 + c u)) beside u' = u (lambda - u^power), parameters (lambda, c).

    The cycles have |z| = 1 and T = 2 pi/(1 + c u), with u = 0 or u^power = lambda: a transcritical point
    (power 1) or a pitchfork (power 2) at lambda = 0, where the period is part of the null vector.
    """

    def rates(phase: float, s: Any, p: Any) -> list[float]:
        growth, turn = 1.0 - s[0] ** 2 - s[1] ** 2, 1.0 + p[1] * s[2]
        return [growth * s[0] - turn * s[1], growth * s[1] + turn * s[0], s[2] * (p[0] - s[2] ** power)]

    def jacobian(phase: float, s: Any, p: Any) -> list[list[float]]:
        x, y, u = s
        growth, turn = 1.0 - x * x - y * y, 1.0 + p[1] * u
        return [
            [growth - 2.0 * x * x, -2.0 * x * y - turn, -p[1] * y],
            [turn - 2.0 * x * y, growth - 2.0 * y * y, p[1] * x],
            [0.0, 0.0, p[0] - (power + 1) * u**power],
        ]

    return ode_system(rates, jacobian, 3, ("lambda", "c"))


def forced_pitchfork() -> DynamicalSystem:
    """u' = u (lambda - u^2) beside y' = cos(omega tau) - y + u, parameters (omega, lambda)."""
    return ode_system(
        lambda phase, s, p: [s[0] * (p[1] - s[0] ** 2), math.cos(phase) - s[1] + s[0]],
        lambda phase, s, p: [[p[1] - 3.0 * s[0] ** 2, 0.0], [1.0, -1.0]],
        2,
        ("omega", "lambda"),
        forcing="omega",
    )
