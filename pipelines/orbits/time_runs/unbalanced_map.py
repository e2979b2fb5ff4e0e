"""The machine with unbalance over one excitation period, from a given rotation angle.

Two angles turn: that of the rings, Omega_ex tau, and that of the rotor, phi = psi + Omega tau. Over one
excitation period T = 2 pi/Omega_ex, from a state x with the rings at phase zero and the rotor at psi,

    x  |->  P(x; psi),     psi  |->  psi + rho,     rho = 2 pi Omega / Omega_ex

A motion with both frequencies is a closed curve x(psi) with P(x(psi); psi) = x(psi + rho).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipelines.case.scales import PARAMETERS
from pipelines.machine.assembly import Machine
from pipelines.machine.unbalance import UnbalanceMass, unbalance_acceleration, unbalanced_rates
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.system import DynamicalSystem

UNBALANCED_PARAMETERS = (*PARAMETERS, "displacement_rate", "unbalance", "rotation_phase")
"""Of the machine with unbalance: ``unbalance`` is a factor on all masses, ``rotation_phase`` is psi."""


def unbalanced_system(machine: Machine, masses: Sequence[UnbalanceMass]) -> DynamicalSystem:
    """The machine with unbalance at constant speed, for any map over a period of its rings.

    Raises ValueError for a mass that is not on the shaft.
    """
    base = machine_system(machine)
    return DynamicalSystem(
        size=base.size,
        rates=unbalanced_rates,
        tangent=base.tangent,  # the force does not depend on the state
        parameter_names=UNBALANCED_PARAMETERS,
        forcing=base.forcing,
        constants=np.concatenate([base.constants, unbalance_acceleration(machine, masses).ravel()]),
        layout=base.layout,
        work_size=base.work_size,
        shifted=base.shifted,
    )
