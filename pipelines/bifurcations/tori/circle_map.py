"""Maps over a circle of angles, whose invariant curves are quasi-periodic orbits.

One pass takes a state x and an angle theta to P(x; theta) and turns the angle by rho.  Two kinds:

    known rho       theta is an angle of the equations (the rotor's, while the rings set the period), and
                    rho = 2 pi period_multiple Omega / Omega_ex follows from two frequencies
    unknown rho     P does not depend on theta, which only names the points of the curve
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipelines.orbits.period_map import Inhomogeneity, PeriodMap
from pipelines.orbits.system import Matrix, Vector


@dataclass(frozen=True)
class CircleImage:
    """The image of a state under a map over a circle, with derivatives.

    ``state`` (N,): P(x; theta); ``columns`` (N, m): dP/dx applied to the block; ``by_parameter`` (N,):
    dP/d parameter, zero unless asked for; ``finite`` is False when the orbit diverged.
    """

    state: Vector
    columns: Matrix
    by_parameter: Vector
    finite: bool


class CircleMap(Protocol):
    """What the solver of invariant curves requires of a map."""

    @property
    def size(self) -> int:
        """Number of states N."""

    def rotation(self, parameter: float) -> tuple[float, float] | None:
        """rho [rad], not reduced to a turn, and d rho/d parameter; None when it is an unknown."""

    def evaluate(
        self, state: Vector, angle: float, parameter: float, columns: Matrix, with_parameter: bool
    ) -> CircleImage:
        """P with the requested derivatives, in one pass."""


@dataclass(frozen=True)
class PeriodCircle:
    """A stroboscopic period map with ``steps`` time steps as a map over a circle.

    ``parameters`` (p,) holds the fixed ones, ``parameter`` names the continued one.  ``angle`` names the
    parameter that is the second angle at the start of a period and ``frequency`` the one that is its angular
    frequency: then rho is known.  Without them rho is an unknown.  Raises ValueError for an autonomous map, a
    wrong number of parameters, unknown names or only one of the two.

    Example, a damped oscillator driven by two frequencies; phase = frequency tau is the first angle::

        twice_driven = ode_system(
            lambda phase, s, p: [
                s[1],
                -0.2 * s[1] - s[0] - s[0] ** 3
                + p[2] * np.cos(phase) + 0.3 * np.cos(p[3] + phase * p[1] / p[0]),
            ],
            lambda phase, s, p: [[0.0, 1.0], [-1.0 - 3.0 * s[0] ** 2, -0.2]],
            size=2, parameter_names=("frequency", "speed", "load", "angle"), forcing="frequency",
        )
        circle = PeriodCircle(
            PeriodMap(twice_driven, DOPRI8), np.array([1.0, 0.618, 0.2, 0.0]), "speed", steps=128,
            angle="angle", frequency="speed",
        )
        problem = TorusProblem(circle)
        start = torus_around(problem, np.zeros(2), 0.618)
        continue_torus(problem, start, TorusOptions(range=(0.6, 1.4)), record)
    """

    period_map: PeriodMap
    parameters: Vector
    parameter: str
    steps: int
    angle: str | None = None
    frequency: str | None = None

    def __post_init__(self) -> None:
        system = self.period_map.system
        if self.period_map.autonomous:
            raise ValueError("invariant curves are those of a stroboscopic map, whose period is known")
        if len(self.parameters) != len(system.parameter_names):
            names = ", ".join(system.parameter_names)
            raise ValueError(f"{len(self.parameters)} parameters given for {names}")
        if (self.angle is None) != (self.frequency is None):
            raise ValueError("give both the angle and its frequency, or neither")
        for name in (self.parameter, self.angle, self.frequency):
            if name is not None:
                system.parameter_index(name)

    @property
    def size(self) -> int:
        return self.period_map.size

    @property
    def index(self) -> int:
        return self.period_map.system.parameter_index(self.parameter)

    def parameters_at(self, value: float, angle: float = 0.0) -> Vector:
        """The parameter vector with the continued one and the angle set."""
        parameters = np.array(self.parameters, dtype=float)
        parameters[self.index] = value
        if self.angle is not None:
            parameters[self.period_map.system.parameter_index(self.angle)] = angle
        return parameters

    def rotation(self, parameter: float) -> tuple[float, float] | None:
        if self.frequency is None:
            return None
        system = self.period_map.system
        assert system.forcing is not None
        parameters = self.parameters_at(parameter)
        second, first = system.parameter_index(self.frequency), system.forcing
        turn = 2.0 * math.pi * self.period_map.period_multiple
        value = turn * float(parameters[second] / parameters[first])
        slope = 0.0
        if self.index == second:
            slope += value / float(parameters[second])
        if self.index == first:
            slope -= value / float(parameters[first])
        return value, slope

    def evaluate(
        self, state: Vector, angle: float, parameter: float, columns: Matrix, with_parameter: bool
    ) -> CircleImage:
        parameters = self.parameters_at(parameter, angle)
        asked: tuple[Inhomogeneity, ...] = ()
        if with_parameter:
            asked = (self.period_map.parameter_column(self.index, parameters),)
        period = self.period_map.period(parameters)
        image = self.period_map.evaluate(state, parameters, period, self.steps, columns, asked)
        slope = image.inhomogeneous[:, 0] if with_parameter else np.zeros(self.size)
        return CircleImage(image.state, image.columns, np.ascontiguousarray(slope), image.finite)
