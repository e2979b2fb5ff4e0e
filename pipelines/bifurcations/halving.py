"""Where a branch of doubled cycles meets the cycle of half their period: at its own period doubling.

The two halves of a doubled cycle are apart by

    d = s(0) - s(T/2),

and the branch passes through d = 0 into its mirror image: the same cycles half a period later, with -d.  The
parameter turns there, and a multiplier reaches 1 without crossing it.  The simple cycles cross the branch, so
that its bordered matrix is singular; therefore the point is located on the simple cycles, where a multiplier
crosses -1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import root_scalar

from pipelines.bifurcations.segment import Segment
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, Unknowns, correct, first_basis, reference_of
from pipelines.orbits.system import Vector

_FIRST_MOVE = 1e-3  # of the secant method, in lengths of the segment
_ITERATIONS = 30


def halved_map(period_map: PeriodMap) -> PeriodMap | None:
    """The map over half of the period; None where a cycle of that period cannot be told."""
    halves = [period_map.samples, period_map.steps_per_period or 2]
    known = period_map.system.forcing is not None
    if known:
        halves.append(period_map.turns)
    if any(count % 2 for count in halves):
        return None
    return replace(
        period_map,
        turns=period_map.turns // 2 if known else period_map.turns,
        samples=period_map.samples // 2,
        steps_per_period=None if period_map.steps_per_period is None else period_map.steps_per_period // 2,
        minimum_steps=period_map.minimum_steps if known else max(1, period_map.minimum_steps // 2),
    )


def passes_own_doubling(segment: Segment) -> bool:
    """Whether the halves of the cycles change sides between the ends of a segment."""
    if halved_map(segment.problem.period_map) is None:
        return False
    start, problem = segment.start, segment.problem
    parameters = problem.parameters_at(start.parameter)
    before = problem.period_map.evaluate(start.state, parameters, start.period, segment.end.steps)
    return bool(_halves_apart(before.orbit) @ _halves_apart(segment.end.image.orbit) < 0.0)


def own_doubling(segment: Segment, width: float) -> Cycle | None:
    """The simple cycle at its period doubling inside a segment, to ``width`` of the parameter; None when it
    was not found there.
    """
    period_map = halved_map(segment.problem.period_map)
    if period_map is None:
        return None
    problem = replace(segment.problem, period_map=period_map)
    guess = segment.guess(0.5)
    guess = problem.consistent(Unknowns(guess.state, 0.5 * guess.period, guess.parameter))
    cycles = _SimpleCycles(problem, guess, segment.end.steps // 2)
    move = _FIRST_MOVE * segment.length / segment.metric.parameter**0.5
    try:
        root = root_scalar(
            cycles.test,
            x0=guess.parameter,
            x1=guess.parameter + move,
            method="secant",
            xtol=width,
            rtol=4.0 * np.finfo(float).eps,
            maxiter=_ITERATIONS,
        )
        cycle = cycles.at(float(root.root))
    except _NotFoundError:
        return None
    away = Unknowns(cycle.unknowns.state, 2.0 * cycle.unknowns.period, cycle.unknowns.parameter)
    near = segment.metric.norm(away.minus(segment.guess(0.5))) <= segment.length
    return cycle if root.converged and near else None


class _NotFoundError(Exception):
    """A simple cycle did not converge."""


class _SimpleCycles:
    """Simple cycles by the parameter, each corrected from the last one."""

    def __init__(self, problem: CycleProblem, guess: Unknowns, steps: int) -> None:
        self._problem, self._guess, self._steps = problem, guess, max(1, steps)
        self._basis = first_basis(problem, guess, self._steps)
        self._reference = reference_of(problem, guess, self._steps)

    def at(self, parameter: float) -> Cycle:
        problem = self._problem
        constraint = problem.fixed_parameter(parameter)
        guess = replace(self._guess, parameter=parameter)
        cycle = correct(problem, guess, constraint, self._basis, self._steps, self._reference).cycle
        if cycle is None:
            raise _NotFoundError
        self._guess, self._basis = cycle.unknowns, cycle.basis
        return cycle

    def test(self, parameter: float) -> float:
        """1 + mu of the real multiplier nearest to -1."""
        multipliers = self.at(parameter).spectrum.multipliers
        return float(1.0 + multipliers[np.argmin(np.abs(multipliers + 1.0))].real)


def _halves_apart(orbit: Vector) -> Vector:
    return np.asarray(orbit[0] - orbit[len(orbit) // 2])
