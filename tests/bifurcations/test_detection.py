"""Test functions and their bookkeeping on spectra written down by hand, and events of systems with known
ones.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, ContinuationOptions
from pipelines.bifurcations.detection import (
    DetectionOptions,
    Event,
    EventKind,
    Resonance,
    critical_multiplier,
    detect,
    evaluate_tests,
    explains,
    strong_resonance,
    unstable_count,
)
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import DynamicalSystem, ode_system
from tests.bifurcations.explicit_maps import CLOCK, explicit_map
from tests.systems import duffing


def spectrum(*values: complex) -> np.ndarray:
    return np.array(values, dtype=complex)


def pair(modulus: float, angle: float) -> tuple[complex, complex]:
    return modulus * np.exp(1j * angle), modulus * np.exp(-1j * angle)


def kinds_between(before: np.ndarray, after: np.ndarray, turned: bool = False):  # type: ignore[no-untyped-def]
    first, second = evaluate_tests(before, False), evaluate_tests(after, False)
    kinds = detect(first, second, turned)
    return kinds, explains(first, second, kinds)


def test_each_crossing_is_its_own_kind() -> None:
    rest = pair(0.5, 1.0)
    assert kinds_between(spectrum(0.9, *rest), spectrum(1.1, *rest), True) == ((EventKind.FOLD,), True)
    assert kinds_between(spectrum(0.9, *rest), spectrum(1.1, *rest)) == ((EventKind.BRANCH_POINT,), True)
    assert kinds_between(spectrum(-0.9, *rest), spectrum(-1.1, *rest)) == ((EventKind.PERIOD_DOUBLING,), True)
    assert kinds_between(spectrum(0.3, *pair(0.9, 2.0)), spectrum(0.3, *pair(1.1, 2.0))) == (
        (EventKind.NEIMARK_SACKER,),
        True,
    )
    assert kinds_between(spectrum(0.9, *rest), spectrum(0.95, *rest)) == ((), True)


def test_unexplained_changes_ask_for_a_shorter_step() -> None:
    two_inside, two_outside = (
        spectrum(*pair(0.9, 1.0), *pair(0.9, 2.0)),
        spectrum(*pair(1.1, 1.0), *pair(1.1, 2.0)),
    )
    assert kinds_between(two_inside, two_outside) == ((), False)
    # two period doublings look like a Neimark-Sacker point until it turns out to be a neutral saddle
    first, second = (evaluate_tests(spectrum(*values), False) for values in ((-0.9, -0.8), (-1.2, -1.1)))
    assert detect(first, second, False) == (EventKind.NEIMARK_SACKER,)
    assert not explains(first, second, (), confirmed=True)
    # the parameter turned, yet no multiplier passed 1
    assert kinds_between(spectrum(0.9, 0.1), spectrum(0.8, 0.1), True) == ((EventKind.FOLD,), False)


def test_neutral_saddle_is_no_bifurcation() -> None:
    before, after = spectrum(1.25, 0.75), spectrum(1.25, 0.85)
    kinds, explained = kinds_between(before, after)
    assert kinds == (EventKind.NEIMARK_SACKER,)
    assert explained
    assert critical_multiplier(EventKind.NEIMARK_SACKER, spectrum(1.25, 0.8), False) is None
    complex_pair = critical_multiplier(EventKind.NEIMARK_SACKER, spectrum(*pair(1.0, 2.0), 0.3), False)
    assert complex_pair == pytest.approx(np.exp(2j))


def test_trivial_multiplier_is_left_out() -> None:
    values = spectrum(1.0 + 1e-11, 0.7, *pair(0.6, 1.0))
    assert unstable_count(values, True) == 0
    # the trivial one would be the smallest factor
    assert evaluate_tests(values, True).fold == pytest.approx(0.3, rel=1e-12)


def test_test_functions_ignore_the_number_of_fast_multipliers() -> None:
    slow = spectrum(1.1, -0.9, *pair(0.8, 2.0))
    many = np.concatenate([slow, spectrum(*([1e-4] * 30))])
    assert evaluate_tests(many, False) == evaluate_tests(slow, False)


def cluster(modulus: float, count: int = 60) -> tuple[complex, ...]:
    """``count`` multipliers of nearly one modulus spread over all angles, closed under conjugation."""
    rng = np.random.default_rng(1)
    sizes, angles = modulus + 0.02 * rng.random(count // 2), math.pi * rng.random(count // 2)
    return tuple(value for size, angle in zip(sizes, angles, strict=True) for value in pair(size, angle))


@pytest.mark.parametrize("rest", [(0.7,) * 60, cluster(0.7), cluster(0.95)])
def test_many_multipliers_of_moderate_modulus_hide_no_event(rest: tuple[complex, ...]) -> None:
    """1830 factors of 0.51 have a product of 1e-535, which is zero in doubles."""
    for kind, inside, outside in (
        (EventKind.NEIMARK_SACKER, pair(0.99, 1.0), pair(1.01, 1.0)),
        (EventKind.PERIOD_DOUBLING, (-0.99,), (-1.01,)),
        (EventKind.BRANCH_POINT, (0.99,), (1.01,)),
    ):
        before, after = spectrum(*inside, *rest), spectrum(*outside, *rest)
        assert kinds_between(before, after) == ((kind,), True)
        assert kinds_between(after, before) == ((kind,), True)
        assert kinds_between(before, spectrum(*(0.999 * value for value in before))) == ((), True)


def test_test_functions_are_linear_through_their_zeros() -> None:
    """The root finder needs a slope: psi_NS = 1 - r^2 at the modulus r of the pair that crosses."""
    for offset in (-1e-3, -1e-10, 1e-10, 1e-3):
        tests = evaluate_tests(spectrum(*pair(1.0 + offset, 1.0), *cluster(0.7)), False)
        assert tests.neimark_sacker == pytest.approx(-2.0 * offset - offset**2, rel=1e-5)
        assert evaluate_tests(spectrum(1.0 + offset, 0.7), False).fold == pytest.approx(-offset, rel=1e-5)
        assert evaluate_tests(spectrum(-1.0 - offset, 0.7), False).period_doubling == pytest.approx(
            -offset, rel=1e-5
        )


@pytest.mark.parametrize("distance", [1e-12, 1e-10, 9e-10, 2e-9])
def test_count_and_signs_agree_next_to_the_circle(distance: float) -> None:
    """A spectrum within the accuracy of the multipliers beyond the circle is on the same side for both."""
    inside, near, far = (spectrum(*pair(modulus, 1.0)) for modulus in (0.99, 1.0 + distance, 1.01))
    assert kinds_between(inside, near) == ((EventKind.NEIMARK_SACKER,), True)
    assert kinds_between(near, far) == ((), True)


def test_spectrum_exactly_on_the_circle_belongs_inside() -> None:
    """An event at a recorded point is found once: on leaving the point, not on reaching it."""
    for kind, on, outside in ((EventKind.PERIOD_DOUBLING, -1.0, -1.1), (EventKind.BRANCH_POINT, 1.0, 1.1)):
        at, after = spectrum(on, 0.3), spectrum(outside, 0.3)
        assert kinds_between(spectrum(0.9 * on, 0.3), at) == ((), True)
        assert kinds_between(at, after) == ((kind,), True)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.01, Resonance.R1),
        (math.pi - 0.02, Resonance.R2),
        (2.0 * math.pi / 3.0 + 0.03, Resonance.R3),
        (math.pi / 2.0 - 0.04, Resonance.R4),
        (1.0, Resonance.NONE),
        (2.0 * math.pi / 3.0 + 0.06, Resonance.NONE),
    ],
)
def test_strong_resonances(angle: float, expected: Resonance) -> None:
    assert strong_resonance(angle, 0.05) is expected


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match="event_tolerance is 0"):
        DetectionOptions(event_tolerance=0.0)
    with pytest.raises(ValueError, match="overlap"):
        DetectionOptions(resonance_distance=0.6)


def trace(
    system: DynamicalSystem,
    parameters: list[float],
    name: str,
    start: list[float],
    interval: tuple[float, float],
    **options: float,
) -> tuple[list[BranchPoint], list[Event]]:
    problem = CycleProblem(
        PeriodMap(system, DOPRI8, samples=32, minimum_steps=128 if system.compiled else 32),
        np.array(parameters),
        name,
        ShootingOptions(tolerance=1e-12),
    )
    points: list[BranchPoint] = []
    events: list[Event] = []
    continue_branch(
        problem,
        BranchStart(np.array(start), interval[0]),
        ContinuationOptions(interval, max_points=400, **options),  # type: ignore[arg-type]
        lambda point, state, found: (points.append(point), events.extend(found)),  # type: ignore[func-returns-value]
    )
    return points, events


def test_duffing_folds_against_another_integrator() -> None:
    """Both folds of the resonance curve: the parameter is extremal there and scipy's integrator finds mu =
    1.
    """
    points, events = trace(duffing(), [0.0, 0.3], "omega", [0.3, 0.0], (0.5, 2.5), maximum_step=0.1)
    assert [event.kind for event in events] == [EventKind.FOLD, EventKind.FOLD]
    assert points[-1].cycle.unknowns.parameter == 2.5
    upper, lower = (event.parameters[0] for event in events)
    frequencies = np.array([point.cycle.unknowns.parameter for point in points])
    turns = np.flatnonzero(np.diff(np.sign(np.diff(frequencies)))) + 1
    assert len(turns) == 2
    assert frequencies[turns[0]] <= upper
    assert frequencies[turns[1]] >= lower
    between = [point.unstable for point in points[turns[0] + 1 : turns[1] - 1]]
    assert between
    assert set(between) == {1}
    for event in events:
        frequency, load = event.parameters

        def rates(t: float, y: np.ndarray, w: float = frequency, f: float = load) -> list[float]:
            slope = [[0.0, 1.0], [-1.0 - 3.0 * y[0] ** 2, -0.1]]
            columns = np.array(slope) @ y[2:].reshape(2, 2)
            force = f * math.cos(w * t)
            return [y[1], -0.1 * y[1] - y[0] - y[0] ** 3 + force, *columns.ravel()]

        start = np.concatenate([event.state, [1.0, 0.0, 0.0, 1.0]])
        final = solve_ivp(rates, (0.0, event.period), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        assert np.allclose(final[:2], event.state, rtol=0, atol=1e-10)
        multipliers = np.linalg.eigvals(final[2:].reshape(2, 2))
        assert np.min(np.abs(multipliers - 1.0)) < 1e-8
        assert event.residual < 1e-9
        assert event.transversality != 0.0


def linear_forced(matrix: object, names: tuple[str, ...]) -> DynamicalSystem:
    """s' = A(parameters) s + cos(phase) e_last: its multipliers are exp(T eig A) for every parameter."""
    build = matrix

    def rates(phase, s, p):  # type: ignore[no-untyped-def]
        out = build(p) @ s  # type: ignore[operator]
        out[-1] += math.cos(phase)
        return out

    return ode_system(
        rates,
        lambda phase, s, p: build(p),
        build(np.ones(len(names))).shape[0],
        names,
        "omega",  # type: ignore[operator]
    )


