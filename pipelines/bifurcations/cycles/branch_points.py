"""Locate the cycle at a branch point from cycles on both sides of it.

Where two branches cross, the corrector has no unique solution: the error that its tolerance leaves lies along
the other branch and grows like 1/(mu - 1).  The branch itself is smooth there, and so is its multiplier mu
near 1.  Both are interpolated from cycles at some distance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import barycentric_interpolate

from pipelines.bifurcations.cycles.segment import Segment
from pipelines.orbits.shooting import Cycle, Unknowns, correct
from pipelines.orbits.vectors import Constraint

_OFFSETS = np.array([-2.0, -1.0, 1.0, 2.0])
_APARTS = (3e-3, 1e-2, 3e-2)  # distances of the multipliers from 1 at the nearest cycles
_LONGEST = 0.25  # of the segment, likewise
_INTERPOLATED = 1e-5  # residual of an interpolated cycle, at most


def cycle_at_branch_point(
    segment: Segment,
    beyond_one: Callable[[Cycle], float],
    bracket: tuple[tuple[float, float], tuple[float, float]],
) -> tuple[float, Cycle] | None:
    """The fraction of a segment where a multiplier passes 1, and the cycle there; None if not found.

    ``beyond_one(cycle)``: mu - 1 of that multiplier; ``bracket``: fractions on both sides with their values.
    """
    (first, before), (last, after) = bracket
    slope = (after - before) / (last - first)
    near = first - before / slope
    for apart in _APARTS:
        fractions = near + min(apart / abs(slope), _LONGEST) * _OFFSETS
        cycles = [segment.correct_at(float(fraction)).cycle for fraction in fractions]
        found = [cycle for cycle in cycles if cycle is not None]
        if len(found) < len(fractions):
            continue
        values = np.array([beyond_one(cycle) for cycle in found])
        if (
            not (np.all(np.diff(values) > 0.0) or np.all(np.diff(values) < 0.0))
            or values[0] * values[-1] > 0.0
        ):
            continue
        fraction = float(barycentric_interpolate(values, fractions, 0.0))
        cycle = _interpolated(segment, fractions, [cycle.unknowns for cycle in found], fraction)
        if cycle is not None:
            return fraction, cycle
    return None


def _interpolated(
    segment: Segment, fractions: np.ndarray, known: list[Unknowns], fraction: float
) -> Cycle | None:
    """The cycle at a fraction by interpolation, with its multipliers; None if its residual is too large."""
    parts = (np.array(part) for part in zip(*(unknowns.parts for unknowns in known), strict=True))
    state, period, parameter = (barycentric_interpolate(fractions, part, fraction, axis=0) for part in parts)
    at = Unknowns(np.asarray(state), float(period), float(parameter))
    options = replace(segment.problem.options, tolerance=_INTERPOLATED, iterations=1)
    problem = replace(segment.problem, options=options)
    row = segment.metric.row(segment.chord)
    constraint = Constraint(row, row.dot(at))
    return correct(problem, at, constraint, segment.basis, segment.end.steps, segment.reference).cycle
