"""Newton-Picard shooting: exact Newton on the slow subspace, Picard sweeps on the rest.

Unknown are the state s, the parameter lambda and, in the autonomous formulation, the period T:

    r = phi(s, T, lambda) - s = 0,      phase(s) = 0,      row . (s, T, lambda) = value

With V an orthonormal basis of the slow invariant subspace, Q = I - V V' and ds = V a + q, q = q_r + dl q_l +
dT q_T, where each q_x = Q (M q_x + x) is solved by Picard sweeps (M contracts there), the remaining small
system is

    | V'(M-I)V    V'(phi_l + M q_l)    V'(phi_T + M q_T) | | a  |      | V'(r + M q_r)  |
    | row_s V     row_l + row_s q_l    row_T + row_s q_T | | dl |  = - | gap + row_s q_r|
    | F V         F_l + F q_l          F_T + F q_T       | | dT |      | F  + F q_r     |

F is the integral phase condition, summed by the same pass; the last row and column exist only for an unknown
period. After each iteration V <- orth(M V).  When V spans the whole space q vanishes and the method is
Newton's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from pipelines.orbits.floquet import (
    BasisOptions,
    FloquetSpectrum,
    adapted_basis,
    floquet_spectrum,
    orthonormal,
    starting_basis,
)
from pipelines.orbits.period_map import Inhomogeneity, OrbitStart, PeriodImage, PeriodMap, PhaseReference
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix, Vector, size_of
from pipelines.orbits.vectors import Combination, Constraint

_NUDGE = 4.0 * np.finfo(float).eps  # relative change of a state in its last digits
_SPARE = 10.0  # tolerance, in residuals that rounding leaves
_DIGITS = 1e-14  # change of a residual by rounding, at least
_NOISE = 1e3  # residual that may be rounding, in changes of it by a nudge: errors of stages and sums add up
_STAGNANT = 0.1  # reduction of the residual in the last iteration that is none
_REFINEMENTS = 2  # of a solution of the bordered system, which each make a hundred times sharper
_NO_INFLUENCE = 0.1  # share of the tolerance below which they are not needed
_DIVERGENCE = 1e3  # growth of the residual over its smallest value that no Newton iteration recovers from


class NewtonStop(Enum):
    """Why the corrector stopped, with advice."""

    CONVERGED = "converged"
    ITERATIONS = (
        "the residual is still above the tolerance after the allowed iterations: start closer or allow more"
    )
    ROUNDING = (
        "rounding keeps the residual above the tolerance, whatever the step and the iterations: "
        "raise the tolerance"
    )
    DIVERGED = "the residual grows: start closer to the cycle or take a smaller continuation step"
    STUCK = "the test function of the bifurcation does not get smaller: take smaller continuation steps"
    NON_FINITE = "the orbit left the domain of the equations: start closer or use more steps per period"
    TOO_STIFF = (
        "an explicit stepper needs more than a million time steps per period to be stable: use an implicit "
        "one, or insist on a number of steps per period"
    )
    SINGULAR = (
        "the bordered matrix is singular: change the continued parameter or start away from the bifurcation"
    )

    @property
    def advice(self) -> str:
        return self.value


@dataclass(frozen=True)
class ShootingOptions:
    """Tolerances of the corrector.

    ``tolerance``: of phi(s) - s, phase and constraint, each relative to its terms.
    ``iterations``: Newton iterations at most.
    ``picard_tolerance``: relative size of the last Picard update.
    ``picard_sweeps``: Picard sweeps at most.
    ``multiplier_tolerance``: residual asked of every multiplier above ``checked_modulus``.
    ``multiplier_sweeps``: further subspace iterations at most to reach it; the residual reached is reported.
    ``step_tolerance``: error of these multipliers that the time steps may leave.
    ``basis``: size of the slow subspace.
    """

    tolerance: float = 1e-10
    iterations: int = 12
    picard_tolerance: float = 1e-4
    picard_sweeps: int = 20
    multiplier_tolerance: float = 1e-9
    checked_modulus: float = 0.1
    multiplier_sweeps: int = 6
    step_tolerance: float = 1e-6
    basis: BasisOptions = field(default_factory=BasisOptions)

    def __post_init__(self) -> None:
        positive = (
            "tolerance",
            "picard_tolerance",
            "multiplier_tolerance",
            "checked_modulus",
            "step_tolerance",
        )
        for name in positive:
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie between 0 and 1")
        if self.iterations < 1 or self.picard_sweeps < 1 or self.multiplier_sweeps < 0:
            raise ValueError("iterations and picard_sweeps must be at least 1, multiplier_sweeps at least 0")


@dataclass(frozen=True)
class Unknowns(Combination):
    """A point or a direction in the space of (s, T, lambda); ``state`` has shape (N,)."""

    state: Vector
    period: float
    parameter: float


@dataclass(frozen=True)
class CycleProblem:
    """Cycles of one period map along one of its parameters; ``parameters`` (p,) holds the fixed ones.

    Raises ValueError for an unknown parameter name or a wrong number of parameters.
    """

    period_map: PeriodMap
    parameters: Vector
    parameter: str
    options: ShootingOptions = field(default_factory=ShootingOptions)

    def __post_init__(self) -> None:
        names = self.period_map.system.parameter_names
        if len(self.parameters) != len(names):
            raise ValueError(f"{len(self.parameters)} parameters given for {', '.join(names)}")
        self.period_map.system.parameter_index(self.parameter)

    @property
    def index(self) -> int:
        return self.period_map.system.parameter_index(self.parameter)

    def parameters_at(self, value: float) -> Vector:
        """The parameter vector with the continued one set to ``value``."""
        parameters = np.array(self.parameters, dtype=float)
        parameters[self.index] = value
        return parameters

    def orbit_start(self, unknowns: Unknowns, steps: int) -> OrbitStart:
        """What the orbit through ``unknowns`` depends on."""
        parameters = self.parameters_at(unknowns.parameter)
        return OrbitStart(unknowns.state, parameters, unknowns.period, steps)

    def consistent(self, unknowns: Unknowns) -> Unknowns:
        """The unknowns with the forcing period in a stroboscopic map; unchanged if T is unknown."""
        if self.period_map.autonomous:
            return unknowns
        return replace(unknowns, period=self.period_map.period(self.parameters_at(unknowns.parameter)))

    def fixed_parameter(self, value: float) -> Constraint[Unknowns]:
        """The condition lambda = value."""
        return Constraint(Unknowns(np.zeros(self.period_map.size), 0.0, 1.0), value)


@dataclass(frozen=True)
class Linearisation:
    """The map and its derivatives at one point.

    ``picard`` (N, k) and ``picard_image`` hold q_x and M q_x of the Picard part for x = r, phi_l and, when
    the period is unknown, phi_T.  The ``image`` has no factors.
    """

    image: PeriodImage
    basis: Matrix
    residual: Vector
    sources: Matrix
    picard: Matrix
    picard_image: Matrix
    picard_phase: Vector


@dataclass(frozen=True)
class Cycle:
    """A corrected periodic orbit.

    ``parameters`` (p,), ``basis`` (N, k) and the ``image`` of the last pass (orbit, M V, phi_l, ...),
    ``spectrum`` of multipliers, ``residual`` as in ShootingOptions.tolerance, ``steps`` per period;
    ``linear``: the last linearisation on the way, None if the guess was the cycle.
    """

    unknowns: Unknowns
    parameters: Vector
    basis: Matrix
    image: PeriodImage
    spectrum: FloquetSpectrum
    residual: float
    steps: int
    linear: Linearisation | None = None


@dataclass(frozen=True)
class Correction:
    """Result of the corrector: the cycle if it converged, else None, and the history of both norms."""

    stop: NewtonStop
    cycle: Cycle | None
    residual_norms: tuple[float, ...]
    update_norms: tuple[float, ...]

    @property
    def iterations(self) -> int:
        return len(self.update_norms)

    @property
    def advice(self) -> str:
        """Why the corrector stopped, and what to change."""
        return advice_of(self.stop, self.residual_norms)


def advice_of(stop: NewtonStop, sizes: Sequence[float]) -> str:
    """The advice of a stop, with the tolerance that rounding allows if rounding ended the iteration."""
    return f"{stop.advice} to {_SPARE * max(sizes[-3:]):.0e}" if stop is NewtonStop.ROUNDING else stop.advice


def correct(
    problem: CycleProblem,
    guess: Unknowns,
    constraint: Constraint[Unknowns],
    basis: Matrix,
    steps: int,
    reference: PhaseReference | None = None,
) -> Correction:
    """Find the cycle near ``guess`` that satisfies ``constraint``.

    ``basis`` (N, k): slow subspace, orthonormal; ``reference``: phase condition, needed when the period is
    unknown. Failure is a result: see ``Correction.stop``.  Raises ValueError when the reference is missing.
    """
    if problem.period_map.autonomous and reference is None:
        raise ValueError("an unknown period needs a phase reference")
    unknowns, options = problem.consistent(guess), problem.options
    residuals: list[float] = []
    updates: list[float] = []

    def ended(stop: NewtonStop, cycle: Cycle | None = None) -> Correction:
        return Correction(stop, cycle, tuple(residuals), tuple(updates))

    def given_up(stop: NewtonStop) -> Correction:
        rounding = is_rounding(problem.period_map, image.start, reference, residuals)
        return ended(NewtonStop.ROUNDING if rounding else stop)

    linear: Linearisation | None = None
    while True:
        near = None if linear is None else linear.image
        image = _evaluate(problem, unknowns, basis, steps, reference, near)
        if not image.finite:
            return ended(NewtonStop.NON_FINITE)
        residuals.append(max(problem.period_map.residual(unknowns.state, image), constraint.error(unknowns)))
        if residuals[-1] <= options.tolerance:
            cycle = with_converged_multipliers(problem, unknowns, basis, image, reference, residuals[-1])
            return ended(NewtonStop.CONVERGED, replace(cycle, linear=linear))
        if residuals[-1] > _DIVERGENCE * min(residuals):
            return given_up(NewtonStop.DIVERGED)
        if len(updates) == options.iterations:
            return given_up(NewtonStop.ITERATIONS)
        linear = _linearise(problem, basis, image, reference)
        update = _newton_step(problem, linear, image, constraint, unknowns, reference)
        if update is None:
            return ended(NewtonStop.SINGULAR)
        image = linear.image  # frees the factors before the next pass makes its own
        unknowns = problem.consistent(unknowns.plus(update))
        updates.append(_update_norm(problem, update, unknowns, image))
        basis = _next_basis(image.columns)


def _newton_step(
    problem: CycleProblem,
    linear: Linearisation,
    passed: PeriodImage,
    constraint: Constraint[Unknowns],
    unknowns: Unknowns,
    reference: PhaseReference | None,
) -> Unknowns | None:
    """The update of the bordered system, corrected for what V is not invariant; None if it is singular.

    What the update leaves of the linearised equations is known from the images of V and of the Picard part.
    Its image costs one column along the orbit that was ``passed``, and the same system solves for the rest.
    """
    options, row, gap = problem.options, constraint.row, constraint.gap(unknowns)
    size = problem.period_map.scale(passed.orbit) * math.sqrt(len(unknowns.state))
    share = float(np.linalg.norm(linear.residual)) / size
    # what second derivatives leave is no smaller
    enough = size * max(_NO_INFLUENCE * options.tolerance, share * share)
    total, phase = None, passed.phase
    for refinement in range(_REFINEMENTS + 1):
        solution = _solve_bordered(problem, linear, row, gap, phase)
        if solution is None:
            return None
        update = _as_unknowns(problem, linear, solution, 1.0)
        total = update if total is None else total.plus(update)
        left, phase = _left_over(linear, solution, update, phase)
        whole = linear.basis.shape[0] == linear.basis.shape[1]
        if whole or refinement == _REFINEMENTS or float(np.linalg.norm(left)) <= enough:
            break
        rest = left - linear.basis @ (linear.basis.T @ left)
        passed = problem.period_map.with_columns(passed, rest[:, None], reference)
        linear, gap = _with_residual(linear, left, rest, passed), gap + row.dot(update)
    return total


def is_rounding(
    period_map: PeriodMap, start: OrbitStart, reference: PhaseReference | None, sizes: Sequence[float]
) -> bool:
    """Whether an iteration with residuals of these ``sizes`` stagnates because of rounding.

    The last digits of the state at the ``start`` then change the residual by as much.
    """
    if len(sizes) < 2 or sizes[-1] < _STAGNANT * min(sizes[:-1]):
        return False
    state, nudged = start.state, start.state * (1.0 + _NUDGE)
    here = period_map.evaluate(*start, reference=reference)
    beside = period_map.evaluate(*start._replace(state=nudged), reference=reference)
    if not (here.finite and beside.finite):
        return False
    moved = here.state - state + nudged  # where the nudged state would arrive with the residual of the other
    change = period_map.residual(moved, replace(beside, phase=beside.phase - here.phase))
    return min(sizes) <= _NOISE * max(change, _DIGITS)


def tangent_at(
    problem: CycleProblem, cycle: Cycle, row: Unknowns, reference: PhaseReference | None = None
) -> Unknowns | None:
    """The direction (ds, dT, dl) of the branch with row . direction = 1; None when that is singular.

    It solves the bordered system of the corrector with r = 0 and gap = -1.  The Picard part is that of the
    corrector's last iteration where it still holds.
    """
    unknowns, basis = cycle.unknowns, cycle.basis
    exact = replace(cycle.image, state=cycle.image.start.state)
    linear = None if cycle.linear is None else _carried_over(cycle.linear, basis, exact)
    if linear is not None:
        following = _next_sweep(basis, linear.sources, linear.picard_image)
        if not _changes_little(following, linear.picard, linear.sources, problem.options.picard_tolerance):
            linear = None
    if linear is None:
        linear = _linearise(problem, basis, exact, reference)
    solution = _solve_bordered(problem, linear, row, -1.0, 0.0)
    if solution is None:
        return None
    direction = _as_unknowns(problem, linear, solution, 1.0)
    if problem.period_map.autonomous:
        return direction
    parameters = problem.parameters_at(unknowns.parameter)
    slope = problem.period_map.parameter_column(problem.index, parameters).period_rate
    return replace(direction, period=slope * direction.parameter)


def null_directions(
    problem: CycleProblem, cycle: Cycle, reference: PhaseReference | None = None
) -> tuple[Unknowns, Unknowns]:
    """The two directions (ds, dT, dl) along which a branch-point cycle remains a cycle to first order.

    They span the null space of the system of the corrector without its closing row; elsewhere only one does.
    """
    exact = replace(cycle.image, state=cycle.image.start.state)
    linear = _linearise(problem, cycle.basis, exact, reference)
    matrix, _ = _cycle_rows(problem, linear, 0.0)
    first, second = np.linalg.svd(matrix)[2][-2:]
    return _as_unknowns(problem, linear, first, 0.0), _as_unknowns(problem, linear, second, 0.0)


def _carried_over(last: Linearisation, basis: Matrix, image: PeriodImage) -> Linearisation:
    """A linearisation with r = 0 and the Picard part of an earlier one with another basis W.

    Of the vectors x = q + W W'x the image M x = M q + M W (W'x) is known, and so is the image of their
    part outside V.
    """
    known = last.basis.T @ last.sources
    whole, whole_image = last.picard + last.basis @ known, last.picard_image + last.image.columns @ known
    whole_phase = last.picard_phase + last.image.phase_columns @ known
    inside = basis.T @ whole
    picard, picard_image = whole - basis @ inside, whole_image - image.columns @ inside
    picard_phase = whole_phase - image.phase_columns @ inside
    for part in (picard, picard_image, picard_phase[None, :]):
        part[:, 0] = 0.0
    sources = np.column_stack([np.zeros(len(basis)), image.inhomogeneous])
    return Linearisation(image, basis, sources[:, 0], sources, picard, picard_image, picard_phase)


def _next_sweep(basis: Matrix, sources: Matrix, picard_image: Matrix) -> Matrix:
    """The next Picard iterate Q (M q + x)."""
    following = picard_image + sources
    return np.asarray(following - basis @ (basis.T @ following))


def _changes_little(following: Matrix, picard: Matrix, sources: Matrix, tolerance: float) -> bool:
    """Whether a Picard sweep moves every q_x by little against x."""
    change = np.linalg.norm(following - picard, axis=0)
    return bool(np.all(change <= tolerance * np.linalg.norm(sources, axis=0)))


def first_basis(problem: CycleProblem, guess: Unknowns, steps: int) -> Matrix:
    """A slow basis for a guess that has none."""
    start = problem.orbit_start(problem.consistent(guess), steps)
    return starting_basis(problem.period_map, start, problem.options.basis)


def following_basis(problem: CycleProblem, cycle: Cycle) -> Matrix:
    """The slow basis with which to correct the neighbours of a cycle."""
    return adapted_basis(cycle.basis, cycle.image.columns, problem.options.basis)


def reference_of(problem: CycleProblem, unknowns: Unknowns, steps: int) -> PhaseReference | None:
    """The phase condition set by the orbit through ``unknowns``; None when the period is known.

    It is recomputed from the state alone, so that a restarted branch gets the same bits.
    """
    if not problem.period_map.autonomous:
        return None
    start = problem.orbit_start(unknowns, steps)
    image = problem.period_map.evaluate(*start)
    return problem.period_map.phase_reference(image.orbit, start.parameters, start.period)


def _evaluate(
    problem: CycleProblem,
    unknowns: Unknowns,
    basis: Matrix,
    steps: int,
    reference: PhaseReference | None,
    near: PeriodImage | None,
) -> PeriodImage:
    """phi(s), M V, phi_l, phi_T and the phase rows in one pass that keeps its factors."""
    start = problem.orbit_start(unknowns, steps)
    inhomogeneous = [problem.period_map.parameter_column(problem.index, start.parameters)]
    if problem.period_map.autonomous:
        inhomogeneous.append(Inhomogeneity(period_rate=1.0))
    return problem.period_map.evaluate(*start, basis, tuple(inhomogeneous), reference, True, near)


def _update_norm(problem: CycleProblem, update: Unknowns, reached: Unknowns, image: PeriodImage) -> float:
    """Largest relative change of state, period and parameter."""
    return max(
        float(np.max(np.abs(update.state))) / problem.period_map.scale(image.orbit),
        abs(update.period) / size_of(reached.period),
        abs(update.parameter) / size_of(reached.parameter),
    )


def _linearise(
    problem: CycleProblem, basis: Matrix, image: PeriodImage, reference: PhaseReference | None
) -> Linearisation:
    """Picard part: q_x <- Q (M q_x + x) for x = r, phi_l, phi_T until the update is small against q_x."""
    passed, image = image, image.without_factors()
    residual = image.state - image.start.state
    sources = np.column_stack([residual, image.inhomogeneous])
    options = problem.options
    picard = sources - basis @ (basis.T @ sources)
    picard_image, picard_phase = np.zeros_like(sources), np.zeros(sources.shape[1])
    if basis.shape[0] == basis.shape[1]:
        picard = np.zeros_like(sources)
        return Linearisation(image, basis, residual, sources, picard, picard_image, picard_phase)
    for _ in range(options.picard_sweeps):
        passed = problem.period_map.with_columns(passed, picard, reference)
        picard_image, picard_phase = passed.columns, passed.phase_columns
        following = _next_sweep(basis, sources, picard_image)
        if _changes_little(following, picard, sources, options.picard_tolerance):
            break
        picard = following
    return Linearisation(image, basis, residual, sources, picard, picard_image, picard_phase)


def _solve_bordered(
    problem: CycleProblem, linear: Linearisation, row: Unknowns, gap: float, phase: float
) -> Vector | None:
    """The solution (a, dl[, dT]) of the small bordered system in this module's docstring."""
    columns = linear.basis.shape[1]
    matrix, right = _cycle_rows(problem, linear, phase)
    # row_s (V a + q) + row_l dl + row_T dT = -gap
    row_picard = row.state @ linear.picard
    direct = np.array([row.parameter, row.period])[: len(row_picard) - 1] + row_picard[1:]
    closing = np.concatenate([row.state @ linear.basis, direct])
    matrix = np.insert(matrix, columns, closing, axis=0)
    right = np.insert(right, columns, -gap - row_picard[0])
    return solve_or_none(matrix, right)


