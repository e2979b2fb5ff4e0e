"""Small motions about an equilibrium: bearing coefficients, leading eigenvalues, instability speed.

With the perturbation exp(sigma tau) of a journal, dF = -Z(sigma) dX of a bearing (see ``machine.bearing``):

    Z(sigma) = -C (sigma I - A)^-1 (B + sigma D),     Z(i omega) = K + i omega C
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.optimize import brentq
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

from pipelines.case.arrays import Array, ComplexArray
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.machine.bearing import Bearing, linearise_bearing
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, Equilibrium, at_rest, machine_equilibrium

# Below this size all eigenvalues of the dense matrix cost less than a few shift-invert sweeps.
DENSE_SIZE = 300


def dynamic_stiffness(
    bearing: Bearing, unknowns: Array, position: Array, parameters: Array, exponents: ComplexArray
) -> ComplexArray:
    """Z(sigma) of a bearing in equilibrium, shape (exponents, 2, 2), in p0 R L_b / c of the bearing.

    ``unknowns`` = {p q} and ``position`` = (X, Y) of the equilibrium.
    """
    journal = np.array([position[0], position[1], 0.0, 0.0])
    linear = linearise_bearing(bearing, unknowns, journal, MEAN_PHASE, at_rest(parameters))
    identity = sparse.eye_array(unknowns.size)
    stiffness = np.empty((len(exponents), 2, 2), dtype=np.complex128)
    for row, sigma in enumerate(exponents):
        response = splu((sigma * identity - linear.unknowns).tocsc()).solve(
            linear.position + sigma * linear.velocity
        )
        stiffness[row] = -linear.force @ response
    return stiffness


@dataclass(frozen=True)
class Eigenpairs:
    """Eigenvalues, right eigenvectors (N, count) and residuals |J v - lambda v| / |v|."""

    values: ComplexArray
    vectors: ComplexArray
    residuals: Array


def leading_eigenvalues(jacobian: sparse.csc_array, count: int, shifts: ComplexArray) -> Eigenpairs:
    """The ``count`` eigenvalues of largest real part among those nearest the shifts, in descending order.

    Of each pair only the one with Im >= 0.  ``shifts`` lie along the imaginary axis where the rotor's whirl
    frequencies are expected: an overdamped film mode far from them may be left out.  A small matrix is solved
    whole.
    """
    pairs = eigenpairs_near(jacobian, shifts, count)
    order = np.lexsort((pairs.values.imag, -pairs.values.real))[:count]
    return Eigenpairs(pairs.values[order], pairs.vectors[:, order], pairs.residuals[order])


def eigenpairs_near(jacobian: sparse.csc_array, shifts: ComplexArray, count: int) -> Eigenpairs:
    """At least the ``count`` eigenpairs nearest every shift, merged; only Im >= 0 of complex pairs.

    Shift-invert Arnoldi about every shift; all eigenvalues of a matrix of at most ``DENSE_SIZE`` rows.
    """
    if jacobian.shape[0] <= DENSE_SIZE:
        values, vectors = np.linalg.eig(jacobian.toarray())
    else:
        found = [_arnoldi(jacobian, shift, count) for shift in shifts]
        values = np.concatenate([pair[0] for pair in found])
        vectors = np.concatenate([pair[1] for pair in found], axis=1)
    distinct: list[int] = []
    for index in np.flatnonzero(values.imag >= -1e-9 * np.abs(values)):
        apart = np.abs(values[distinct] - values[index]) > 1e-7 * (1.0 + abs(values[index]))
        if np.all(apart):
            distinct.append(int(index))
    values, vectors = values[distinct], vectors[:, distinct]
    residuals = np.linalg.norm(jacobian @ vectors - vectors * values, axis=0) / np.linalg.norm(
        vectors, axis=0
    )
    return Eigenpairs(values, vectors, residuals)


def _arnoldi(jacobian: sparse.csc_array, shift: complex, count: int) -> tuple[ComplexArray, ComplexArray]:
    """Eigenpairs nearest a shift by Arnoldi on (J - shift I)^-1, from a fixed start vector (reproducible)."""
    size = jacobian.shape[0]
    factor = splu((jacobian - shift * sparse.eye_array(size)).tocsc().astype(np.complex128))
    inverse = LinearOperator((size, size), matvec=factor.solve, dtype=np.complex128)
    start = np.cos(np.arange(1, size + 1, dtype=np.float64)).astype(np.complex128)
    wanted = min(count, size - 2)
    search = {"k": wanted, "v0": start, "tol": 1e-13, "maxiter": 200 * wanted, "rng": 0}
    try:
        values, vectors = eigs(inverse, **search)
    except ArpackNoConvergence:  # once more in a space so large that few restarts are needed
        values, vectors = eigs(inverse, ncv=min(size, 6 * wanted + 40), **search)
    return shift + 1.0 / values, vectors


def whirl_shifts(machine: Machine, speed: float) -> ComplexArray:
    """Shifts on the imaginary axis: from the low whirl modes to beyond the rotating speed, then higher modes.

    Modes of the free rotor above that range are taken up if they decay slowly enough to lead film and foil.
    """
    free = np.linalg.eigvals(machine.space.constant)
    elastic = free[free.imag > 1e-3 * np.abs(free).max()]
    elastic = elastic[np.argsort(elastic.imag)]
    top = 1.5 * speed if elastic.size == 0 else max(1.5 * speed, 1.2 * float(elastic[0].imag))
    shifts = [*(np.linspace(0.1, 1.0, 4) * top)]
    for mode in elastic[-elastic.real < top]:
        if mode.imag > 1.2 * shifts[-1]:  # the modes of both planes coincide
            shifts.append(mode.imag)
    return 1j * np.array(shifts)


@dataclass(frozen=True)
class LinearPoint:
    """An equilibrium at a speed with its leading eigenvalues."""

    speed: float
    equilibrium: Equilibrium
    eigenpairs: Eigenpairs


def linear_point(
    machine: Machine, parameters: Array, count: int, guess: Array | None = None
) -> LinearPoint | Equilibrium:
    """Equilibrium and leading eigenvalues, or the failed ``Equilibrium``."""
    equilibrium = machine_equilibrium(machine, parameters, guess)
    return linearised(machine, parameters, equilibrium, count) if equilibrium.converged else equilibrium


def linearised(machine: Machine, parameters: Array, equilibrium: Equilibrium, count: int) -> LinearPoint:
    """The leading eigenvalues of an equilibrium."""
    jacobian = machine.jacobian(MEAN_PHASE, equilibrium.state, at_rest(parameters))
    speed = float(parameters[film.SPEED])
    pairs = leading_eigenvalues(jacobian, count, whirl_shifts(machine, speed))
    return LinearPoint(speed, equilibrium, pairs)


def at_speed(parameters: Array, speed: float) -> Array:
    """The parameters with another rotating speed."""
    changed = parameters.copy()
    changed[film.SPEED] = speed
    return changed


@dataclass(frozen=True)
class Instability:
    """A Hopf point: the speed at which a pair crosses the imaginary axis, its frequency and eigenvector."""

    speed: float
    frequency: float
    eigenvector: ComplexArray
    equilibrium: Equilibrium
    growth: float
    """Real part left at the located speed."""
    growth_slope: float
    """d Re lambda / d speed."""


def locate_instability(
    machine: Machine, parameters: Array, lower: LinearPoint, upper: LinearPoint, tolerance: float = 1e-8
) -> Instability:
    """Locate the speed between two points at which the leading complex pair changes stability (Hopf).

    The speed is accurate to ``tolerance`` or better.  Raises ValueError if the pair does not cross.
    """
    guess = lower.equilibrium.state
    frequency = _critical(upper if _critical(upper).real > 0.0 else lower).imag

    def crossing(speed: float) -> tuple[complex, ComplexArray, Equilibrium]:
        at = at_speed(parameters, speed)
        equilibrium = machine_equilibrium(machine, at, guess)
        jacobian = machine.jacobian(MEAN_PHASE, equilibrium.state, at_rest(at))
        pairs = leading_eigenvalues(jacobian, 4, np.array([1j * frequency]))
        index = int(np.argmax(np.where(pairs.values.imag > 1e-6, pairs.values.real, -np.inf)))
        return complex(pairs.values[index]), pairs.vectors[:, index], equilibrium

    def growth(speed: float) -> float:
        return crossing(speed)[0].real

    if growth(lower.speed) * growth(upper.speed) > 0.0:
        raise ValueError(f"no pair crosses the imaginary axis between {lower.speed:g} and {upper.speed:g}")
    speed = float(
        brentq(growth, lower.speed, upper.speed, xtol=0.01 * tolerance, rtol=4 * np.finfo(float).eps)
    )
    value, vector, equilibrium = crossing(speed)
    step = 1e-4 * speed
    slope = (growth(speed + step) - growth(speed - step)) / (2.0 * step)
    return Instability(speed, value.imag, vector, equilibrium, value.real, slope)


def _critical(point: LinearPoint) -> complex:
    """The oscillating eigenvalue of largest real part."""
    oscillating = point.eigenpairs.values[point.eigenpairs.values.imag > 1e-6]
    return complex(oscillating[np.argmax(oscillating.real)])
