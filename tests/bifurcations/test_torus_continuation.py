"""Branches of tori: exact families, the forced van der Pol oscillator, restarts, how branches end."""

from __future__ import annotations

import math
import textwrap
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.continuation import continue_torus, resonance_ahead
from pipelines.bifurcations.tori.fourier import angles, interpolated
from pipelines.bifurcations.tori.problem import FourierOptions, TorusProblem
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.start import torus_around
from pipelines.bifurcations.tori.torus import TorusOptions, TorusPoint, TorusStart, TorusState, TorusStop
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import ode_system
from tests.bifurcations.explicit_maps import CLOCK
from tests.bifurcations.quasi_periodic import (
    moebius_circle,
    moebius_rotation,
    shaken_hopf,
    two_tones,
    van_der_pol,
)
from tests.bifurcations.torus_runs import TorusRun, fitted_curve, rotation_number, trace_torus

STEPS = 64
THETA, D, B, E = 1.0, -0.5, 0.3, 0.7


def moebius_start(m: float) -> tuple[TorusProblem, TorusStart]:
    circle = PeriodCircle(moebius_rotation(), np.array([m, THETA, D, B, E, CLOCK]), "m", 1)
    radius, rotation, _ = moebius_circle(m, THETA, D, B)
    w = radius * np.exp(1j * angles(15))
    seen = w / (1.0 - E * w)
    states = np.stack([seen.real, seen.imag], axis=1)
    problem = TorusProblem(circle, ShootingOptions(tolerance=1e-12), FourierOptions(tolerance=1e-9))
    return problem, TorusStart(states, constant_bases(np.eye(2), 15), m, rotation)


def test_exact_family() -> None:
    """Rotation and multiplier along m; the circle grows, and with it the number of angles it needs."""
    problem, start = moebius_start(0.02)
    run = trace_torus(problem, start, TorusOptions((0.02, 0.3), step=0.05, maximum_step=0.1))
    assert run.result.stop is TorusStop.RANGE
    assert run.parameters[-1] == 0.3
    for point in run.points:
        at = point.torus.unknowns
        radius, rotation, multiplier = moebius_circle(at.parameter, THETA, D, B)
        assert at.rotation == pytest.approx(rotation, abs=1e-8)
        assert point.spectrum.moduli == pytest.approx([multiplier], abs=1e-7)
        w = radius * np.exp(1j * angles(501))
        curve = interpolated(at.states, angles(501))
        distance = np.abs((curve[:, 0] + 1j * curve[:, 1])[:, None] - (w / (1.0 - E * w))[None, :])
        assert np.max(np.min(distance, axis=1)) < 0.02  # half of the distance of the exact points
        inverse = (curve[:, 0] + 1j * curve[:, 1]) / (1.0 + E * (curve[:, 0] + 1j * curve[:, 1]))
        assert np.max(np.abs(np.abs(inverse) - radius)) < 1e-7
    counts = [point.torus.count for point in run.points]
    assert counts[0] < counts[-1]
    back = trace_torus(
        problem,
        TorusStart(run.states[-1].states, run.states[-1].slow_bases, 0.3, run.states[-1].rotation),
        TorusOptions((0.02, 0.3), direction=-1, step=0.05, maximum_step=0.1),
    )
    assert back.result.stop is TorusStop.RANGE
    assert len(back.states[-1].states) < counts[-1]


def test_restart_is_bitwise() -> None:
    """From a copy of any recorded state the same points follow, to the last bit."""
    problem, start = moebius_start(0.02)
    options = TorusOptions((0.02, 0.3), step=0.05, maximum_step=0.1)
    run = trace_torus(problem, start, options)
    middle = len(run.states) // 2
    copied = TorusState.from_arrays(run.states[middle].arrays())
    again = trace_torus(problem, copied, options)
    assert len(again.states) == len(run.states) - middle - 1
    for mine, theirs in zip(again.states, run.states[middle + 1 :], strict=True):
        for name, value in mine.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(theirs.arrays()[name]).tobytes(), name
    assert again.result.stop is run.result.stop


# --- The forced van der Pol oscillator ----------------------------------------------------------------


