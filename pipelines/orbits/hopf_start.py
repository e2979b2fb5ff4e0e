"""The first small cycle beside a Hopf point.

At the Hopf point the Jacobian has the pair +- i omega with eigenvector q, and the cycle of amplitude A is

    s(tau) = s_0 + A Re(q exp(i omega tau)) + O(A^2),    T = 2 pi / omega + O(A^2),    lambda = lambda_0 +
    O(A^2)

A is held by the linear row <Re q, s - s_0> = A <Re q, Re q>, so that the correction cannot fall back on the
equilibrium, and the phase is that of the linear oscillation.
"""

from __future__ import annotations

import math

import numpy as np

from pipelines.orbits.floquet import Complex
from pipelines.orbits.period_map import PhaseReference
from pipelines.orbits.shooting import Correction, CycleProblem, NewtonStop, Unknowns, correct, first_basis
from pipelines.orbits.system import Vector
from pipelines.orbits.time_steps import first_steps
from pipelines.orbits.vectors import Constraint


def start_at_hopf(
    problem: CycleProblem,
    equilibrium: Vector,
    eigenvector: Complex,
    frequency: float,
    parameter: float,
    amplitude: float,
) -> Correction:
    """Correct the cycle of small ``amplitude`` (> 0) that is born at a Hopf point.

    ``equilibrium`` (N,), ``eigenvector`` (N,) of the eigenvalue i ``frequency`` (> 0) and ``parameter``
    describe the Hopf point; the eigenvector is scaled to a largest entry of modulus one, so that the
    amplitude is that of the entry which moves most.  The cycle has parameter, period and state free: continue
    it from ``cycle.unknowns``. Raises ValueError for a map with a known period, a non-positive amplitude or a
    non-positive frequency.
    """
    period_map = problem.period_map
    if not period_map.autonomous or period_map.extended:
        raise ValueError("a Hopf point starts cycles of an autonomous system only")
    if not amplitude > 0.0 or not frequency > 0.0:
        raise ValueError(f"amplitude is {amplitude} and frequency {frequency}; both must be positive")
    largest = eigenvector[np.argmax(np.abs(eigenvector))]
    direction = eigenvector / largest
    guess = Unknowns(equilibrium + amplitude * direction.real, 2.0 * math.pi / frequency, parameter)
    row = direction.real / float(direction.real @ direction.real)
    constraint = Constraint(Unknowns(row, 0.0, 0.0), float(row @ equilibrium) + amplitude)
    steps = first_steps(problem, guess)
    if isinstance(steps, NewtonStop):
        return Correction(steps, None, (), ())
    reference = _linear_reference(direction, amplitude, equilibrium, period_map.samples)
    return correct(problem, guess, constraint, first_basis(problem, guess, steps), steps, reference)


def _linear_reference(
    direction: Complex, amplitude: float, equilibrium: Vector, samples: int
) -> PhaseReference:
    """ds/dtau1 = A Re(2 pi i q exp(2 pi i tau1)) of the linear oscillation."""
    turn = np.exp(2j * math.pi * np.arange(samples) / samples)[:, None]
    orbit = equilibrium + amplitude * (direction * turn).real
    return PhaseReference.of(orbit, np.ascontiguousarray((1j * direction * turn).real))