def rotation(decay: float, frequency: float) -> np.ndarray:
    return np.array([[decay, -frequency], [frequency, decay]])


def two_growing_pairs() -> DynamicalSystem:
    """Pairs with the angular rates 0.7 and 1.3 that become unstable at growth = 0 and 0.004."""

    def matrix(p):  # type: ignore[no-untyped-def]
        out = np.zeros((4, 4))
        out[:2, :2], out[2:, 2:] = rotation(p[1], 0.7), rotation(p[1] - 0.004, 1.3)
        return out

    return linear_forced(matrix, ("omega", "growth"))


def test_two_pairs_leaving_in_one_step_are_both_found() -> None:
    """Steps of 0.1 jump over both: the unexplained change by four shortens the step."""
    points, events = trace(
        two_growing_pairs(), [2.0, 0.0], "growth", [0, 0, 0, 0], (-0.25, 0.25), step=0.1, maximum_step=0.1
    )
    assert [event.kind for event in events] == [EventKind.NEIMARK_SACKER] * 2
    assert np.allclose([event.parameters[1] for event in events], [0.0, 0.004], rtol=0, atol=1e-9)
    # theta = frequency T modulo 2 pi, folded into [0, pi]; d abs(mu)/d growth = T
    period = math.pi
    folded = [abs(math.remainder(w * period, 2.0 * math.pi)) for w in (0.7, 1.3)]
    assert np.allclose([event.angle for event in events], folded, rtol=0, atol=1e-8)
    assert np.allclose([event.transversality for event in events], period, rtol=1e-3)
    assert points[-1].unstable == 4
    assert not any(point.unexplained for point in points)


