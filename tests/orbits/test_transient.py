"""The transient loop: order, forces, blocks, samples, and how it ends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.unbalance import UnbalanceMass
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.time_runs.drive import Drive, Switching, make_drive
from pipelines.orbits.time_runs.transient import (
    DrivenSystem,
    Plan,
    Position,
    Status,
    advance,
    choose_steps,
    starting_position,
    trial_end,
)
from pipelines.stages.transients.run import driven_machine
from tests.helpers.unbalanced_map import unbalanced_map
from tests.machines import BEARING, case
from tests.orbits.driven_rotor import DAMPING, ECCENTRICITY, STIFFNESS, driven_rotor

PARAMETERS = np.array([1.4, 0.9, 0.0, 0.0])
STEADY, FREE = Switching(0.0, 0.0), np.full(2, -np.inf)


def harmonic(speed: float, time: np.ndarray) -> np.ndarray:
    """x + i y of the linear rotor: e Omega^2 / (k - Omega^2 + i c Omega) exp(i Omega tau)."""
    return ECCENTRICITY * speed**2 / (STIFFNESS - speed**2 + 1j * DAMPING * speed) * np.exp(1j * speed * time)


def harmonic_state(speed: float, time: float = 0.0) -> np.ndarray:
    z = harmonic(speed, np.array(time))
    return np.array([z.real, z.imag, (1j * speed * z).real, (1j * speed * z).imag])


def run(driven: DrivenSystem, plan: Plan, state: np.ndarray, limits: np.ndarray = FREE):
    """All blocks: the end, samples (first left out), extremes."""
    position = starting_position(driven, plan.drive, PARAMETERS, state)
    samples, extremes = [], []
    while position.step < plan.steps:
        block = advance(driven, plan, position, PARAMETERS, limits)
        samples.append(block.samples)
        extremes.append(block.extremes)
        position = block.end
        if block.status is not Status.DONE:
            break
    return block, np.concatenate(samples), np.concatenate(extremes)


def orders(driven: DrivenSystem, drive: Drive, parameters, state, steps, exact=None) -> np.ndarray:
    """Observed orders between consecutive numbers of steps."""
    if exact is None:
        exact = trial_end(driven, drive, parameters, state, 4 * steps[-1])
    errors = [np.abs(trial_end(driven, drive, parameters, state, n) - exact).max() for n in steps]
    return np.diff(np.log(errors)) / -np.diff(np.log(steps))


def test_order_against_the_harmonic_response():
    """Rotor on linear supports at constant speed: closed form, order five."""
    speed, end = PARAMETERS[0], 9.0
    drive = make_drive([0.0], [speed], end, STEADY, 0.9)
    found = orders(
        driven_rotor(), drive, PARAMETERS, harmonic_state(speed), (40, 80, 160), harmonic_state(speed, end)
    )
    assert found.min() > 4.8


def test_order_of_a_run_up_with_a_switched_excitation():
    """Hardening rotor, speed table with a kink, excitation switched on smoothly: order five across pieces."""
    drive = make_drive([0.0, 4.0], [0.5, 1.5], 12.0, Switching(0.0, 0.4, 1.0, 5.0), 0.9)
    found = orders(driven_rotor(0.5), drive, PARAMETERS, np.array([0.3, 0.0, 0.0, 0.1]), (60, 120, 240))
    assert found.min() > 4.7


def test_run_up_against_an_independent_integrator():
    """phi'' in the force: DOP853 of scipy on the equations as they are written down in the module's head."""
    begin, slope, end = 0.5, 0.1, 10.0

    def rates(t, s):
        phi, speed = begin * t + 0.5 * slope * t * t, begin + slope * t
        z, v = s[0] + 1j * s[1], s[2] + 1j * s[3]
        force = ECCENTRICITY * (speed**2 - 1j * slope) * np.exp(1j * phi)
        a = force - DAMPING * v - STIFFNESS * z
        return [v.real, v.imag, a.real, a.imag]

    expected = solve_ivp(rates, (0.0, end), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    drive = make_drive([0.0, end], [begin, begin + slope * end], end, STEADY, 0.9)
    found = trial_end(driven_rotor(), drive, PARAMETERS, np.zeros(4), 800)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-10)


