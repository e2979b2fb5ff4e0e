"""Campbell diagram, critical speeds and predicted parametric resonances of the linearised machine.

A mode is an oscillating eigenpair of the full linearisation, film and foil states included, followed in speed
by its shape.  A critical speed is where a mode whirls synchronously:

    Im lambda_j(Omega) = Omega        with damping ratio -Re lambda / |lambda| below a bound
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, linear_sum_assignment

from pipelines.machine.assembly import Machine
from pipelines.machine.rotor_modes import translations, whirl_directions

from .equilibrium import MEAN_PHASE, at_rest, machine_equilibrium
from .linear import Array, ComplexArray, at_speed, eigenpairs_near, nearest_eigenpair

# Modes damped more than this are film and foil modes: they do not vibrate and are not followed.
LARGEST_DAMPING_RATIO = 0.9
MODES_PER_SHIFT = 10
SHIFTS = 4


@dataclass(frozen=True)
class ModeSet:
    """Oscillating modes at one speed: eigenvalues (modes,) and their displacements at all shaft nodes (modes,
    nodes, 2).
    """

    eigenvalues: ComplexArray
    shapes: ComplexArray


@dataclass(frozen=True)
class CampbellDiagram:
    """Modes followed over the speeds; entries of a mode are NaN where it does not exist or was not found.

    ``eigenvalues`` (speeds, modes), ``directions`` (speeds, modes): +1 forward, -1 backward, 0 planar.
    ``missing``: reasons of the speeds without equilibrium, by index.
    """

    speeds: Array
    eigenvalues: ComplexArray
    directions: NDArray[np.int8]
    states: tuple[Array | None, ...]
    missing: dict[int, str]

    @property
    def damping_ratios(self) -> Array:
        """-Re lambda / |lambda|, shape (speeds, modes)."""
        return np.asarray(-self.eigenvalues.real / np.abs(self.eigenvalues))


@dataclass(frozen=True)
class CriticalSpeed:
    """Synchronous whirl: speed, eigenvalue there, +1 forward / -1 backward / 0 planar, shape (nodes, 2)."""

    speed: float
    eigenvalue: complex
    direction: int
    shape: ComplexArray

    @property
    def damping_ratio(self) -> float:
        """-Re lambda / |lambda|."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


@dataclass(frozen=True)
class Resonance:
    """An excitation frequency at which Eq. 22 expects a parametric resonance or anti-resonance.

    ``first`` and ``second`` count the critical speeds from 1; ``kind`` is principal (2 Omega_j / n), sum or
    difference.
    """

    frequency: float
    first: int
    second: int
    order: int
    kind: str


def campbell_diagram(
    machine: Machine, parameters: Array, speeds: Array, visit: Callable[[int], None] | None = None
) -> CampbellDiagram:
    """Follow the oscillating modes over rising ``speeds``; ``visit(index)`` is called before each."""
    rows: list[dict[int, complex]] = []
    whirl: list[dict[int, int]] = []
    states: list[Array | None] = []
    missing: dict[int, str] = {}
    last: dict[int, tuple[complex, ComplexArray]] = {}
    top, guess, known = 1.2 * float(speeds[-1]), None, 0
    for index, speed in enumerate(speeds):
        if visit is not None:
            visit(index)
        equilibrium = machine_equilibrium(machine, at_speed(parameters, speed), guess)
        rows.append({})
        whirl.append({})
        states.append(equilibrium.state if equilibrium.converged else None)
        if not equilibrium.converged:
            missing[index] = equilibrium.reason
            continue
        guess = equilibrium.state
        modes = modes_at(machine, at_speed(parameters, speed), guess, top)
        for mode, column in enumerate(_same_modes(last, modes, known)):
            known = max(known, column + 1)
            last[column] = (complex(modes.eigenvalues[mode]), modes.shapes[mode])
            rows[-1][column] = complex(modes.eigenvalues[mode])
            whirl[-1][column] = int(whirl_directions(modes.shapes[mode : mode + 1])[0])
    eigenvalues = np.full((len(rows), known), complex(np.nan, np.nan))
    directions = np.zeros((len(rows), known), dtype=np.int8)
    for index, row in enumerate(rows):
        eigenvalues[index, list(row)] = list(row.values())
        directions[index, list(row)] = [whirl[index][column] for column in row]
    return CampbellDiagram(np.asarray(speeds)[: len(rows)], eigenvalues, directions, tuple(states), missing)


def modes_at(machine: Machine, parameters: Array, state: Array, top: float) -> ModeSet:
    """Oscillating modes with a damping ratio below ``LARGEST_DAMPING_RATIO`` and 0 < Im lambda <= ``top``."""
    jacobian = machine.jacobian(MEAN_PHASE, state, at_rest(parameters))
    shifts = np.array([1j * top * (number + 0.5) / SHIFTS for number in range(SHIFTS)])
    pairs = eigenpairs_near(jacobian, shifts, MODES_PER_SHIFT)
    values = pairs.values
    kept = (values.imag > 1e-6) & (values.imag <= top)
    kept &= -values.real < LARGEST_DAMPING_RATIO * np.abs(values)
    order = np.flatnonzero(kept)[np.argsort(values.imag[kept], kind="stable")]
    return ModeSet(values[order], node_shapes(machine, pairs.vectors[:, order]))


