"""Coefficients of piecewise smooth maps from regularised maps beside them."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveState, CurveStop, SpecialKind
from pipelines.bifurcations.detection import Resonance
from pipelines.bifurcations.normal_forms.coefficients import NormalForm, NormalFormOptions
from pipelines.orbits.period_map import Formulation, PeriodImage, PeriodMap
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.bilinear_oscillator import START, STATE, exact_map, oscillator
from tests.bifurcations.curve_runs import FLIP, NS, map_problem, start, trace
from tests.bifurcations.explicit_maps import ExplicitMap, flip_map, henon, rotation_map

PLANE = ((-5.0, 5.0), (-5.0, 5.0))
OPTIONS = CurveOptions(PLANE, max_points=1, normal_form=NormalFormOptions(1e-3))


@cache
def regularised(*widths: float) -> NormalForm:
    """The form at the first point of the exact curve, from regularised maps if any width is given."""
    smooth = tuple(PeriodMap(oscillator(width), DOPRI8, samples=1) for width in widths)
    problem = replace(map_problem(exact_map(), FLIP, (0, 0), ("c", "f")), smooth_maps=smooth)
    form = trace(problem, start(STATE, START), OPTIONS).points[0].normal_form
    assert form is not None
    return form


def test_the_regularised_coefficient_tends_to_the_exact_one() -> None:
    """A kernel with a second moment: b differs from that of the exact flow by O(width^2)."""
    exact = regularised().coefficient.real
    errors = [abs(regularised(width).coefficient.real - exact) for width in (0.2, 0.1)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    assert errors[1] < 0.02 * exact


def test_the_error_holds_what_the_width_leaves() -> None:
    exact, fine, coarse = regularised(), regularised(0.1), regularised(0.2)
    both = regularised(0.1, 0.2)
    assert both.coefficient == fine.coefficient
    spread = abs(fine.coefficient - coarse.coefficient)
    assert both.error == pytest.approx(both.noise + spread, rel=1e-12)
    assert both.noise < 0.1 * spread
    assert abs(both.coefficient - exact.coefficient) <= both.error
    assert both.decided
    assert both.supercritical
    assert not replace(both, real_error=2.0 * both.coefficient.real).decided


@dataclass(frozen=True)
class NowhereMap(ExplicitMap):
    """A regularised map whose orbits leave the domain of its equations."""

    def evaluate(self, state, *rest, **more) -> PeriodImage:  # type: ignore[no-untyped-def, override]
        return replace(super().evaluate(state, *rest, **more), finite=False)


def test_without_a_smooth_cycle_there_is_no_form_but_a_curve() -> None:
    nowhere = NowhereMap(henon().system, samples=1, steps_per_period=1, function=henon().function)
    problem = replace(map_problem(henon(), FLIP, (0, 0), ("a", "b")), smooth_maps=(henon(), nowhere))
    begin = start([2.0 / 2.1, 0.6 / 2.1], (0.75 * 0.49, 0.3))
    run = trace(problem, begin, CurveOptions(PLANE, max_points=4))
    assert run.result.stop is CurveStop.MAXIMUM_POINTS
    assert [point.normal_form for point in run.points] == [None] * 4


def shifted(explicit: ExplicitMap, parameter: int, shift: float) -> ExplicitMap:
    """The map with one of its parameters moved: another map with the same critical cycles."""
    assert explicit.function is not None
    own, vector = explicit.function, shift * np.eye(len(explicit.system.parameter_names))[parameter]
    return replace(explicit, function=lambda s, p: own(s, p + vector))


def test_special_points_are_those_of_the_regularised_coefficient() -> None:
    """b = c + q^2 and d = d_r + 0.7 i: shifted in the regularised map, the zeros move by as much.

    The second map moves the coefficients by a constant above their change in a step, which is no noise.
    """
    maps = tuple(shifted(flip_map(), 2, shift) for shift in (0.05, 0.15))
    problem = replace(map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m")), smooth_maps=maps)
    run = trace(problem, start(np.zeros(2), (-0.46, 0.0)), CurveOptions(((-0.5, -0.2), (-1, 1))))
    assert [special.kind for special in run.specials] == [SpecialKind.GENERALISED_FLIP]
    assert run.specials[0].parameters[2] == pytest.approx(-0.41, abs=1e-7)
    assert run.points[0].normal_form.error == pytest.approx(0.1, abs=1e-6)
    maps = tuple(shifted(rotation_map(), 2, shift) for shift in (0.05, 0.15))
    problem = replace(map_problem(rotation_map(), NS, (0, 1.2, 0, 0, 0.8), ("d_r", "m")), smooth_maps=maps)
    run = trace(problem, start(np.zeros(3), (-0.21, 0.0), 1.2), CurveOptions(((-0.3, 0.3), (-1, 1))))
    assert [special.kind for special in run.specials] == [SpecialKind.CHENCINER]
    assert run.specials[0].parameters[2] == pytest.approx(-0.05, abs=1e-7)


def test_restart_gives_the_same_bits() -> None:
    problem = map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m"))
    problem = replace(problem, smooth_maps=(shifted(flip_map(), 1, 0.05),))
    options = CurveOptions(PLANE, max_points=6)
    whole = trace(problem, start(np.zeros(2), (-0.46, 0.0)), options)
    half = CurveState.from_arrays(pickle.loads(pickle.dumps(whole.states[2].arrays())))
    rest = trace(problem, half, options)
    assert len(rest.points) == 3
    for old, new in zip(whole.points[3:], rest.points, strict=True):
        assert old.normal_form == new.normal_form
        assert old.normal_form is not None


@pytest.mark.parametrize(
    ("theta", "expected"),
    [
        (0.04, Resonance.R1),
        (0.5 * math.pi + 0.04, Resonance.R4),
        (2.0 * math.pi / 3.0 - 0.04, Resonance.R3),
        (math.pi - 0.04, Resonance.R2),
        (1.2, Resonance.NONE),
    ],
)
def test_caution_near_strong_resonances(theta: float, expected: Resonance) -> None:
    problem = map_problem(rotation_map(), NS, (0, theta, 0.4, 0, 0.8), ("theta", "m"))
    point = trace(problem, start(np.zeros(3), (theta, 0.0), theta), OPTIONS).points[0]
    assert point.resonance() is expected
    assert point.resonance(0.01) is Resonance.NONE


def test_no_caution_on_other_curves() -> None:
    problem = map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m"))
    assert trace(problem, start(np.zeros(2), (0.3, 0.0)), OPTIONS).points[0].resonance() is Resonance.NONE


def test_smooth_maps_are_checked() -> None:
    problem = map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m"))
    free = PeriodMap(henon().system, formulation=Formulation.AUTONOMOUS)
    for other in (rotation_map(), henon(), free):
        with pytest.raises(ValueError, match="smooth map"):
            replace(problem, smooth_maps=(other,))
