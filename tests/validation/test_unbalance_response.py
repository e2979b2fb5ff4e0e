"""Steady whirl of the whole machine under a small unbalance against the linear rotor on linear bearings.

The film's stiffness and damping at the whirl frequency are linearised at the equilibrium; the response of the
full machine to an unbalance so small that it stays linear must be that of the rotor on these bearings, in SI
units, with amplitude and phase at every master node.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.rotor_modes import LinearBearing, unbalance_response
from pipelines.machine.unbalance import UnbalanceMass
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import dynamic_stiffness
from pipelines.orbits.time_runs.drive import Switching, make_drive
from pipelines.orbits.time_runs.transient import Plan, Status, advance, starting_position
from pipelines.stages.transients.run import driven_machine
from tests.helpers.unbalanced_map import unbalanced_map
from tests.machines import BEARING, OTHER_BEARING, case, symmetric_rotor

SPEED = 0.7
MASSES = (UnbalanceMass(2, 1e-10, 0.4), UnbalanceMass(9, 2e-10, -1.0))  # kg m; node 9 is condensed out
TOLERANCE = 1e-3
SUPPORTS = [
    {"node": node, "stiffness_xx": 1e5, "stiffness_yy": 2e5, "damping_xx": 300.0, "damping_yy": 200.0}
    for node in (0, 14)
]


@pytest.fixture(scope="module", params=["flexible", "stiff_on_supports"])
def resting(request):
    """Machine, parameters and equilibrium, the rings at rest."""
    rotor = symmetric_rotor()
    if request.param == "stiff_on_supports":
        steel = {"young_modulus": 206e10, "poisson_ratio": 0.3, "density": 7850.0}
        rotor = symmetric_rotor(materials={"steel": steel}, supports=SUPPORTS, rayleigh_stiffness=2.43e-6)
    description = case((16, 1), displacement=0.0, speed=SPEED, bearings=(BEARING, OTHER_BEARING), rotor=rotor)
    machine, parameters = build_machine(description), parameter_vector(description)
    found = machine_equilibrium(machine, parameters)
    assert found.converged
    return machine, parameters, found.state


def predicted(machine, parameters, state) -> np.ndarray:
    """Complex displacements of the masters over clearance, x(tau) = Re(X exp(i Omega tau))."""
    scales = machine.scales
    bearings = []
    for index, bearing in enumerate(machine.bearings):
        own = scales.bearings[index]
        position = machine.journal(state, index)[:2]
        z = dynamic_stiffness(
            bearing, state[machine.film_unknowns(index)], position, parameters, np.array([1j * SPEED])
        )[0]
        z = z * own.force / (own.clearance_ratio * scales.displacement)
        node = machine.condensed.masters[machine.journal_freedoms[index] // 2]
        bearings.append(LinearBearing(node, z.real, z.imag * scales.time / SPEED))
    unbalance = {mass.node: mass.moment * np.exp(1j * mass.phase) for mass in MASSES}
    response = unbalance_response(machine.condensed, np.array([SPEED / scales.time]), unbalance, bearings)[0]
    return response[list(machine.condensed.masters)].ravel() / scales.displacement


def test_the_run_settles_on_the_linear_response(resting):
    """From the equilibrium, until free vibrations have died; the last rotation, Fourier analysed."""
    machine, parameters, state = resting
    expected = predicted(machine, parameters, state)
    assert 1e-7 < np.abs(expected).max() < 1e-3
    turns, per_turn = 400, 64
    period = 2.0 * np.pi / SPEED
    drive = make_drive([0.0], [SPEED], turns * period, Switching(0.0, 0.0), parameters[1])
    driven = driven_machine(machine, MASSES)
    plan = Plan.of(drive, period / 32, period / per_turn, 4 * per_turn, 1000)
    position = starting_position(driven, drive, parameters, state)
    while position.step < plan.steps:
        block = advance(driven, plan, position, parameters, np.full(driven.observed, -np.inf))
        assert block.status is Status.DONE
        position = block.end
    last = block.samples[-per_turn:] - machine.masters(state)
    angle = 2.0 * np.pi * np.arange(1, per_turn + 1) / per_turn
    found = 2.0 * np.mean(last * np.exp(-1j * angle)[:, None], axis=0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE * np.abs(expected).max())


def test_the_fixed_point_of_the_map_is_the_linear_response(resting):
    """With the rings' frequency set to the speed, the map over a turn has a fixed point: Newton's method with
    the map's own derivatives finds it, for any rotation angle at the start.
    """
    machine, parameters, state = resting
    expected = predicted(machine, parameters, state)
    synchronous = parameters.copy()
    synchronous[1] = SPEED
    turn, angle = unbalanced_map(machine, MASSES, synchronous, 48), 0.9
    found = state.copy()
    for _ in range(3):
        image = turn.evaluate(found, angle, np.eye(machine.size))
        found = found + np.linalg.solve(np.eye(machine.size) - image.columns, image.state - found)
    wanted = np.real(expected * np.exp(1j * angle))
    moved = machine.masters(found) - machine.masters(state)
    np.testing.assert_allclose(moved, wanted, rtol=0.0, atol=TOLERANCE * np.abs(expected).max())
    # the response turns with the start angle: dx/dpsi = (I - dP/dx)^-1 dP/dpsi
    turned = np.linalg.solve(np.eye(machine.size) - image.columns, image.by_angle)
    wanted = np.real(1j * expected * np.exp(1j * angle))
    np.testing.assert_allclose(
        machine.masters(turned), wanted, rtol=0.0, atol=TOLERANCE * np.abs(expected).max()
    )
