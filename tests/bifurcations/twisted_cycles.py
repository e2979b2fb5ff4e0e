"""Cycles of unknown period around which a pair turns by a whole or half a turn, with known normal forms.

With u = exp(i theta/2) (U + i V) every turn of z = r exp(i theta) changes the signs of U and V.
"""

from __future__ import annotations

from numba import njit

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem


@njit(RATES, cache=True)
def flip_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y, u, v = s
    size = u * u + v * v
    growth, turn = 1.0 - x * x - y * y + p[1] * size, 1.0 + p[2] * size
    mean, half = 0.5 * (p[0] - p[3]) - size, 0.5 * (p[0] + p[3])
    # u' = (i turn/2 + (lambda - kappa)/2 - |u|^2) u + (lambda + kappa)/2 z u*
    out[0] = growth * x - turn * y
    out[1] = growth * y + turn * x
    out[2] = mean * u - 0.5 * turn * v + half * (x * u + y * v)
    out[3] = mean * v + 0.5 * turn * u + half * (y * u - x * v)


@njit(TANGENT, cache=True)
def flip_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y, u, v = s
    size = u * u + v * v
    growth, turn = 1.0 - x * x - y * y + p[1] * size, 1.0 + p[2] * size
    mean, half = 0.5 * (p[0] - p[3]) - size, 0.5 * (p[0] + p[3])
    for j in range(block.shape[1]):
        dx, dy, du, dv = block[0, j], block[1, j], block[2, j], block[3, j]
        ds = 2.0 * (u * du + v * dv)
        dg, dt = -2.0 * (x * dx + y * dy) + p[1] * ds, p[2] * ds
        out[0, j] = growth * dx - turn * dy + dg * x - dt * y
        out[1, j] = growth * dy + turn * dx + dg * y + dt * x
        out[2, j] = (
            mean * du - ds * u - 0.5 * (turn * dv + dt * v) + half * (dx * u + x * du + dy * v + y * dv)
        )
        out[3, j] = (
            mean * dv - ds * v + 0.5 * (turn * du + dt * u) + half * (dy * u + y * du - dx * v - x * dv)
        )


def flip_cycles() -> DynamicalSystem:
    """z' = z (1 - |z|^2 + g |u|^2 + i (1 + c |u|^2)) beside U' = (lambda - |u|^2) U, V' = (-kappa - |u|^2) V.

    Parameters (lambda, g, c, kappa).  The cycle |z| = 1, u = 0 has T = 2 pi and the multipliers 1,
    exp(-4 pi), -exp(lambda T), -exp(-kappa T).  At lambda = 0 slow |z| = 1 + g U^2/2 gives U' = -(1 - kappa
    g/4) U^3, so that b = 2 pi (1 - kappa g/4).
    """
    return DynamicalSystem(4, flip_rates, flip_tangent, ("lambda", "g", "c", "kappa"))


@njit(RATES, cache=True)
def torus_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y, u, v = s
    size = u * u + v * v
    growth, turn = 1.0 - x * x - y * y, 1.0 + p[2] * size
    mean, spin = p[0] - p[3] * size, p[1]
    out[0] = growth * x - turn * y
    out[1] = growth * y + turn * x
    out[2] = mean * u - spin * v
    out[3] = mean * v + spin * u


@njit(TANGENT, cache=True)
def torus_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y, u, v = s
    size = u * u + v * v
    growth, turn = 1.0 - x * x - y * y, 1.0 + p[2] * size
    mean, spin = p[0] - p[3] * size, p[1]
    for j in range(block.shape[1]):
        dx, dy, du, dv = block[0, j], block[1, j], block[2, j], block[3, j]
        ds = 2.0 * (u * du + v * dv)
        dg, dt, dm = -2.0 * (x * dx + y * dy), p[2] * ds, -p[3] * ds
        out[0, j] = growth * dx - turn * dy + dg * x - dt * y
        out[1, j] = growth * dy + turn * dx + dg * y + dt * x
        out[2, j] = mean * du + dm * u - spin * dv
        out[3, j] = mean * dv + dm * v + spin * du


def torus_cycles() -> DynamicalSystem:
    """z' = z (1 - |z|^2) + i z (1 + c |u|^2) beside u' = (delta + i omega - e |u|^2) u.

    Parameters (delta, omega, c, e).  At delta = 0 an orbit with |u| = R returns after 2 pi (1 - c R^2), so
    that u -> u exp(2 pi i omega) (1 - 2 pi (e + i omega c) R^2), and d = -4 pi (e + i omega c) with |u|^2 =
    2 |w|^2.
    """
    return DynamicalSystem(4, torus_rates, torus_tangent, ("delta", "omega", "c", "e"))
