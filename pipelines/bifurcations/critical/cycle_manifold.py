"""Cycles over a plane of two parameters: the surface on which the bifurcation curves lie.

The cycles near a point form a surface in the space of (s, T, lambda_1, lambda_2),

    phi(s, T, lambda) - s = 0,      phase(s) = 0

and a bifurcation curve is the line on it where one test function vanishes.  With V an orthonormal basis of
the slow invariant subspace and ds = V a + q, where every q_x = Q (M q_x + x) is found by Picard sweeps as in
``pipelines.orbits.shooting``, both the Newton correction towards the surface and its two tangents solve

    | V'(M-I)V   V'(phi_j + M q_j)   V'(phi_T + M q_T) | | a    |     | V'(r + M q_r) |
    | F V        F_j + F q_j         F_T + F q_T       | | dl_j | = - | F  + F q_r    |
    | row_s V    row_j + row_s q_j   row_T + row_s q_T | | dT   |     | gap + row q_r |

with j = 1, 2 and two closing rows.  Only a derivative of the test function along each tangent is then wanted,
never its whole gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.plane import MapAt, PlaneMetric, Position
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix, Vector

RESIDUAL_TOLERANCE = 1e-3  # of the Picard part of a residual, relative to the residual
_FIRST_TOLERANCE = 1e-2  # likewise in the first pass of a correction: the next one takes what is left
_SETTLED = 0.1  # share of the corrector's tolerance below which it is not needed
_CURVED = 10.0  # likewise of the square of a relative change of the state: second derivatives leave more
_NO_INFLUENCE = 0.1  # share of the corrector's tolerance below which a Picard change is left alone


@dataclass(frozen=True)
class PicardColumns:
    """Solutions q (N, c) of q A = Q (M q + x), their images M q and phase rows F q (c,)."""

    columns: Matrix
    image: Matrix
    phase: Vector


def picard_iteration(
    at: MapAt,
    passed: PeriodImage,
    basis: Matrix,
    sources: Matrix,
    inverse: Matrix,
    tolerance: float | Vector,
    guess: Matrix | None = None,
    sizes: float | Vector = 1.0,
) -> PicardColumns:
    """Picard sweeps q <- Q (M q + x) A^-1 outside the slow subspace; ``inverse`` (c, c) is A^-1.

    They go along the orbit of an image that was ``passed`` at the position, and converge like
    abs(mu_neglected / eigenvalue of A), until the change of every column is below its ``tolerance`` times the
    size of its source, or without influence on the corrector: ``sizes`` of the columns are what its tolerance
    is relative to.
    """
    zeros = np.zeros_like(sources)
    if basis.shape[0] == basis.shape[1]:
        return PicardColumns(zeros, zeros, np.zeros(sources.shape[1]))
    options = at.problem.options
    picard = project_out(basis, sources @ inverse if guess is None else guess)
    enough = tolerance * np.linalg.norm(sources, axis=0) + _NO_INFLUENCE * options.tolerance * sizes
    image, phase = zeros, np.zeros(sources.shape[1])
    for _ in range(options.picard_sweeps):
        passed = at.with_columns(passed, picard)
        image, phase = passed.columns, passed.phase_columns
        following = project_out(basis, image + sources) @ inverse
        if np.all(np.linalg.norm(following - picard, axis=0) <= enough):
            break
        picard = following
    return PicardColumns(picard, image, phase)


def project_out(basis: Matrix, columns: Matrix) -> Matrix:
    """Q x = x - V V'x."""
    return np.asarray(columns - basis @ (basis.T @ columns))


@dataclass(frozen=True)
class ManifoldLinearisation:
    """The map and its derivatives at a position near the surface of cycles.

    ``image``: the full pass, with its factors; ``sources`` (N, 3 or 4): r, phi_1, phi_2 and phi_T;
    ``picard``: their Picard parts.
    """

    at: MapAt
    basis: Matrix
    image: PeriodImage
    sources: Matrix
    picard: PicardColumns

    @property
    def residual(self) -> float:
        """Residual of the cycle, as in ``PeriodMap.residual``."""
        return self.at.problem.period_map.residual(self.at.position.state, self.image)

    @property
    def scale(self) -> float:
        """The size of the states on the orbit."""
        return self.at.problem.period_map.scale(self.image.orbit)

    @property
    def whole(self) -> Matrix:
        """M q_x + x (N, 3 or 4), whose part outside V is q_x and outside a nearby basis nearly its q_x."""
        return np.asarray(self.sources + self.picard.image)

    def mapped(self, columns: Matrix) -> Matrix:
        """M columns, along the orbit of the full pass."""
        return self.at.with_columns(self.image, columns).columns

    @property
    def period_unit(self) -> float:
        """The function `period_unit` for this position."""
        return period_unit(self.at, self.image)


