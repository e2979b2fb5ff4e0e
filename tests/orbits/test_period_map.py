"""The period map: derivatives, both formulations, compiled against plain Python, Liouville, stiffness,
failure.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine
from pipelines.orbits import period_map as period_map_module
from pipelines.orbits.integration.implicit import propagate_implicit
from pipelines.orbits.period_map import Formulation, Inhomogeneity, PeriodImage, PeriodMap
from pipelines.orbits.steppers import DOPRI8, ESDIRK5, RK4
from pipelines.orbits.system import DynamicalSystem, ode_system
from pipelines.stages.cycles.problem import cycle_problem
from tests.helpers.monodromy import full_monodromy
from tests.helpers.tiny import tiny_case
from tests.systems import duffing, hopf_pair, implicit, tondl

STATE = np.array([0.3, 0.1, -0.2, 0.15])
PARAMETERS = np.array([0.03, 1.45])


def python_duffing() -> DynamicalSystem:
    return ode_system(
        lambda phase, s, p: [s[1], -0.1 * s[1] - s[0] - s[0] ** 3 + p[1] * np.cos(phase)],
        lambda phase, s, p: [[0.0, 1.0], [-1.0 - 3.0 * s[0] ** 2, -0.1]],
        size=2,
        parameter_names=("omega", "load"),
        forcing="omega",
    )


@pytest.mark.parametrize("formulation", list(Formulation))
@pytest.mark.parametrize("stepper", [RK4, DOPRI8], ids=lambda s: s.name)
def test_derivatives_of_the_discrete_map(formulation, stepper) -> None:  # type: ignore[no-untyped-def]
    """Columns against central differences of the map itself, on a coarse grid where the map is far from the
    flow.
    """
    period_map = PeriodMap(tondl(), stepper, formulation, samples=8)
    state, period, steps, h = period_map.extend(STATE), period_map.period(PARAMETERS), 16, 1e-5
    if period_map.extended:
        state[-2:] = 0.3, 0.8  # off the oscillator's cycle, so that every term of its tangent counts
    reference = period_map.phase_reference(
        period_map.evaluate(1.1 * state, PARAMETERS, period, steps).orbit, PARAMETERS, period
    )
    terms = [period_map.parameter_column(0, PARAMETERS), period_map.parameter_column(1, PARAMETERS)]
    if period_map.autonomous:
        terms.append(Inhomogeneity(period_rate=1.0))
    image = period_map.evaluate(
        state, PARAMETERS, period, steps, np.eye(period_map.size), tuple(terms), reference
    )
    got = np.hstack([image.columns, image.inhomogeneous])
    phase = np.concatenate([image.phase_columns, image.phase_inhomogeneous])

    def shifted(j: int, step: float):  # type: ignore[no-untyped-def]
        s, p, t = state.copy(), PARAMETERS.copy(), period
        if j < period_map.size:
            s[j] += step
        elif j < period_map.size + 2:
            p[j - period_map.size] += step
            t = period if period_map.autonomous else period_map.period(p)
        else:
            t += step
        return period_map.evaluate(s, p, t, steps, reference=reference)

    for j in range(got.shape[1]):
        plus, minus = shifted(j, h), shifted(j, -h)
        # 1e-8: truncation h^2 times third derivatives of order one to a hundred
        assert np.allclose((plus.state - minus.state) / (2 * h), got[:, j], atol=1e-8)
        assert (plus.phase - minus.phase) / (2 * h) == pytest.approx(phase[j], abs=2e-8)


def test_compiled_and_python_systems_share_the_loop() -> None:
    parameters, state = np.array([0.9, 0.3]), np.array([0.4, 0.1])
    for formulation in Formulation:
        results = []
        for system in (duffing(), python_duffing()):
            period_map = PeriodMap(system, RK4, formulation)
            start = period_map.extend(state)
            terms = (period_map.parameter_column(0, parameters),)
            period = period_map.period(parameters)
            results.append(period_map.evaluate(start, parameters, period, 64, np.eye(period_map.size), terms))
        # identical arithmetic except for fused operations and the library's cosine
        assert np.allclose(results[0].state, results[1].state, rtol=0, atol=1e-13)
        assert np.allclose(results[0].columns, results[1].columns, rtol=0, atol=1e-12)
        assert np.allclose(results[0].inhomogeneous, results[1].inhomogeneous, rtol=0, atol=1e-9)


def test_oscillator_extension_follows_the_forcing() -> None:
    """Eq. 17: the extended map gives the same orbit and returns to (sin 0, cos 0)."""
    forced = PeriodMap(tondl(), DOPRI8)
    extended = PeriodMap(tondl(), DOPRI8, Formulation.AUTONOMOUS)
    period = forced.period(PARAMETERS)
    plain = forced.evaluate(STATE, PARAMETERS, period, 128)
    wide = extended.evaluate(extended.extend(STATE), PARAMETERS, period, 128)
    assert np.allclose(wide.state[:4], plain.state, rtol=0, atol=1e-12)
    assert np.allclose(wide.orbit[:, :4], plain.orbit, rtol=0, atol=1e-12)
    assert np.allclose(wide.state[4:], [0.0, 1.0], rtol=0, atol=1e-12)


def test_two_turns_are_the_map_applied_twice() -> None:
    once, twice = PeriodMap(tondl(), RK4), PeriodMap(tondl(), RK4, turns=2)
    period = once.period(PARAMETERS)
    first = once.evaluate(STATE, PARAMETERS, period, 128, np.eye(4))
    second = once.evaluate(first.state, PARAMETERS, period, 128, first.columns)
    both = twice.evaluate(STATE, PARAMETERS, twice.period(PARAMETERS), 256, np.eye(4))
    assert np.allclose(both.state, second.state, rtol=0, atol=1e-13)
    assert np.allclose(both.columns, second.columns, rtol=0, atol=1e-13)


def test_liouville() -> None:
    """det M = exp of the integral of tr J along the orbit, here tr J = c1 - 3 gamma v1^2 - c2."""
    period_map = PeriodMap(tondl(), DOPRI8, samples=256)
    period = period_map.period(PARAMETERS)
    orbit = period_map.evaluate(STATE, PARAMETERS, period, 256).orbit
    closing = period_map.evaluate(STATE, PARAMETERS, period, 256).state
    trace = PARAMETERS[0] - 3.0 * 0.3 * np.append(orbit[:, 2], closing[2]) ** 2 - 0.2
    simpson = np.ones(257)
    simpson[1:-1:2], simpson[2:-1:2] = 4.0, 2.0
    integral = period / 256 / 3.0 * simpson @ trace
    determinant = np.linalg.det(full_monodromy(period_map, STATE, PARAMETERS, period, 256))
    # Simpson's rule on 256 intervals leaves 1e-8 of the integral
    assert determinant == pytest.approx(math.exp(integral), rel=1e-7)


def test_liouville_on_a_periodic_orbit_is_exact_to_rounding() -> None:
    """On a closed orbit the trapezoidal rule is spectral, so the identity can be asked to 1e-11."""
    from pipelines.orbits.shooting import CycleProblem, ShootingOptions, Unknowns, correct

    period_map = PeriodMap(tondl(), DOPRI8, samples=256)
    problem = CycleProblem(period_map, PARAMETERS, "c1", ShootingOptions(tolerance=1e-13))
    guess = Unknowns(STATE, 0.0, PARAMETERS[0])
    cycle = correct(problem, guess, problem.fixed_parameter(PARAMETERS[0]), np.eye(4), 256).cycle
    assert cycle is not None
    trace = PARAMETERS[0] - 3.0 * 0.3 * cycle.image.orbit[:, 2] ** 2 - 0.2
    expected = math.exp(cycle.unknowns.period * float(np.mean(trace)))
    assert np.prod(cycle.spectrum.multipliers).real == pytest.approx(expected, rel=1e-11)


def test_spectral_radius_and_steps() -> None:
    """A stiff linear system with a known spectrum; the steps chosen are stable and two thirds of them are
    not.
    """
    rates = -np.linspace(1.0, 900.0, 40)
    system = ode_system(
        lambda phase, s, p: rates * s + np.cos(phase),
        None,
        40,
        ("omega",),
        "omega",
        action=lambda phase, s, block, p: rates[:, None] * block,
    )
    period_map = PeriodMap(system, RK4, samples=16, minimum_steps=16)
    orbit, parameters = np.zeros((16, 40)), np.array([2.0])
    radius = period_map.spectral_radius(orbit, parameters)
    assert 0.9 * 900.0 < radius <= 900.0 * (1 + 1e-12)
    assert radius == period_map.spectral_radius(orbit, parameters)
    steps, period = period_map.steps_for(radius, math.pi), math.pi
    assert steps % 16 == 0
    assert period_map.evaluate(np.ones(40), parameters, period, steps).finite
    assert np.max(np.abs(period_map.evaluate(np.ones(40), parameters, period, steps).state)) < 1.0
    unstable = period_map.evaluate(np.ones(40), parameters, period, 16 * (2 * steps // 48))
    assert not unstable.finite or np.max(np.abs(unstable.state)) > 1e3
    assert replace(period_map, steps_per_period=100).steps_for(radius, period) == 112


@pytest.mark.parametrize("make", [duffing, python_duffing])
def test_divergence_is_a_result(make) -> None:  # type: ignore[no-untyped-def]
    """Sixty-four steps are far too few for a start on the steep part of the spring."""
    period_map = PeriodMap(make(), RK4)
    image = period_map.evaluate(np.array([1e4, 0.0]), np.array([0.5, 0.1]), 4.0 * math.pi, 64, np.eye(2))
    assert not image.finite


def test_bad_arguments_name_the_value() -> None:
    with pytest.raises(ValueError, match="stroboscopic"):
        PeriodMap(replace(duffing(), forcing=None))
    with pytest.raises(ValueError, match="turns is 0"):
        PeriodMap(duffing(), turns=0)
    with pytest.raises(ValueError, match="steps is 65"):
        PeriodMap(duffing()).evaluate(np.zeros(2), np.ones(2), 1.0, 65)
    with pytest.raises(ValueError, match="autonomous system"):
        PeriodMap(replace(duffing(), forcing=None), formulation=Formulation.AUTONOMOUS).period(np.ones(2))
    with pytest.raises(ValueError, match="exactly one"):
        ode_system(lambda phase, s, p: s, None, 1, ("a",))
    with pytest.raises(ValueError, match="forcing is 'b'"):
        ode_system(lambda phase, s, p: s, lambda phase, s, p: [[1.0]], 1, ("a",), "b")
    with pytest.raises(ValueError, match="unknown parameter 'x'"):
        duffing().parameter_index("x")
    with pytest.raises(ValueError, match="forcing is 7"):
        replace(duffing(), forcing=7)
    with pytest.raises(ValueError, match="size is 0"):
        replace(duffing(), size=0)
    with pytest.raises(ValueError, match="repeat"):
        replace(duffing(), parameter_names=("a", "a"))


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The steps of every pass that integrates an orbit."""
    integrated: list[int] = []

    def counting(*arguments):  # type: ignore[no-untyped-def]
        integrated.append(arguments[7])
        return propagate_implicit(*arguments)

    monkeypatch.setattr(period_map_module, "propagate_implicit", counting)
    return integrated


