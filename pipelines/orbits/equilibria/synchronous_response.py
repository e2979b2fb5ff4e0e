"""Response of the linearised machine to its unbalance over the rotating speed, and its peaks.

At the equilibrium of a speed Omega, with the Jacobian J there, small motions under unbalance turn with it:

    s = s_0 + Re[s_1 exp(i Omega tau)],   (i Omega I - J) s_1 = Omega^2 (A_c - i A_s)

A_c and A_s accelerate the rotor (see `pipelines.machine.unbalance`).  The phase of s_1 is that of the motion
ahead of the rotor's mark.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize_scalar
from scipy.sparse.linalg import splu

from pipelines.case.arrays import Array, ComplexArray
from pipelines.machine.assembly import Machine
from pipelines.machine.shaft import NODE_FREEDOMS
from pipelines.machine.unbalance import UnbalanceMass, unbalance_acceleration
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest, equilibrium_along
from pipelines.orbits.equilibria.linear import at_speed

CURVED = 0.02  # of the largest amplitude: the response may deviate so much from a chord between two speeds
MOST_HALVINGS = 7
HALF_POWER = 0.7071  # of a peak, as API Std 684 reads amplification factors


@dataclass(frozen=True)
class SpeedResponse:
    """The response at one speed.

    ``displacement`` (planes, probes, 2): complex amplitudes of x and y at the probes in units of the
    machine's displacement scale, for every plane alone; ``gap`` (bearings,): largest motion of a journal
    towards its bearing over the smallest film, all planes together.
    """

    speed: float
    displacement: ComplexArray
    gap: Array
    state: Array


@dataclass(frozen=True)
class SynchronousResponse:
    """The response over rising ``speeds`` (n,), and the speeds without equilibrium with the reason.

    ``displacement`` (n, planes, probes, 2) and ``gap`` (n, bearings) as in `SpeedResponse`.
    """

    speeds: Array
    displacement: ComplexArray
    gap: Array
    missing: dict[float, str]


def synchronous_response(
    machine: Machine,
    parameters: Array,
    masses: Sequence[UnbalanceMass],
    probes: Sequence[int],
    speeds: Array,
    visit: Callable[[int], None] = lambda done: None,
) -> SynchronousResponse:
    """The response at rising ``speeds`` and at speeds between them where it is curved.

    ``probes``: nodes of the shaft. ``visit`` hears how many of ``speeds`` are done. Raises ValueError for a
    node that is not on the shaft.
    """
    forces = np.array([_force(machine, mass) for mass in masses])
    rows = _probe_rows(machine, probes)
    found: dict[float, SpeedResponse] = {}
    missing: dict[float, str] = {}

    def compute(among: Array, index: int, guess: Array | None) -> SpeedResponse | None:
        speed = float(among[index])
        equilibrium = equilibrium_along(machine, parameters, among, index, guess)
        if not equilibrium.converged:
            missing[speed] = equilibrium.reason
            return None
        found[speed] = _at_equilibrium(machine, at_speed(parameters, speed), equilibrium.state, forces, rows)
        return found[speed]

    previous: SpeedResponse | None = None
    for index in range(len(speeds)):
        visit(index)
        previous = compute(speeds, index, None if previous is None else previous.state)
    largest = max((np.abs(_total(each)).max() for each in found.values()), default=0.0)
    for low, high in zip(speeds[:-1].tolist(), speeds[1:].tolist(), strict=True):
        if low in found and high in found:
            _refine(compute, found[low], found[high], CURVED * largest, MOST_HALVINGS)
    ordered = [found[speed] for speed in sorted(found)]
    shape = (len(masses), len(probes), 2)
    return SynchronousResponse(
        np.array([each.speed for each in ordered]),
        np.array([each.displacement for each in ordered]).reshape(len(ordered), *shape),
        np.array([each.gap for each in ordered]).reshape(len(ordered), len(machine.bearings)),
        missing,
    )


def _refine(
    compute: Callable[[Array, int, Array | None], SpeedResponse | None],
    low: SpeedResponse,
    high: SpeedResponse,
    tolerance: float,
    halvings: int,
) -> None:
    """Halve an interval until the response in its middle lies on the chord."""
    middle = compute(np.array([low.speed, 0.5 * (low.speed + high.speed), high.speed]), 1, low.state)
    if middle is None or halvings == 0:
        return
    if np.abs(_total(middle) - 0.5 * (_total(low) + _total(high))).max() > tolerance:
        _refine(compute, low, middle, tolerance, halvings - 1)
        _refine(compute, middle, high, tolerance, halvings - 1)


def _total(response: SpeedResponse) -> ComplexArray:
    """All planes together, (probes, 2)."""
    return np.asarray(response.displacement.sum(axis=0))


def _force(machine: Machine, mass: UnbalanceMass) -> ComplexArray:
    """A_c - i A_s of one plane (n,)."""
    along, across = unbalance_acceleration(machine, (mass,))
    return np.asarray(along - 1j * across)


def _probe_rows(machine: Machine, probes: Sequence[int]) -> Array:
    """x and y of the probes from the freedoms of the masters, (probes, 2, n)."""
    transformation = machine.scaled.transformation
    nodes = transformation.shape[0] // NODE_FREEDOMS
    for node in probes:
        if not 0 <= node < nodes:
            raise ValueError(f"probe at node {node}: the shaft's nodes are 0 to {nodes - 1}")
    return np.array([transformation[NODE_FREEDOMS * node : NODE_FREEDOMS * node + 2] for node in probes])


def _at_equilibrium(
    machine: Machine, parameters: Array, state: Array, forces: ComplexArray, rows: Array
) -> SpeedResponse:
    """Solve for every plane; ``forces`` (planes, n), ``rows`` (probes, 2, n)."""
    speed, freedoms = float(parameters[0]), machine.rotor_freedoms
    still = at_rest(parameters)
    jacobian = machine.jacobian(MEAN_PHASE, state, still)
    matrix = (1j * speed * sparse.eye_array(machine.size) - jacobian).tocsc()
    right = np.zeros((machine.size, len(forces)), dtype=np.complex128)
    right[machine.rotor_start + freedoms :] = speed**2 * forces.T
    solution = splu(matrix).solve(right)
    masters = solution[machine.rotor_start : machine.rotor_start + freedoms]
    films = machine.minimum_film(MEAN_PHASE, state, still)
    total = solution.sum(axis=1)
    real, imaginary = (
        np.array([machine.journal(part, bearing)[:2] for bearing in range(len(films))])
        for part in (total.real, total.imag)
    )
    motion = [_largest_radius(orbit) for orbit in real + 1j * imaginary]
    displacement = np.einsum("pan,nk->kpa", rows, masters)
    return SpeedResponse(speed, displacement, np.array(motion) / films, state)


def _largest_radius(orbit: ComplexArray) -> float:
    """Major semi-axis of the ellipse Re[(x, y) exp(i phi)]: |forward| + |backward| circular motion."""
    x, y = orbit
    return float(0.5 * (abs(x + 1j * y) + abs(x - 1j * y)))


@dataclass(frozen=True)
class Peak:
    """A resonance of one probe: where its amplitude has a maximum over the speed.

    ``low``, ``high``: speeds beside it with ``HALF_POWER`` of the amplitude, NaN where the curve does not
    fall so low before it ends or rises again.
    """

    speed: float
    amplitude: float
    phase: float
    low: float
    high: float

    @property
    def amplification(self) -> float:
        """Amplification factor N / (N_2 - N_1) of API Std 684; NaN where a half-power point is missing."""
        return self.speed / (self.high - self.low)


def peaks(speeds: Array, amplitude: ComplexArray) -> Iterator[Peak]:
    """The maxima of |amplitude| (n,) over rising speeds, located on its cubic spline."""
    if len(speeds) < 4:
        return
    spline = CubicSpline(speeds, np.column_stack([amplitude.real, amplitude.imag]))

    def size(speed: float) -> float:
        return float(np.hypot(*spline(speed)))

    sizes = np.abs(amplitude)
    tops = [k for k in range(1, len(speeds) - 1) if sizes[k - 1] < sizes[k] >= sizes[k + 1]]
    for top in tops:
        bracket = (float(speeds[top - 1]), float(speeds[top + 1]))
        where = float(
            minimize_scalar(lambda s: -size(s), bounds=bracket, method="bounded", options={"xatol": 1e-9}).x
        )
        height, (real, imaginary) = size(where), spline(where)
        low = _falls_to(size, where, HALF_POWER * height, speeds[:top][::-1])
        high = _falls_to(size, where, HALF_POWER * height, speeds[top + 1 :])
        yield Peak(where, height, float(np.arctan2(imaginary, real)), low, high)


def _falls_to(size: Callable[[float], float], peak: float, level: float, away: Array) -> float:
    """Where the amplitude first falls to a level on the way from a peak; NaN if it rises above the peak."""
    inner = peak
    for outer in away.tolist():
        if size(outer) <= level:
            return float(brentq(lambda speed: size(speed) - level, inner, outer, xtol=1e-12))
        if size(outer) > size(peak):
            return float("nan")
        inner = outer
    return float("nan")
