"""Dynamical systems: right-hand side, action of the Jacobian, parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_NOTHING = 1e-12  # smaller numbers are rounding errors of zero, whatever their unit


def size_of(values: Vector | float) -> float:
    """The size to which errors of these values are relative: the largest modulus, or one if all are zero."""
    largest = float(np.max(np.abs(values)))
    return largest if largest > _NOTHING else 1.0


@dataclass(frozen=True)
class ShiftedSolver:
    """Solves (I - shift J) x = b, the linear systems of implicit steppers.

    ``factorise`` and ``solve`` are compiled functions of the types FACTORISE and SOLVE of
    ``pipelines.machine.kernels``; ``factors_size`` is the number of doubles that the factors take.
    """

    factorise: Callable[..., None]
    solve: Callable[..., None]
    factors_size: int


@dataclass(frozen=True)
class DynamicalSystem:
    """ds/dtau = f(phase, s, parameters), with phase = 2 pi tau / T for a forced system.

    ``rates`` and ``tangent`` follow the signatures RATES and TANGENT of ``pipelines.machine.kernels``:
    compiled functions of exactly these types (``compiled=True``) or Python callables with the same arguments.
    Both receive ``constants``, ``layout`` and ``work_size`` doubles of scratch space.  ``forcing`` is the
    index of the parameter which is the angular frequency of the forcing, so that the period is
    2 pi / parameters[forcing]; ``None`` marks an autonomous system.  Implicit steppers need ``shifted``,
    which only compiled systems may have.

    Raises ValueError when the size is not positive, a parameter name is repeated, ``forcing`` is out of
    range or ``shifted`` is given for Python callables.
    """

    size: int
    rates: Callable[..., None]
    tangent: Callable[..., None]
    parameter_names: tuple[str, ...]
    forcing: int | None = None
    constants: Vector = field(default_factory=lambda: np.zeros(1))
    layout: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    work_size: int = 1
    compiled: bool = True
    shifted: ShiftedSolver | None = None

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ValueError(f"size is {self.size}; a dynamical system has at least one state")
        if len(set(self.parameter_names)) != len(self.parameter_names):
            raise ValueError(f"parameter_names {self.parameter_names} repeat a name")
        if self.shifted is not None and not self.compiled:
            raise ValueError("implicit steppers are compiled: shifted equations need a compiled system")
        if self.forcing is not None and not 0 <= self.forcing < len(self.parameter_names):
            raise ValueError(f"forcing is {self.forcing}; it must index one of {self.parameter_names}")

    def parameter_index(self, name: str) -> int:
        """Position of a named parameter; ValueError names the known ones."""
        if name not in self.parameter_names:
            raise ValueError(f"unknown parameter {name!r}; known are {', '.join(self.parameter_names)}")
        return self.parameter_names.index(name)

    def rates_at(self, phase: float, state: Vector, parameters: Vector) -> Vector:
        """f(phase, state, parameters), shape (size,)."""
        out = np.empty(self.size)
        self.rates(phase, state, parameters, self.constants, self.layout, np.empty(self.work_size), out)
        return out

    def tangent_at(self, phase: float, state: Vector, block: Matrix, parameters: Vector) -> Matrix:
        """J(phase, state, parameters) @ block, shape (size, columns)."""
        out = np.empty((self.size, block.shape[1]))
        work = np.empty(self.work_size)
        self.tangent(
            phase, state, np.ascontiguousarray(block), parameters, self.constants, self.layout, work, out
        )
        return out


def ode_system(
    rates: Callable[[float, Vector, Vector], Any],
    jacobian: Callable[[float, Vector, Vector], Any] | None,
    size: int,
    parameter_names: tuple[str, ...],
    forcing: str | None = None,
    *,
    action: Callable[[float, Vector, Matrix, Vector], Any] | None = None,
) -> DynamicalSystem:
    """Make a system from ordinary Python callables.

    ``rates(phase, s, parameters)`` returns f, shape (size,).  Give either ``jacobian(phase, s, parameters)``
    returning df/ds, shape (size, size), or ``action(phase, s, block, parameters)`` returning df/ds @ block.
    ``forcing`` names the parameter which is the forcing frequency; phase = 2 pi tau / T replaces the time.
    Example, a pendulum::

        pendulum = ode_system(
            lambda phase, s, p: [s[1], -p[1] * s[1] - np.sin(s[0]) + p[2] * np.cos(phase)],
            lambda phase, s, p: [[0.0, 1.0], [-np.cos(s[0]), -p[1]]],
            size=2, parameter_names=("frequency", "damping", "load"), forcing="frequency",
        )

    Raises ValueError unless exactly one of ``jacobian`` and ``action`` is given or if ``forcing`` is unknown.
    """
    if (jacobian is None) == (action is None):
        raise ValueError("give exactly one of jacobian and action")
    if forcing is not None and forcing not in parameter_names:
        raise ValueError(f"forcing is {forcing!r}; it must be one of {', '.join(parameter_names)}")

    def rates_kernel(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
        out[:] = rates(phase, state, parameters)

    def tangent_kernel(phase, state, block, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
        if action is not None:
            out[:] = action(phase, state, block, parameters)
        elif jacobian is not None:
            out[:] = np.asarray(jacobian(phase, state, parameters), dtype=float) @ block

    return DynamicalSystem(
        size=size,
        rates=rates_kernel,
        tangent=tangent_kernel,
        parameter_names=parameter_names,
        forcing=None if forcing is None else parameter_names.index(forcing),
        compiled=False,
    )