def long_orbit(period_map: PeriodMap, parameters: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    period, orbit = period_map.period(parameters), np.empty((count, period_map.size))
    state = start
    for row in orbit:
        state = period_map.evaluate(state, parameters, period, STEPS).state
        row[:] = state
    return orbit


def nearest(states: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    """The angle of a curve that is nearest to a point, and the distance."""
    grid = np.linspace(0.0, 2.0 * math.pi, 401)
    for _ in range(8):
        distances = np.linalg.norm(interpolated(states, grid) - point, axis=1)
        best, width = grid[np.argmin(distances)], grid[1] - grid[0]
        grid = np.linspace(best - width, best + width, 41)
    return float(best), float(np.min(distances))


def van_der_pol_branch(
    force: float, first: float, last: float, fourier: FourierOptions | None = None, maximum_step: float = 0.2
) -> tuple[TorusProblem, TorusRun, PeriodMap]:
    """Tori of x'' - 0.4 (1 - x^2) x' + x = a cos(omega t) over omega, the first one from a simulation."""
    period_map = PeriodMap(van_der_pol(), DOPRI8, samples=1, minimum_steps=STEPS)
    parameters = np.array([first, 0.4, force])
    orbit = long_orbit(period_map, parameters, np.array([2.0, 0.0]), 900)[300:]
    rotation = rotation_number(orbit)
    states = fitted_curve(orbit, rotation, 31, 12)
    circle = PeriodCircle(period_map, parameters, "omega", STEPS)
    fourier = FourierOptions() if fourier is None else fourier
    problem = TorusProblem(circle, ShootingOptions(tolerance=1e-11), fourier)
    start = TorusStart(states, constant_bases(np.eye(2), 31), first, rotation)
    interval = (min(first, last), max(first, last))
    options = TorusOptions(
        interval, direction=1 if last > first else -1, step=0.05, maximum_step=maximum_step
    )
    return problem, trace_torus(problem, start, options), period_map


@pytest.mark.slow
def test_van_der_pol_against_simulation() -> None:
    """Points of a long run lie on every computed torus: P^n(x) = x(theta + n rho); the rotation is that of
    2000 periods and the multiplier that of the decay towards the torus.
    """
    problem, run, period_map = van_der_pol_branch(0.5, 1.7, 1.45)
    assert run.result.stop is TorusStop.RANGE
    assert len(run.points) >= 3
    for point in (run.points[0], run.points[-1]):
        torus, at = point.torus, point.torus.unknowns
        parameters = np.array([at.parameter, 0.4, 0.5])
        assert torus.error < problem.fourier.tolerance
        orbit = long_orbit(period_map, parameters, np.array([1.5, 0.5]), 2200)[200:]
        difference = (rotation_number(orbit) - at.rotation) / (2.0 * math.pi)
        assert abs(difference - round(difference)) < 1e-9
        angle, _ = nearest(at.states, orbit[0])
        followed = interpolated(at.states, angle + at.rotation * np.arange(len(orbit)))
        # 2000 periods with an error of the rotation of 1e-12 and a Fourier error below 1e-8
        assert np.max(np.abs(followed - orbit)) < 3e-8
        aside = long_orbit(period_map, parameters, at.states[0] * 1.05, 9)
        distances = [nearest(at.states, state)[1] for state in aside]
        # the distance falls like multiplier^n times a bounded function of the angle
        rate = (distances[8] / distances[0]) ** (1.0 / 8.0)
        assert rate == pytest.approx(point.spectrum.moduli[0], rel=0.15)


@pytest.mark.slow
def test_locking_ends_a_branch() -> None:
    """Towards the 1:1 tongue a weakly forced oscillator slows down on the torus, its series falls ever more
    slowly, and the branch ends before the torus is lost, naming the resonance.
    """
    _, run, _ = van_der_pol_branch(0.1, 1.25, 0.9, FourierOptions(tolerance=1e-6, most=63))
    assert run.result.stop is TorusStop.ROUGH
    assert "0/1" in run.result.message or "1/1" in run.result.message
    assert run.points[-1].torus.count == 63
    # the rotation falls towards that of the tongue
    turns = np.abs(np.mod(run.rotations / (2.0 * math.pi) + 0.5, 1.0) - 0.5)
    assert np.all(np.diff(turns) < 0.0)


@pytest.mark.slow
def test_a_leap_over_a_resonance() -> None:
    """Over the 1:5 tongue near omega = 4.95 the branch goes on; simulation confirms the rotation beyond."""
    fourier = FourierOptions(tolerance=1e-6, most=63)
    _, run, period_map = van_der_pol_branch(1.0, 4.93, 5.0, fourier, maximum_step=0.08)
    assert run.result.stop is TorusStop.RANGE
    turns = run.rotations / (2.0 * math.pi)
    assert np.all(np.diff(turns) > 0.0)
    (crossed,) = np.flatnonzero((turns[:-1] < -0.2) & (turns[1:] > -0.2))
    assert run.parameters[crossed + 1] - run.parameters[crossed] < 0.01
    last = run.parameters[-1]
    orbit = long_orbit(period_map, np.array([last, 0.4, 1.0]), np.array([2.0, 0.0]), 2200)[200:]
    difference = rotation_number(orbit) / (2.0 * math.pi) - turns[-1]
    assert abs(difference - round(difference)) < 1e-7


@pytest.mark.parametrize(
    ("rotation", "slope", "ahead"),
    [(0.19, 1.0, 0.01), (0.21, -2.0, -0.01), (-0.2001, 0.1, 0.0001), (0.49, 1.0, 0.01), (0.3, 0.0, None)],
)
def test_the_resonance_ahead(rotation: float, slope: float, ahead: float | None) -> None:
    found = resonance_ahead(2.0 * math.pi * rotation, slope)
    assert found == (None if ahead is None else pytest.approx(2.0 * math.pi * ahead, rel=1e-9))


def test_torus_shrinks_to_its_cycle() -> None:
    """Back to the Neimark-Sacker point at mu = 0, where r^2 = mu: the branch ends there."""
    period_map = PeriodMap(shaken_hopf(0.35), DOPRI8, samples=1)
    circle = PeriodCircle(period_map, np.array([1.0, 0.04, 0.4, 0.6]), "mu", 128)
    states = np.stack([0.6 + 0.2 * np.cos(angles(15)), 0.2 * np.sin(angles(15))], axis=1)
    start = TorusStart(states, constant_bases(np.eye(2), 15), 0.04, (0.35 + 0.4 * 0.04) * 2.0 * math.pi)
    problem = TorusProblem(circle, ShootingOptions(tolerance=1e-12))
    options = TorusOptions((-0.1, 0.2), direction=-1, step=0.05, maximum_step=0.1, minimum_step=1e-3)
    run = trace_torus(problem, start, options)
    assert run.result.stop is TorusStop.COLLAPSED
    assert np.all(run.parameters > 0.0)
    # the last radius is within a few of the smallest steps
    assert run.parameters[-1] < 1e-4


# --- Known rotation -----------------------------------------------------------------------------------


def two_tone_problem(cubic: float) -> TorusProblem:
    period_map = PeriodMap(two_tones(0.2, cubic, 0.5), DOPRI8, samples=1, minimum_steps=STEPS)
    circle = PeriodCircle(period_map, np.array([1.0, 0.618, 0.2, 0.3, 0.0]), "speed", STEPS, "angle", "speed")
    return TorusProblem(circle, ShootingOptions(tolerance=1e-11))


def test_known_rotation_against_simulation() -> None:
    """A Duffing oscillator with two frequencies over the second one: rho follows the parameter, and a run of
    1000 periods from any state ends on the curve at the angle n rho.
    """
    problem = two_tone_problem(0.3)
    start = torus_around(problem, np.zeros(2), 0.618)
    run = trace_torus(problem, start, TorusOptions((0.6, 0.66), step=0.05, maximum_step=0.1))
    assert run.result.stop is TorusStop.RANGE
    assert run.rotations == pytest.approx(2.0 * math.pi * run.parameters, rel=1e-14)
    torus = run.points[-1].torus
    circle, at = problem.circle, torus.unknowns
    state, angle = np.array([0.1, -0.2]), 0.0
    for _ in range(200):
        state = circle.evaluate(state, angle, at.parameter, np.zeros((2, 0)), False).state
        angle += at.rotation
    assert np.max(np.abs(interpolated(at.states, np.array([angle]))[0] - state)) < 1e-7
    # volumes contract by exp(-c T) everywhere, so do areas transverse to the angle
    for point in run.points:
        assert np.prod(point.spectrum.moduli) == pytest.approx(math.exp(-0.2 * 2.0 * math.pi), rel=1e-6)


@pytest.mark.slow
def test_example_of_the_docstring() -> None:
    """The example of ``PeriodCircle`` runs as it is printed."""
    assert PeriodCircle.__doc__ is not None
    example = textwrap.dedent(PeriodCircle.__doc__.split("first angle::\n")[1])
    points: list[TorusPoint] = []
    names = {
        "np": np, "ode_system": ode_system, "PeriodCircle": PeriodCircle, "PeriodMap": PeriodMap,
        "DOPRI8": DOPRI8, "TorusProblem": TorusProblem, "torus_around": torus_around,
        "continue_torus": continue_torus, "record": lambda point, *_: points.append(point),
        "TorusOptions": lambda range: TorusOptions(range, max_points=2),
    }  # fmt: skip
    exec(example, names)
    assert len(points) == 2
    assert all(point.stable for point in points)


def test_other_ends_and_options() -> None:
    problem, start = moebius_start(0.02)
    options = TorusOptions((0.02, 0.3), step=0.05, maximum_step=0.1, max_points=3)
    run = trace_torus(problem, start, options)
    assert run.result.stop is TorusStop.MAXIMUM_POINTS
    assert len(run.points) == 3
    told = trace_torus(
        problem, start, options, limit=lambda point: "far" if point.torus.unknowns.parameter > 0.03 else None
    )
    assert (told.result.stop, told.result.message) == (TorusStop.LIMIT, "far")
    assert trace_torus(problem, start, options, should_stop=lambda: True).result.stop is TorusStop.INTERRUPTED
    with pytest.raises(ValueError, match="outside the range"):
        trace_torus(problem, replace(start, parameter=0.5), options)
    wild = replace(start, states=start.states * 30.0)
    assert trace_torus(problem, wild, options).result.stop is TorusStop.START_FAILED
    for name, value in (("range", (1.0, 0.0)), ("direction", 2), ("step", 1.0), ("minimum_cosine", 1.0)):
        with pytest.raises(ValueError, match=name):
            replace(options, **{name: value})
