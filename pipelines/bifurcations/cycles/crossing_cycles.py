"""Where a branch meets the branch that it was born on: at its own period doubling or its own pitchfork.

The two halves of a doubled cycle are apart by

    d = s(0) - s(T/2),

and the branch passes through d = 0 into its mirror image: the same cycles half a period later, with -d.  The
parameter turns there, and a multiplier reaches 1 without crossing it; likewise where a branch of cycles
without a symmetry meets those with it.  The cycles of the other branch cross there, so that the bordered
matrix is singular; therefore the point is located on them, where a multiplier crosses -1 (the cycles of half
the period) or 1 (those with the symmetry).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.interpolate import barycentric_interpolate
from scipy.optimize import root_scalar

from pipelines.bifurcations.cycles.segment import Segment
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, Unknowns, correct, first_basis, reference_of
from pipelines.orbits.system import Vector

_FIRST_MOVE = 1e-3  # of the secant method, in lengths of the segment
_ITERATIONS = 30
_POINTS, _APARTS = 5, (1e-3, 1e-4, 1e-5)  # of the interpolation, and how far their multipliers are apart
_SHARP = 1e-9  # distance of the multiplier from its critical value that is enough
_LOCATED = 1e-4  # and one beyond which the cycle is not the critical one


def halved_map(period_map: PeriodMap) -> PeriodMap | None:
    """The map over half of the period; None where cycles of that period cannot be computed."""
    halves = [period_map.samples, period_map.steps_per_period or 2]
    known = period_map.system.forcing is not None
    if known:
        halves.append(period_map.period_multiple)
    if any(count % 2 for count in halves):
        return None
    return replace(
        period_map,
        period_multiple=period_map.period_multiple // 2 if known else period_map.period_multiple,
        samples=period_map.samples // 2,
        steps_per_period=None if period_map.steps_per_period is None else period_map.steps_per_period // 2,
        minimum_steps=period_map.minimum_steps if known else max(1, period_map.minimum_steps // 2),
    )


def passes_own_doubling(segment: Segment) -> bool:
    """Whether the halves of the cycles change sides between the ends of a segment."""
    if halved_map(segment.problem.period_map) is None:
        return False
    start, problem = segment.start, segment.problem
    before = problem.period_map.evaluate(*problem.orbit_start(start, segment.end.steps))
    return bool(_halves_apart(before.orbit) @ _halves_apart(segment.end.image.orbit) < 0.0)


def own_doubling(segment: Segment) -> Cycle | None:
    """The simple cycle at its period doubling inside a segment; None if it was not found."""
    period_map = halved_map(segment.problem.period_map)
    if period_map is None:
        return None
    return _crossing_cycle(segment, replace(segment.problem, period_map=period_map), 2, -1.0)


def own_pitchfork(segment: Segment) -> Cycle | None:
    """The cycle of the crossing branch at its pitchfork inside a segment; None if it was not found.

    The parameter turns on this segment.
    """
    return _crossing_cycle(segment, segment.problem, 1, 1.0)


def _crossing_cycle(segment: Segment, problem: CycleProblem, parts: int, critical: float) -> Cycle | None:
    """The cycle with the multiplier ``critical`` on the branch that crosses a segment.

    Its period is that of the segment divided by one of ``parts``.
    """
    turn = segment.guess(0.5)
    guess = problem.consistent(Unknowns(turn.state, turn.period / parts, turn.parameter))
    cycles = _CrossingCycles(problem, guess, segment.end.steps // parts, critical)
    # on the side that the branch does not reach there are the crossing cycles alone
    outwards = 1.0 if segment.start_tangent.parameter > 0.0 else -1.0
    move = outwards * _FIRST_MOVE * segment.length / math.sqrt(float(segment.metric.parameters))
    try:
        root = root_scalar(
            cycles.test,
            x0=guess.parameter + 2.0 * move,
            x1=guess.parameter + move,
            method="secant",
            xtol=_FIRST_MOVE * abs(move),
            maxiter=_ITERATIONS,
        )
    except _NotFoundError:
        return None
    cycle = cycles.critical(root.root, move) if root.converged else None
    if cycle is None:
        return None
    at = cycle.unknowns
    away = segment.metric.norm(Unknowns(at.state, parts * at.period, at.parameter).minus(turn))
    return cycle if away <= segment.length else None


class _NotFoundError(Exception):
    """A cycle of the crossing branch did not converge."""


class _CrossingCycles:
    """Cycles along the parameter, each corrected from the last one.

    The test function is the distance of the nearest multiplier from ``critical``.
    """

    def __init__(self, problem: CycleProblem, guess: Unknowns, steps: int, critical: float) -> None:
        self._problem, self._guess, self._steps = problem, guess, max(1, steps)
        self._critical = critical
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

    def critical(self, near: float, move: float) -> Cycle | None:
        """The cycle where the test function vanishes, from cycles on the side of ``move``.

        The search begins ``near`` a parameter.  Cycles farther away are less disturbed by the other branch,
        but nearer ones lie more nearly on a line.
        """
        found: list[tuple[float, Cycle]] = []
        try:
            slope = self.test(near + move) / move
            for distance in _APARTS if slope else ():
                apart = math.copysign(distance / abs(slope), move)
                cycle = self.interpolated(near + apart * np.arange(1.0, _POINTS + 1.0))
                found.append((abs(self.test(cycle.unknowns.parameter)), cycle))
                if found[-1][0] <= _SHARP:
                    break
        except _NotFoundError:
            pass
        error, best = min(found, key=lambda pair: pair[0], default=(math.inf, None))
        return best if error <= _LOCATED else None

    def interpolated(self, parameters: Vector) -> Cycle:
        """The cycle where the test function vanishes, interpolated between cycles a little farther out.

        Close to a pitchfork the corrector leaves an amplitude of the other branch, which grows
        towards it.
        """
        tests = np.array([self.test(float(parameter)) for parameter in parameters[::-1]])[::-1]
        found = float(barycentric_interpolate(tests, parameters, 0.0))
        places = [self.at(float(parameter)).unknowns for parameter in parameters[::-1]][::-1]
        states = np.array([place.state for place in places])
        periods = np.array([place.period for place in places])
        self._guess = Unknowns(
            barycentric_interpolate(parameters, states, found, axis=0),
            float(barycentric_interpolate(parameters, periods, found)),
            found,
        )
        return self.at(found)

    def test(self, parameter: float) -> float:
        multipliers = self.at(parameter).spectrum.multipliers
        if self._problem.period_map.autonomous:  # without the trivial one
            multipliers = np.delete(multipliers, int(np.argmin(np.abs(multipliers - 1.0))))
        return float((multipliers[np.argmin(np.abs(multipliers - self._critical))] - self._critical).real)


def _halves_apart(orbit: Vector) -> Vector:
    return np.asarray(orbit[0] - orbit[len(orbit) // 2])
