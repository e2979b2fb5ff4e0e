"""Where branches of tori start: around a cycle with a second driving frequency, or at a Neimark-Sacker point.

At a Neimark-Sacker point with M q = e^(i theta_0) q the invariant curves are

    x(theta) = s_0 + 2 A Re(q e^(i theta)) + O(A^2),    rho = theta_0 + O(A^2),    lambda = lambda_0 + O(A^2)

so the parameter turns there.  The first curve is corrected with the amplitude fixed instead of the parameter,

    mean_j <v_j, x_j - s_0> = A',    v_j = Re(q e^(i theta_j))

which the cycle cannot satisfy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.fourier import angles
from pipelines.bifurcations.tori.invariant_curve import TorusCorrection, correct_torus
from pipelines.bifurcations.tori.problem import FourierOptions, TorusConstraint, TorusProblem, TorusUnknowns
from pipelines.bifurcations.tori.slow_bases import SlowBases, constant_bases
from pipelines.bifurcations.tori.stability import growth_moduli, transport
from pipelines.bifurcations.tori.system import pass_from_all
from pipelines.bifurcations.tori.torus import TorusStart
from pipelines.orbits.floquet import Complex, deterministic_block, floquet_spectrum, orthonormal
from pipelines.orbits.shooting import CycleProblem, Unknowns, first_basis
from pipelines.orbits.system import Matrix, Vector

_SWEEPS = 3  # of subspace iteration for bases from nothing
_EIGENVECTOR_SWEEPS = 40
_EIGENVECTOR_RESIDUAL = 1e-8


def torus_around(problem: TorusProblem, state: Vector, parameter: float) -> TorusStart:
    """The start for a constant curve around a state (N,) of a map with known rotation.

    Its slow bases come from subspace iteration.  Raises ValueError for an unknown rotation.
    """
    if problem.circle.rotation(parameter) is None:
        raise ValueError("a curve of unknown rotation does not start from a constant; use torus_from_event")
    states = np.tile(np.asarray(state, dtype=float), (problem.fourier.fewest, 1))
    unknowns = problem.consistent(TorusUnknowns(states, 0.0, parameter))
    return TorusStart(states, first_bases(problem, unknowns), parameter, unknowns.rotation)


def first_bases(problem: TorusProblem, unknowns: TorusUnknowns) -> SlowBases:
    """Slow bases of a curve that has none, by subspace iteration on a fixed block.

    The block is enlarged until the smallest multiplier is below the cut.  Identities when the system is
    no larger than the initial block.
    """
    count, size = unknowns.states.shape
    options = problem.options.basis
    if size <= options.initial_columns:
        return constant_bases(np.eye(size), count)
    bases = constant_bases(orthonormal(deterministic_block(size, options.initial_columns)), count)
    while True:
        for _ in range(_SWEEPS):
            passed = pass_from_all(problem, unknowns, bases.columns, False)
            if not passed.finite:
                return bases
            previous, bases = bases, bases.following(passed.columns, unknowns.rotation)
        carried = transport(previous.columns, passed.columns, unknowns.rotation)
        wider = bases.grown(growth_moduli(carried, unknowns.rotation), options)
        if wider.columns.shape[2] == bases.columns.shape[2]:
            return bases
        bases = wider


@dataclass(frozen=True)
class BornTorus:
    """The start of the branch of tori at a Neimark-Sacker point, for ``continue_torus(problem, start, ...)``.

    ``direction``: the sense of the parameter in which the branch leaves the point; ``correction``: how the
    first torus was found.
    """

    problem: TorusProblem
    start: TorusStart
    direction: int
    correction: TorusCorrection


def torus_from_event(
    problem: CycleProblem, event: Event, amplitude: float, fourier: FourierOptions | None = None
) -> BornTorus | None:
    """The branch of tori at a Neimark-Sacker point of ``problem``.

    ``amplitude`` (> 0): largest entry of the first step away from the cycle.  None when no torus of that
    amplitude was found: try another one.  Raises ValueError for an event of another kind, an amplitude that
    is not positive or cycles of unknown period.
    """
    if event.kind is not EventKind.NEIMARK_SACKER:
        raise ValueError(f"tori start at a Neimark-Sacker point, not at a {event.kind.name}")
    if not amplitude > 0.0:
        raise ValueError(f"amplitude is {amplitude}; it must be positive")
    circle = PeriodCircle(problem.period_map, event.parameters, problem.parameter, event.steps)
    tori = TorusProblem(circle, problem.options, FourierOptions() if fourier is None else fourier)
    found = _critical_vector(problem, event)
    if found is None:
        return None
    vector, basis = found
    count, parameter = tori.fourier.fewest, float(event.parameters[problem.index])
    deviation = amplitude * np.ascontiguousarray((np.exp(1j * angles(count))[:, None] * vector).real)
    guess = TorusUnknowns(event.state + deviation, event.angle, parameter)
    row = deviation / float(np.vdot(deviation, deviation))
    constraint = TorusConstraint(TorusUnknowns(row, 0.0, 0.0), float(np.vdot(row, guess.states)))
    correction = correct_torus(tori, guess, constraint, constant_bases(basis, count), guess.states)
    if correction.torus is None or correction.rough:
        return None
    torus = correction.torus
    at = torus.unknowns
    start = TorusStart(at.states, torus.bases, at.parameter, at.rotation)
    return BornTorus(tori, start, 1 if at.parameter >= parameter else -1, correction)


def _critical_vector(problem: CycleProblem, event: Event) -> tuple[Complex, Matrix] | None:
    """The eigenvector of e^(i theta_0), scaled to the largest entry one, and the slow basis that holds it."""
    period_map = problem.period_map
    basis = first_basis(problem, Unknowns(event.state, event.period, float(event.parameters[problem.index])),
                        event.steps)  # fmt: skip
    target = np.exp(1j * event.angle)
    image = period_map.evaluate(
        event.state, event.parameters, event.period, event.steps, basis, keep_factors=True
    )
    for _ in range(_EIGENVECTOR_SWEEPS):
        if not image.finite:
            return None
        spectrum = floquet_spectrum(basis, image.columns)
        nearest = int(np.argmin(np.abs(spectrum.multipliers - target)))
        if spectrum.residuals[nearest] <= _EIGENVECTOR_RESIDUAL:
            vector = spectrum.vectors[:, nearest]
            return vector / vector[np.argmax(np.abs(vector))], basis
        basis = orthonormal(image.columns)
        image = period_map.with_columns(image, basis)
    return None
