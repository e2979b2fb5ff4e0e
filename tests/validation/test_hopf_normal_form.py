"""A cycle known in closed form: Hopf normal form beside a driven linear pair, followed from the Hopf point.

abs(z)^2 = mu, T = 2 pi/(1 + b mu); multipliers 1, exp(-2 mu T), exp((decay +- i frequency) T).
"""

from __future__ import annotations

import math

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.hopf_start import start_at_hopf
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import ode_system
from tests.systems import closed_form_hopf_multipliers, hopf_pair

DECAY, FREQUENCY, DRIVE, SHIFT = -0.1, 0.4, 0.3, 0.5


def test_branch_from_the_hopf_point() -> None:
    """Every point to 1e-9 and every multiplier to 1e-8, from the Hopf point to mu = 1; no event on the
    way.
    """
    period_map = PeriodMap(hopf_pair(DECAY, FREQUENCY, DRIVE), DOPRI8, Formulation.AUTONOMOUS)
    problem = CycleProblem(period_map, np.array([0.0, SHIFT]), "mu", ShootingOptions(tolerance=1e-12))
    pair = np.array([[DECAY - 1j, -FREQUENCY], [FREQUENCY, DECAY - 1j]])
    eigenvector = np.concatenate([[1.0, -1j], np.linalg.solve(pair, [-DRIVE, 0.0])])
    cycle = start_at_hopf(problem, np.zeros(4), eigenvector, 1.0, 0.0, 0.05).cycle
    assert cycle is not None
    start = BranchStart(cycle.unknowns.state, cycle.unknowns.parameter, cycle.unknowns.period)
    rows = []
    options = ContinuationOptions((0.0, 1.0), maximum_step=0.15)
    result = continue_branch(problem, start, options, lambda *row: rows.append(row))
    assert result.stop is BranchStop.RANGE
    for point, state, events in rows:
        assert events == ()
        assert abs(float(state.state[:2] @ state.state[:2]) - state.parameter) < 1e-9
        assert abs(state.period - 2.0 * math.pi / (1.0 + SHIFT * state.parameter)) < 1e-9
        expected = closed_form_hopf_multipliers(state.parameter, SHIFT, DECAY, FREQUENCY)
        for multiplier in expected:
            assert np.min(np.abs(point.cycle.spectrum.multipliers - multiplier)) < 1e-8


def test_torus_bifurcation_of_an_autonomous_cycle() -> None:
    """The pair's decay is the continued parameter of a plain Python system: Neimark-Sacker at zero decay with
    theta = frequency T modulo 2 pi and d abs(mu)/d decay = T; the trivial multiplier is never counted.
    """

    def rates(phase, s, p):  # type: ignore[no-untyped-def]
        radius = s[0] ** 2 + s[1] ** 2
        return [
            (0.25 - radius) * s[0] - s[1],
            (0.25 - radius) * s[1] + s[0],
            p[0] * s[2] - FREQUENCY * s[3],
            FREQUENCY * s[2] + p[0] * s[3],
        ]

    def jacobian(phase, s, p):  # type: ignore[no-untyped-def]
        x, y = s[0], s[1]
        return [
            [0.25 - 3 * x * x - y * y, -2 * x * y - 1, 0, 0],
            [1 - 2 * x * y, 0.25 - x * x - 3 * y * y, 0, 0],
            [0, 0, p[0], -FREQUENCY],
            [0, 0, FREQUENCY, p[0]],
        ]

    system = ode_system(rates, jacobian, 4, ("decay",))
    period_map = PeriodMap(system, DOPRI8, Formulation.AUTONOMOUS, samples=32, minimum_steps=64)
    problem = CycleProblem(period_map, np.array([0.0]), "decay", ShootingOptions(tolerance=1e-12))
    rows = []
    result = continue_branch(
        problem,
        BranchStart(np.array([0.5, 0.0, 0.0, 0.0]), -0.055, 6.3),
        ContinuationOptions((-0.055, 0.05), step=0.05),
        lambda *row: rows.append(row),
    )
    assert result.stop is BranchStop.RANGE
    (event,) = [event for row in rows for event in row[2]]
    assert event.kind is EventKind.NEIMARK_SACKER
    assert abs(event.parameters[0]) < 1e-9
    assert abs(event.period - 2.0 * math.pi) < 1e-9
    assert abs(event.angle - abs(math.remainder(FREQUENCY * 2.0 * math.pi, 2.0 * math.pi))) < 1e-8
    assert abs(event.transversality - 2.0 * math.pi) < 1e-3
    assert (rows[0][0].unstable, rows[-1][0].unstable) == (0, 2)
