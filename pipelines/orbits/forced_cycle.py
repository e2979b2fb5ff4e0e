"""A cycle of a forced system with its leading multipliers, found alone: without a cycle beside it.

Harmonic balance gives the cycle, one pass over the period with the slow modes of the system at rest its
multipliers.  The pass also tells by how much the cycle misses: where that is too much, harmonics are doubled,
and at last Newton's method corrects it.  A pass with half as many time steps and the few columns of the
leading multipliers tells their error, and how many steps are needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from pipelines.orbits.floquet import orthonormal
from pipelines.orbits.harmonic_balance import HarmonicCycle, HarmonicOptions, RestingSystem, harmonic_balance
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.shooting import (
    Cycle,
    CycleProblem,
    NewtonStop,
    Unknowns,
    correct,
    with_converged_multipliers,
)
from pipelines.orbits.steppers import ImplicitStepper
from pipelines.orbits.system import Matrix, Vector, size_of
from pipelines.orbits.time_steps import halved_change, steps_stable_at

_FEWEST = 12  # time steps of a forcing period
_MARGIN = 1.2  # steps beyond the need
_MOST = 512  # time steps with which their error is accepted as it is
_SAFE_ORDER = 4  # of the convergence with the time steps: kinks spoil the order of the stepper
_LAST = 4.0  # size of the last harmonic, in tolerated misses, beyond which those left out miss too much
_SHARE = 0.05  # of the tolerated miss: the last update of the harmonic balance
_ATTEMPTS = 8  # of Newton's method on the way from the cycle beside
_USABLE = 0.1  # miss, or update of the harmonic balance, beyond which a state is no guess


class Method(Enum):
    """How a cycle was found."""

    HARMONIC_BALANCE = "harmonic balance"
    NEWTON = "Newton's method"


@dataclass(frozen=True)
class ForcedCycleOptions:
    """How a cycle is sought.

    ``harmonics`` at so many ``phases``; ``tolerance``: miss phi(s) - s of the harmonic balance that is
    accepted, relative to the largest state of the orbit; ``columns``: size of the slow subspace.
    """

    harmonics: int = 3
    phases: int = 10
    tolerance: float = 5e-4
    columns: int = 24


@dataclass(frozen=True)
class ForcedCycle:
    """A cycle, how it was found, and the likely error that the time steps leave in its leading multipliers.

    ``cycle.residual`` is its miss; the error is infinite where half the steps are too few to tell.
    """

    cycle: Cycle
    method: Method
    step_error: float


@dataclass(frozen=True)
class _Trial:
    """A pass from a state that may lie on a cycle, with M ``basis``, and by how much it misses."""

    unknowns: Unknowns
    basis: Matrix
    image: PeriodImage
    miss: float


def forced_cycle(
    problem: CycleProblem,
    resting: RestingSystem,
    options: ForcedCycleOptions,
    beside: ForcedCycle | None = None,
) -> ForcedCycle | NewtonStop:
    """The cycle of a problem at its own parameters, or why Newton's method found none.

    ``beside``: the cycle at other parameters, another guess.  The tolerances of multipliers and time steps
    are those of ``problem.options``.  Raises ValueError for an unknown period.
    """
    if problem.period_map.autonomous:
        raise ValueError("a forced cycle has the period of its forcing: use the stroboscopic formulation")
    steps = _first_steps(problem, resting.state, beside)
    found = _first_cycle(problem, resting, options, beside, steps)
    while isinstance(found, ForcedCycle):
        if found.step_error <= problem.options.step_tolerance or _has_most_steps(problem, found.cycle):
            break
        found = _with_more_steps(problem, options, found)
    return found


def _first_steps(problem: CycleProblem, state: Vector, beside: ForcedCycle | None) -> int:
    """Time steps of the first pass: those that the cycle beside needed, if there is one."""
    period_map = problem.period_map
    if period_map.steps_per_period is not None or not isinstance(period_map.stepper, ImplicitStepper):
        return steps_stable_at(problem, _unknowns(problem, state))
    if beside is None:
        return period_map.rounded_steps(2 * _FEWEST * period_map.period_multiple)
    return _needed_steps(problem, beside)


def _needed_steps(problem: CycleProblem, found: ForcedCycle) -> int:
    """Time steps that meet the tolerance, judged by the error of those in use; at most twice as many."""
    relative = found.step_error / problem.options.step_tolerance
    needed = min(_MARGIN * found.cycle.steps * relative ** (1.0 / _SAFE_ORDER), 2.0 * found.cycle.steps)
    return problem.period_map.rounded_steps(max(_FEWEST * problem.period_map.period_multiple, needed))


def _has_most_steps(problem: CycleProblem, cycle: Cycle) -> bool:
    return problem.period_map.steps_per_period is not None or 2 * cycle.steps > _MOST


def _unknowns(problem: CycleProblem, state: Vector) -> Unknowns:
    """A state at the problem's own parameters."""
    return problem.consistent(Unknowns(state, 0.0, float(problem.parameters[problem.index])))


