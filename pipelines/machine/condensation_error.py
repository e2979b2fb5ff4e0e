"""Errors of the condensed rotor's natural frequencies up to the highest speed, and masters that reduce them.

Unbalance excites no frequency above the highest speed, so that up to there the condensed rotor must have the
modes of the full one. Both turn on the same linear bearings; modes with similar shapes are compared. A mode
has an error because its slaves do not follow the masters statically. Those freedoms become masters whose
inertia forces do the most work on the part of the mode that the condensation misses,

    w_i = |(phi - T phi_m)_i (M phi)_i| / (phi* M phi)

summed over all full modes phi, each weighted with its error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pipelines.machine.condensation import condense, static_transformation
from pipelines.machine.condensation_check import modal_assurance
from pipelines.machine.rotor_modes import LinearBearing, Modes, oscillating_modes, translations
from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices

FloatArray = NDArray[np.float64]

ALLOWED_ERROR = 0.01  # relative, of a frequency: far below the uncertainty of bearing data
TRIED = 6  # candidates whose effect is computed, at each addition
MOST_ADDITIONS = 12
MISSING = 1.0  # error of a mode that the condensed rotor does not have


@dataclass(frozen=True)
class Masters:
    """Master nodes in rising order, and those of them that keep their slopes."""

    nodes: tuple[int, ...]
    slopes: tuple[int, ...] = ()

    def adding(self, node: int, slopes: bool) -> Masters:
        """These masters and a node, with its slopes if ``slopes``."""
        return Masters(
            tuple(sorted({*self.nodes, node})), tuple(sorted({*self.slopes, *([node] if slopes else [])}))
        )


@dataclass(frozen=True)
class FullModes:
    """Modes of the full rotor up to the highest speed, at a speed [rad/s] with the bearings at that speed."""

    speed: float
    bearings: tuple[LinearBearing, ...]
    modes: Modes


@dataclass(frozen=True)
class ModeErrors:
    """Frequencies of the full rotor's modes up to the highest speed, beside those of the condensed rotor.

    All arrays have shape (modes,): rotating speed, frequency of the full rotor, frequency of the condensed
    rotor (NaN where it has no such mode), in rad/s.
    """

    speed: FloatArray
    full: FloatArray
    condensed: FloatArray

    @property
    def relative(self) -> FloatArray:
        """|condensed / full - 1|, ``MISSING`` without a partner."""
        return np.where(np.isfinite(self.condensed), np.abs(self.condensed / self.full - 1.0), MISSING)

    @property
    def worst(self) -> float:
        """Largest relative error; 0 where there is no mode up to the highest speed."""
        return float(np.max(self.relative, initial=0.0))


def full_modes(
    rotor: RotorMatrices,
    speed: float,
    bearings: Sequence[LinearBearing],
    highest: float,
    max_damping_ratio: float,
) -> FullModes:
    """Modes of the full rotor with frequencies up to ``highest`` [rad/s], damped less than the bound."""
    found = oscillating_modes(rotor, speed, bearings)
    kept = (found.damped_frequencies <= highest) & (found.damping_ratios < max_damping_ratio)
    return FullModes(speed, tuple(bearings), Modes(found.eigenvalues[kept], found.shapes[kept]))


def mode_errors(rotor: RotorMatrices, masters: Masters, references: Sequence[FullModes]) -> ModeErrors:
    """The condensed rotor against the full one at all speeds of the references.

    Raises ValueError as ``condensation.condense`` does.
    """
    condensed = condense(rotor, masters.nodes, masters.slopes)
    pairs = [np.zeros((0, 3))]
    for reference in references:
        found = oscillating_modes(condensed, reference.speed, reference.bearings)
        shapes = [
            translations(each, modes.shapes).reshape(len(modes.shapes), 2 * rotor.nodes)
            for each, modes in ((rotor, reference.modes), (condensed, found))
        ]
        own, partner = linear_sum_assignment(modal_assurance(shapes[0], shapes[1]), maximize=True)
        partners = np.full(len(reference.modes.eigenvalues), np.nan)
        partners[own] = found.damped_frequencies[partner]
        frequencies = reference.modes.damped_frequencies
        pairs.append(np.column_stack([np.full(len(partners), reference.speed), frequencies, partners]))
    return ModeErrors(*np.concatenate(pairs).T)


def better_masters(
    rotor: RotorMatrices, masters: Masters, references: Sequence[FullModes]
) -> tuple[Masters, ModeErrors]:
    """Add masters one by one until no mode has an error above ``ALLOWED_ERROR``.

    Each addition is the one that reduces the errors most. Returns the masters, the given ones if no addition
    helps, and the errors of the modes.
    """
    errors = mode_errors(rotor, masters, references)
    for _ in range(MOST_ADDITIONS):
        if errors.worst <= ALLOWED_ERROR:
            break
        trials = [
            (trial, mode_errors(rotor, trial, references))
            for trial in _promising(rotor, masters, references, errors)
        ]
        best, found = min(trials, key=lambda trial: _sum(trial[1]), default=(masters, errors))
        if not _sum(found) < _sum(errors):
            break
        masters, errors = best, found
    return masters, errors


def _sum(errors: ModeErrors) -> float:
    """Sum of squared errors: the largest error alone may not fall until two masters are added."""
    return float(np.sum(errors.relative**2))


def _promising(
    rotor: RotorMatrices, masters: Masters, references: Sequence[FullModes], errors: ModeErrors
) -> Iterator[Masters]:
    """The ``TRIED`` additions with the largest w of the module's head."""
    transformation = static_transformation(rotor.stiffness, masters.nodes, masters.slopes)
    condensed = condense(rotor, masters.nodes, masters.slopes)
    shapes = np.concatenate([reference.modes.shapes for reference in references])
    missed = shapes - shapes[:, condensed.freedoms] @ transformation.T
    inertia = shapes @ rotor.mass
    energy = np.sum(shapes.conj() * inertia, axis=1).real
    work = (errors.relative / energy) @ np.abs(missed * inertia)
    by_node = work.reshape(rotor.nodes, NODE_FREEDOMS // 2, 2).sum(axis=2)  # translations, slopes
    choices = [
        (by_node[node, 0] + (by_node[node, 1] if slopes else 0.0), node, slopes)
        for node in range(rotor.nodes)
        for slopes in (False, True)
        if (slopes and node not in masters.slopes) or node not in masters.nodes
    ]
    for _, node, slopes in sorted(choices, key=lambda choice: -choice[0])[:TRIED]:
        yield masters.adding(node, slopes)