def period_unit(at: MapAt, image: PeriodImage) -> float:
    """The change of the period that counts like a change of the state by one in a common vector."""
    return at.position.period / (2.0 * math.pi * at.problem.period_map.scale(image.orbit))


def linearise(
    at: MapAt, basis: Matrix, image: PeriodImage, defect: Matrix, inverse: Matrix, warm: Matrix | None = None
) -> tuple[ManifoldLinearisation, PicardColumns]:
    """The Picard parts for a full pass and for a ``defect`` (N, m) of critical vectors, in common sweeps.

    The defect's part solves q A = Q (M q + defect), with ``inverse`` (m, m) = A^-1.

    ``warm``: M q_j + phi_j of the last position (`ManifoldLinearisation.whole`), for first guesses of q_j.
    """
    sources = np.column_stack([image.state - at.position.state, image.inhomogeneous])
    count, defects = sources.shape[1], defect.shape[1]
    both = np.eye(count + defects)
    both[count:, count:] = inverse
    tolerances = np.full(count + defects, _FIRST_TOLERANCE if warm is None else RESIDUAL_TOLERANCE)
    tolerances[1:count] = at.problem.options.picard_tolerance
    together = np.hstack([sources, defect])
    guess = None
    if warm is not None:
        guess = together @ both
        guess[:, 1:count] = warm[:, 1:]
    sizes = np.full(count + defects, at.problem.period_map.scale(image.orbit))
    sizes[count:] = 1.0
    picard = picard_iteration(at, image, basis, together, both, tolerances, guess, sizes)
    surface = PicardColumns(picard.columns[:, :count], picard.image[:, :count], picard.phase[:count])
    rest = PicardColumns(picard.columns[:, count:], picard.image[:, count:], picard.phase[count:])
    return ManifoldLinearisation(at, basis, image, sources, surface), rest


def manifold_rows(linear: ManifoldLinearisation) -> tuple[Matrix, Vector]:
    """Matrix and right side of the periodicity (and phase) rows; unknowns (a, dl_1, dl_2[, dT])."""
    basis, image, picard = linear.basis, linear.image, linear.picard
    # V'(M - I)V a + V'(phi_j + M q_j) dl_j + V'(phi_T + M q_T) dT = -V'(r + M q_r)
    reduced = basis.T @ linear.whole
    matrix = np.hstack([basis.T @ image.columns - np.eye(basis.shape[1]), reduced[:, 1:]])
    right = -reduced[:, 0]
    if linear.at.problem.period_map.autonomous:
        # F V a + (F_j + F q_j) dl_j + (F_T + F q_T) dT = -(F + F q_r)
        row = np.concatenate([image.phase_columns, image.phase_inhomogeneous + picard.phase[1:]])
        matrix = np.vstack([matrix, row])
        right = np.append(right, -image.phase - picard.phase[0])
    return matrix, right


def position_of(linear: ManifoldLinearisation, solution: Vector, with_residual: bool) -> Position:
    """ds = V a + sum_j q_j dl_j + q_T dT (+ q_r) as a direction."""
    columns = linear.basis.shape[1]
    weights = np.concatenate([[1.0 if with_residual else 0.0], solution[columns:]])
    period = float(solution[columns + 2]) if linear.at.problem.period_map.autonomous else 0.0
    state = linear.basis @ solution[:columns] + linear.picard.columns @ weights
    return Position(state, period, solution[columns : columns + 2].copy())


@dataclass(frozen=True)
class ManifoldStep:
    """The Newton correction towards the surface, and its tangents.

    row_i . tangent_j = 1 for i = j, else 0.  ``solutions`` (k, 3): the three in the unknowns of
    ``manifold_rows``.
    """

    correction: Position
    along: Position
    across: Position
    solutions: Matrix


