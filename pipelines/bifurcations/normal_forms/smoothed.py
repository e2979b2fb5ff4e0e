"""Normal forms of piecewise smooth maps, computed from regularised maps.

A piecewise smooth force has third derivatives with singularities at the moments where a piece begins or
ends.  The flow may still be smooth, but time steps miss what happens between them, so that differences of the
discrete map tend to a wrong coefficient however many steps are taken.  A force regularised over a width that
the steps resolve has none of this, and where every piece begins and ends with a rate its coefficient tends to
that of the flow as the width falls.  Events without a rate make it depend on widths above their depth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipelines.bifurcations.critical.correction import CriticalCycle, CurveConstraint
from pipelines.bifurcations.critical.corrector import correct_critical, with_converged_multipliers
from pipelines.bifurcations.critical.critical_cycles import BorderingVectors, with_sharp_left
from pipelines.bifurcations.normal_forms.coefficients import (
    NormalForm,
    NormalFormOptions,
    critical_coefficients,
    normal_form,
)
from pipelines.orbits.floquet import Complex
from pipelines.orbits.period_map import PeriodMap

_CYCLE = 1e-8  # residual asked of the critical cycle of a smooth map, whose coefficient is wanted to 1e-4
_MULTIPLIER = 1e-6  # of its test function and multipliers, likewise
_LEFT = 1e-6  # last term of the series for its left vectors


def smoothed_normal_form(
    found: CriticalCycle,
    bordering: BorderingVectors,
    constraint: CurveConstraint,
    options: NormalFormOptions,
    sharpest: bool = False,
) -> NormalForm | None:
    """The normal form at a corrected point of a curve: of the first smooth map, if the problem has any.

    Each smooth map has its own critical cycle, corrected from ``found`` with ``bordering`` in the plane of
    ``constraint``.  The error is that of the differences plus the largest distance of the other smooth maps
    by second-order differences; they are left out if only the ``sharpest`` is asked for.  None when one of
    the cycles is not found, or as in ``normal_form``.
    """
    problem = found.linear.at.problem
    if not problem.smooth_maps:
        return normal_form(found.linear, found.critical, options)
    found_values: list[Complex] = []
    for smooth in problem.smooth_maps[: 1 if sharpest else None]:
        values = _smooth_coefficients(smooth, found, bordering, constraint, options, bool(found_values))
        if values is None:
            return None
        found_values.append(values)
    fine, coarse = map(complex, found_values[0])
    noise, apart = abs(fine - coarse), [complex(values[-1]) - coarse for values in found_values]
    error = noise + max(abs(distance) for distance in apart)
    real_error = noise + max(abs(distance.real) for distance in apart)
    return NormalForm(problem.kind, fine, error, real_error, noise)


def _smooth_coefficients(
    smooth: PeriodMap,
    found: CriticalCycle,
    bordering: BorderingVectors,
    constraint: CurveConstraint,
    options: NormalFormOptions,
    rough: bool,
) -> Complex | None:
    at = found.linear.at
    tolerances = replace(
        at.problem.options,
        tolerance=max(_CYCLE, at.problem.options.tolerance),
        multiplier_tolerance=max(_MULTIPLIER, at.problem.options.multiplier_tolerance),
    )
    problem = replace(at.problem, period_map=smooth, smooth_maps=(), options=tolerances)
    try:
        point = correct_critical(
            problem, found.position, constraint, found.basis, bordering, found.steps, at.reference
        ).point
        if point is None:
            return None
        point = with_converged_multipliers(point, bordering, tolerances.multiplier_tolerance)
        critical = with_sharp_left(point.linear, point.critical, _LEFT)
    except np.linalg.LinAlgError:
        return None
    return critical_coefficients(point.linear, critical, options, rough)
