"""A branch of tori between two of its points: the cubic through them, and the tori beside it."""

from __future__ import annotations

from dataclasses import dataclass

from pipelines.bifurcations.continuation import CubicPiece
from pipelines.bifurcations.tori.invariant_curve import Torus, correct_on_angles, torus_tangent
from pipelines.bifurcations.tori.problem import TorusMetric, TorusProblem, TorusUnknowns
from pipelines.bifurcations.tori.slow_bases import SlowBases
from pipelines.orbits.system import Matrix
from pipelines.orbits.vectors import Constraint


@dataclass(frozen=True)
class TorusSegment(CubicPiece[TorusUnknowns]):
    """The branch between two tori with their unit tangents, on the same angles; ``bases``: slow subspaces."""

    problem: TorusProblem
    metric: TorusMetric
    start: TorusUnknowns
    start_tangent: TorusUnknowns
    end: TorusUnknowns
    end_tangent: TorusUnknowns
    bases: SlowBases

    def ends(self) -> tuple[TorusUnknowns, TorusUnknowns, TorusUnknowns, TorusUnknowns]:
        """Start, unit tangent there, end, unit tangent there."""
        return self.start, self.start_tangent, self.end, self.end_tangent

    def torus_at(self, fraction: float) -> Torus | None:
        """The torus in the plane across the chord at a fraction of it."""
        cubic, row = self.guess(fraction), self.metric.row(self.chord)
        constraint = Constraint(row, row.dot(self.start) + fraction * row.dot(self.chord))
        bases = self.bases.resampled(len(cubic.states))
        return correct_on_angles(
            self.problem, cubic, constraint, bases, reference_curve(self.problem, cubic)
        ).torus

    def tangent_of(self, torus: Torus) -> TorusUnknowns | None:
        """The unit tangent of the branch at one of its tori, towards the end of the segment."""
        row = self.metric.row(self.chord)
        tangent = torus_tangent(self.problem, torus, row, reference_curve(self.problem, torus.unknowns))
        return None if tangent is None else self.metric.unit(tangent)

    def missed_at(self, fraction: float) -> float:
        """Distance of the torus at a fraction from the cubic.

        Zero when there is no such torus: in a resonance, where nothing can be told of the step.
        """
        torus = self.torus_at(fraction)
        return 0.0 if torus is None else self.metric.norm(torus.unknowns.minus(self.guess(fraction)))


def rotation_known(problem: TorusProblem, parameter: float) -> bool:
    """Whether the rotation follows from the parameter."""
    return problem.circle.rotation(parameter) is not None


def reference_curve(problem: TorusProblem, unknowns: TorusUnknowns) -> Matrix | None:
    """The curve that sets the phase condition of its neighbours."""
    return None if rotation_known(problem, unknowns.parameter) else unknowns.states
