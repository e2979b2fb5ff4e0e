"""How many time steps a period needs, and the error of the multipliers with the steps in use.

An explicit stepper needs at least as many as keep it stable, which the spectral radius along the orbit tells.
The steps of both kinds follow from a tolerance on the Floquet multipliers.  With n and with n/2 steps of
order p

    |mu_n - mu| = |mu_n - mu_{n/2}| / (2^p - 1),    n_needed = n (|mu_n - mu| / tolerance)^(1/p)

A clipped film whose pressure touches the ambient line without a slope is not smooth in time, and what a kink
leaves depends on where the steps fall: no coarser pass tells.  So a pass with r n steps, r = 3/2, must find
the same error,

    |mu_n - mu| = |mu_n - mu_{rn}| / (1 - r^-p),

unless a neighbour with as many steps has been told nearly that error already.

Where it does not, the larger of the two is the likely error, from which the steps follow, and that of first
order, p = 1 in the last line, bounds it and is told.  Where more steps change the multipliers far less than
the order predicts, or more than fewer steps did, the error is unknown: NaN.

The next cycle takes fewer steps where the error predicts that they are enough, or where n/2 steps were.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pipelines.machine.lanes import LANES
from pipelines.orbits.period_map import OrbitStart, PeriodImage, PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, NewtonStop, ShootingOptions, Unknowns
from pipelines.orbits.steppers import ImplicitStepper, Stepper
from pipelines.orbits.system import Matrix, Vector

MOST_STEPS = 1_000_000  # of a period, with which an explicit stepper would be busy for hours
_POWER_PHASES = 8  # phases at which the spectral radius is sampled
_FIRST_POWER_STEPS = 60
_POWER_STEPS = 15
_POWER_WINDOW = 5  # growth factors in the geometric mean: a complex pair makes single ones oscillate
_RADIUS_MARGIN = 1.15  # the power iteration approaches the radius from below
_FEWEST = 16  # steps of a forcing period
_MOST = 1 << 16  # steps with which the search for a first number gives up
_RESOLVED = 1e-3  # change of phi(s) on halving the steps below which a correction can start
_STEP_CAP = 400  # steps of a forcing period: beyond, kinks of the clipped film rule the error
_MARGIN = 1.1  # steps beyond the need
_REDUCE_BELOW = 0.7  # share of the steps in use below which fewer are taken
_FINER = 1.5  # r
_AGREE = 0.1  # relative difference of two estimates of the same error
_NEAR = 0.2  # likewise, of the error at a neighbour; the bound at one with a kink is farther from it
_CONTRADICT = 2.0  # ratio of two changes of the multipliers that no convergence explains
_BOUND = 3.0  # bound of a likely error in units of it
_SEPARATE = 0.99  # ratio of the moduli of two multipliers above which they may be a pair
_ROUNDING = 1e-12  # change of a multiplier that tells nothing

_Mapped = Callable[[Matrix, int], Matrix | None]  # M block with a number of steps; None where they diverge


@dataclass(frozen=True)
class RequiredSteps:
    """The ``steps`` whose likely error meets the tolerance, and the reported ``error`` of the steps in use.

    ``coarser``: likely error of half as many steps.  Errors of the multipliers; NaN where they are unknown.
    """

    steps: int
    error: float
    coarser: float = math.nan


def first_steps(problem: CycleProblem, guess: Unknowns) -> int | NewtonStop:
    """Steps per period with which to correct a guess that is not yet a cycle, or why there are none."""
    period_map = problem.period_map
    if period_map.steps_per_period is not None:
        return period_map.rounded_steps(period_map.steps_per_period)
    if not isinstance(period_map.stepper, ImplicitStepper):
        return _first_stable_steps(problem, guess)
    steps = 2 * _FEWEST * period_map.period_multiple
    start = problem.orbit_start(problem.consistent(guess), steps)
    coarse = period_map.evaluate(*start)
    while steps < _MOST:
        steps *= 2
        fine = period_map.evaluate(*start._replace(steps=steps))
        resolved = _RESOLVED * period_map.scale(fine.orbit)
        if fine.finite and coarse.finite and np.max(np.abs(fine.state - coarse.state)) <= resolved:
            return steps // 2
        coarse = fine
    return steps


def _first_stable_steps(problem: CycleProblem, guess: Unknowns) -> int | NewtonStop:
    """Steps that are stable along their own orbit.

    Starting with what is stable at the first state, and increased until they are.
    """
    period_map, start = problem.period_map, problem.orbit_start(problem.consistent(guess), 1)
    steps, reached = steps_stable_at(problem, guess), -1
    while steps <= MOST_STEPS:
        image = period_map.evaluate(*start._replace(steps=steps))
        known = image.orbit[np.all(np.isfinite(image.orbit), axis=1)]
        if image.finite:
            needed = _stable_along(period_map, known, start)
            if needed <= steps:
                return steps
            steps = min(needed, 2 * steps)
            continue
        if len(known) == reached:  # more steps do not lead farther: it is the orbit that leaves
            return steps
        reached, steps = len(known), 2 * steps
    return NewtonStop.TOO_STIFF


def steps_stable_at(problem: CycleProblem, guess: Unknowns) -> int:
    """Steps per period at which an explicit stepper is stable at the first state of a guess."""
    start = problem.orbit_start(problem.consistent(guess), 1)
    return _stable_along(problem.period_map, np.ascontiguousarray(start.state[None, :]), start)


def stable_steps(period_map: PeriodMap, radius: float, period: float) -> int:
    """Steps per period at which an explicit stepper is stable, or the fixed number where the map has one.

    They keep radius T / steps inside its real stability interval, for the spectral ``radius`` of J.
    """
    steps = period_map.steps_per_period
    if steps is None:
        assert isinstance(period_map.stepper, Stepper)
        stable = _RADIUS_MARGIN * radius * period / period_map.stepper.real_stability_interval
        steps = max(period_map.minimum_steps * period_map.period_multiple, math.ceil(stable))
    return period_map.rounded_steps(steps)


def _stable_along(period_map: PeriodMap, orbit: Matrix, start: OrbitStart) -> int:
    """Steps that are stable along the ``orbit`` (samples, size) from a ``start``."""
    fixed = period_map.steps_per_period is not None
    radius = 0.0 if fixed else spectral_radius(period_map, orbit, start.parameters)
    return stable_steps(period_map, radius, start.period)


def spectral_radius(period_map: PeriodMap, orbit: Matrix, parameters: Vector) -> float:
    """Largest modulus of the eigenvalues of J along the first samples of an orbit, by power iteration.

    The start vector is fixed, so that the same orbit always gives the same number.
    """
    system, radius = period_map.system, 0.0
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    vector: Vector = np.mod(np.arange(1, system.size + 1) * golden, 1.0) - 0.4
    stride = max(1, period_map.samples // _POWER_PHASES)
    for k in range(0, len(orbit), stride):
        phase, state = period_map.phase_at(k, orbit[k]), np.ascontiguousarray(orbit[k, : system.size])
        growth = []
        for _ in range(_FIRST_POWER_STEPS if k == 0 else _POWER_STEPS):
            direction = np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)
            vector = system.tangent_at(phase, state, direction[:, None], parameters)[:, 0]
            growth.append(float(np.linalg.norm(vector)))
            if growth[-1] == 0.0 or not math.isfinite(growth[-1]):
                return radius
        radius = max(radius, math.exp(sum(map(math.log, growth[-_POWER_WINDOW:])) / _POWER_WINDOW))
    return radius


def required_steps(
    problem: CycleProblem, cycle: Cycle, neighbour: RequiredSteps | None = None
) -> RequiredSteps:
    """The steps that a corrected cycle asks for; ``neighbour``: the steps of one nearby, and their error."""
    return required_steps_at(problem.period_map, problem.options, cycle.basis, cycle.image, neighbour)


def required_steps_at(
    period_map: PeriodMap,
    options: ShootingOptions,
    basis: Matrix,
    image: PeriodImage,
    neighbour: RequiredSteps | None = None,
) -> RequiredSteps:
    """The same from the pass of a periodic state, whose columns begin with ``basis``."""
    start, stable = image.start, 0
    steps = start.steps
    if not isinstance(period_map.stepper, ImplicitStepper):
        stable = min(MOST_STEPS, _stable_along(period_map, image.orbit, start))
    projected = basis.T @ image.columns[:, : basis.shape[1]]
    half = period_map.rounded_steps(max(1, steps // 2))
    finer = period_map.rounded_steps(math.ceil(_FINER * steps))

    def mapped(block: Matrix, count: int) -> Matrix | None:
        passed = period_map.evaluate(*start._replace(steps=count), block)
        return passed.columns if passed.finite else None

    halved, coarser = math.nan, math.nan
    if stable <= half < steps:
        halved = _change(mapped, basis, projected, half, options.checked_modulus)
    if math.isinf(halved):
        required, error = max(steps, most_steps(period_map, 2 * steps)), math.nan
    else:
        likely = error = _smooth_error(period_map.stepper.order, steps / half, halved)
        if neighbour is None or neighbour.steps != steps or not _near(error, neighbour.error):
            refined = _cheap_change(mapped, basis, projected, finer, options.checked_modulus)
            likely, error = _errors(
                period_map.stepper.order, (steps / half, halved), (finer / steps, refined)
            )
        required = _steps_for_error(period_map, options, steps, likely) if math.isfinite(likely) else steps
        coarser = halved + likely
    if period_map.steps_per_period is not None:
        return RequiredSteps(steps, error, coarser)
    return RequiredSteps(max(required, stable), error, coarser)


def halved_change(problem: CycleProblem, cycle: Cycle) -> float:
    """Largest change of a cycle's leading multipliers with half the time steps; infinite if those diverge.

    Of as many multipliers as fit into one chunk of columns, where they do not form a larger cluster: it costs
    little more than the orbit.
    """
    period_map, start = problem.period_map, cycle.image.start
    moduli = np.append(np.abs(cycle.spectrum.multipliers), 0.0)
    # the last gap that leaves so few: a pair must not be divided
    gaps = [k for k in range(1, len(moduli)) if moduli[k] < _SEPARATE * moduli[k - 1]] or [1]
    last = max((k for k in gaps if k <= LANES), default=gaps[0])
    least = 0.5 * (moduli[last - 1] + moduli[last])
    half = period_map.rounded_steps(max(1, start.steps // 2))

    def mapped(block: Matrix, count: int) -> Matrix | None:
        passed = period_map.evaluate(*start._replace(steps=count), block)
        return passed.columns if passed.finite else None

    return _cheap_change(mapped, cycle.basis, cycle.basis.T @ cycle.image.columns, half, float(least))


def _errors(order: int, coarser: tuple[float, float], finer: tuple[float, float]) -> tuple[float, float]:
    """The likely error and the reported error, from passes with other numbers of steps.

    From the ratio of the steps and the change of the multipliers with fewer steps (NaN where there is no
    such pass) and with more.
    """
    (fewer, halved), (more, refined) = coarser, finer
    same, bound = refined / (1.0 - more**-order), refined / (1.0 - 1.0 / more)
    if math.isnan(halved):
        return same, bound if math.isfinite(bound) else math.nan
    smooth = _smooth_error(order, fewer, halved)
    if abs(smooth - same) <= _AGREE * max(smooth, same) or max(halved, refined) <= _ROUNDING:
        return smooth, smooth
    contradict = refined > _CONTRADICT * halved or _CONTRADICT * same < smooth
    return max(smooth, same), math.nan if contradict else bound


def _smooth_error(order: int, fewer: float, halved: float) -> float:
    """The error that a change of the multipliers with ``fewer`` times less steps tells; NaN without one."""
    return math.nan if math.isnan(halved) else halved / (fewer**order - 1.0)


def _near(error: float, known: float) -> bool:
    """Whether an error is nearly one that is known; False where one of them is NaN."""
    return abs(error - known) <= _NEAR * max(error, known)


def _change(mapped: _Mapped, basis: Matrix, projected: Matrix, steps: int, modulus: float) -> float:
    """Largest change of a multiplier above ``modulus`` with other ``steps``; infinite if those diverge."""
    columns = mapped(basis, steps)
    if columns is None:
        return math.inf
    return _largest_change(projected, basis.T @ columns, modulus)


def _cheap_change(mapped: _Mapped, basis: Matrix, projected: Matrix, steps: int, modulus: float) -> float:
    """The largest change at the cost of few columns.

    With bases R, L of the dominant invariant subspaces of H = V'MV and of H', the multipliers of another
    M are, up to the square of the change, those of (L'R)^-1 L'V'M V R.
    """
    right, left = (_dominant(matrix, modulus) for matrix in (projected, projected.T))
    if right.shape[1] == 0:
        return 0.0
    columns = mapped(basis @ right, steps)
    if columns is None:
        return math.inf
    other = np.asarray(np.linalg.solve(left.T @ right, left.T @ (basis.T @ columns)), dtype=np.float64)
    return _largest_change(projected, other, modulus)


def _dominant(matrix: Matrix, modulus: float) -> Matrix:
    """Orthonormal basis of the invariant subspace of the eigenvalues above ``modulus``."""
    _, vectors, count = scipy.linalg.schur(matrix, sort=lambda re, im=0.0: math.hypot(re, im) > modulus)
    return np.ascontiguousarray(vectors[:, :count])


def next_steps(problem: CycleProblem, told: RequiredSteps) -> int:
    """Steps for the next cycle, where ``told`` are the steps of the last one with their errors.

    Fewer if the error is far below the tolerance or that of half as many steps meets it, more if it is above.
    An explicit stepper takes no fewer, because stability may require them.
    """
    period_map, options = problem.period_map, problem.options
    steps, error = told.steps, told.error
    if period_map.steps_per_period is not None or not math.isfinite(error):
        return steps
    required = _steps_for_error(period_map, options, steps, error)
    if (
        told.coarser <= options.step_tolerance
    ):  # where kinks rule the error, it falls more slowly than assumed
        required = min(required, _with_margin(period_map, 0.5 * steps))
    fewer = required < _REDUCE_BELOW * steps and isinstance(period_map.stepper, ImplicitStepper)
    more = required > steps and error > _BOUND * options.step_tolerance
    return required if fewer or more else steps


def _steps_for_error(period_map: PeriodMap, options: ShootingOptions, steps: int, error: float) -> int:
    """Steps that meet the tolerance where ``steps`` leave ``error``, with a margin and within limits."""
    relative = error / options.step_tolerance
    return _with_margin(period_map, steps * relative ** (1.0 / period_map.stepper.order))


def most_steps(period_map: PeriodMap, steps: float) -> int:
    """So many steps or as many as a period has at most; the fixed number where the map has one."""
    if period_map.steps_per_period is not None:
        return period_map.rounded_steps(period_map.steps_per_period)
    return period_map.rounded_steps(min(math.ceil(steps), _STEP_CAP * period_map.period_multiple))


def _with_margin(period_map: PeriodMap, steps: float) -> int:
    """Slightly more than ``steps`` within limits."""
    needed, multiple = math.ceil(_MARGIN * steps), period_map.period_multiple
    return period_map.rounded_steps(min(max(_FEWEST, needed // multiple + 1), _STEP_CAP) * multiple)


def _largest_change(fine: Matrix, coarse: Matrix, modulus: float) -> float:
    """Largest distance from an eigenvalue above ``modulus`` of one matrix to those of the other."""
    found, other = np.linalg.eigvals(fine), np.linalg.eigvals(coarse)
    found = found[np.abs(found) > modulus]
    if found.size == 0:
        return 0.0
    return float(np.max(np.min(np.abs(found[:, None] - other[None, :]), axis=1)))
