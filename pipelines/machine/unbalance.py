"""Unbalance of the rotor: its force, and the machine's right-hand side with it.

A mass m off the axis by e turns with the rotor. At the rotation angle phi, with U = m e and the angular
position alpha of the mass, it pulls its node with

    F_x = U (phi'^2 cos(phi + alpha) + phi'' sin(phi + alpha))
    F_y = U (phi'^2 sin(phi + alpha) - phi'' cos(phi + alpha))

which is U times the negative second derivative of (cos, sin)(phi + alpha). All nodes together accelerate the
masters by

    A_c (phi'^2 cos phi + phi'' sin phi) + A_s (phi'^2 sin phi - phi'' cos phi)

    A_c = M^-1 T' sum_n U_n (cos alpha_n, sin alpha_n),   A_s = M^-1 T' sum_n U_n (-sin alpha_n, cos alpha_n)

with the condensation T, so that a mass may sit on any node. At constant speed phi = psi + Omega tau; the
ring's phase Omega_ex tau then gives phi = psi + phase Omega / Omega_ex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.case.models import Case
from pipelines.case.transient_settings import unbalance_moments

from .assembly import Machine
from .film import EXCITATION_FREQUENCY, SPEED
from .kernels import RATES, kernel
from .rates import ROTOR_CONSTANTS, ROTOR_SIZE, ROTOR_STATE, machine_rates
from .shaft import NODE_FREEDOMS

Array = NDArray[np.float64]

# Entries of the parameter vector after those of ``film``: a factor on the whole unbalance, and psi.
UNBALANCE, ROTATION_PHASE = 5, 6


@dataclass(frozen=True)
class UnbalanceMass:
    """U = m e [kg m] at a node of the shaft, at the angle ``phase`` [rad] from the rotor's mark."""

    node: int
    moment: float
    phase: float = 0.0


def unbalance_acceleration(machine: Machine, masses: Sequence[UnbalanceMass]) -> Array:
    """A_c and A_s of the module's head, dimensionless, shape (2, n), n freedoms of the masters.

    Raises ValueError for a node that is not on the shaft.
    """
    scales, condensed = machine.scales, machine.scaled
    nodes = condensed.transformation.shape[0] // NODE_FREEDOMS
    loads = np.zeros((2, condensed.transformation.shape[0]))
    for mass in masses:
        if not 0 <= mass.node < nodes:
            raise ValueError(f"unbalance at node {mass.node}: the shaft's nodes are 0 to {nodes - 1}")
        # U phi'^2 in units of the force scale, with phi' in units of 1/t0
        amount = mass.moment / (scales.force * scales.time**2)
        c, s = amount * np.cos(mass.phase), amount * np.sin(mass.phase)
        first = NODE_FREEDOMS * mass.node
        loads[:, first : first + 2] += [[c, s], [-s, c]]
    velocities = machine.space.force_input[machine.rotor_freedoms :]
    return np.ascontiguousarray(loads @ condensed.transformation @ velocities.T)


@kernel()
def unbalance_factors(angle, speed, acceleration):  # type: ignore[no-untyped-def]
    """The factors of A_c and A_s at the rotation angle phi, with speed phi' and acceleration phi''."""
    c, s = np.cos(angle), np.sin(angle)
    return speed * speed * c + acceleration * s, speed * speed * s - acceleration * c


@kernel(RATES)
def unbalanced_rates(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
    """ds/dtau with unbalance at constant speed; A_c and A_s follow the machine's own constants."""
    machine_rates(phase, state, parameters, constants, layout, work, out)
    size, speed = layout[ROTOR_SIZE], parameters[SPEED]
    own = layout[ROTOR_CONSTANTS] + 3 * size * size + 5 * size  # matrices, influence of 4 forces, gravity
    angle = parameters[ROTATION_PHASE] + phase * speed / parameters[EXCITATION_FREQUENCY]
    along, across = unbalance_factors(angle, speed, 0.0)
    along, across = along * parameters[UNBALANCE], across * parameters[UNBALANCE]
    start = layout[ROTOR_STATE] + size
    for row in range(size):
        out[start + row] += along * constants[own + row] + across * constants[own + size + row]


def unbalance_masses(case: Case) -> tuple[UnbalanceMass, ...]:
    """The masses of a case's unbalance, in SI units."""
    planes = unbalance_moments(case.unbalance, case.rotor, case.bearings, case.scales)
    return tuple(UnbalanceMass(*plane) for plane in planes)