def test_order_on_the_machine():
    """Film without clipping (which is smooth), run-up, unbalance and excitation switched up."""
    bearing = {**BEARING, "clipping": "full"}
    description = case((16, 1), displacement=0.1, speed=0.8, bearings=(bearing, bearing))
    machine, parameters = build_machine(description), parameter_vector(description)
    driven = driven_machine(machine, (UnbalanceMass(2, 2e-6), UnbalanceMass(9, 1e-6, 1.0)))
    drive = make_drive([0.0, 4.0], [0.8, 1.0], 8.0, Switching(0.1, 0.2, 0.0, 8.0), parameters[1])
    state = machine_equilibrium(machine, parameters).state
    assert orders(driven, drive, parameters, state, (100, 200, 400)).min() > 4.6


def test_one_period_is_the_unbalanced_map():
    """Two loops, the same equations: the discrete ones differ by Newton's tolerance only."""
    description = case((16, 1), displacement=0.1, speed=0.8)
    machine, parameters = build_machine(description), parameter_vector(description)
    masses = (UnbalanceMass(2, 2e-6), UnbalanceMass(9, 1e-6, 1.0))
    drive = make_drive(
        [0.0], [0.8], 2.0 * np.pi / parameters[1], Switching(0.1, 0.1), parameters[1], angle=0.7
    )
    state = machine_equilibrium(machine, parameters).state
    found = trial_end(driven_machine(machine, masses), drive, parameters, state, 50)
    expected = unbalanced_map(machine, masses, parameters, 50).evaluate(state, 0.7)
    assert expected.finite
    np.testing.assert_allclose(found, expected.state, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("per_sample", [3.7, 0.21])
def test_samples_lie_at_their_times_for_any_ratio_to_the_steps(per_sample):
    """Cubic interpolation within steps of 0.05: Omega^4 h^4/384 of an amplitude of 0.6, 3e-8."""
    speed, step = 1.4, 0.05
    drive = make_drive([0.0], [speed], 30.0, STEADY, 0.9)
    plan = Plan.of(drive, step, per_sample * step, 16, 1000)
    block, samples, _ = run(driven_rotor(), plan, harmonic_state(speed))
    assert plan.blocks > 2
    assert block.end.samples == plan.samples == len(samples) + 1
    expected = harmonic(speed, np.arange(1, plan.samples) * plan.interval)
    np.testing.assert_allclose(samples[:, 0] + 1j * samples[:, 1], expected, rtol=0.0, atol=1e-7)


def test_extremes_cover_the_steps_between_samples():
    """A circle of radius r: the gap is 1 - r at every step; the lowest y of ten turns is -r."""
    speed = 1.4
    radius = abs(harmonic(speed, np.array(0.0)))
    drive = make_drive([0.0], [speed], 90.0, STEADY, 0.9)
    plan = Plan.of(drive, 0.02, 45.0, 1, 1000)
    _, _, extremes = run(driven_rotor(), plan, harmonic_state(speed))
    np.testing.assert_allclose(extremes[:, 0], 1.0 - radius, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(extremes[:, 1], -radius, rtol=0.0, atol=radius * (1.4 * 0.02) ** 2 / 8.0)


def test_a_run_taken_up_between_blocks_is_the_same_to_the_last_bit():
    drive = make_drive([0.0, 4.0], [0.5, 1.5], 12.0, Switching(0.0, 0.4, 1.0, 5.0), 0.9)
    driven, plan = driven_rotor(0.5), Plan.of(drive, 0.11, 0.3, 8, 1000)
    assert plan.blocks > 5
    whole, samples, _ = run(driven, plan, np.array([0.3, 0.0, 0.0, 0.1]))
    position = starting_position(driven, drive, PARAMETERS, np.array([0.3, 0.0, 0.0, 0.1]))
    again = []
    while position.step < plan.steps:
        block = advance(driven, plan, position, PARAMETERS, FREE)
        again.append(block.samples)
        end = block.end
        position = Position(end.state.copy(), end.running.copy(), end.step, end.samples)
    assert np.array_equal(np.concatenate(again), samples)
    assert np.array_equal(position.state, whole.end.state)


def test_every_step_belongs_to_one_block_and_every_sample_to_one_step():
    drive = make_drive([0.0, 4.0, 4.001], [0.5, 1.5, 1.4], 12.0, STEADY, 0.9)
    plan = Plan.of(drive, 0.11, 0.02, 8, 1000)
    times = np.array([plan.time(step) for step in range(plan.steps + 1)])
    assert np.all(np.diff(times) > 0.0)
    assert np.diff(times).max() <= 0.11 * (1.0 + 1e-12)
    assert {0.0, 4.0, 4.001, 12.0} <= set(times.tolist())
    counts = [plan.samples_until(step) for step in range(plan.steps + 1)]
    assert counts[0] == 1
    assert counts[-1] == plan.samples == 601
    assert np.all(np.diff(counts) >= 0)


def test_few_blocks_are_made_of_a_long_run():
    """1e10 steps: the plan costs no memory, and its blocks stay countable."""
    drive = make_drive([0.0], [1.0], 1e8, STEADY, 0.9)
    plan = Plan.of(drive, 0.01, 1e3, 512, 100_000)
    assert plan.steps == 10**10
    assert plan.blocks <= 100_000


def test_a_limit_ends_the_run_at_its_step():
    """The resonant rotor spirals out to radius 0.3/0.2; it meets the stator where the exact solution does."""
    drive = make_drive([0.0], [1.0], 60.0, STEADY, 0.9)
    plan = Plan.of(drive, 0.05, 0.5, 20, 1000)
    driven = driven_rotor()
    block, samples, _ = run(driven, plan, np.zeros(4), np.array([0.2, -np.inf]))
    assert block.status is Status.LIMIT
    assert block.limit == 0
    assert np.hypot(*block.end.state[:2]) > 0.8
    assert block.end.running[0] < 0.2
    before = plan.time(block.end.step - 1)
    inside = trial_end(
        driven, make_drive([0.0], [1.0], before, STEADY, 0.9), PARAMETERS, np.zeros(4), block.end.step - 1
    )
    assert np.hypot(*inside[:2]) <= 0.8
    assert len(samples) + 1 == block.end.samples == plan.samples_until(block.end.step)
    again = advance(driven, plan, block.end, PARAMETERS, np.array([0.2, -np.inf]))
    assert again.status is Status.LIMIT
    assert again.end.step == block.end.step


def test_a_step_without_a_solution_is_told():
    """Newton's method leaves the numbers behind when the rotor starts at 1e200."""
    drive = make_drive([0.0], [1.0], 10.0, STEADY, 0.9)
    plan = Plan.of(drive, 1.0, 1.0, 20, 1000)
    block, samples, _ = run(driven_rotor(1.0), plan, np.array([1e200, 0.0, 0.0, 0.0]))
    assert block.status is Status.NEWTON
    assert block.end.step == 0
    assert len(samples) == 0


def test_steps_are_chosen_to_meet_the_tolerance():
    speed, end = 1.4, 2.0 * np.pi / 1.4
    drive = make_drive([0.0], [speed], end, STEADY, 0.9)
    driven, state = driven_rotor(), harmonic_state(speed)
    for tolerance in (1e-7, 1e-9):
        choice = choose_steps(driven, drive, PARAMETERS, state, tolerance)
        error = np.abs(trial_end(driven, drive, PARAMETERS, state, choice.steps) - harmonic_state(speed, end))
        assert error.max() <= tolerance
        assert choice.error == pytest.approx(error.max(), rel=0.3)
    given = choose_steps(driven, drive, PARAMETERS, state, 1.0, given=20)
    error = np.abs(trial_end(driven, drive, PARAMETERS, state, 20) - harmonic_state(speed, end)).max()
    assert given.steps == 20
    assert given.error == pytest.approx(error, rel=0.3)
