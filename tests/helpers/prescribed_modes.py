"""Modes on prescribed paths over the speed, in place of a machine's: their critical speeds are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from pipelines.orbits.equilibria import campbell, followed_mode
from pipelines.orbits.equilibria.campbell import CampbellDiagram, campbell_diagram
from pipelines.orbits.equilibria.critical_speeds import CriticalSpeeds, critical_speeds
from pipelines.orbits.equilibria.equilibrium import Equilibrium
from pipelines.orbits.equilibria.modes import LARGEST_KNOWN, ModeSet

Matrix = NDArray[np.float64]
Path = Callable[[float], complex | Matrix]


@dataclass(frozen=True)
class PrescribedModes:
    """The modes of J(speed); ``missing`` speeds have no equilibrium."""

    matrix: Callable[[float], Matrix]
    missing: Callable[[float], bool] = lambda speed: False

    def equilibrium(self, speed: float) -> Equilibrium:
        gone = self.missing(speed)
        return Equilibrium(np.zeros(1), 0.0, 0, not gone, "too heavy" if gone else "converged")

    def modes(self, speed: float) -> ModeSet:
        values, vectors = np.linalg.eig(self.matrix(speed))
        kept = np.flatnonzero((values.imag > 1e-6) & (-values.real < LARGEST_KNOWN * np.abs(values)))
        kept = kept[np.argsort(values.imag[kept], kind="stable")]
        vectors = vectors[:, kept] / np.linalg.norm(vectors[:, kept], axis=0)
        even = vectors.shape[0] // 2 * 2
        return ModeSet(values[kept], vectors, vectors[:even].T.reshape(len(kept), -1, 2))

    def critical_speeds(
        self, patch: pytest.MonkeyPatch, speeds: tuple[float, float], points: int
    ) -> tuple[CampbellDiagram, CriticalSpeeds]:
        """Critical speeds damped less than 1/2 of a machine that has these modes."""
        patch.setattr(
            campbell,
            "equilibrium_along",
            lambda machine, at, along, index, guess: self.equilibrium(along[index]),
        )
        patch.setattr(
            followed_mode, "machine_equilibrium", lambda machine, at, guess: self.equilibrium(at[0])
        )
        for module in (campbell, followed_mode):
            patch.setattr(module, "modes_at", lambda machine, at, state, top: self.modes(at[0]))
        nothing: Any = None
        diagram = campbell_diagram(nothing, np.zeros(4), np.linspace(*speeds, points))
        return diagram, critical_speeds(nothing, np.zeros(4), diagram, 0.5)


def on_paths(*paths: Path) -> Callable[[float], Matrix]:
    """J = S D S^-1: blocks of two states on paths (an eigenvalue or the block itself), mixed by a matrix S
    that turns with the speed and is far from orthogonal.
    """
    draw, size = np.random.default_rng(0), 2 * len(paths)
    turn, skew = draw.standard_normal((2, size, size)) / np.sqrt(size)

    def matrix(speed: float) -> Matrix:
        blocks = np.zeros((size, size))
        for index, path in enumerate(paths):
            own, value = slice(2 * index, 2 * index + 2), path(speed)
            is_block = isinstance(value, np.ndarray)
            blocks[own, own] = value if is_block else [[value.real, -value.imag], [value.imag, value.real]]
        mixing = expm(0.3 * speed * (turn - turn.T)) @ (np.eye(size) + 0.3 * skew)
        return np.asarray(mixing @ blocks @ np.linalg.inv(mixing))

    return matrix


def rotor_in_films(seed: int) -> Callable[[float], Matrix]:
    """A random chain of 2 to 4 discs, with or without gyroscopy, alike or not, between two films that lag,
    cross-couple and change with the speed: modes come close, veer, coalesce, become overdamped, unstable.
    """
    draw = np.random.default_rng(seed)
    nodes = int(draw.integers(2, 5))
    size = 2 * nodes

    def between(low: float, high: float, *shape: int) -> Any:
        return np.exp(draw.uniform(np.log(low), np.log(high), shape))

    shaft, mass, gyroscopic = (
        between(0.2, 4.5, nodes - 1),
        between(0.4, 2.7, nodes),
        draw.uniform(0, 1.5, nodes),
    )
    if draw.random() < 0.3:
        mass[::-1][: nodes // 2], shaft, gyroscopic = mass[: nodes // 2], np.minimum(shaft, shaft[::-1]), 0.5
    if draw.random() < 0.2:
        gyroscopic = 0.0
    stiffness = np.zeros((nodes, nodes))
    for node, own in enumerate(shaft):
        stiffness[node : node + 2, node : node + 2] += own * np.array([[1.0, -1.0], [-1.0, 1.0]])
    planes, turn = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
    inverse = np.kron(np.diag(1.0 / mass), planes)
    shaft_part = inverse @ np.kron(stiffness, planes)
    gyroscopic_part = np.kron(np.diag(gyroscopic * np.ones(nodes)), turn)
    damping = float(between(2.5e-3, 0.2))
    soft, lag, cross, rise = (
        float(between(*bounds)) for bounds in ((0.08, 2.7), (0.2, 12), (0.05, 2.7), (0.1, 3))
    )
    unlike = 1.0 + draw.uniform(-0.5, 0.5) * (draw.random() < 0.7)

    def matrix(speed: float) -> Matrix:
        whole = np.zeros((2 * size + 4, 2 * size + 4))
        whole[:size, size : 2 * size] = np.eye(size)
        whole[size : 2 * size, :size] = -shaft_part
        whole[size : 2 * size, size : 2 * size] = -speed * gyroscopic_part - damping * (
            shaft_part + 0.1 * np.eye(size)
        )
        direct, coupled = soft * (0.3 + rise * speed / (1.0 + speed)), cross * soft * speed / (1.0 + speed**2)
        for index, node in enumerate((0, nodes - 1)):
            film, place = slice(2 * size + 2 * index, 2 * size + 2 * index + 2), slice(2 * node, 2 * node + 2)
            velocity = slice(size + 2 * node, size + 2 * node + 2)
            # f' = lag (K x + C x' - f)
            whole[film, film] = -lag * planes
            whole[film, place] = lag * (direct * np.diag([1.0, unlike]) + coupled * turn)
            whole[film, velocity] = lag * 0.5 * soft / (0.2 + speed) * planes
            whole[velocity, film] -= inverse[place, place]
        return whole

    return matrix
