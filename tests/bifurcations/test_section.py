"""Normal forms of cycles of unknown period: closed forms, and those of the stroboscopic map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, SpecialKind
from pipelines.bifurcations.normal_forms.coefficients import NormalForm, NormalFormOptions
from pipelines.bifurcations.plane import CurveProblem
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.steppers import DOPRI8, ESDIRK5
from pipelines.orbits.system import DynamicalSystem
from tests.bifurcations.curve_runs import FLIP, FOLD, NS, Run, start, trace
from tests.bifurcations.polar_cycles import polar_cycles
from tests.bifurcations.twisted_cycles import flip_cycles, torus_cycles
from tests.systems import implicit, tondl

TURN = 2.0 * math.pi
SHARP = ShootingOptions(tolerance=1e-12, multiplier_tolerance=1e-10)


def unknown_period(
    system: DynamicalSystem, kind, names: tuple[str, str], parameters: tuple[float, ...], stepper=DOPRI8
) -> CurveProblem:  # type: ignore[no-untyped-def]
    period_map = PeriodMap(system, stepper, Formulation.AUTONOMOUS, samples=32, minimum_steps=64)
    return CurveProblem(period_map, kind, np.array(parameters), names, SHARP)


def form_of(problem: CurveProblem, begin, difference: float = 2e-3) -> NormalForm:  # type: ignore[no-untyped-def]
    options = NormalFormOptions(difference)
    run = trace(problem, begin, CurveOptions(((-9.0, 9.0), (-9.0, 9.0)), max_points=1, normal_form=options))
    form = run.points[0].normal_form
    assert form is not None
    return form


@pytest.mark.parametrize(("g", "c", "kappa"), [(0.0, 0.0, 0.4), (3.0, 0.7, 0.4), (-2.0, -0.5, 0.1)])
def test_flip(g: float, c: float, kappa: float) -> None:
    """The amplitude of z answers to u, and so does its speed: quadratic terms and another return time."""
    problem = unknown_period(flip_cycles(), FLIP, ("lambda", "c"), (0.0, g, c, kappa))
    form = form_of(problem, start([1.0, 0.0, 0.0, 0.0], (0.0, c), period=TURN))
    assert form.coefficient == pytest.approx(TURN * (1.0 - kappa * g / 4.0), abs=1e-6)
    assert form.error < 1e-3
    assert form.supercritical == (kappa * g < 4.0)


def test_generalised_flip() -> None:
    """b = 0 at g = 4/kappa."""
    problem = unknown_period(flip_cycles(), FLIP, ("lambda", "g"), (0.0, 7.0, 0.3, 0.5))
    options = CurveOptions(((-1.0, 1.0), (6.5, 8.7)), maximum_step=0.6, step=0.6)
    run = trace(problem, start([1.0, 0.0, 0.0, 0.0], (0.0, 7.0), period=TURN), options)
    (special,) = run.specials
    assert special.kind is SpecialKind.GENERALISED_FLIP
    assert special.parameters[:2] == pytest.approx([0.0, 8.0], abs=1e-6)


@pytest.mark.parametrize("stepper", [DOPRI8, ESDIRK5], ids=lambda stepper: stepper.name)
@pytest.mark.parametrize(("c", "e"), [(0.0, 1.0), (0.8, 0.5), (-0.6, -0.7)])
def test_torus(stepper, c: float, e: float) -> None:  # type: ignore[no-untyped-def]
    """The imaginary part is that of the return time."""
    system = implicit(torus_cycles()) if stepper is ESDIRK5 else torus_cycles()
    problem = unknown_period(system, NS, ("delta", "c"), (0.0, 0.3, c, e), stepper)
    form = form_of(problem, start([1.0, 0.0, 0.0, 0.0], (0.0, c), TURN * 0.3, period=TURN))
    assert form.coefficient == pytest.approx(-2.0 * TURN * (e + 0.3j * c), abs=1e-5)
    assert form.supercritical == (e > 0.0)


@pytest.mark.parametrize("e", [0.3, -0.4])
def test_fold(e: float) -> None:
    """e' = 2 (1 + e)(m + n e - e^3) with x the distance along the radius: a = 12 e r^3 T, up to the sign of
    q.
    """
    m, n, shift = -2.0 * e**3, 3.0 * e**2, 0.6
    problem = unknown_period(polar_cycles(), FOLD, ("m", "n"), (m, n, -0.5, 0.3, shift))
    r, period = math.sqrt(1.0 + e), TURN / (1.0 + shift * e)
    form = form_of(problem, start([0.0, r, 0.0, 0.0], (m, n), period=period), 1e-4)
    assert abs(form.coefficient) == pytest.approx(12.0 * abs(e) * r**3 * period, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "state", "at", "angle"),
    [
        (NS, [0.34346802, 0.06268184, -0.04931439, 0.01362864], (0.05608335552, 0.72), 1.9054859747),
        (FLIP, [0.323, 0.0477, 0.062, -0.1016], (0.0845, 2.45), math.pi),
    ],
    ids=["NS", "PD"],
)  # fmt: skip
def test_a_forced_system_has_the_coefficients_of_its_stroboscopic_map(kind, state, at, angle) -> None:  # type: ignore[no-untyped-def]
    """Wherever the phase condition puts the first point of the orbit."""
    free = forced(Formulation.AUTONOMOUS, kind, state, at, angle, 5)
    phases = []
    for point, there in zip(free.points, free.states, strict=True):
        where = (float(there.parameters[0]), float(there.parameters[1]))
        known = forced(Formulation.STROBOSCOPIC, kind, there.state[:4], where, point.angle, 1).points[0]
        assert np.allclose(known.parameters, where, rtol=0, atol=1e-9)
        assert point.normal_form is not None
        assert known.normal_form is not None
        assert abs(point.normal_form.coefficient - known.normal_form.coefficient) < 1e-6
        phases.append(abs(math.atan2(*there.state[-2:])))
    assert max(phases) > 1e-5


def forced(formulation: Formulation, kind, state, at: tuple[float, float], angle: float, points: int) -> Run:  # type: ignore[no-untyped-def]
    period_map = PeriodMap(tondl(), DOPRI8, formulation)
    curves = CurveProblem(period_map, kind, np.zeros(2), ("c1", "eta"), SHARP)
    begin = start(period_map.extend(np.array(state)), at, angle, TURN / at[1])
    options = CurveOptions(
        ((-0.1, 0.2), (0.4, 4.0)), parameter_scales=(0.05, 0.5), step=0.2, maximum_step=0.5, max_points=points
    )
    return trace(curves, begin, options)


@pytest.mark.slow
def test_generalised_flips_of_a_tiny_oval() -> None:
    """A closed curve of period doublings of 4e-5 x 7e-6 that starts at R2: the same points in both
    formulations.
    """
    found = []
    for formulation in Formulation:
        period_map = PeriodMap(tondl(), DOPRI8, formulation)
        curves = CurveProblem(period_map, FLIP, np.zeros(2), ("c1", "eta"), SHARP)
        state, at = [0.31955974, 0.05368591, -0.02798818, 0.00473829], (0.020404344298, 0.486025635914)
        begin = start(period_map.extend(np.array(state)), at, math.pi, TURN / at[1])
        run = trace(curves, begin, CurveOptions(((-0.1, 0.25), (0.4, 4.6))))
        flips = [special for special in run.specials if special.kind is SpecialKind.GENERALISED_FLIP]
        found.append(np.array([special.parameters for special in flips]) - at)
    assert found[0] == pytest.approx(
        np.array([[4.828307e-6, -6.486816e-6], [-5.076040e-6, -1.54371e-7]]), abs=1e-11
    )
    assert found[1] == pytest.approx(found[0], abs=1e-11)
