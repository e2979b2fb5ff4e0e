"""The map of the machine with unbalance over one excitation period, from a given rotation angle: a reference.

From a state x with the rings at phase zero and the rotor at psi, x |-> P(x; psi), psi |-> psi + rho,
rho = 2 pi Omega / Omega_ex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.case.scales import PARAMETERS
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.machine.unbalance import ROTATION_PHASE, UNBALANCE, UnbalanceMass
from pipelines.orbits.period_map import Inhomogeneity, PeriodMap
from pipelines.orbits.steppers import ESDIRK5, ImplicitStepper, Stepper
from pipelines.orbits.system import Matrix, Vector
from pipelines.orbits.time_runs.unbalanced_map import UNBALANCED_PARAMETERS, unbalanced_system


@dataclass(frozen=True)
class UnbalancedImage:
    """P(x; psi) (size,), dP/dx @ columns (size, m), dP/dpsi (size,), the derivative by a parameter (size,) if
    one was asked for, and the orbit (samples, size); ``finite`` is False when it diverged.
    """

    state: Vector
    columns: Matrix
    by_angle: Vector
    by_parameter: Vector | None
    orbit: Matrix
    finite: bool


@dataclass(frozen=True)
class UnbalancedMap:
    """x |-> P(x; psi) with ``steps`` time steps at the four ``parameters`` of a case.

    All derivatives are those of the discrete map, columns exactly; dP/dpsi and parameter columns take
    df/dpsi from a central difference (relative error about 1e-10). ``unbalance`` is a factor on all masses,
    for branches that grow out of the balanced machine.
    """

    period_map: PeriodMap
    parameters: Vector
    steps: int
    unbalance: float = 1.0

    @property
    def rotation(self) -> float:
        """rho [rad], not reduced to one turn."""
        return 2.0 * math.pi * self.speed / float(self.parameters[film.EXCITATION_FREQUENCY])

    @property
    def speed(self) -> float:
        return float(self.parameters[film.SPEED])

    @property
    def period(self) -> float:
        return self.period_map.period(self.parameters)

    def parameters_at(self, angle: float) -> Vector:
        """The whole parameter vector of a map that starts at the rotation angle."""
        extended = np.zeros(len(UNBALANCED_PARAMETERS))
        extended[: len(PARAMETERS)] = self.parameters
        extended[UNBALANCE], extended[ROTATION_PHASE] = self.unbalance, angle
        return extended

    def evaluate(
        self, state: Vector, angle: float, columns: Matrix | None = None, parameter: str | None = None
    ) -> UnbalancedImage:
        """P(state; angle) with the derivatives asked for, in one pass; ``parameter`` is one of
        ``UNBALANCED_PARAMETERS`` (for the excitation frequency the period changes too, for the speed rho
        does).
        """
        parameters = self.parameters_at(angle)
        asked = [Inhomogeneity(ROTATION_PHASE)]
        if parameter is not None:
            index = self.period_map.system.parameter_index(parameter)
            asked.append(self.period_map.parameter_column(index, parameters))
        image = self.period_map.evaluate(state, parameters, self.period, self.steps, columns, tuple(asked))
        return UnbalancedImage(
            image.state,
            image.columns,
            np.ascontiguousarray(image.inhomogeneous[:, 0]),
            None if parameter is None else np.ascontiguousarray(image.inhomogeneous[:, 1]),
            image.orbit,
            image.finite,
        )


def unbalanced_map(
    machine: Machine,
    masses: Sequence[UnbalanceMass],
    parameters: Vector,
    steps: int,
    stepper: Stepper | ImplicitStepper = ESDIRK5,
    samples: int = 64,
) -> UnbalancedMap:
    """The map of a machine at the four parameters of a case (see ``assembly.parameter_vector``)."""
    system = unbalanced_system(machine, masses)
    period_map = PeriodMap(system, stepper=stepper, samples=samples)
    return UnbalancedMap(period_map, np.array(parameters[: len(PARAMETERS)], dtype=float), steps)