def _left_over(
    linear: Linearisation, solution: Vector, update: Unknowns, phase: float
) -> tuple[Vector, float]:
    """What a solution leaves of the linearised equations r + (M - I) ds + phi_l dl + phi_T dT and F + dF."""
    columns = linear.basis.shape[1]
    inside, weights = solution[:columns], np.concatenate([[1.0], solution[columns:]])
    image = linear.image.columns @ inside + (linear.sources + linear.picard_image) @ weights
    phases = linear.image.phase_columns @ inside + linear.picard_phase @ weights
    return image - update.state, phase + float(phases + linear.image.phase_inhomogeneous @ weights[1:])


def _with_residual(
    linear: Linearisation, residual: Vector, rest: Vector, passed: PeriodImage
) -> Linearisation:
    """The linearisation with another residual, its Picard part ``rest`` and the pass of that."""
    sources, picard, image = linear.sources.copy(), linear.picard.copy(), linear.picard_image.copy()
    phase = linear.picard_phase.copy()
    sources[:, 0], picard[:, 0] = residual, rest
    image[:, 0], phase[0] = passed.columns[:, 0], passed.phase_columns[0]
    return replace(
        linear, residual=residual, sources=sources, picard=picard, picard_image=image, picard_phase=phase
    )


def _cycle_rows(problem: CycleProblem, linear: Linearisation, phase: float) -> tuple[Matrix, Vector]:
    """The rows of the bordered system that make a cycle, and their right side; unknowns (a, dl[, dT])."""
    basis, columns = linear.basis, linear.basis.shape[1]
    reduced = basis.T @ (linear.sources + linear.picard_image)
    # V'(M - I)V a + V'(phi_l + M q_l) dl + V'(phi_T + M q_T) dT = -V'(r + M q_r)
    matrix = np.hstack([basis.T @ linear.image.columns - np.eye(columns), reduced[:, 1:]])
    right = -reduced[:, 0]
    if problem.period_map.autonomous:
        # F (V a + q) + F_l dl + F_T dT = -F
        inhomogeneous = linear.image.phase_inhomogeneous + linear.picard_phase[1:]
        matrix = np.vstack([matrix, np.concatenate([linear.image.phase_columns, inhomogeneous])])
        right = np.append(right, -phase - linear.picard_phase[0])
    return matrix, right


