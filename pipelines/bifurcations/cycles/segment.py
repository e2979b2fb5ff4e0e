"""The metric of a branch and the piece of it between two neighbouring cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipelines.bifurcations.continuation import CubicPiece
from pipelines.orbits.floquet import Complex
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import Correction, Cycle, CycleProblem, Unknowns, correct
from pipelines.orbits.system import Matrix
from pipelines.orbits.vectors import Constraint, Metric

BranchMetric = Metric[Unknowns]


def metric_of(
    problem: CycleProblem, parameter_scale: float, period_scale: float = 2.0 * math.pi
) -> BranchMetric:
    """The metric for a problem; the scales are changes of parameter and period that count as one."""
    period = 1.0 / period_scale**2 if problem.period_map.autonomous else 0.0
    return Metric(period, 1.0 / parameter_scale**2)


@dataclass(frozen=True)
class Segment(CubicPiece[Unknowns]):
    """The branch between two corrected cycles with their unit tangents, both discretised with ``end.steps``.

    ``basis`` and ``reference``: slow subspace and phase condition for the cycles between them.
    A fraction in [0, 1] names the cycle in the plane <chord, u - u_0> = fraction <chord, chord>.
    """

    problem: CycleProblem
    metric: BranchMetric
    start: Unknowns
    start_tangent: Unknowns
    start_multipliers: Complex
    end: Cycle
    end_tangent: Unknowns
    basis: Matrix
    reference: PhaseReference | None

    def ends(self) -> tuple[Unknowns, Unknowns, Unknowns, Unknowns]:
        """Start, unit tangent there, end, unit tangent there."""
        return self.start, self.start_tangent, self.end.unknowns, self.end_tangent

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
