"""The period map: derivatives, both formulations, compiled against plain Python, Liouville, stiffness,
failure.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from pipelines.machine.assembly import build_machine
from pipelines.machine.kernels import SOLVE
from pipelines.machine.lanes import LANES
from pipelines.orbits.integration import passes
from pipelines.orbits.integration.implicit import propagate_implicit
from pipelines.orbits.period_map import Formulation, Inhomogeneity, PeriodImage, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions, Unknowns, correct, first_basis
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


def test_two_periods_are_the_map_applied_twice() -> None:
    simple, twice = PeriodMap(tondl(), RK4), PeriodMap(tondl(), RK4, period_multiple=2)
    period = simple.period(PARAMETERS)
    first = simple.evaluate(STATE, PARAMETERS, period, 128, np.eye(4))
    second = simple.evaluate(first.state, PARAMETERS, period, 128, first.columns)
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
    period_map = PeriodMap(tondl(), DOPRI8, samples=256)
    problem = CycleProblem(period_map, PARAMETERS, "c1", ShootingOptions(tolerance=1e-13))
    guess = Unknowns(STATE, 0.0, PARAMETERS[0])
    cycle = correct(problem, guess, problem.fixed_parameter(PARAMETERS[0]), np.eye(4), 256).cycle
    assert cycle is not None
    trace = PARAMETERS[0] - 3.0 * 0.3 * cycle.image.orbit[:, 2] ** 2 - 0.2
    expected = math.exp(cycle.unknowns.period * float(np.mean(trace)))
    assert np.prod(cycle.spectrum.multipliers).real == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("make", [duffing, python_duffing])
def test_divergence_is_a_result(make) -> None:  # type: ignore[no-untyped-def]
    """Sixty-four steps are far too few for a start on the steep part of the spring."""
    period_map = PeriodMap(make(), RK4)
    image = period_map.evaluate(np.array([1e4, 0.0]), np.array([0.5, 0.1]), 4.0 * math.pi, 64, np.eye(2))
    assert not image.finite


def test_bad_arguments_name_the_value() -> None:
    with pytest.raises(ValueError, match="stroboscopic"):
        PeriodMap(replace(duffing(), forcing=None))
    with pytest.raises(ValueError, match="period_multiple is 0"):
        PeriodMap(duffing(), period_multiple=0)
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

    monkeypatch.setattr(passes, "propagate_implicit", counting)
    return integrated


def same_bits(first: PeriodImage, second: PeriodImage) -> bool:
    """Of all that two images tell of the map, its columns included."""
    names = ("state", "columns", "orbit", "phase", "phase_columns", "finite")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)


def counting_solves(system: DynamicalSystem) -> DynamicalSystem:
    """The system with the number of linear systems that it has solved in its last constant."""
    solve = system.shifted.solve  # type: ignore[union-attr]

    @njit(SOLVE)
    def counted_solve(factors, constants, layout, work, lanes):  # type: ignore[no-untyped-def]
        constants[constants.shape[0] - 1] += 1.0
        solve(factors, constants, layout, work, lanes)

    shifted = replace(system.shifted, solve=counted_solve)
    return replace(system, shifted=shifted, constants=np.append(system.constants, 0.0))


@pytest.mark.parametrize("formulation", list(Formulation))
def test_a_pass_beside_another_takes_fewer_iterations(formulation: Formulation) -> None:
    """It gives the same image; the nearer the orbits, the less Newton's method has left to do."""
    system = counting_solves(implicit(tondl()))
    period_map, steps = PeriodMap(system, ESDIRK5, formulation, samples=8), 12
    period, state = period_map.period(PARAMETERS), period_map.extend(STATE)
    columns = np.eye(period_map.size)
    alone = period_map.evaluate(state, PARAMETERS, period, steps, columns, keep_factors=True)

    def solves(near: PeriodImage | None) -> float:
        before = system.constants[-1]
        image = period_map.evaluate(state, PARAMETERS, period, steps, columns, keep_factors=True, near=near)
        np.testing.assert_allclose(image.columns, alone.columns, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(image.state, alone.state, rtol=0.0, atol=1e-12)
        # what the predictor misses belongs to the orbit, not to the one beside it
        np.testing.assert_allclose(image.missed, alone.missed, rtol=0.0, atol=1e-11)
        return float(system.constants[-1] - before)

    counts = [solves(None)]
    for apart in (1e-2, 1e-6, 1e-13):
        beside = state + apart * np.append(np.ones(4), np.zeros(period_map.size - 4))
        counts.append(solves(period_map.evaluate(beside, PARAMETERS, period, steps, keep_factors=True)))
    stages = steps * (ESDIRK5.stages - 1)
    columns_alone = stages * -(-period_map.size // LANES)
    assert counts[0] > counts[1] > counts[2] > counts[3] == stages + columns_alone
    other = period_map.evaluate(state, PARAMETERS, period, 2 * steps, keep_factors=True)
    assert solves(other) == counts[0]  # of other steps nothing is known
    same = period_map.evaluate(state, PARAMETERS, period, steps, keep_factors=True)
    assert solves(replace(same, finite=False)) == counts[0]


def test_errors_of_guesses_are_kept_on_request_and_within_the_limit(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """A long pass that nobody comes back to takes no memory for its stages."""
    period_map = PeriodMap(implicit(tondl()), ESDIRK5, samples=8)
    start = (STATE, PARAMETERS, period_map.period(PARAMETERS), 16)
    kept = period_map.evaluate(*start, keep_factors=True)
    rows = 16 * (ESDIRK5.stages - 1)
    assert kept.missed is not None
    assert kept.missed.shape == (rows, 4)
    plain = period_map.evaluate(*start)
    assert plain.missed is not None
    assert plain.missed.shape == (0, 4)
    assert same_bits(plain, kept)
    monkeypatch.setattr("pipelines.orbits.period_map.KEPT_BYTES", kept.missed.nbytes - 1)
    large = period_map.evaluate(*start, keep_factors=True)
    assert large.missed is not None
    assert large.missed.shape == (0, 4)
    assert same_bits(large, kept)


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
    start, columns = (state, parameters, period, 16), np.cos(np.arange(period_map.size * 11)).reshape(-1, 11)
    terms = (period_map.parameter_column(0, parameters),)
    alone = period_map.evaluate(*start, columns, (), reference)
    integrated = counted(monkeypatch)
    wide = period_map.evaluate(*start, columns[:, :9], terms, reference, keep_factors=True)
    assert np.array_equal(wide.columns, alone.columns[:, :9])
    further = period_map.with_columns(wide, columns, reference)
    assert same_bits(alone, further)
    assert np.array_equal(further.inhomogeneous, wide.inhomogeneous)
    assert same_bits(wide, period_map.with_columns(further, columns[:, :9], reference))
    assert integrated == [16]


def test_every_image_has_the_columns_of_its_own_orbit(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Whatever was passed before or since, and a pass costs the same every time."""
    period_map, columns = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), np.eye(4)
    period = period_map.period(PARAMETERS)
    starts = [
        (STATE, PARAMETERS, period, 16),
        (np.nextafter(STATE, 1.0), PARAMETERS, period, 16),
        (STATE, np.nextafter(PARAMETERS, 1.0), period, 16),
        (STATE, PARAMETERS, np.nextafter(period, 1.0), 16),
        (STATE, PARAMETERS, period, 17),
    ]
    integrated = counted(monkeypatch)
    images = [period_map.evaluate(*start, columns[:, :1], keep_factors=True) for start in starts]
    alone = [period_map.evaluate(*start, columns) for start in starts]
    assert integrated == 2 * [16, 16, 16, 16, 17]
    for image, expected in zip(images, alone, strict=True):
        assert same_bits(period_map.with_columns(image, columns), expected)
    assert len(integrated) == 10


def test_factors_are_there_on_request_and_within_the_limit(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Without them a block of columns is a pass, which finds them again."""
    period_map, columns = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), np.eye(4)
    start = (STATE, PARAMETERS, period_map.period(PARAMETERS), 16)
    plain = period_map.evaluate(*start, columns)
    kept = period_map.evaluate(*start, columns, keep_factors=True)
    assert plain.factors is None
    assert kept.factors is not None
    assert kept.without_factors().factors is None
    integrated = counted(monkeypatch)
    again = period_map.with_columns(kept.without_factors(), columns)
    assert same_bits(again, plain)
    assert again.factors is not None
    assert np.array_equal(again.factors, kept.factors)
    assert integrated == [16]
    monkeypatch.setattr(passes, "KEPT_BYTES", kept.factors.nbytes - 1)
    large = period_map.evaluate(*start, columns, keep_factors=True)
    assert large.factors is None
    assert same_bits(period_map.with_columns(large, columns), plain)


def test_a_failed_pass_has_no_factors(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    period_map, columns = PeriodMap(implicit(tondl()), ESDIRK5, samples=8), np.eye(4)

    def failing(*arguments):  # type: ignore[no-untyped-def]
        arguments[-1][:] = np.nan  # the factors of the stages before it failed
        return 3

    monkeypatch.setattr(passes, "propagate_implicit", failing)
    period = period_map.period(PARAMETERS)
    image = period_map.evaluate(STATE, PARAMETERS, period, 16, columns, keep_factors=True)
    assert not image.finite
    assert image.factors is None


def test_the_oscillator_is_integrated_with_every_block() -> None:
    period_map = PeriodMap(implicit(tondl()), ESDIRK5, Formulation.AUTONOMOUS, samples=8)
    state, period, columns = period_map.extend(STATE), period_map.period(PARAMETERS), np.eye(6)
    alone = period_map.evaluate(state, PARAMETERS, period, 16, columns)
    image = period_map.evaluate(state, PARAMETERS, period, 16, columns[:, :2], keep_factors=True)
    for _ in range(2):
        image = period_map.with_columns(image, columns)
        assert image.factors is None
        assert same_bits(image, alone)


def test_cycles_hold_no_factors() -> None:
    """They are kept, and the factors of an orbit may take 256 MiB."""
    case = tiny_case().case
    problem = cycle_problem(build_machine(case), case)
    guess = problem.consistent(
        Unknowns(np.zeros(problem.period_map.size), 0.0, problem.parameters[problem.index])
    )
    basis, fixed = first_basis(problem, guess, 32), problem.fixed_parameter(guess.parameter)
    cycle = correct(problem, guess, fixed, basis, 32).cycle
    assert cycle is not None
    assert cycle.linear is not None
    assert basis.shape[1] < basis.shape[0], "Picard sweeps were needed, and with them factors"
    assert cycle.image.factors is None
    assert cycle.linear.image.factors is None
