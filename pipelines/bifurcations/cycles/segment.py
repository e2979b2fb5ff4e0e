"""The metric of a branch and the piece of it between two neighbouring cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipelines.bifurcations.continuation import hermite_slopes, hermite_weights
from pipelines.orbits.floquet import Complex
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import (
    Constraint,
    Correction,
    Cycle,
    CycleProblem,
    Unknowns,
    correct,
)
from pipelines.orbits.system import Matrix


@dataclass(frozen=True)
class Metric:
    """<u, v> = <u_s, v_s>/N + T_u T_v/T_scale^2 + l_u l_v/scale^2; T counts only when it is unknown.

    The mean square of the state makes a step mean the same on every grid.
    """

    state: float
    period: float
    parameter: float

    def row(self, direction: Unknowns) -> Unknowns:
        """The row vector w with w . v = <direction, v>."""
        return Unknowns(
            self.state * direction.state, self.period * direction.period, self.parameter * direction.parameter
        )

    def inner(self, left: Unknowns, right: Unknowns) -> float:
        return self.row(left).dot(right)

    def norm(self, direction: Unknowns) -> float:
        return float(self.inner(direction, direction) ** 0.5)


def metric_of(problem: CycleProblem, parameter_scale: float, period_scale: float = 2.0 * math.pi) -> Metric:
    """The metric for a problem; the scales are changes of parameter and period that count as one."""
    period = 1.0 / period_scale**2 if problem.period_map.autonomous else 0.0
    return Metric(1.0 / problem.period_map.size, period, 1.0 / parameter_scale**2)


@dataclass(frozen=True)
class Segment:
    """The branch between two corrected cycles with their unit tangents, both discretised with ``end.steps``.

    ``basis`` and ``reference``: slow subspace and phase condition for the cycles between them.
    A fraction in [0, 1] names the cycle in the plane <chord, u - u_0> = fraction <chord, chord>.
    """

    problem: CycleProblem
    metric: Metric
    start: Unknowns
    start_tangent: Unknowns
    start_multipliers: Complex
    end: Cycle
    end_tangent: Unknowns
    basis: Matrix
    reference: PhaseReference | None

    @property
    def chord(self) -> Unknowns:
        return self.end.unknowns.minus(self.start)

    @property
    def length(self) -> float:
        return self.metric.norm(self.chord)

    def guess(self, fraction: float) -> Unknowns:
        """Cubic Hermite interpolation of the branch."""
        return self._combined(hermite_weights(fraction, self.length))

    def direction(self, fraction: float) -> Unknowns:
        """Derivative of the cubic by arclength."""
        return self._combined(hermite_slopes(fraction, self.length))

    def _combined(self, weights: tuple[float, float, float, float]) -> Unknowns:
        start, start_tangent, end, end_tangent = weights
        return (
            self.start.scaled(start)
            .plus(self.start_tangent, start_tangent)
            .plus(self.end.unknowns, end)
            .plus(self.end_tangent, end_tangent)
        )

    def correct_at(self, fraction: float) -> Correction:
        """The cycle at a fraction of the segment."""
        row = self.metric.row(self.chord)
        constraint = Constraint(row, row.dot(self.start) + fraction * row.dot(self.chord))
        guess = self.guess(fraction)
        return correct(self.problem, guess, constraint, self.basis, self.end.steps, self.reference)

    def missed_at(self, fraction: float) -> float | None:
        """Distance of the cycle at a fraction from the cubic; None when it does not converge."""
        cycle = self.correct_at(fraction).cycle
        return None if cycle is None else self.metric.norm(cycle.unknowns.minus(self.guess(fraction)))
