"""Energy of the vibrating rotor in each mode of the free rotor at rest.

With the shapes K phi_k = omega_k^2 M phi_k, phi_j' M phi_k = delta_jk, and a = Phi' M x:

    1/2 x'' M x' + 1/2 x' K x = sum_k 1/2 (a_k')^2 + 1/2 omega_k^2 a_k^2

Modes of equal frequency (both planes of a round rotor, all rigid-body motions) count as one, because only
their sum does not depend on the choice of the shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

from pipelines.case.arrays import Array

_EQUAL = 1e-6  # relative distance of two equal frequencies
_RIGID = 1e-9  # omega^2 of a rigid-body motion over the largest
_STENCIL = 7  # samples of a velocity: central differences of sixth order


@dataclass(frozen=True)
class RotorModes:
    """Modes of a rotor; modes of equal frequency are taken together.

    ``frequency`` (modes,), ``multiplicity`` (modes,); ``weights`` (shapes, freedoms) = Phi' M gives the
    amplitudes of all shapes, ``mode`` (shapes,) the mode of each.
    """

    frequency: Array
    multiplicity: NDArray[np.intp]
    weights: Array
    mode: NDArray[np.intp]


@dataclass(frozen=True)
class ModalEnergy:
    """Energies (samples, modes), in the unit of energy of the matrices."""

    kinetic: Array
    strain: Array


def rotor_modes(mass: Array, stiffness: Array) -> RotorModes:
    """Modes of a rotor with the matrices M and K (freedoms, freedoms), K symmetric and not negative.

    Raises ValueError for a stiffness that is not symmetric.
    """
    if not np.allclose(stiffness, stiffness.T, rtol=0.0, atol=1e-9 * np.abs(stiffness).max()):
        raise ValueError("modes of a rotor need a symmetric stiffness")
    squares, shapes = linalg.eigh(stiffness, mass)
    squares = np.where(squares < _RIGID * squares[-1], 0.0, squares)
    frequencies = np.sqrt(squares)
    begins = np.flatnonzero(np.diff(frequencies, prepend=-1.0) > _EQUAL * frequencies)
    mode = np.searchsorted(begins, np.arange(len(frequencies)), side="right") - 1
    return RotorModes(frequencies[begins], np.bincount(mode), shapes.T @ mass, mode)


def modal_energy(modes: RotorModes, displacement: Array, velocity: Array) -> ModalEnergy:
    """Energy of every mode from displacements and velocities (samples, freedoms)."""
    rates, amplitudes = velocity @ modes.weights.T, displacement @ modes.weights.T
    own = modes.frequency[modes.mode]
    gather = np.eye(len(modes.frequency))[modes.mode]  # shapes into modes
    return ModalEnergy(0.5 * rates**2 @ gather, 0.5 * (own * amplitudes) ** 2 @ gather)


def sampled_velocity(displacement: Array, interval: float) -> Array:
    """Velocity (samples, freedoms) of a motion sampled every ``interval``, by differences of sixth order.

    Raises ValueError for fewer samples than the differences need.
    """
    if len(displacement) < _STENCIL:
        raise ValueError(f"a velocity needs {_STENCIL} samples; there are {len(displacement)}")
    found = signal.savgol_filter(displacement, _STENCIL, _STENCIL - 1, deriv=1, delta=interval, axis=0)
    return np.asarray(found)