def _as_unknowns(problem: CycleProblem, linear: Linearisation, solution: Vector, residual: float) -> Unknowns:
    """(a, dl[, dT]) as (ds, dT, dl), with ds = V a + q_l dl + q_T dT + ``residual`` q_r."""
    columns = linear.basis.shape[1]
    weights = np.concatenate([[residual], solution[columns:]])
    state = linear.basis @ solution[:columns] + linear.picard @ weights
    period = float(solution[columns + 1]) if problem.period_map.autonomous else 0.0
    return Unknowns(state, period, float(solution[columns]))


def _next_basis(image: Matrix) -> Matrix:
    """V <- orth(M V); a basis of the whole space stays the identity."""
    return np.eye(image.shape[0]) if image.shape[0] == image.shape[1] else orthonormal(image)


def with_converged_multipliers(
    problem: CycleProblem,
    unknowns: Unknowns,
    basis: Matrix,
    image: PeriodImage,
    reference: PhaseReference | None,
    residual: float,
) -> Cycle:
    """The converged cycle after as many further subspace iterations as its multipliers need."""
    options = problem.options
    spectrum = floquet_spectrum(basis, image.columns)
    for _ in range(options.multiplier_sweeps):
        checked = np.abs(spectrum.multipliers) > options.checked_modulus
        if np.all(spectrum.residuals[checked] <= options.multiplier_tolerance):
            break
        basis = _next_basis(image.columns)
        image = problem.period_map.with_columns(image, basis, reference)
        spectrum = floquet_spectrum(basis, image.columns)
    parameters, steps = image.start.parameters, image.start.steps
    return Cycle(unknowns, parameters, basis, image.without_factors(), spectrum, residual, steps)
