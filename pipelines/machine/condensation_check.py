"""Modes and unbalance response of the condensed rotor beside those of the full one, to judge the masters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pipelines.machine.condensation import condense
from pipelines.machine.rotor_modes import (
    LinearBearing,
    Modes,
    oscillating_modes,
    translations,
    unbalance_response,
)
from pipelines.machine.shaft import RotorMatrices

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class ModalComparison:
    """Modes of the full rotor, by rising frequency, beside their partners of the condensed one.

    Damped frequencies [rad/s] and logarithmic decrements have shape (modes,). ``mac`` (modes, modes) compares
    full mode i with the partner of full mode j over the translations of all nodes: 1 on the diagonal for a
    perfect condensation.
    """

    full_frequency: FloatArray
    condensed_frequency: FloatArray
    full_decrement: FloatArray
    condensed_decrement: FloatArray
    mac: FloatArray


@dataclass(frozen=True)
class CondensationComparison:
    """Modes at one speed [rad/s], and unbalance responses [m] of shape (speeds, nodes, 2), complex x, y."""

    modal: ModalComparison
    modal_speed: float
    speeds: FloatArray
    unbalance_full: ComplexArray
    unbalance_condensed: ComplexArray


def modal_assurance(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """MAC_ij = |a_i* b_j|^2 / (a_i* a_i)(b_j* b_j) of two sets of shapes (modes, freedoms)."""
    inner = np.conj(first) @ second.T
    norms = np.outer(np.sum(np.abs(first) ** 2, axis=1), np.sum(np.abs(second) ** 2, axis=1))
    result: FloatArray = np.abs(inner) ** 2 / norms
    return result


def compare_modes(
    rotor: RotorMatrices,
    masters: Sequence[int],
    speed: float,
    bearings: Sequence[LinearBearing],
    modes: int,
    max_damping_ratio: float = 0.5,
    *,
    slopes: Collection[int] = (),
) -> ModalComparison:
    """Compare the lowest ``modes`` modes at a speed [rad/s]; fewer if either rotor has fewer.

    Modes damped beyond ``max_damping_ratio`` are left out: stiffness-proportional damping overdamps the
    highest modes, and the gyroscopic effect then gives them a low frequency without meaning. Partners are
    chosen by the assignment with the largest sum of MAC values among the lowest ``2 modes`` condensed modes,
    so that two modes which change their order do not count as an error.
    """
    condensed = condense(rotor, masters, slopes)
    candidates = oscillating_modes(condensed, speed, bearings).lightly_damped(max_damping_ratio, 2 * modes)
    count = min(modes, candidates.eigenvalues.size)
    full = oscillating_modes(rotor, speed, bearings).lightly_damped(max_damping_ratio, count)

    full_shapes = translations(rotor, full.shapes)
    condensed_shapes = translations(condensed, candidates.shapes)
    # without lightly damped modes, reshape(0, -1) would fail
    flat = (s.reshape(len(s), s.shape[1] * s.shape[2]) for s in (full_shapes, condensed_shapes))
    mac = modal_assurance(*flat)
    _, partner = linear_sum_assignment(mac, maximize=True)
    partners = Modes(candidates.eigenvalues[partner], candidates.shapes[partner])
    return ModalComparison(
        full_frequency=full.damped_frequencies,
        condensed_frequency=partners.damped_frequencies,
        full_decrement=full.logarithmic_decrements,
        condensed_decrement=partners.logarithmic_decrements,
        mac=mac[:, partner],
    )


def compare_condensation(
    rotor: RotorMatrices,
    masters: Sequence[int],
    bearings: Sequence[LinearBearing],
    speeds: FloatArray,
    *,
    unbalance: Mapping[int, complex],
    modal_index: int,
    modes: int = 8,
    max_damping_ratio: float = 0.5,
    slopes: Collection[int] = (),
) -> CondensationComparison:
    """Compare full and condensed rotor: modes at one speed, unbalance response over all speeds.

    The modes are those at ``speeds[modal_index]``, with ``speeds`` in rad/s. The bearings' coefficients have
    shape (speeds, 2, 2) if the film is linearised at each speed, or (2, 2) if they are constant.
    ``unbalance`` [kg m] per node. Raises ValueError as ``condense`` does, or for a bearing that is not on a
    master.
    """
    condensed = condense(rotor, masters, slopes)
    at_modal_speed = [bearing.at(modal_index) for bearing in bearings]
    modal_speed = float(speeds[modal_index])
    return CondensationComparison(
        modal=compare_modes(
            rotor, masters, modal_speed, at_modal_speed, modes, max_damping_ratio, slopes=slopes
        ),
        modal_speed=modal_speed,
        speeds=np.asarray(speeds, dtype=np.float64),
        unbalance_full=unbalance_response(rotor, speeds, unbalance, bearings),
        unbalance_condensed=unbalance_response(condensed, speeds, unbalance, bearings),
    )
