"""What lies on a branch or a curve does not depend on how it is walked along: step lengths and scales."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchResult, BranchStart, ContinuationOptions
from pipelines.bifurcations.curve import CurveOptions, CurveStop, TongueSide
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.switching import curve_from_event
from pipelines.case.reading import read_cases
from pipelines.machine import film
from pipelines.machine.assembly import build_machine
from pipelines.orbits.compiled import compiled_system
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import DynamicalSystem
from pipelines.stages.cycles.problem import cycle_problem
from tests.bifurcations.curve_runs import trace as trace_curve
from tests.validation.test_bearing_cycles import COARSE, SMOKE, equilibrium_of
from tests.validation.test_tondl_curves import POINTS, problem, start_at, trace

pytestmark = pytest.mark.slow

PLANE = ((-0.1, 0.25), (0.4, 4.6))
# Longest steps and factors of the parameter's scale; with a scale a hundred times smaller steps are so short
# that one length of them is enough.
WALKS = [*((longest, scale) for scale in (1.0, 100.0) for longest in (0.2, 0.1, 0.05, 0.025)), (0.2, 0.01)]


def walked(
    problem: CycleProblem, start: BranchStart, interval: tuple[float, float], scale: float, longest: float
) -> tuple[BranchResult, list[BranchPoint], list[Event]]:
    points: list[BranchPoint] = []
    events: list[Event] = []

    def record(point, state, found):  # type: ignore[no-untyped-def]
        points.append(point)
        events.extend(found)

    options = ContinuationOptions(interval, maximum_step=longest, parameter_scale=scale, max_points=20000)
    return continue_branch(problem, start, options, record), points, events


# --- The forced Hopf normal form z' = (m + i) z - z |z|^2 + F exp(i omega t) ----------------------------

_GROWTH, _DETUNING = 1.0, 0.55


@functools.cache
def forced_hopf() -> DynamicalSystem:
    """Parameters (omega, F).  With R = |z|^2 and sigma = omega - 1 cycles have

    F^2 = R ((m - R)^2 + sigma^2) and multipliers exp(lambda T), lambda = m - 2 R +- sqrt(R^2 - sigma^2):
    Neimark-Sacker points at R = m/2, folds at 3 R = 2 m +- sqrt(m^2 - 3 sigma^2).
    """

    def rates(phase, s, p, out):  # type: ignore[no-untyped-def]
        excess = _GROWTH - s[0] ** 2 - s[1] ** 2
        out[0] = excess * s[0] - s[1] + p[1] * math.cos(phase)
        out[1] = excess * s[1] + s[0] + p[1] * math.sin(phase)

    def jacobian(phase, s, p, out):  # type: ignore[no-untyped-def]
        excess = _GROWTH - s[0] ** 2 - s[1] ** 2
        out[0, 0], out[0, 1] = excess - 2.0 * s[0] ** 2, -1.0 - 2.0 * s[0] * s[1]
        out[1, 0], out[1, 1] = 1.0 - 2.0 * s[0] * s[1], excess - 2.0 * s[1] ** 2

    return compiled_system(rates, jacobian, 2, ("omega", "F"), "omega")


def force(squared: float) -> float:
    return math.sqrt(squared * ((_GROWTH - squared) ** 2 + _DETUNING**2))


@pytest.mark.parametrize(("longest", "scale"), WALKS)
def test_forced_hopf(longest: float, scale: float) -> None:
    """A Neimark-Sacker point and two folds within 0.004 of F = 0.525."""
    low, high = (0.1, 1.0) if scale >= 1.0 else (0.45, 0.6)  # thousands of short steps show nothing more
    problem = CycleProblem(
        PeriodMap(forced_hopf(), DOPRI8), np.array([1.0 + _DETUNING, low]), "F", ShootingOptions(1e-11)
    )
    # the smallest R at F, and z = F exp(i phase)/(i sigma - m + R)
    cubic = np.roots([1.0, -2.0 * _GROWTH, _GROWTH**2 + _DETUNING**2, -(low**2)])
    squared = min(root.real for root in cubic if abs(root.imag) < 1e-9)
    z = low / (1j * _DETUNING - _GROWTH + squared)
    start = BranchStart(np.array([z.real, z.imag]), low)
    result, points, events = walked(problem, start, (low, high), 0.1 * scale, longest)
    assert result.stop.name == "RANGE"
    assert points[-1].cycle.unknowns.parameter == high
    root = math.sqrt(_GROWTH**2 - 3.0 * _DETUNING**2)
    expected = [
        (EventKind.NEIMARK_SACKER, force(0.5 * _GROWTH)),
        (EventKind.FOLD, force((2.0 * _GROWTH - root) / 3.0)),
        (EventKind.FOLD, force((2.0 * _GROWTH + root) / 3.0)),
    ]
    assert [event.kind for event in events] == [kind for kind, _ in expected]
    assert np.allclose([e.parameters[1] for e in events], [value for _, value in expected], rtol=0, atol=1e-8)
    assert not any(point.unexplained for point in points)


# --- Langford's system, self-excited ---------------------------------------------------------------------

_TURN, _LEVEL, _ALPHA = 2.5, 1.0, 0.5


@functools.cache
def langford() -> DynamicalSystem:
    """x' = (z - b) x - w y, y' = w x + (z - b) y, z' = l + a z - z^3/3 - x^2 - y^2 with parameter b.

    Cycles have z = b, r^2 = l + a b - b^3/3, T = 2 pi/w and the exponents of [[0, r], [-2 r, a - b^2]]: a
    Neimark-Sacker point at b = +-sqrt(a).
    """

    def rates(phase, s, p, out):  # type: ignore[no-untyped-def]
        growth = s[2] - p[0]
        out[0] = growth * s[0] - _TURN * s[1]
        out[1] = _TURN * s[0] + growth * s[1]
        out[2] = _LEVEL + _ALPHA * s[2] - s[2] ** 3 / 3.0 - s[0] ** 2 - s[1] ** 2

    def jacobian(phase, s, p, out):  # type: ignore[no-untyped-def]
        growth = s[2] - p[0]
        out[0, 0], out[0, 1], out[0, 2] = growth, -_TURN, s[0]
        out[1, 0], out[1, 1], out[1, 2] = _TURN, growth, s[1]
        out[2, 0], out[2, 1], out[2, 2] = -2.0 * s[0], -2.0 * s[1], _ALPHA - s[2] ** 2

    return compiled_system(rates, jacobian, 3, ("b",))


@pytest.mark.parametrize(("longest", "scale"), WALKS)
def test_langford(longest: float, scale: float) -> None:
    """The cycles between both Neimark-Sacker points are unstable."""
    first = -1.0
    radius = math.sqrt(_LEVEL + _ALPHA * first - first**3 / 3.0)
    problem = CycleProblem(
        PeriodMap(langford(), DOPRI8, Formulation.AUTONOMOUS), np.array([first]), "b", ShootingOptions(1e-11)
    )
    start = BranchStart(np.array([radius, 0.0, first]), first, 2.0 * math.pi / _TURN)
    result, points, events = walked(problem, start, (-1.0, 1.0), scale, longest)
    assert result.stop.name == "RANGE"
    assert [event.kind for event in events] == [EventKind.NEIMARK_SACKER] * 2
    root = math.sqrt(_ALPHA)
    assert np.allclose([event.parameters[0] for event in events], [-root, root], rtol=0, atol=1e-8)
    assert {point.unstable for point in points} == {0, 2}


# --- Tondl's system: curves through every verified point ---------------------------------------------------


@pytest.mark.parametrize(("kind", "eta"), POINTS)
def test_tondl_curves(kind: str, eta: float) -> None:
    """Ends and special points are the same for all steps and scales.

    Only the far side of a wide tongue is found from long steps alone: it begins another curve.
    """
    seen = []
    for longest, scale in ((0.1, 1.0), (0.2, 1.0), (0.025, 1.0), (0.1, 100.0)):
        scales = (0.05 * scale, 0.5 * scale)
        options = {"maximum_step": longest, "parameter_scales": scales}
        result, points, found = trace(problem(kind), start_at(kind, eta), PLANE, **options)
        specials = [special for special in found if special.tongue is not TongueSide.FAR]
        places = np.array([points[-1].parameters, *(special.parameters for special in specials)])
        seen.append((result.stop, [special.kind for special in specials], places))
    stop, kinds, places = seen[0]
    assert stop in (CurveStop.RANGE, CurveStop.RESONANCE_1, CurveStop.RESONANCE_2, CurveStop.CLOSED)
    for other_stop, other_kinds, other_places in seen[1:]:
        assert (other_stop, other_kinds) == (stop, kinds)
        assert np.allclose(other_places, places, rtol=0, atol=1e-6)


# --- The smoke machine -------------------------------------------------------------------------------------


def test_smoke_machine() -> None:
    """A branch over the speed through its Neimark-Sacker point, and the curve of these to both sides.  The
    number of time steps is fixed: what they leave would be different where it is chosen on the way.
    """
    (named,) = read_cases(SMOKE, "smoke.toml", [*COARSE, "numerics.steps_per_period=64"])
    machine = build_machine(named.case)
    cycles = cycle_problem(machine, named.case)
    low, high = 1.16, 1.23
    state = equilibrium_of(machine, at_speed(cycles.parameters, low))
    lengths = (0.2, 0.1, 0.05, 0.025)
    found = []
    for longest in lengths:
        result, points, events = walked(cycles, BranchStart(state, low), (low, high), 1.0, longest)
        assert result.stop.name == "RANGE"
        assert not any(point.unexplained or point.unlocated for point in points)
        assert [event.kind for event in events] == [EventKind.NEIMARK_SACKER]
        end = points[-1].cycle
        found.append([events[0].parameters[film.SPEED], events[0].angle, *end.unknowns.state])
    assert np.allclose(found[1:], found[0], rtol=0, atol=1e-8)
    ends = []
    for longest in lengths[:3]:
        curves, begin = curve_from_event(cycles, events[0], ("excitation_frequency", "speed"))
        for direction in (1, -1):
            ranges = ((0.68, 0.72), (1.17, 1.25))
            options = CurveOptions(ranges, direction, maximum_step=longest, normal_form=None)
            run = trace_curve(curves, begin, options)
            last = run.points[-1]
            ends.append((run.result.stop, [special.kind for special in run.specials], last))
    for way, (stop, kinds, last) in enumerate(ends):
        first = ends[way % 2]
        assert (stop, kinds) == first[:2] == (CurveStop.RANGE, [])
        assert np.allclose(last.parameters, first[2].parameters, rtol=0, atol=1e-8)
        assert last.angle == pytest.approx(first[2].angle, abs=1e-8)
