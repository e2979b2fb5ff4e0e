"""Tori of the rotor out of balance: against a run in time, without unbalance, and against linear response."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.fourier import interpolated
from pipelines.bifurcations.tori.invariant_curve import Torus, correct_torus
from pipelines.bifurcations.tori.problem import FourierOptions, TorusProblem, TorusUnknowns, fixed_parameter
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.stability import converged_spectrum
from pipelines.machine.assembly import Machine, build_machine
from pipelines.machine.unbalance import UNBALANCE, UnbalanceMass, unbalance_acceleration
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.shooting import Cycle, CycleProblem, Unknowns, correct, first_basis
from pipelines.orbits.system import Vector
from pipelines.orbits.time_runs.drive import Switching, make_drive
from pipelines.orbits.time_runs.transient import Plan, Status, advance, starting_position
from pipelines.orbits.time_runs.unbalanced_map import UNBALANCED_PARAMETERS, unbalanced_system
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.transients.run import driven_machine
from tests.helpers.tiny import SHARP, tiny_case

SPEED, STEPS = 0.9371, 60
MASSES = (UnbalanceMass(2, 1e-7, 0.4), UnbalanceMass(9, 5e-8, -1.0))  # kg m; node 9 is condensed out


def balanced(displacement: float) -> tuple[Machine, CycleProblem, Cycle]:
    """The smallest machine below its critical speed, its cycle without unbalance."""
    overrides = (f"excitation.displacement={displacement}", f"continue_cycles.start={SPEED}")
    stages = ("continue_cycles",)
    case = tiny_case(SHARP, *overrides, "continue_cycles.range=[0.9, 1.0]", stages=stages).case
    machine = build_machine(case)
    problem = cycle_problem(machine, case)
    state = machine_equilibrium(machine, problem.parameters).state
    guess = problem.consistent(Unknowns(state, 0.0, SPEED))
    basis = first_basis(problem, guess, STEPS)
    cycle = correct(problem, guess, problem.fixed_parameter(SPEED), basis, STEPS).cycle
    assert cycle is not None
    return machine, problem, cycle


def torus(
    machine: Machine, problem: CycleProblem, cycle: Cycle, unbalance: float
) -> tuple[TorusProblem, Torus]:
    """The torus with so many times the masses, found from the cycle."""
    parameters = np.zeros(len(UNBALANCED_PARAMETERS))
    parameters[: len(problem.parameters)], parameters[UNBALANCE] = problem.parameters, unbalance
    period_map = replace(problem.period_map, system=unbalanced_system(machine, MASSES))
    circle = PeriodCircle(period_map, parameters, "speed", STEPS, "rotation_phase", "speed")
    tori = TorusProblem(circle, problem.options, FourierOptions(tolerance=1e-8))
    count = tori.fourier.fewest
    guess = TorusUnknowns(np.tile(cycle.unknowns.state, (count, 1)), 0.0, SPEED)
    bases = constant_bases(cycle.basis, count)
    found = correct_torus(tori, guess, fixed_parameter(tori, count, SPEED), bases).torus
    assert found is not None
    return tori, found


def periods_in_time(machine: Machine, parameters: Vector, state: Vector, angle: float, count: int) -> Vector:
    """States after 1 to ``count`` excitation periods of a run that starts at a rotation angle, the rings at
    phase zero.  Its steps are half as long as those of the map.
    """
    period = 2.0 * np.pi / parameters[1]
    drive = make_drive(
        [0.0], [SPEED], count * period, Switching(parameters[2], parameters[2]), parameters[1], angle
    )
    driven = replace(driven_machine(machine, MASSES), recorded=slice(0, machine.size))
    plan = Plan.of(drive, period / (2 * STEPS), period, count, 1000)
    position = starting_position(driven, drive, parameters, state)
    samples = []
    while position.step < plan.steps:
        block = advance(driven, plan, position, parameters, np.full(driven.observed, -np.inf))
        assert block.status is Status.DONE
        samples.append(block.samples)
        position = block.end
    return np.concatenate(samples)


@pytest.mark.slow
def test_a_run_in_time_stays_on_the_torus_and_comes_back_to_it() -> None:
    """From the torus, 60 periods of the machine under its drive lie at the angles psi + n rho; from beside it
    the distance falls like the largest modulus.
    """
    machine, problem, cycle = balanced(0.2)
    tori, found = torus(machine, problem, cycle, 1.0)
    found, spectrum = converged_spectrum(tori, found)
    at, angle = found.unknowns, 0.7
    first = interpolated(at.states, np.array([angle]))[0]
    assert np.abs(at.states - cycle.unknowns.state).max() > 0.01, "the unbalance must be felt"
    count = 60
    there = interpolated(at.states, angle + at.rotation * np.arange(1, count + 1))
    parameters = problem.parameters
    on = periods_in_time(machine, parameters, first, angle, count)
    # the steps of the map leave 5e-8 in an image, the series less
    assert np.abs(on - there).max() < 1e-7
    beside = first.copy()
    beside[machine.rotor_start + machine.journal_freedoms[0]] += 1e-5
    apart = np.linalg.norm(periods_in_time(machine, parameters, beside, angle, count) - on, axis=1)
    assert spectrum.unstable == 0
    # a complex pair, above the next one by 1.1: the distance swings by 1.4 about its decay
    slope = np.polyfit(np.arange(10, count), np.log(apart[10:]), 1)[0]
    assert np.exp(slope) == pytest.approx(spectrum.moduli[0], rel=5e-3)


def waves(found: Torus) -> np.ndarray:
    """Mean, and the waves of e^(i psi), e^(2 i psi) as x = mean + Re(c e^(i psi)) + ..., shape (3, N)."""
    spectrum = np.fft.rfft(found.unknowns.states, axis=0) / found.count
    return spectrum[:3] * np.array([1.0, 2.0, 2.0])[:, None]


@pytest.mark.slow
def test_without_unbalance_it_is_the_cycle_and_a_small_one_acts_linearly() -> None:
    """x = s + U c e^(i psi) + O(U^2): the synchronous wave is linear, mean and second wave are quadratic."""
    machine, problem, cycle = balanced(0.2)
    still = torus(machine, problem, cycle, 0.0)[1]
    assert np.abs(still.unknowns.states - cycle.unknowns.state).max() < 1e-9
    small, twice = (waves(torus(machine, problem, cycle, factor)[1]) for factor in (0.05, 0.1))
    size = np.abs(small[1]).max()
    assert 1e-4 < size < 5e-3
    # the next term of the synchronous wave is of third order
    assert np.abs(twice[1] - 2.0 * small[1]).max() < size * size
    for order in (0, 2):
        own = [wave[order] - (cycle.unknowns.state if order == 0 else 0.0) for wave in (small, twice)]
        assert np.abs(own[1]).max() / np.abs(own[0]).max() == pytest.approx(4.0, rel=1e-3)


def test_at_rest_rings_give_the_linear_response_to_unbalance() -> None:
    """(i Omega - J) c = Omega^2 (A_c - i A_s) for the whole state, with the analytic Jacobian: the map over
    the period of rings that do not move only samples this motion.
    """
    machine, problem, cycle = balanced(0.0)
    push = unbalance_acceleration(machine, MASSES)
    force = np.zeros(machine.size, dtype=complex)
    force[-push.shape[1] :] = SPEED**2 * (push[0] - 1j * push[1])
    jacobian = machine.jacobian(0.0, cycle.unknowns.state, problem.parameters).toarray()
    expected = np.linalg.solve(1j * SPEED * np.eye(machine.size) - jacobian, force)
    size = np.abs(expected).max()
    assert size > 0.01
    errors = []
    for factor in (0.01, 0.05):
        found = waves(torus(machine, problem, cycle, factor)[1])[1] / factor
        errors.append(np.abs(found - expected).max() / size)
    # the next term is of third order; that of the steps is far smaller
    assert errors[0] < 1e-6
    assert errors[1] / errors[0] == pytest.approx(25.0, rel=0.2)