def test_smallest_step_over_two_events_is_marked() -> None:
    """A step that may not become short enough to part the two pairs is accepted and says so."""
    points, events = trace(
        two_growing_pairs(),
        [2.0, 0.0],
        "growth",
        [0, 0, 0, 0],
        (-0.25, 0.25),
        step=0.1,
        maximum_step=0.1,
        minimum_step=0.09,
    )
    assert events == []
    counts = [point.unstable for point in points]
    assert sorted(set(counts)) == [0, 4]
    assert [point.unexplained for point in points] == [
        index == counts.index(4) for index in range(len(points))
    ]
    assert all(point.unlocated == () for point in points)


def test_neutral_saddle_on_a_branch_is_not_reported() -> None:
    """Rates 0.3 and -growth: the product of the two multipliers passes one at growth = 0.3."""
    points, events = trace(
        linear_forced(lambda p: np.diag([0.3, -p[1]]), ("omega", "growth")),
        [2.0, 0.0],
        "growth",
        [0, 0],
        (0.1, 0.5),
    )
    before, after = points[0].cycle.spectrum.multipliers, points[-1].cycle.spectrum.multipliers
    assert np.prod(before).real > 1.0 > np.prod(after).real
    assert events == []


def test_two_branch_points_in_one_step_are_both_found() -> None:
    """Trivial cycle s = 0 with the rates growth and growth - 0.004, in steps of 0.1."""
    system = ode_system(
        lambda phase, s, p: [p[1] * s[0], (p[1] - 0.004) * s[1]],
        lambda phase, s, p: [[p[1], 0.0], [0.0, p[1] - 0.004]],
        2,
        ("omega", "growth"),
        "omega",
    )
    _, events = trace(system, [2.0, 0.0], "growth", [0, 0], (-0.25, 0.25), step=0.1, maximum_step=0.1)
    assert [event.kind for event in events] == [EventKind.BRANCH_POINT] * 2
    assert np.allclose([event.parameters[1] for event in events], [0.0, 0.004], rtol=0, atol=1e-9)


