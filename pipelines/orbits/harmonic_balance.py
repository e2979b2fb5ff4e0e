"""Cycles of forced systems by harmonic balance, in the modes of the system at rest.

With x = s - s0 about a state s0 at rest, A = J(s0) = V diag(lambda) W and the forcing frequency omega, the
harmonic k of a cycle is a fixed point of

    x_k <- V (i k omega - lambda)^-1 W [f(phase, s0 + x) - A x]_k,      k = 0 ... K

which Anderson acceleration finds.  [.]_k is the discrete Fourier transform over equally spaced phases, of
which there are more than 2 K, so that products alias little into the harmonics that are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pipelines.orbits.floquet import Complex, orthonormal
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import DynamicalSystem, Matrix, Vector, size_of

_GROWTH = 1e3  # of the update over its smallest value: the iteration does not come back
_PHASES = 16  # of the forcing, over which the mean is taken that a state at rest balances
_RESTS = 50  # iterations of Newton's method for a state at rest, at most
_AT_REST = 1e-10  # relative update that is none


@dataclass(frozen=True)
class RestingSystem:
    """A system about a state at rest: ``state`` (N,), Jacobian ``matrix`` (N, N) and its eigenvalues (N,).

    ``vectors`` V and ``inverse`` W, both (N, N), diagonalise it.
    """

    state: Vector
    matrix: Matrix
    eigenvalues: Complex
    vectors: Complex
    inverse: Complex

    @classmethod
    def of(cls, state: Vector, matrix: Matrix) -> RestingSystem:
        """Diagonalise the Jacobian at a state; raises LinAlgError where it has too few eigenvectors."""
        eigenvalues, vectors = scipy.linalg.eig(matrix)
        return cls(state, matrix, eigenvalues, vectors, scipy.linalg.inv(vectors))

    def slow_basis(self, columns: int) -> Matrix:
        """Orthonormal basis (N, k) of the slowest modes, k at most ``columns``: pairs are not divided.

        The identity where the system is no larger.
        """
        size = len(self.state)
        if size <= columns:
            return np.eye(size)
        kept: list[Vector] = []
        for mode in np.argsort(-self.eigenvalues.real, kind="stable"):
            value, vector = self.eigenvalues[mode], self.vectors[:, mode]
            if value.imag < 0.0:  # the conjugate of a mode that is kept
                continue
            parts = [vector.real] if value.imag == 0.0 else [vector.real, vector.imag]
            if len(kept) + len(parts) > columns:
                break
            kept += parts
        return orthonormal(np.column_stack(kept))


def resting_near(system: DynamicalSystem, guess: Vector, parameters: Vector) -> RestingSystem | None:
    """The system at rest: a zero near ``guess`` (N,) of the mean of its rates over the phase of the forcing.

    None where Newton's method finds none; raises LinAlgError as `RestingSystem.of` does.
    """
    phases = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
    state, identity = np.array(guess, dtype=float), np.eye(system.size)

    def mean(values: list[Matrix]) -> Matrix:
        return np.asarray(np.mean(values, axis=0))

    for _ in range(_RESTS):
        rates = mean([system.rates_at(phase, state, parameters) for phase in phases])
        matrix = mean([system.tangent_at(phase, state, identity, parameters) for phase in phases])
        update = solve_or_none(matrix, -rates)
        if update is None:
            return None
        if float(np.max(np.abs(update))) <= _AT_REST * size_of(state):
            return RestingSystem.of(state, matrix)
        state = state + update
    return None


@dataclass(frozen=True)
class HarmonicOptions:
    """``harmonics`` K at equally spaced ``phases``, and when the iteration ends.

    ``tolerance``: largest update of a state relative to the largest state; ``iterations`` at most; ``depth``:
    earlier iterates that the acceleration combines.  Raises ValueError for too few phases.
    """

    harmonics: int = 3
    phases: int = 10
    tolerance: float = 1e-4
    iterations: int = 30
    depth: int = 6

    def __post_init__(self) -> None:
        if self.harmonics < 1 or self.phases <= 2 * self.harmonics:
            raise ValueError(
                f"{self.harmonics} harmonics on {self.phases} phases; needed: at least 1, and more than "
                "twice as many phases"
            )


@dataclass(frozen=True)
class HarmonicCycle:
    """The last iterate: ``harmonics`` (K + 1, N) of s(phase), and the relative ``update`` that led to it."""

    harmonics: Complex
    update: float
    iterations: int
    converged: bool

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.harmonics)))

    @property
    def state(self) -> Vector:
        """The state (N,) at phase zero."""
        return self.at(np.zeros(1))[0]

    def at(self, phases: Vector) -> Matrix:
        """States (phases, N) at phases of the forcing [rad]."""
        turns = np.exp(1j * np.outer(phases, np.arange(len(self.harmonics))))
        turns[:, 1:] *= 2.0
        return np.ascontiguousarray((turns @ self.harmonics).real)


def harmonic_balance(
    system: DynamicalSystem,
    resting: RestingSystem,
    parameters: Vector,
    options: HarmonicOptions,
    guess: HarmonicCycle | None = None,
) -> HarmonicCycle:
    """The cycle of a forced system near its state at rest, or near a ``guess``.

    Failure is a result: see ``HarmonicCycle.converged``.  Raises ValueError for an autonomous system.
    """
    if system.forcing is None:
        raise ValueError("harmonic balance needs the frequency of a forcing")
    phases = 2.0 * np.pi * np.arange(options.phases) / options.phases
    orders = np.arange(options.harmonics + 1)
    waves = np.exp(1j * np.outer(phases, orders))
    transform, synthesis = waves.conj().T / options.phases, np.where(orders > 0, 2.0, 1.0) * waves
    inverse_shifts = 1j * orders[:, None] * float(parameters[system.forcing]) - resting.eigenvalues
    rates, work = np.empty((options.phases, system.size)), np.empty(system.work_size)

    def harmonics_of(deviation: Matrix) -> Complex:
        states = resting.state + deviation
        for phase, state, out in zip(phases, states, rates, strict=True):
            system.rates(phase, state, parameters, system.constants, system.layout, work, out)
        modal = (transform @ (rates - deviation @ resting.matrix.T)) @ resting.inverse.T
        return np.asarray((modal / inverse_shifts) @ resting.vectors.T)

    def step(deviation: Vector) -> Vector:
        harmonics = harmonics_of(deviation.reshape(rates.shape))
        return np.asarray((synthesis @ harmonics).real.ravel())

    start = np.zeros(rates.size) if guess is None else (guess.at(phases) - resting.state).ravel()
    scale = size_of(resting.state)
    with np.errstate(all="ignore"):
        deviation, update, iterations = accelerated(step, start, options, scale)
        harmonics = transform @ deviation.reshape(rates.shape)
    harmonics[0] += resting.state
    return HarmonicCycle(harmonics, update, iterations, update <= options.tolerance)


def accelerated(
    step: Callable[[Vector], Vector], start: Vector, options: HarmonicOptions, scale: float
) -> tuple[Vector, float, int]:
    """Anderson acceleration of x <- step(x): the last step(x), its update over ``scale``, the iterations.

    Of the last iterates x_i with residuals r_i = step(x_i) - x_i it takes the affine combination of the
    step(x_i) whose combined residual is smallest.
    """
    images: list[Vector] = []
    residuals: list[Vector] = []
    smallest, point, iterations = np.inf, start, 0
    while True:
        image, iterations = step(point), iterations + 1
        residual = image - point
        update = float(np.max(np.abs(residual))) / scale
        smallest = min(smallest, update)
        settled = update <= options.tolerance or not update <= _GROWTH * smallest
        if settled or iterations == options.iterations:
            return image, update, iterations
        images, residuals = [*images, image][-options.depth :], [*residuals, residual][-options.depth :]
        point = image
        if len(images) > 1:
            changes = np.diff(residuals, axis=0)
            weights = np.linalg.lstsq(changes.T, residual, rcond=None)[0]
            point = image - weights @ np.diff(images, axis=0)
