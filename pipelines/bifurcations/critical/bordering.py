"""Bordering vectors of the test function: their start, and their update along a curve."""

from __future__ import annotations

import math

import numpy as np

from pipelines.bifurcations.critical.critical_cycles import (
    BorderingVectors,
    Critical,
    Vectors,
    target_multiplier,
    with_period,
)
from pipelines.bifurcations.critical.critical_pair import invariant_plane
from pipelines.bifurcations.critical.cycle_manifold import linearise
from pipelines.bifurcations.critical.testfunctions import critical_matrix
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import MapAt
from pipelines.orbits.floquet import Complex, nontrivial, orthonormal
from pipelines.orbits.system import Matrix


def next_bordering(basis: Matrix, critical: Critical) -> BorderingVectors:
    """The bordering vectors for the next point of a curve."""
    if critical.right.shape[1] == 2:
        plane = orthonormal(critical.right)
        return BorderingVectors(plane[:, 0].copy(), plane[:, 1].copy(), cos_theta=critical.cos_theta)
    period = critical.right_period or 0.0
    size = math.hypot(float(np.linalg.norm(critical.right)), period)
    left_size = math.hypot(float(np.linalg.norm(critical.left)), critical.left_phase)
    return BorderingVectors(
        critical.right[:, 0] / size,
        basis @ critical.left[:, 0] / left_size,
        period / size,
        critical.left_phase / left_size,
        critical.cos_theta,
    )


def vectors_of(bordering: BorderingVectors, kind: EventKind) -> Vectors:
    """The critical vectors of the last point, as first guess at the next point."""
    if kind is EventKind.NEIMARK_SACKER:
        return Vectors(np.column_stack([bordering.right, bordering.left]))
    return Vectors(bordering.right[:, None].copy(), bordering.right_period)


def first_bordering(at: MapAt, basis: Matrix, angle: float | None = None) -> BorderingVectors | None:
    """The bordering vectors without any earlier point.

    They are the singular vectors of the critical matrix, or the invariant plane of the complex pair nearest
    to the unit circle (nearest to exp(i angle) when the angle is given).  None when the pass diverges or
    there is no pair.
    """
    image = at.full_pass(basis)
    if not image.finite:
        return None
    nothing = np.zeros((basis.shape[0], 0))
    linear, _ = linearise(at, basis, image, nothing, np.zeros((0, 0)))
    columns = basis.shape[1]
    if at.problem.kind is not EventKind.NEIMARK_SACKER:
        left, _, right = np.linalg.svd(critical_matrix(linear))
        tail_right, tail_left = (float(vector[columns:].sum()) for vector in (right[-1], left[:, -1]))
        vector = basis @ right[-1][:columns]
        if with_period(at):
            vector = vector + linear.picard.columns[:, -1] * linear.period_unit * tail_right
        return BorderingVectors(
            vector, basis @ left[:columns, -1], tail_right, tail_left, target_multiplier(at.problem.kind)
        )
    projected = basis.T @ image.columns
    pair = _starting_pair(projected, angle, at.problem.period_map.autonomous)
    plane = None if pair is None else invariant_plane(projected, pair)
    if pair is None or plane is None:
        return None
    vectors = basis @ plane
    return BorderingVectors(
        vectors[:, 0].copy(), vectors[:, 1].copy(), cos_theta=0.5 * float(np.sum(pair).real)
    )


def _starting_pair(projected: Matrix, angle: float | None, autonomous: bool) -> Complex | None:
    multipliers = nontrivial(np.linalg.eigvals(projected).astype(complex), autonomous)
    first, second = np.triu_indices(len(multipliers), k=1)
    total, product = multipliers[first] + multipliers[second], multipliers[first] * multipliers[second]
    real = np.abs(total.imag) + np.abs(product.imag) <= 1e-9 * (1.0 + np.abs(total))
    complex_pair = real & (np.abs(multipliers[first].imag) > 0.0)
    if angle is None:
        distance = np.where(complex_pair, np.abs(product - 1.0), np.inf)
    else:
        distance = np.where(real, np.abs(product - 1.0) + np.abs(total - 2.0 * math.cos(angle)), np.inf)
    if not np.any(np.isfinite(distance)):
        return None
    best = int(np.argmin(distance))
    return np.array([multipliers[first[best]], multipliers[second[best]]])
