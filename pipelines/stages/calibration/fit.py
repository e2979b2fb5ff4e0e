"""Least squares of a calibration, over positions x in [0, 1]^n of the parameters within their ranges.

    minimise  sum_i r_i(x)^2,    r_i = (reached_i - wanted_i) / scatter_i,    0 <= x <= 1

by a trust region (`scipy.optimize.least_squares`), with one-sided differences of a stated step.  A target
that a machine fails counts as missed by its whole range of speeds, so that such a machine is left again, and
has no derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipelines.case.arrays import Array

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Evaluation:
    """One machine: ``position`` (n,), weighted ``deviations`` r (m,), and which targets ``failed`` (m,)."""

    position: Array
    deviations: Array
    failed: Flags

    @property
    def cost(self) -> float:
        """The sum of squares."""
        return float(self.deviations @ self.deviations)


Evaluate = Callable[[Array], Evaluation]


class NoEvaluationsLeft(Exception):  # noqa: N818
    """The allowed number of machines has been computed."""


@dataclass(frozen=True)
class Fit:
    """The best machine, and d r / d x (m, n) where it was last computed; None if it was not."""

    best: Evaluation
    jacobian: Array | None
    converged: bool


def fit(evaluate: Evaluate, start: Array, tolerance: float, step: float) -> Fit:
    """The machine with the least sum of squares near a start (n,).

    ``tolerance``: relative change of the sum of squares, and change of the positions, at which it ends;
    ``step`` of the differences.  `evaluate` may raise NoEvaluationsLeft, which ends the search unconverged.
    """
    best = evaluate(start)
    jacobian: Array | None = None

    def deviations(position: Array) -> Array:
        nonlocal best
        found = evaluate(position)
        best = found if found.cost < best.cost else best
        return found.deviations

    def slopes(position: Array) -> Array:
        nonlocal jacobian
        jacobian = differences(evaluate, evaluate(position), step)
        return jacobian

    try:
        result = least_squares(
            deviations, start, slopes, bounds=(0.0, 1.0), method="trf", ftol=tolerance, xtol=tolerance
        )
    except NoEvaluationsLeft:
        return Fit(best, jacobian, False)
    return Fit(evaluate(np.asarray(result.x)), jacobian, bool(result.success))


def differences(evaluate: Evaluate, at: Evaluation, step: float) -> Array:
    """d r / d x (m, n) by one-sided differences towards the middle of the range.

    To the other side where a target fails there, and 0 where it fails on both sides.
    """
    columns = []
    for index in range(len(at.position)):
        side = step if at.position[index] < 0.5 else -step
        column = np.zeros(len(at.deviations))
        missing = ~at.failed
        for signed in (side, -side):
            beside = at.position.copy()
            beside[index] += signed
            if not missing.any() or not 0.0 <= beside[index] <= 1.0:
                continue
            found = evaluate(beside)
            known = missing & ~found.failed
            column[known] = (found.deviations - at.deviations)[known] / signed
            missing = missing & found.failed
        columns.append(column)
    return np.column_stack(columns)
