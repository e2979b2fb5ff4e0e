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
from pipelines.bifurcations.normal_forms import smoothed
from pipelines.bifurcations.normal_forms.coefficients import (
    NormalForm,
    NormalFormOptions,
    critical_coefficients,
)
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
    """The distance of the widths is one of second-order differences, off by no more than the noise."""
    exact, fine, coarse = regularised(), regularised(0.1), regularised(0.2)
    both = regularised(0.1, 0.2)
    assert both.coefficient == fine.coefficient
    spread = abs(fine.coefficient - coarse.coefficient)
    assert both.error == pytest.approx(both.noise + spread, abs=both.noise)
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


def test_rough_differences_are_of_second_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """b = c + q^2 also with a term of fifth order, of which second-order differences see h^2."""
    quintic = replace(flip_map(), function=lambda s, p: flip_map().function(s, p) + np.array([s[0] ** 5, 0]))
    monkeypatch.setattr(smoothed, "critical_coefficients", rough_twice)
    problem = replace(map_problem(flip_map(), FLIP, (0, 0.6, 0, 0.5), ("c", "m")), smooth_maps=(quintic,))
    errors = []
    for difference in (0.08, 0.04, 0.02):
        options = CurveOptions(PLANE, max_points=1, normal_form=NormalFormOptions(difference))
        form = trace(problem, start(np.zeros(2), (-0.2, 0.0)), options).points[0].normal_form
        assert form is not None
        errors.append(abs(form.coefficient - (-0.2 + 0.6**2)))
    assert np.allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05), errors


def rough_twice(*arguments):  # type: ignore[no-untyped-def]
    """The coefficient by second-order differences alone, in the place of both."""
    values = critical_coefficients(*arguments[:3], rough=True)
    assert values is not None
    assert values.shape == (1,)
    return np.repeat(values, 2)


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


def test_a_zero_is_located_as_far_as_the_regularisations_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two maps 0.1 apart in b: a tenth of that is enough, and the second map tells nothing inside a step."""
    calls = []

    def counted(*arguments):  # type: ignore[no-untyped-def]
        calls.append(arguments)
        return critical_coefficients(*arguments)

    monkeypatch.setattr(smoothed, "critical_coefficients", counted)
    curved = replace(flip_map(), function=lambda s, p: flip_map().function(s, [p[0], np.exp(p[1]), *p[2:]]))
    maps = tuple(shifted(curved, 2, shift) for shift in (0.05, 0.15))
    # b = c + 0.05 + exp(2 q) = 0 at q = -0.5 along a curve over q, with few long steps
    c = -0.05 - math.exp(-1.0)
    problem = replace(map_problem(curved, FLIP, (0, -1.0, c, 0.5), ("q", "m")), smooth_maps=maps)
    options = CurveOptions(((-1.2, 0.4), (-1, 1)), step=0.4, maximum_step=0.4)
    run = trace(problem, start(np.zeros(2), (-1.0, 0.0)), options)
    assert [special.kind for special in run.specials] == [SpecialKind.GENERALISED_FLIP]
    q = run.specials[0].parameters[1]
    assert abs(c + 0.05 + math.exp(2.0 * q)) < 0.1 * 0.1
    assert len(calls) - 2 * len(run.points) <= 3


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