def _balanced(
    problem: CycleProblem, resting: RestingSystem, options: ForcedCycleOptions, basis: Matrix, steps: int
) -> list[_Trial]:
    """Passes from the harmonic balance, the best first.

    Harmonics are doubled where the last one is large already, or where the pass misses.
    """

    def trial(found: HarmonicCycle) -> _Trial:
        return _trial(problem, _unknowns(problem, found.state), basis, steps)

    trials: list[_Trial] = []
    guess = None
    for factor in (1, 2):
        harmonics, phases = factor * options.harmonics, factor * options.phases
        tolerance = HarmonicOptions(harmonics, phases, _SHARE * options.tolerance)
        found = harmonic_balance(problem.period_map.system, resting, problem.parameters, tolerance, guess)
        if not (found.finite and found.update <= _USABLE):
            continue
        guess = found
        if factor == 1 and size_of(found.harmonics[-1]) > _LAST * options.tolerance * size_of(resting.state):
            continue
        trials = sorted([*trials, trial(found)], key=lambda one: one.miss)
        if trials[0].miss <= options.tolerance:
            break
    return trials if trials or guess is None else [trial(guess)]


def _trial(problem: CycleProblem, unknowns: Unknowns, basis: Matrix, steps: int) -> _Trial:
    start = problem.orbit_start(unknowns, steps)
    image = problem.period_map.evaluate(*start, basis, keep_factors=True)
    miss = problem.period_map.residual(unknowns.state, image) if image.finite else math.inf
    return _Trial(unknowns, basis, image, miss)


def _first_cycle(
    problem: CycleProblem,
    resting: RestingSystem,
    options: ForcedCycleOptions,
    beside: ForcedCycle | None,
    steps: int,
) -> ForcedCycle | NewtonStop:
    """The cycle of the best trial, or that of Newton's method from the first guess from which it converges.

    Guesses are the best trial, the cycle beside, followed from its own parameters, and the state at rest.
    """
    basis = resting.slow_basis(options.columns)
    trials = _balanced(problem, resting, options, basis, steps)
    if trials and trials[0].miss <= options.tolerance:
        return _accepted(problem, trials[0])
    found: Cycle | NewtonStop | None = None
    if trials and trials[0].miss <= _USABLE:
        found = _newton(problem, trials[0].unknowns.state, basis, steps)
    if not isinstance(found, Cycle) and beside is not None:
        found = _followed(problem, beside.cycle, steps)
    if not isinstance(found, Cycle):
        found = _newton(problem, resting.state, basis, steps)
    return found if isinstance(found, NewtonStop) else _measured(problem, found, Method.NEWTON)


def _followed(problem: CycleProblem, beside: Cycle, steps: int) -> Cycle | None:
    """The cycle beside, followed from its own parameters; None where it gets lost."""
    begin, end = beside.parameters, problem.parameters
    reached, done, share = beside, 0.0, 1.0
    for _ in range(_ATTEMPTS):
        if done == 1.0:
            break
        ahead = min(1.0, done + share)
        on_the_way = replace(problem, parameters=(1.0 - ahead) * begin + ahead * end)
        found = _newton(on_the_way, reached.unknowns.state, reached.basis, steps)
        if isinstance(found, Cycle):
            reached, done, share = found, ahead, 2.0 * share
        else:
            share *= 0.5
    return reached if done == 1.0 else None


def _accepted(problem: CycleProblem, trial: _Trial) -> ForcedCycle:
    """A trial as a cycle: the multipliers after one subspace iteration, and as many more as they need."""
    basis = trial.basis
    image = trial.image
    if basis.shape[1] < basis.shape[0]:
        basis = orthonormal(image.columns)
        image = problem.period_map.with_columns(image, basis)
    cycle = with_converged_multipliers(problem, trial.unknowns, basis, image, None, trial.miss)
    return _measured(problem, cycle, Method.HARMONIC_BALANCE)


def _newton(problem: CycleProblem, state: Vector, basis: Matrix, steps: int) -> Cycle | NewtonStop:
    """Newton's method from a state."""
    unknowns = _unknowns(problem, state)
    correction = correct(problem, unknowns, problem.fixed_parameter(unknowns.parameter), basis, steps)
    return correction.stop if correction.cycle is None else correction.cycle


def _with_more_steps(
    problem: CycleProblem, options: ForcedCycleOptions, found: ForcedCycle
) -> ForcedCycle | NewtonStop:
    """The same cycle with as many time steps as it seems to need."""
    cycle, steps = found.cycle, _needed_steps(problem, found)
    if found.method is Method.HARMONIC_BALANCE:
        trial = _trial(problem, cycle.unknowns, cycle.basis, steps)
        if trial.miss <= options.tolerance:
            return _accepted(problem, trial)
    again = _newton(problem, cycle.unknowns.state, cycle.basis, steps)
    return again if isinstance(again, NewtonStop) else _measured(problem, again, Method.NEWTON)


def _measured(problem: CycleProblem, cycle: Cycle, method: Method) -> ForcedCycle:
    """A cycle with the error that its time steps leave in its leading multipliers."""
    error = halved_change(problem, cycle) / (2.0**_SAFE_ORDER - 1.0)
    return ForcedCycle(cycle, method, error)
