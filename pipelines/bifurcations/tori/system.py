"""The linear system of Newton-Picard for invariant curves, as shown in ``invariant_curve``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipelines.bifurcations.tori.fourier import Array, angles, applied, derivative, shift_matrix
from pipelines.bifurcations.tori.problem import TorusProblem, TorusUnknowns
from pipelines.orbits.solving import solve_or_none
from pipelines.orbits.system import Matrix, Vector


@dataclass(frozen=True)
class CirclePass:
    """One pass from every angle: ``images`` (M, N), ``columns`` (M, N, m), ``by_parameter`` (M, N)."""

    images: Matrix
    columns: Array
    by_parameter: Matrix
    finite: bool


def pass_from_all(
    problem: TorusProblem, unknowns: TorusUnknowns, columns: Array, with_parameter: bool
) -> CirclePass:
    """One pass of the map from every angle with its own columns (M, N, m)."""
    count, size, width = columns.shape
    images, slopes = np.empty((count, size)), np.empty((count, size))
    block, finite = np.empty((count, size, width)), True
    for j, angle in enumerate(angles(count)):
        image = problem.circle.evaluate(
            unknowns.states[j], float(angle), unknowns.parameter, columns[j], with_parameter
        )
        images[j], block[j], slopes[j] = image.state, image.columns, image.by_parameter
        finite = finite and image.finite
        if not finite:
            break
    return CirclePass(images, block, slopes, finite)


def carried(unknowns: TorusUnknowns, values: Array) -> Array:
    """S(-rho) values: the images of a pass moved back to the angles themselves, shape (M, ...)."""
    return applied(shift_matrix(len(values), -unknowns.rotation)[0], values)


@dataclass(frozen=True)
class PhaseRow:
    """mean_j <g_j, x_j> = offset with g = dX_ref/dtheta, divided by the mean square of g."""

    row: Matrix
    offset: float

    @classmethod
    def of(cls, reference: Matrix) -> PhaseRow:
        slope = derivative(reference)
        size = float(np.vdot(slope, slope))
        row = slope / size if size > 0.0 else slope
        return cls(row, float(np.vdot(row, reference)))

    def gap(self, states: Matrix) -> float:
        return float(np.vdot(self.row, states)) - self.offset


@dataclass(frozen=True)
class Linearised:
    """The derivatives at a curve in reduced form.

    ``reduced`` (M k, M k): V'D V; ``sources`` and ``picard``, ``picard_image`` (M, N, c): x, q_x and D
    q_x for r, Phi_l and, when rho is unknown, Phi_rho.
    """

    bases: Array
    reduced: Matrix
    sources: Array
    picard: Array
    picard_image: Array


def linearise(problem: TorusProblem, unknowns: TorusUnknowns, bases: Array, passed: CirclePass) -> Linearised:
    """The derivatives at a curve that is not yet invariant, with their Picard parts."""
    count = len(bases)
    shift, slope = shift_matrix(count, -unknowns.rotation)
    by_parameter, by_rotation = applied(shift, passed.by_parameter), -applied(slope, passed.images)
    known = problem.circle.rotation(unknowns.parameter)
    residual = applied(shift, passed.images) - unknowns.states
    if known is None:
        sources = np.stack([residual, by_parameter, by_rotation], axis=2)
    else:
        sources = np.stack([residual, by_parameter + known[1] * by_rotation], axis=2)
    picard, image = _picard_iteration(problem, unknowns, bases, shift, sources)
    return Linearised(bases, reduced_transport(bases, passed.columns, shift), sources, picard, image)


def reduced_transport(bases: Array, columns: Array, shift: Matrix) -> Matrix:
    """V'D V: blocks S_ji V_j' M_i V_i, shape (M k, M k)."""
    count, size, width = bases.shape
    left = np.swapaxes(bases, 1, 2).reshape(count * width, size)
    right = np.moveaxis(columns, 1, 0).reshape(size, count * width)
    blocks = (left @ right).reshape(count, width, count, width)
    blocks *= shift[:, None, :, None]
    return blocks.reshape(count * width, count * width)


def _project_out(bases: Array, values: Array) -> Array:
    """Q x = x - V V'x at every angle, for values (M, N, c)."""
    return np.asarray(values - bases @ (np.swapaxes(bases, 1, 2) @ values))


def _picard_iteration(
    problem: TorusProblem, unknowns: TorusUnknowns, bases: Array, shift: Matrix, sources: Array
) -> tuple[Array, Array]:
    """Repeat q <- Q (D q + x) until every q changes little against its x; returns q and D q."""
    if bases.shape[1] == bases.shape[2]:
        return np.zeros_like(sources), np.zeros_like(sources)
    picard, image = _project_out(bases, sources), np.zeros_like(sources)
    sizes = np.linalg.norm(sources, axis=(0, 1))
    for _ in range(problem.options.picard_sweeps):
        passed = pass_from_all(problem, unknowns, np.ascontiguousarray(picard), False)
        image = applied(shift, passed.columns)
        following = _project_out(bases, image + sources)
        moved = np.linalg.norm(following - picard, axis=(0, 1))
        if np.all(moved <= problem.options.picard_tolerance * sizes):
            break
        picard = following
    return picard, image


def solve_bordered(
    linear: Linearised, phase: PhaseRow | None, offset: float, row: TorusUnknowns, gap: float
) -> TorusUnknowns | None:
    """The update (dX, drho, dl) of the system shown in ``invariant_curve``."""
    count, _, width = linear.bases.shape
    inner, tails = count * width, linear.sources.shape[2] - 1
    matrix, right = np.empty((inner + tails, inner + tails)), np.empty(inner + tails)
    projected = np.swapaxes(linear.bases, 1, 2) @ (linear.sources + linear.picard_image)
    projected = projected.reshape(inner, tails + 1)
    # V'(D - I)V a + V'(Phi_l + D q_l) dl + V'(Phi_rho + D q_rho) drho = -V'(r + D q_r)
    matrix[:inner, :inner] = linear.reduced
    matrix[np.arange(inner), np.arange(inner)] -= 1.0
    matrix[:inner, inner:] = projected[:, 1:]
    right[:inner] = -projected[:, 0]
    # row_x (V a + q) + row_l dl + row_rho drho = -gap
    direct = np.array([row.parameter, row.rotation])[:tails]
    matrix[inner], right[inner] = _border(linear, row.states, direct, gap)
    if phase is not None and tails == 2:
        # g (V a + q) = -(g X - g X_ref)
        matrix[inner + 1], right[inner + 1] = _border(linear, phase.row, np.zeros(2), offset)
    solution = solve_or_none(matrix, right)
    if solution is None:
        return None
    weights = np.concatenate([[1.0], solution[inner:]])
    inside = linear.bases @ solution[:inner].reshape(count, width, 1)
    states = inside[:, :, 0] + linear.picard @ weights
    rotation = float(solution[inner + 1]) if tails == 2 else 0.0
    return TorusUnknowns(np.ascontiguousarray(states), rotation, float(solution[inner]))


def _border(linear: Linearised, row: Matrix, direct: Vector, gap: float) -> tuple[Vector, float]:
    """One closing row in the unknowns of the small system, and its right side."""
    inside = (row[:, None, :] @ linear.bases).ravel()
    picard: Vector = np.tensordot(row, linear.picard, axes=2)
    return np.concatenate([inside, direct + picard[1:]]), -gap - float(picard[0])
