"""The problem of an invariant curve: its unknowns, closing condition and metric."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from pipelines.bifurcations.tori.circle_map import CircleMap
from pipelines.bifurcations.tori.fourier import resampled
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.system import Matrix
from pipelines.orbits.vectors import Combination, Constraint, Metric


@dataclass(frozen=True)
class FourierOptions:
    """How many angles: between ``fewest`` and ``most``, both odd.

    So many that what the Fourier series lacks is below ``tolerance``, relative to the largest entry of the
    state.

    Raises ValueError for even numbers or values out of order.
    """

    tolerance: float = 1e-8
    fewest: int = 15
    most: int = 255

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < 1.0:
            raise ValueError(f"tolerance is {self.tolerance}; it must lie between 0 and 1")
        if self.fewest % 2 == 0 or self.most % 2 == 0 or not 3 <= self.fewest <= self.most:
            raise ValueError(
                f"fewest {self.fewest}, most {self.most}; odd numbers of at least 3 are needed, in this order"
            )


@dataclass(frozen=True)
class TorusProblem:
    """Invariant curves of a map; ``options`` are those of the corrector of cycles."""

    circle: CircleMap
    options: ShootingOptions = field(default_factory=ShootingOptions)
    fourier: FourierOptions = field(default_factory=FourierOptions)

    def consistent(self, unknowns: TorusUnknowns) -> TorusUnknowns:
        """The unknowns with the known rotation at their parameter; unchanged when it is unknown."""
        known = self.circle.rotation(unknowns.parameter)
        return unknowns if known is None else replace(unknowns, rotation=known[0])


@dataclass(frozen=True)
class TorusUnknowns(Combination):
    """A point or a direction in the space of (X, rho, lambda); ``states`` has shape (M, N)."""

    states: Matrix
    rotation: float
    parameter: float

    def resampled(self, count: int) -> TorusUnknowns:
        """The same curve or direction at another number of angles."""
        return replace(self, states=resampled(self.states, count))


TorusConstraint = Constraint[TorusUnknowns]
TorusMetric = Metric[TorusUnknowns]


def resampled_constraint(constraint: TorusConstraint, count: int) -> TorusConstraint:
    """The condition for a curve with another number of angles: a mean over them."""
    old = len(constraint.row.states)
    row = constraint.row.resampled(count)
    return replace(constraint, row=replace(row, states=row.states * (old / count)))


def fixed_parameter(problem: TorusProblem, count: int, value: float) -> TorusConstraint:
    """The condition lambda = value, for curves of ``count`` angles."""
    return TorusConstraint(TorusUnknowns(np.zeros((count, problem.circle.size)), 0.0, 1.0), value)


def metric_of(problem: TorusProblem, parameter: float, scale: float) -> TorusMetric:
    """The metric at a parameter; ``scale``: change of the parameter that counts as one."""
    unknown = problem.circle.rotation(parameter) is None
    return Metric(1.0 / (2.0 * math.pi) ** 2 if unknown else 0.0, 1.0 / scale**2)
