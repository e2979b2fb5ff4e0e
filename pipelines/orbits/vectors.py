"""Points and directions of a continuation, their metric and linear constraints on them.

A point has three parts: a state of any shape, a phase (a period or a rotation number), and parameters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Generic, Self, TypeVar

import numpy as np

from pipelines.orbits.system import Vector, size_of

_Part = Any  # an array or a number


class Combination:
    """Sums and multiples of a frozen dataclass of three parts: state, phase, parameters."""

    @property
    def parts(self) -> tuple[_Part, _Part, _Part]:
        state, phase, parameters = (getattr(self, item.name) for item in fields(self))  # type: ignore[arg-type]
        return state, phase, parameters

    def of(self, *parts: _Part) -> Self:
        """A combination of the same class with other parts."""
        return type(self)(*parts)

    def plus(self, other: Self, factor: float = 1.0) -> Self:
        """The sum with ``factor`` times another combination."""
        pairs = zip(self.parts, other.parts, strict=True)
        return self.of(*(mine + factor * theirs for mine, theirs in pairs))

    def minus(self, other: Self) -> Self:
        """The difference to another combination."""
        return self.plus(other, -1.0)

    def scaled(self, factor: float) -> Self:
        """The multiple by a factor."""
        return self.of(*(factor * part for part in self.parts))

    def dot(self, other: Self) -> float:
        """The sum of the products of all entries."""
        pairs = zip(self.parts, other.parts, strict=True)
        return float(sum(np.vdot(mine, theirs) for mine, theirs in pairs))


Point = TypeVar("Point", bound=Combination)


@dataclass(frozen=True)
class Metric(Generic[Point]):
    """<u, v> = mean of the products of the states + phase u_phase v_phase + parameters u_par v_par.

    The mean makes a step mean the same on every grid.  ``phase``: its weight, 0 where the phase is known;
    ``parameters``: a weight, or one for each.
    """

    phase: float
    parameters: float | Vector

    def row(self, direction: Point) -> Point:
        """The row vector w with w . v = <direction, v>."""
        state, phase, parameters = direction.parts
        return direction.of(state / state.size, self.phase * phase, self.parameters * parameters)

    def inner(self, left: Point, right: Point) -> float:
        """<left, right>."""
        return self.row(left).dot(right)

    def norm(self, direction: Point) -> float:
        """The length of a direction."""
        return math.sqrt(self.inner(direction, direction))

    def unit(self, direction: Point) -> Point:
        """A direction scaled to length one."""
        return direction.scaled(1.0 / self.norm(direction))

    def largest(self, direction: Point) -> float:
        """The largest entry of a direction, with phase and parameters weighted."""
        state, phase, parameters = direction.parts
        scaled = math.sqrt(self.phase) * phase, np.sqrt(self.parameters) * parameters
        return max(float(np.max(np.abs(part))) for part in (state, *scaled))


@dataclass(frozen=True)
class Constraint(Generic[Point]):
    """The closing row of a corrector: row . u = value."""

    row: Point
    value: float

    def gap(self, point: Point) -> float:
        """The residual row . u - value."""
        return self.row.dot(point) - self.value

    def error(self, point: Point) -> float:
        """The gap relative to the largest term of the row."""
        state, phase, parameters = (
            mine * theirs for mine, theirs in zip(self.row.parts, point.parts, strict=True)
        )
        terms = [np.sum(np.abs(state)), phase, *np.atleast_1d(parameters), self.value]
        return abs(self.gap(point)) / size_of(np.array(terms))
