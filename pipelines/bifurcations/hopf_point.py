"""Where cycles of an autonomous system are born: a complex pair of eigenvalues crosses the imaginary axis.

The test function is the product of all lambda_i + lambda_j, i < j, kept as its sign times the modulus of its
smallest factor: it changes sign at Hopf points, and where two real eigenvalues have the sum zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from pipelines.bifurcations.branch import BranchStart
from pipelines.bifurcations.detection import signed_smallest
from pipelines.orbits.floquet import Complex
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.system import Matrix, Vector

_ITERATIONS = 50  # of Newton for an equilibrium
_TOLERANCE = 1e-12  # last update of an equilibrium, relative to max(1, its largest entry)
_REAL = 1e-6  # imaginary part, relative to the largest eigenvalue, below which a pair is two real eigenvalues


@dataclass(frozen=True)
class HopfPoint:
    """An equilibrium with a pair of imaginary eigenvalues.

    The ``equilibrium`` (N,) with the eigenvalue i ``frequency`` (> 0), its ``eigenvector`` (N,) and the
    ``parameter``.
    """

    equilibrium: Vector
    eigenvector: Complex
    frequency: float
    parameter: float


def hopf_point(problem: CycleProblem, bracket: tuple[float, float], guess: Vector) -> HopfPoint:
    """The Hopf point of the equilibrium near ``guess`` (N,) between two values of the problem's parameter.

    Raises ValueError for a forced system, where Newton's method finds no equilibrium, and where none or two
    pairs cross between the two values.
    """
    if problem.period_map.system.forcing is not None:
        raise ValueError("a forced system has no equilibria: Hopf points are those of autonomous ones")
    ends = [_equilibrium(problem, value, guess) for value in bracket]

    def at(value: float) -> tuple[Vector, Matrix]:
        share = (value - bracket[0]) / (bracket[1] - bracket[0])
        state = _equilibrium(problem, value, (1.0 - share) * ends[0] + share * ends[1])
        return state, _jacobian(problem, state, value)

    def test(value: float) -> float:
        eigenvalues = np.linalg.eigvals(at(value)[1]).astype(complex)
        first, second = np.triu_indices(len(eigenvalues), k=1)
        return signed_smallest(eigenvalues[first] + eigenvalues[second])

    if test(bracket[0]) * test(bracket[1]) > 0.0:
        raise ValueError(
            f"no pair, or two, cross the imaginary axis between {problem.parameter} = {bracket[0]} and "
            f"{bracket[1]}: give other ends"
        )
    parameter = float(brentq(test, *bracket, xtol=1e-14, rtol=1e-14))
    state, jacobian = at(parameter)
    eigenvalues, vectors = np.linalg.eig(jacobian)
    nearest = int(np.argmin(np.where(eigenvalues.imag > 0.0, np.abs(eigenvalues.real), np.inf)))
    frequency = float(eigenvalues[nearest].imag)
    if not frequency > _REAL * float(np.max(np.abs(eigenvalues))):
        raise ValueError(f"two real eigenvalues have the sum zero at {problem.parameter} = {parameter:.6g}")
    return HopfPoint(state, vectors[:, nearest].astype(complex), frequency, parameter)


def cycles_from_hopf(problem: CycleProblem, point: HopfPoint, amplitude: float) -> BranchStart | None:
    """The start of the branch of cycles born at a Hopf point of ``problem``.

    ``amplitude`` (> 0) of the entry that moves most.  None when no cycle of that amplitude was found: try a
    smaller one.
    """
    found = start_at_hopf(
        problem, point.equilibrium, point.eigenvector, point.frequency, point.parameter, amplitude
    )
    if found.cycle is None:
        return None
    first = found.cycle.unknowns
    return BranchStart(first.state, first.parameter, first.period)


def _equilibrium(problem: CycleProblem, value: float, guess: Vector) -> Vector:
    """Solve f(s) = 0 by Newton's method."""
    system, parameters = problem.period_map.system, problem.parameters_at(value)
    state = np.array(guess, dtype=float)
    for _ in range(_ITERATIONS):
        try:
            update = np.linalg.solve(
                _jacobian(problem, state, value), system.rates_at(0.0, state, parameters)
            )
        except np.linalg.LinAlgError:
            break
        state = state - update
        if np.max(np.abs(update)) <= _TOLERANCE * max(1.0, float(np.max(np.abs(state)))):
            return state
    raise ValueError(f"no equilibrium was found at {problem.parameter} = {value}: give a better guess")


def _jacobian(problem: CycleProblem, state: Vector, value: float) -> Matrix:
    system = problem.period_map.system
    return system.tangent_at(0.0, state, np.eye(system.size), problem.parameters_at(value))
