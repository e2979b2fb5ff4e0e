"""Input and result of the two correctors of a bifurcation curve."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipelines.bifurcations.critical.critical_cycles import Critical
from pipelines.bifurcations.critical.cycle_manifold import ManifoldLinearisation
from pipelines.bifurcations.plane import CurveProblem, MapAt, PlaneMetric, Position
from pipelines.orbits.floquet import orthonormal
from pipelines.orbits.shooting import NewtonStop, advice_of, is_rounding
from pipelines.orbits.system import Matrix
from pipelines.orbits.vectors import Constraint

_DIVERGENCE = 1e3  # growth of the residual over its smallest value that no Newton iteration recovers from
_STALLED = 0.5  # reduction of g in one step that asks for its exact derivatives
_PATIENCE = 4  # steps without getting on: with exact derivatives it does not either


@dataclass(frozen=True)
class CurveConstraint(Constraint[Position]):
    """What fixes one point of a curve: row . u = value.

    ``across``: a row that tells the second tangent of the surface from the first; ``gradient``: the row
    gamma of the test function; ``metric`` measures its Broyden updates; ``follows``: whether gamma comes from
    a point of the curve, which has told its slope along the tangent.
    """

    across: Position
    gradient: Position
    metric: PlaneMetric
    follows: bool = True


@dataclass(frozen=True)
class CriticalCycle:
    """A corrected point of a curve: the map there and its criticality, both in the basis of the last pass.

    ``gradient``: the row of the test function as the corrector has learnt it.
    """

    linear: ManifoldLinearisation
    critical: Critical
    gradient: Position

    def without_factors(self) -> CriticalCycle:
        """The same point, free of what only further columns need."""
        image = self.linear.image.without_factors()
        return replace(self, linear=replace(self.linear, image=image))

    @property
    def position(self) -> Position:
        return self.linear.at.position

    @property
    def basis(self) -> Matrix:
        return self.linear.basis

    @property
    def steps(self) -> int:
        return self.linear.at.steps


@dataclass(frozen=True)
class CurveCorrection:
    """Result of a corrector: the critical cycle if it converged, else None, and both histories."""

    stop: NewtonStop
    point: CriticalCycle | None
    residual_norms: tuple[float, ...]
    test_values: tuple[float, ...]

    @property
    def iterations(self) -> int:
        return max(0, len(self.residual_norms) - 1)

    @property
    def advice(self) -> str:
        """Why the corrector stopped, with what to change."""
        pairs = zip(self.residual_norms, self.test_values, strict=True)
        return advice_of(self.stop, [max(residual, abs(value)) for residual, value in pairs])


@dataclass(frozen=True)
class History:
    """Residual norms and test values of the passes so far."""

    residual_norms: tuple[float, ...] = ()
    test_values: tuple[float, ...] = ()

    def and_then(self, residual: float, value: float) -> History:
        return History((*self.residual_norms, residual), (*self.test_values, value))

    def converged(self, problem: CurveProblem, invariance: float) -> bool:
        """Whether the cycle, its criticality and the critical vectors all meet their tolerances."""
        options = problem.options
        critical = max(abs(self.test_values[-1]), invariance) <= options.multiplier_tolerance
        return critical and self.residual_norms[-1] <= options.tolerance

    def stalls(self, follows: bool = True) -> bool:
        """Whether the last step reduced the test function by less than half.

        The first step of a guess that ``follows`` a curve does not count: it tells how the correction towards
        the surface changes the test function.
        """
        values = self.test_values
        return len(values) > 1 + follows and abs(values[-1]) > _STALLED * abs(values[-2])

    def stuck(self, problem: CurveProblem) -> bool:
        """Whether the last steps made no progress while the test function is not yet small."""
        sizes = [abs(value) for value in self.test_values]
        before, recent = sizes[:-_PATIENCE], sizes[-_PATIENCE:]
        if not before or min(sizes) <= problem.options.multiplier_tolerance:
            return False
        return self.stalls() and min(recent) > _STALLED * min(before)

    @property
    def diverged(self) -> bool:
        """Whether the sum of residual and test function grew beyond recovery."""
        sizes = [r + abs(g) for r, g in zip(self.residual_norms, self.test_values, strict=True)]
        return sizes[-1] > max(1.0, _DIVERGENCE * min(sizes))

    def given_up(self, stop: NewtonStop, at: MapAt) -> CurveCorrection:
        """The end of an iteration that did not converge, by rounding where that is why."""
        rounding = is_rounding(at.problem.period_map, at.orbit_start, at.reference, self._sizes)
        return self.ended(NewtonStop.ROUNDING if rounding else stop)

    @property
    def _sizes(self) -> list[float]:
        pairs = zip(self.residual_norms, self.test_values, strict=True)
        return [max(residual, abs(value)) for residual, value in pairs]

    def ended(self, stop: NewtonStop, point: CriticalCycle | None = None) -> CurveCorrection:
        return CurveCorrection(stop, point, self.residual_norms, self.test_values)


def following(basis: Matrix, image: Matrix) -> Matrix:
    """V <- orth(M V); a basis of the whole space stays the identity."""
    return basis if basis.shape[0] == basis.shape[1] else orthonormal(image)