def manifold_step(
    linear: ManifoldLinearisation, rows: tuple[Position, Position], gaps: tuple[float, float]
) -> ManifoldStep | None:
    """Solve the system in this module's docstring for its three right sides; None if it is singular."""
    matrix, right = manifold_rows(linear)
    basis, picard = linear.basis, linear.picard.columns
    given = len(right)
    constraint = np.zeros((2, matrix.shape[1]))
    sides = np.zeros((given + 2, 3))
    sides[:given, 0] = right
    for i, row in enumerate(rows):
        # row_s (V a + q) + row_j dl_j + row_T dT = -gap
        direct = np.append(row.parameters, row.period)[: picard.shape[1] - 1]
        constraint[i] = np.concatenate([row.state @ basis, direct + row.state @ picard[:, 1:]])
        sides[given + i, 0] = -gaps[i] - row.state @ picard[:, 0]
        sides[given + i, 1 + i] = 1.0
    solution = solve_or_none(np.vstack([matrix, constraint]), sides)
    if solution is None:
        return None
    return ManifoldStep(
        position_of(linear, solution[:, 0], True),
        position_of(linear, solution[:, 1], False),
        position_of(linear, solution[:, 2], False),
        solution,
    )


def refined_step(
    linear: ManifoldLinearisation, rows: tuple[Position, Position], step: ManifoldStep, across: float
) -> Position | None:
    """The correction plus ``across`` times its tangent, corrected for what V is not invariant.

    It solves the linearised equations of the surface as they are, not only in V, and keeps its products with
    both rows.  That costs one column along the orbit and makes the step a hundred times sharper.  None if the
    system is singular.
    """
    moved = step.correction.plus(step.across, across)
    if linear.basis.shape[0] == linear.basis.shape[1]:
        return moved
    size = linear.scale * math.sqrt(len(moved.state))
    share = float(np.linalg.norm(moved.state)) / size
    left, phase = _left_over(linear, step.solutions[:, 0] + across * step.solutions[:, 2], moved)
    tolerance = linear.at.problem.options.tolerance
    if float(np.linalg.norm(left)) <= size * max(_SETTLED * tolerance, _CURVED * share * share):
        return moved
    again = manifold_step(_with_residual(linear, left, phase), rows, (0.0, 0.0))
    return None if again is None else moved.plus(again.correction)


def _left_over(linear: ManifoldLinearisation, solution: Vector, moved: Position) -> tuple[Vector, float]:
    """What a step leaves of r + (M - I) ds + phi_j dl_j + phi_T dT and of the phase condition."""
    columns, image, picard = linear.basis.shape[1], linear.image, linear.picard
    inside, weights = solution[:columns], np.concatenate([[1.0], solution[columns:]])
    mapped = image.columns @ inside + linear.whole @ weights
    phases = image.phase_columns @ inside + picard.phase @ weights
    return mapped - moved.state, image.phase + float(phases + image.phase_inhomogeneous @ weights[1:])


def _with_residual(linear: ManifoldLinearisation, residual: Vector, phase: float) -> ManifoldLinearisation:
    """The linearisation with another residual and its Picard part after one sweep."""
    sources, old = linear.sources.copy(), linear.picard
    rest = project_out(linear.basis, residual[:, None])
    passed = linear.at.with_columns(linear.image, rest)
    sources[:, 0] = residual
    picard = PicardColumns(
        np.hstack([rest, old.columns[:, 1:]]),
        np.hstack([passed.columns, old.image[:, 1:]]),
        np.concatenate([passed.phase_columns, old.phase[1:]]),
    )
    return replace(linear, sources=sources, picard=picard, image=replace(linear.image, phase=phase))


def manifold_tangents(linear: ManifoldLinearisation, metric: PlaneMetric) -> tuple[Position, Position]:
    """Two orthonormal tangents of the surface without a closing row: the null space of its rows."""
    matrix, _ = manifold_rows(linear)
    _, _, right = np.linalg.svd(matrix)
    first, second = (position_of(linear, vector, False) for vector in right[-2:])
    first = metric.unit(first)
    return first, metric.unit(second.plus(first, -metric.inner(first, second)))
