"""A Jeffcott rotor, x'' + c x' + k x (1 + delta sin(phase)) + b x |x|^2 = force, in the machine's order.

State (x, y, x', y'); entries 0, 1 and 2 of the parameters are speed, excitation frequency and displacement.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipelines.machine.film import DISPLACEMENT, EXCITATION_FREQUENCY
from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem
from pipelines.orbits.time_runs.transient import DrivenSystem
from tests.systems import dense_shifted

DAMPING, STIFFNESS = 0.2, 1.0
ECCENTRICITY = 0.3


@njit(RATES)
def rotor_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    k = STIFFNESS * (1.0 + p[DISPLACEMENT] * np.sin(phase)) + constants[0] * (s[0] ** 2 + s[1] ** 2)
    for i in range(2):
        out[i] = s[2 + i]
        out[2 + i] = -DAMPING * s[2 + i] - k * s[i]


@njit(TANGENT)
def rotor_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    k = STIFFNESS * (1.0 + p[DISPLACEMENT] * np.sin(phase)) + constants[0] * (s[0] ** 2 + s[1] ** 2)
    for j in range(block.shape[1]):
        radial = 2.0 * constants[0] * (s[0] * block[0, j] + s[1] * block[1, j])
        for i in range(2):
            out[i, j] = block[2 + i, j]
            out[2 + i, j] = -DAMPING * block[2 + i, j] - k * block[i, j] - radial * s[i]


@njit(RATES)
def gap(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    """Distance to a stator of radius one, and height."""
    out[0] = 1.0 - np.sqrt(s[0] ** 2 + s[1] ** 2)
    out[1] = s[1]


def driven_rotor(hardening: float = 0.0) -> DrivenSystem:
    """The rotor with a mass ECCENTRICITY off its axis."""
    system = DynamicalSystem(
        4,
        rotor_rates,
        rotor_tangent,
        ("speed", "excitation_frequency", "displacement", "unused", "displacement_rate"),
        forcing=EXCITATION_FREQUENCY,
        constants=np.array([hardening]),
        shifted=dense_shifted(rotor_tangent, 4),
    )
    return DrivenSystem(system, ECCENTRICITY * np.eye(2), 2, slice(0, 2), gap, 2)
