"""Stiffness and damping of the bearings over the whirl frequency, about an equilibrium.

For a journal that whirls steadily at the frequency omega the dynamic stiffness of film and foil in series is

    Z(i omega) = K(omega) + i omega C(omega),      K(0) = Z(0),   C(0) = Z'(0)

(`pipelines.orbits.equilibria.linear.dynamic_stiffness`).  The ring is at rest: it is no part of Z.  A mode
with the exponent lambda = sigma + i omega sees Z(lambda); K + lambda C differs from it by

    K(omega) + lambda C(omega) - Z(lambda) = sigma (i K'(omega) - omega C'(omega)) + O(sigma^2),

which vanishes for an undamped mode and where K and C do not depend on the frequency.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from pipelines.case.arrays import Array
from pipelines.machine.assembly import Machine
from pipelines.machine.bearing import Bearing, linearise_bearing
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest
from pipelines.orbits.equilibria.linear import dynamic_stiffness


def machine_coefficients(
    machine: Machine, parameters: Array, state: Array, frequencies: Array
) -> tuple[Array, Array]:
    """K and C of all bearings in an equilibrium, each of shape (frequencies, bearings, 2, 2).

    In p0 R L/c and p0 R L t0/c of each bearing, t0 of the machine.  ``frequencies``: whirl, 0 or positive.
    """
    both = [
        stiffness_and_damping(
            bearing,
            state[machine.film_unknowns(index)],
            machine.journal(state, index)[:2],
            parameters,
            frequencies,
        )
        for index, bearing in enumerate(machine.bearings)
    ]
    stiffness, damping = (np.stack(parts, axis=1) for parts in zip(*both, strict=True))
    return stiffness, damping


def stiffness_and_damping(
    bearing: Bearing, unknowns: Array, position: Array, parameters: Array, frequencies: Array
) -> tuple[Array, Array]:
    """K and C of a bearing, each of shape (frequencies, 2, 2); arguments as of ``dynamic_stiffness``."""
    exponents = np.asarray(1j * frequencies, dtype=np.complex128)
    complex_stiffness = dynamic_stiffness(bearing, unknowns, position, parameters, exponents)
    still = frequencies == 0.0
    damping = complex_stiffness.imag / np.where(still, 1.0, frequencies)[:, None, None]
    if still.any():
        damping[still] = _quasi_static_damping(bearing, unknowns, position, parameters)
    return complex_stiffness.real, damping


def _quasi_static_damping(bearing: Bearing, unknowns: Array, position: Array, parameters: Array) -> Array:
    """Z'(0), shape (2, 2).

    Z(s) = -C X(s),   X(s) = (s I - A)^-1 (B + s D)   gives   Z'(0) = C A^-1 (D - X(0)),   X(0) = -A^-1 B
    """
    journal = np.array([position[0], position[1], 0.0, 0.0])
    linear = linearise_bearing(bearing, unknowns, journal, MEAN_PHASE, at_rest(parameters))
    factors = splu(sparse.csc_array(linear.unknowns))
    static = -factors.solve(linear.position)
    return np.asarray(linear.force @ factors.solve(linear.velocity - static))