def same_bits(first: PeriodImage, second: PeriodImage) -> bool:
    return all(np.array_equal(value, getattr(second, name)) for name, value in vars(first).items())


@pytest.mark.parametrize("make", ["stroboscopic", "unforced", "machine"])
def test_further_columns_along_an_orbit_have_the_same_bits(make: str, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """As in a pass of their own, and without integrating the orbit again."""
    reference = None
    if make == "machine":
        case = tiny_case().case
        problem = cycle_problem(build_machine(case), case)
        period_map, parameters = problem.period_map, problem.parameters
        state, period = 0.01 * np.cos(np.arange(period_map.size)), period_map.period(parameters)
    elif make == "stroboscopic":
        period_map, parameters, state = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), PARAMETERS, STATE
        period = period_map.period(parameters)
    else:
        period_map = PeriodMap(implicit(hopf_pair()), ESDIRK5, Formulation.AUTONOMOUS, samples=8)
        parameters, state, period = np.array([0.2, 0.3]), np.array([0.4, 0.1, 0.02, -0.01]), 6.0
        orbit = period_map.evaluate(1.1 * state, parameters, period, 16).orbit
        reference = period_map.phase_reference(orbit, parameters, period)
    steps, columns = 16, np.cos(np.arange(period_map.size * 11)).reshape(-1, 11)
    terms = (period_map.parameter_column(0, parameters),)
    alone = replace(period_map).evaluate(state, parameters, period, steps, columns, (), reference)
    integrated = counted(monkeypatch)
    wide = period_map.evaluate(state, parameters, period, steps, columns[:, :9], terms, reference)
    assert np.array_equal(wide.columns, alone.columns[:, :9])
    further = period_map.evaluate(state, parameters, period, steps, columns, (), reference)
    assert same_bits(alone, further)
    assert integrated == [steps]


