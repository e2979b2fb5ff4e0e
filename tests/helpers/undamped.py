"""Undamped critical speeds of a rotor, without scanning: a reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from pipelines.machine.condensation import CondensedRotor
from pipelines.machine.rotor_modes import LinearBearing, translations, whirl_directions, with_bearings
from pipelines.machine.shaft import RotorMatrices

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class CriticalSpeeds:
    """Undamped critical speeds [rad/s], rising; whirl +1 forward, -1 backward, 0 planar; shapes (speeds,
    freedoms).
    """

    speeds: FloatArray
    whirl: NDArray[np.int8]
    shapes: ComplexArray


def undamped_critical_speeds(
    rotor: RotorMatrices | CondensedRotor, bearings: Sequence[LinearBearing] = ()
) -> CriticalSpeeds:
    """Speeds at which an undamped free whirl is synchronous, q = phi exp(i Omega t):

        (M - i G) phi = Omega^-2 K phi

    Both matrices are Hermitian, so every speed is found, without scanning. A forward mode with more polar
    than diametral inertia may have none (its Omega^-2 is negative). Damping is left out. Raises ValueError
    when K is not symmetric positive definite: a free rotor, or cross-coupled bearings, which have no undamped
    critical speeds.
    """
    _, stiffness = with_bearings(rotor, bearings)
    if not np.allclose(stiffness, stiffness.T, rtol=0.0, atol=1e-9 * np.max(np.abs(stiffness))):
        raise ValueError("undamped critical speeds need a symmetric stiffness: stiffness_xy = stiffness_yx")
    try:
        inverse_square, vectors = linalg.eigh(rotor.mass - 1j * rotor.gyroscopic, stiffness)
    except linalg.LinAlgError as error:
        raise ValueError("undamped critical speeds need a rotor held by its bearings") from error
    real_speeds = np.flatnonzero(inverse_square > 0.0)[::-1]
    shapes = vectors[:, real_speeds].T
    whirl = whirl_directions(translations(rotor, shapes))
    return CriticalSpeeds(inverse_square[real_speeds] ** -0.5, whirl, shapes)
