"""A forced reaction-diffusion chain through the same engine: the problem on which collocation was measured.

Brusselator of n cells (Prigogine and Lefever, 1968) on a line of length one, both ends held at the
equilibrium (A, B/A), forced through the supply of all cells, h = 1/(n + 1):

    u_i' = A (1 + F cos phase) + u_i^2 v_i - (B + 1) u_i + D_u (u_{i-1} - 2 u_i + u_{i+1})/h^2
    v_i' = B u_i - u_i^2 v_i + D_v (v_{i-1} - 2 v_i + v_{i+1})/h^2

A = 2, D_u = 0.008, D_v = 0.004 are the constants with which its Hopf bifurcation is usually studied, at
B = 1 + A^2 + pi^2 (D_u + D_v) = 5.12 for a fine chain.  B is continued from 4.6, below it, so that the
equilibrium leads to the stroboscopic cycle; F = 0.2 at the forcing frequency 1.5.  The ends make the cycle
vary along the chain, and its stiffness grows with n^2.  State {u_1, v_1, u_2, v_2, ...}, N = 2 n.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numba import njit

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchState, ContinuationOptions
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.machine.kernels import FACTORISE, RATES, SOLVE, TANGENT
from pipelines.machine.lanes import LANES, set_lanes
from pipelines.machine.rates import UNSIGNED
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import ESDIRK5
from pipelines.orbits.system import DynamicalSystem, ShiftedSolver
from pipelines.stages.cycles.problem import BUFFER_COLUMNS, INITIAL_COLUMNS, ORBIT_SAMPLES
from tests.benchmarks.measuring import Measurement, growth_exponent
from tests.benchmarks.settings import Settings

SUPPLY, FORCING, DIFFUSION_U, DIFFUSION_V = 2.0, 0.2, 0.008, 0.004
START, FREQUENCY = 4.6, 1.5
STEP = 0.004
NAMES = ("B", "frequency")
PER_SQUARE = 0  # the one constant: 1/h^2


@njit(cache=True)
def _neighbours(s, i, by_supply):  # type: ignore[no-untyped-def]
    """u and v of the cells before and after cell i; an end holds (A, B/A)."""
    n = s.size // 2
    u_before, v_before = (s[2 * i - 2], s[2 * i - 1]) if i > 0 else (SUPPLY, by_supply)
    u_after, v_after = (s[2 * i + 2], s[2 * i + 3]) if i + 1 < n else (SUPPLY, by_supply)
    return u_before + u_after, v_before + v_after


@njit(RATES, cache=True)
def chain_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    scale, b = constants[PER_SQUARE], p[0]
    supply = SUPPLY * (1.0 + FORCING * np.cos(phase))
    for i in range(s.size // 2):
        u, v = s[2 * i], s[2 * i + 1]
        beside_u, beside_v = _neighbours(s, i, b / SUPPLY)
        reaction = u * u * v
        out[2 * i] = supply + reaction - (b + 1.0) * u + DIFFUSION_U * scale * (beside_u - 2.0 * u)
        out[2 * i + 1] = b * u - reaction + DIFFUSION_V * scale * (beside_v - 2.0 * v)


@njit(TANGENT, cache=True)
def chain_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    n, b = s.size // 2, p[0]
    by_u, by_v = DIFFUSION_U * constants[PER_SQUARE], DIFFUSION_V * constants[PER_SQUARE]
    for i in range(n):
        uv, uu = 2.0 * s[2 * i] * s[2 * i + 1], s[2 * i] * s[2 * i]
        for c in range(block.shape[1]):
            du, dv = block[2 * i, c], block[2 * i + 1, c]
            spread_u, spread_v = -2.0 * du, -2.0 * dv
            if i > 0:
                spread_u += block[2 * i - 2, c]
                spread_v += block[2 * i - 1, c]
            if i + 1 < n:
                spread_u += block[2 * i + 2, c]
                spread_v += block[2 * i + 3, c]
            out[2 * i, c] = (uv - b - 1.0) * du + uu * dv + by_u * spread_u
            out[2 * i + 1, c] = (b - uv) * du - uu * dv + by_v * spread_v


@njit(FACTORISE, cache=True)
def chain_factorise(phase, s, p, shift, constants, layout, work, factors):  # type: ignore[no-untyped-def]
    """D_i <- D_i - U D_{i-1}^-1 U with U = -shift diag(D_u, D_v)/h^2; the inverses, 4 numbers a cell, and
    U.
    """
    n, b = s.size // 2, p[0]
    u, v = -shift * DIFFUSION_U * constants[PER_SQUARE], -shift * DIFFUSION_V * constants[PER_SQUARE]
    factors[4 * n], factors[4 * n + 1] = u, v
    for i in range(n):
        uv, uu = 2.0 * s[2 * i] * s[2 * i + 1], s[2 * i] * s[2 * i]
        a11, a12 = 1.0 - shift * (uv - b - 1.0) - 2.0 * u, -shift * uu
        a21, a22 = -shift * (b - uv), 1.0 + shift * uu - 2.0 * v
        if i > 0:
            before = factors[4 * i - 4 : 4 * i]
            a11 -= u * before[0] * u
            a12 -= u * before[1] * v
            a21 -= v * before[2] * u
            a22 -= v * before[3] * v
        determinant = a11 * a22 - a12 * a21
        own = factors[4 * i : 4 * i + 4]
        own[0], own[1] = a22 / determinant, -a12 / determinant
        own[2], own[3] = -a21 / determinant, a11 / determinant


@njit(SOLVE, cache=True)
def chain_solve(factors, constants, layout, work, lines):  # type: ignore[no-untyped-def]
    w, two = UNSIGNED(LANES), UNSIGNED(2)
    n = UNSIGNED(lines.size) // (two * w)
    u, v = factors[4 * n], factors[4 * n + UNSIGNED(1)]
    zero, cell = UNSIGNED(0), two * w
    for i in range(n):  # y_i = D_i^-1 (b_i - U y_{i-1})
        own, at = factors[4 * i : 4 * i + 4], i * cell
        before, present = (at - cell, 1.0) if i > 0 else (at, 0.0)
        set_lanes(work, zero, (1.0, -u * present), lines, (at, before))
        set_lanes(work, w, (1.0, -v * present), lines, (at + w, before + w))
        set_lanes(lines, at, (own[0], own[1]), work, (zero, w))
        set_lanes(lines, at + w, (own[2], own[3]), work, (zero, w))
    for back in range(UNSIGNED(1), n):  # x_i = y_i - D_i^-1 U x_{i+1}
        i = n - UNSIGNED(1) - back
        own, at = factors[4 * i : 4 * i + 4], i * cell
        after = at + cell
        set_lanes(lines, at, (1.0, -u * own[0], -v * own[1]), lines, (at, after, after + w))
        set_lanes(lines, at + w, (1.0, -u * own[2], -v * own[3]), lines, (at + w, after, after + w))


def chain(cells: int) -> DynamicalSystem:
    """The chain of ``cells`` cells, parameters (B, frequency)."""
    return DynamicalSystem(
        2 * cells, chain_rates, chain_tangent, NAMES, forcing=1,
        constants=np.array([(cells + 1.0) ** 2]), work_size=2 * LANES,
        shifted=ShiftedSolver(chain_factorise, chain_solve, 4 * cells + 2),
    )  # fmt: skip


def brusselator(settings: Settings) -> list[Measurement]:
    """Time per branch point, with all slow multipliers, over N."""
    times, rows = [], []
    for size in settings.chains:
        walk = _walk(size // 2, settings.chain_points)
        times.append(walk.seconds)
        what = (
            f"informative: time per branch point, N = {size}, {walk.steps} steps per period, "
            f"{walk.multipliers} slow multipliers"
        )
        rows.append(Measurement(f"brusselator_{size}", 1e3 * walk.seconds, "ms", what))
    what = "slope of log(time per branch point) over log(N); AUTO-07p elsewhere: 1.46 s at N = 160, 2.5"
    return [Measurement("brusselator_exponent", growth_exponent(settings.chains, times), "1", what), *rows]


@dataclass(frozen=True)
class _Walk:
    """Median CPU time [s] of the points after the first; steps and multipliers above 1e-3 of the last one."""

    seconds: float
    steps: int
    multipliers: int


def _walk(cells: int, points: int) -> _Walk:
    problem = CycleProblem(
        PeriodMap(chain(cells), ESDIRK5, samples=ORBIT_SAMPLES),
        np.array([START, FREQUENCY]),
        "B",
        ShootingOptions(basis=BasisOptions(buffer=BUFFER_COLUMNS, initial_columns=INITIAL_COLUMNS)),
    )
    marks: list[float] = []
    last: list[tuple[int, int]] = []

    def record(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        marks.append(time.process_time())
        slow = np.abs(state.multipliers) > problem.options.basis.multiplier_cut
        last[:] = [(state.steps, int(np.count_nonzero(slow)))]

    step = STEP * math.sqrt(cells)  # the same change of B for every n: arclength is not divided by n
    options = ContinuationOptions(
        (4.0, 6.0), step=step, maximum_step=step, max_points=points + 1, detection=DetectionOptions(kinds=())
    )
    equilibrium = np.tile([SUPPLY, START / SUPPLY], cells)
    continue_branch(problem, BranchStart(equilibrium, START), options, record)
    assert len(marks) == points + 1
    return _Walk(float(np.median(np.diff(marks))), *last[0])