def node_shapes(machine: Machine, vectors: ComplexArray) -> ComplexArray:
    """Displacements x, y at all shaft nodes (modes, nodes, 2) of eigenvectors (N, modes), the largest
    component 1.
    """
    start = machine.rotor_start
    shapes = translations(machine.scaled, vectors[start : start + machine.rotor_freedoms].T)
    flat = shapes.reshape(vectors.shape[1], -1)
    largest = flat[np.arange(len(flat)), np.argmax(np.abs(flat), axis=1)]
    return np.asarray(shapes / largest[:, None, None])


def _same_modes(last: dict[int, tuple[complex, ComplexArray]], modes: ModeSet, known: int) -> list[int]:
    """Column of every mode: that of the last mode with nearest eigenvalue and shape, or a new one."""
    columns = list(last)
    if not columns or not len(modes.eigenvalues):
        return list(range(known, known + len(modes.eigenvalues)))
    values = np.array([last[column][0] for column in columns])
    shapes = np.array([last[column][1].ravel() for column in columns])
    own = modes.shapes.reshape(len(modes.eigenvalues), -1)
    distance = np.abs(modes.eigenvalues[:, None] - values[None, :])
    likeness = np.abs(own.conj() @ shapes.T) ** 2
    likeness /= np.outer(np.sum(np.abs(own) ** 2, axis=1), np.sum(np.abs(shapes) ** 2, axis=1))
    cost = distance + 0.3 * (1.0 - likeness)
    rows, matched = linear_sum_assignment(cost)
    result = [-1] * len(modes.eigenvalues)
    for row, column in zip(rows, matched, strict=True):
        if cost[row, column] < 0.35:  # neither another mode nor one that jumped
            result[row] = columns[column]
    fresh = iter(range(known, known + len(result)))
    return [next(fresh) if column < 0 else column for column in result]


def critical_speeds(
    machine: Machine, parameters: Array, diagram: CampbellDiagram, max_damping_ratio: float
) -> list[CriticalSpeed]:
    """Critical speeds between the speeds of a diagram, rising; located to rounding by bracketing."""
    found = []
    excess = diagram.eigenvalues.imag - diagram.speeds[:, None]
    for index, mode in zip(*np.nonzero(excess[:-1] * excess[1:] < 0.0), strict=True):
        critical = _locate_critical(machine, parameters, diagram, int(index), int(mode))
        if critical is not None and critical.damping_ratio < max_damping_ratio:
            found.append(critical)
    return sorted(found, key=lambda critical: critical.speed)


def _locate_critical(
    machine: Machine, parameters: Array, diagram: CampbellDiagram, index: int, mode: int
) -> CriticalSpeed | None:
    """The crossing of one mode with the synchronous line between two speeds of the diagram; None if it was
    lost.
    """
    low, high = diagram.speeds[index : index + 2]
    ends = diagram.eigenvalues[index : index + 2, mode]

    def pair_at(speed: float) -> tuple[complex, ComplexArray]:
        at = at_speed(parameters, speed)
        state = machine_equilibrium(machine, at, diagram.states[index]).state
        expected = ends[0] + (ends[1] - ends[0]) * (speed - low) / (high - low)
        eigenvalue, vector = nearest_eigenpair(machine.jacobian(MEAN_PHASE, state, at_rest(at)), expected)
        return eigenvalue, node_shapes(machine, vector[:, None])[0]

    def excess(speed: float) -> float:
        return pair_at(speed)[0].imag - speed

    if excess(low) * excess(high) > 0.0:
        return None
    speed = float(brentq(excess, low, high, xtol=1e-10))
    eigenvalue, shape = pair_at(speed)
    return CriticalSpeed(speed, eigenvalue, int(whirl_directions(shape[None])[0]), shape)


def parametric_resonances(critical: Sequence[float], orders: int) -> list[Resonance]:
    """2 Omega_j / n and |Omega_j +- Omega_k| / n for n up to ``orders`` (Eq. 22), by rising frequency."""
    found = []
    for order in range(1, orders + 1):
        for j, first in enumerate(critical, start=1):
            found.append(Resonance(2.0 * first / order, j, j, order, "principal"))
            for k in range(j + 1, len(critical) + 1):
                second = critical[k - 1]
                found.append(Resonance((first + second) / order, j, k, order, "sum"))
                found.append(Resonance(abs(first - second) / order, j, k, order, "difference"))
    return sorted(found, key=lambda resonance: resonance.frequency)