def test_only_the_very_same_orbit_is_taken_up_again(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    period_map, columns = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), np.eye(4)
    period = period_map.period(PARAMETERS)
    places = [
        (STATE, PARAMETERS, period, 16),
        (np.nextafter(STATE, 1.0), PARAMETERS, period, 16),
        (STATE, np.nextafter(PARAMETERS, 1.0), period, 16),
        (STATE, PARAMETERS, np.nextafter(period, 1.0), 16),
        (STATE, PARAMETERS, period, 17),
    ]
    alone = [replace(period_map).evaluate(*place, columns) for place in places]
    integrated = counted(monkeypatch)
    for place, expected in zip(places, alone, strict=True):
        period_map.evaluate(*places[0], columns)
        integrated.clear()
        assert same_bits(period_map.evaluate(*place, columns), expected)
        assert len(integrated) == (place is not places[0])
    # an orbit of which no further columns are wanted does not replace it
    period_map.evaluate(*places[0], columns)
    period_map.evaluate(*places[1], columns, once=True)
    integrated.clear()
    assert same_bits(period_map.evaluate(*places[0], columns), alone[0])
    assert integrated == []


def test_a_failed_pass_leaves_no_orbit(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    period_map, columns = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), np.eye(4)
    place = (STATE, PARAMETERS, period_map.period(PARAMETERS), 16)
    first = period_map.evaluate(*place, columns)

    def failing(*arguments):  # type: ignore[no-untyped-def]
        arguments[-1][:] = np.nan  # the factors of the stages before it failed
        return 3

    monkeypatch.setattr(period_map_module, "propagate_implicit", failing)
    assert not period_map.evaluate(1.1 * STATE, *place[1:], columns).finite
    integrated = counted(monkeypatch)
    assert same_bits(period_map.evaluate(*place, columns), first)
    assert integrated == [16]


def test_the_oscillator_is_integrated_with_every_block() -> None:
    period_map = PeriodMap(implicit(tondl()), ESDIRK5, Formulation.AUTONOMOUS, samples=8)
    state, period, columns = period_map.extend(STATE), period_map.period(PARAMETERS), np.eye(6)
    alone = replace(period_map).evaluate(state, PARAMETERS, period, 16, columns)
    for _ in range(2):
        assert same_bits(period_map.evaluate(state, PARAMETERS, period, 16, columns), alone)