def test_branch_point_without_turning_parameter() -> None:
    """s' = level s - s^3 with the trivial cycle s = 0: a pitchfork at level = 0."""
    system = ode_system(
        lambda phase, s, p: [(p[1] + 0.2 * math.cos(phase)) * s[0] - s[0] ** 3],
        lambda phase, s, p: [[p[1] + 0.2 * math.cos(phase) - 3.0 * s[0] ** 2]],
        1,
        ("omega", "level"),
        "omega",
    )
    points, events = trace(system, [1.0, 0.0], "level", [0.0], (-0.11, 0.2))
    assert [event.kind for event in events] == [EventKind.BRANCH_POINT]
    assert events[0].parameters[1] == pytest.approx(0.0, abs=1e-10)
    assert (points[0].unstable, points[-1].unstable) == (0, 1)
    assert events[0].transversality == pytest.approx(2.0 * math.pi, rel=1e-3)


@pytest.mark.parametrize("kind", [EventKind.PERIOD_DOUBLING, EventKind.BRANCH_POINT])
@pytest.mark.parametrize("width", [0.1, 0.01])
@pytest.mark.parametrize("longest", [0.2, 0.1, 0.05, 0.025])
@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_a_bubble_within_one_step(kind: EventKind, width: float, longest: float, scale: float) -> None:
    """A multiplier beyond 1 or -1 for abs(l) < width, on the first step of the branch too; with steps of 0.1
    one of them ends just where it returns.
    """
    sign = 1.0 if kind is EventKind.BRANCH_POINT else -1.0
    bubble = explicit_map(
        2, ("l",), lambda s, p: (sign * (1.0 + width**2 - p[0] ** 2) * s[0] - sign * s[0] ** 3, 0.3 * s[1])
    )
    problem = CycleProblem(bubble, np.array([-0.43, CLOCK]), "l")
    events: list[Event] = []
    options = ContinuationOptions((-0.43, 0.5), maximum_step=longest, parameter_scale=scale)
    begin = BranchStart(np.zeros(2), -0.43)
    continue_branch(problem, begin, options, lambda point, state, found: events.extend(found))
    assert [event.kind for event in events] == [kind, kind]
    assert np.allclose([event.parameters[0] for event in events], [-width, width], rtol=0, atol=1e-8)
