"""How many time steps a period needs.

An explicit stepper needs as many as keep it stable, which the spectral radius along the orbit tells; its
error is far smaller then.  An L-stable implicit one is stable anyway: its steps follow from a tolerance on
the Floquet multipliers.  With n and with n/2 steps of order p

    |mu_n - mu| = |mu_n - mu_{n/2}| / (2^p - 1),    n_needed = n (|mu_n - mu| / tolerance)^(1/p)

A clipped film whose pressure touches the ambient line without a slope is not smooth in time; then more
steps help little, their number is limited, and the error that is left is told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipelines.orbits.period_map import PeriodImage, PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, ShootingOptions, Unknowns
from pipelines.orbits.steppers import ImplicitStepper
from pipelines.orbits.system import Matrix, Vector

_FEWEST = 16  # steps of a forcing period
_MOST = 1 << 16  # steps with which the search for a first number gives up
_RESOLVED = 1e-3  # change of phi(s) on halving the steps below which a correction can start
_ENOUGH = (
    400  # steps of a forcing period that are chosen at most; beyond, kinks of the clipped film rule the error
)
_MARGIN = 1.1  # steps beyond the need
_TOO_MANY = 0.7  # share of the steps in use below which fewer are taken


@dataclass(frozen=True)
class StepDemand:
    """``steps`` that meet the tolerance, and the estimated ``error`` of the multipliers with those in use:
    NaN for an explicit stepper.
    """

    steps: int
    error: float


def first_steps(problem: CycleProblem, guess: Unknowns) -> int:
    """Steps per period with which to correct a guess that is not yet a cycle."""
    period_map, guess = problem.period_map, problem.consistent(guess)
    parameters = problem.parameters_at(guess.parameter)
    if period_map.steps_per_period is not None or not isinstance(period_map.stepper, ImplicitStepper):
        orbit = np.tile(guess.state, (period_map.samples, 1))
        return _stable_steps(period_map, orbit, parameters, guess.period)
    steps = 2 * _FEWEST * period_map.turns
    coarse = period_map.evaluate(guess.state, parameters, guess.period, steps)
    while steps < _MOST:
        steps *= 2
        fine = period_map.evaluate(guess.state, parameters, guess.period, steps)
        resolved = _RESOLVED * period_map.scale(fine.orbit)
        if fine.finite and coarse.finite and np.max(np.abs(fine.state - coarse.state)) <= resolved:
            return steps // 2
        coarse = fine
    return steps


def step_demand(problem: CycleProblem, cycle: Cycle) -> StepDemand:
    """The steps that a corrected cycle asks for."""
    at = cycle.unknowns
    return demand_at(
        problem.period_map, problem.options, at.state, cycle.parameters, at.period, cycle.steps, cycle.basis,
        cycle.image,
    )  # fmt: skip


def demand_at(
    period_map: PeriodMap,
    options: ShootingOptions,
    state: Vector,
    parameters: Vector,
    period: float,
    steps: int,
    basis: Matrix,
    image: PeriodImage,
) -> StepDemand:
    """The same from a periodic state and its pass with ``steps``, whose columns begin with ``basis``."""
    stepper = period_map.stepper
    if not isinstance(stepper, ImplicitStepper):
        return StepDemand(_stable_steps(period_map, image.orbit, parameters, period), math.nan)
    half = max(1, steps // 2)
    coarse = period_map.evaluate(state, parameters, period, half, basis, once=True)
    if not coarse.finite:
        return StepDemand(min(2 * steps, _ENOUGH * period_map.turns), math.inf)
    fine = basis.T @ image.columns[:, : basis.shape[1]]
    change = _largest_change(fine, basis.T @ coarse.columns, options.checked_modulus)
    error = change / ((steps / half) ** stepper.order - 1.0)
    if period_map.steps_per_period is not None:
        return StepDemand(steps, error)
    return StepDemand(_wanted_steps(period_map, options, steps, error), error)


def following_steps(problem: CycleProblem, steps: int, error: float) -> int:
    """Steps for the next cycle: fewer when those in use leave far less than the tolerance, more when they
    leave more.
    """
    period_map, stepper = problem.period_map, problem.period_map.stepper
    fixed = period_map.steps_per_period is not None or not isinstance(stepper, ImplicitStepper)
    if fixed or not math.isfinite(error):
        return steps
    wanted = _wanted_steps(period_map, problem.options, steps, error)
    return wanted if wanted < _TOO_MANY * steps or wanted > steps else steps


def _wanted_steps(period_map: PeriodMap, options: ShootingOptions, steps: int, error: float) -> int:
    relative = error / options.step_tolerance
    needed = math.ceil(_MARGIN * steps * relative ** (1.0 / period_map.stepper.order))
    return min(max(_FEWEST, needed // period_map.turns + 1), _ENOUGH) * period_map.turns


def _stable_steps(period_map: PeriodMap, orbit: Matrix, parameters: Vector, period: float) -> int:
    if period_map.steps_per_period is not None:
        return period_map.steps_for(0.0, period)
    return period_map.steps_for(period_map.spectral_radius(orbit, parameters), period)


def _largest_change(fine: Matrix, coarse: Matrix, modulus: float) -> float:
    """From an eigenvalue above ``modulus`` of one projected monodromy matrix to the nearest of the other."""
    found, other = np.linalg.eigvals(fine), np.linalg.eigvals(coarse)
    found = found[np.abs(found) > modulus]
    if found.size == 0:
        return 0.0
    return float(np.max(np.min(np.abs(found[:, None] - other[None, :]), axis=1)))
