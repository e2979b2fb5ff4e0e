"""Tori at Neimark-Sacker points: amplitude, rotation and multiplier against exact tori and normal forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, ContinuationOptions
from pipelines.bifurcations.curve import CurveOptions, CurvePoint
from pipelines.bifurcations.curve_continuation import continue_curve
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.switching import curve_from_event
from pipelines.bifurcations.tori.stability import torus_spectrum
from pipelines.bifurcations.tori.start import BornTorus, torus_from_event
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.bifurcations.explicit_maps import CLOCK
from tests.bifurcations.quasi_periodic import moebius_rotation, shaken_hopf

OWN, SHIFT, LOAD = 0.35, 0.4, 0.6
SHARP = ShootingOptions(tolerance=1e-12)


def neimark_sacker(problem: CycleProblem, state: np.ndarray, low: float, high: float) -> Event:
    events: list[Event] = []
    continue_branch(
        problem,
        BranchStart(state, low),
        ContinuationOptions((low, high)),
        lambda point, state, found: events.extend(found),
    )
    (event,) = events
    assert event.kind is EventKind.NEIMARK_SACKER
    return event


def shaken() -> tuple[CycleProblem, Event]:
    period_map = PeriodMap(shaken_hopf(OWN), DOPRI8, samples=1)
    problem = CycleProblem(period_map, np.array([1.0, -0.05, SHIFT, LOAD]), "mu", SHARP)
    return problem, neimark_sacker(problem, np.array([LOAD, 0.0]), -0.05, 0.05)


def moebius(d: float) -> tuple[CycleProblem, Event]:
    problem = CycleProblem(moebius_rotation(), np.array([-0.1, 1.0, d, 0.3, 0.7, CLOCK]), "m", SHARP)
    return problem, neimark_sacker(problem, np.zeros(2), -0.1, 0.1)


def born(problem: CycleProblem, event: Event, amplitude: float) -> BornTorus:
    found = torus_from_event(problem, event, amplitude)
    assert found is not None
    return found


@pytest.mark.parametrize("amplitude", [0.02, 0.08])
def test_exact_torus_of_a_flow(amplitude: float) -> None:
    """|z|^2 = mu, rho = (w + b mu) T, multiplier exp(-2 mu T); the circle in s is that in z, shifted."""
    problem, event = shaken()
    found = born(problem, event, amplitude)
    assert found.correction.torus is not None
    at, period = found.correction.torus.unknowns, 2.0 * math.pi
    # eighth order, 128 steps: 1e-10
    assert at.parameter == pytest.approx(amplitude**2, abs=1e-9)
    assert at.rotation == pytest.approx((OWN + SHIFT * at.parameter) * period, abs=1e-9)
    radii = np.hypot(at.states[:, 0] - LOAD, at.states[:, 1])
    assert radii == pytest.approx(np.full(len(radii), amplitude), abs=1e-9)
    spectrum = torus_spectrum(found.problem, found.correction.torus)
    assert spectrum.moduli == pytest.approx([math.exp(-2.0 * at.parameter * period)], abs=1e-9)
    assert found.direction == 1


@pytest.mark.parametrize(("d", "direction"), [(-0.5, 1), (0.4, -1)])
def test_normal_form(d: float, direction: int) -> None:
    """With q of norm one and x = s_0 + 2 A Re(q e^(i theta)):  A^2 Re d = -alpha' (lambda - lambda_0),
    rho = theta_0 + A^2 Im d and the multiplier 1 - 2 alpha' (lambda - lambda_0), each with an error of the
    next order: halving A divides the relative errors by four.  Re d > 0 is subcritical: unstable tori.
    """
    problem, event = moebius(d)
    curve, start = curve_from_event(problem, event, ("m", "theta"))
    points: list[CurvePoint] = []
    continue_curve(
        curve, start, CurveOptions(((-1.0, 1.0), (0.5, 1.5)), max_points=1),
        lambda point, state, specials: points.append(point),
    )  # fmt: skip
    form = points[0].normal_form
    assert form is not None
    errors = []
    for amplitude in (0.08, 0.04):
        found = born(problem, event, amplitude)
        assert found.direction == direction
        torus = found.correction.torus
        assert torus is not None
        # first wave number of x: A q, with |q| = 1
        first = np.fft.fft(torus.unknowns.states, axis=0)[1] / torus.count
        square = float(np.linalg.norm(first) ** 2)
        growth = event.transversality * (torus.unknowns.parameter - event.parameters[0])
        spectrum = torus_spectrum(found.problem, torus)
        assert spectrum.unstable == (0 if d < 0.0 else 1)
        errors.append(
            [
                square * form.coefficient.real / -growth - 1.0,
                (torus.unknowns.rotation - event.angle) / (square * form.coefficient.imag) - 1.0,
                (1.0 - spectrum.moduli[0]) / (2.0 * growth) - 1.0,
            ]
        )
    assert np.all(np.abs(errors[1]) < 0.02)
    assert np.array(errors[0]) / np.array(errors[1]) == pytest.approx(np.full(3, 4.0), rel=0.1)


def test_what_cannot_be_started() -> None:
    problem, event = moebius(-0.5)
    with pytest.raises(ValueError, match="Neimark-Sacker"):
        torus_from_event(problem, replace(event, kind=EventKind.PERIOD_DOUBLING), 0.1)
    with pytest.raises(ValueError, match="amplitude"):
        torus_from_event(problem, event, 0.0)
    hasty = replace(problem, options=replace(SHARP, iterations=1))
    assert torus_from_event(hasty, event, 0.3) is None
