"""The torus born at the Neimark-Sacker point of the machine, against simulation of the same machine."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.tori.fourier import interpolated
from pipelines.bifurcations.tori.problem import FourierOptions
from pipelines.bifurcations.tori.stability import converged_spectrum
from pipelines.bifurcations.tori.start import torus_from_event
from pipelines.machine.assembly import build_machine
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.cycles.problem import continuation_options, cycle_problem
from pipelines.stages.cycles.start import FirstCycle, resting_start
from tests.helpers.tiny import SHARP, tiny_case


@pytest.fixture(scope="module")
def instability() -> tuple[CycleProblem, Event]:
    """The reconstructed machine on the smallest grid (N = 88), excited at 0.7: unstable beyond 1.18."""
    case = tiny_case(SHARP, "continue_cycles.start=1.17", "continue_cycles.range=[1.15, 1.25]").case
    machine = build_machine(case)
    problem = cycle_problem(machine, case)
    first = resting_start(machine, problem)
    assert isinstance(first, FirstCycle)
    events: list[Event] = []
    continue_branch(
        problem,
        first.start,
        continuation_options(case, 1),
        lambda point, state, found: events.extend(found),
        should_stop=lambda: bool(events),
    )
    (event,) = events
    assert event.kind is EventKind.NEIMARK_SACKER
    return problem, event


@pytest.mark.slow
def test_born_torus_against_simulation(instability: tuple[CycleProblem, Event]) -> None:
    """Supercritical here: a stable torus above the critical speed.  Its weak multiplier is 1 - 2 alpha, its
    size grows like the square root of the distance, and 200 excitation periods of simulation, from a point of
    the curve, stay on it at the angles n rho.
    """
    problem, event = instability
    distances = []
    for amplitude in (0.01, 0.02):
        born = torus_from_event(problem, event, amplitude, FourierOptions(tolerance=1e-7))
        assert born is not None
        assert born.direction == 1
        assert born.correction.torus is not None
        torus, spectrum = converged_spectrum(born.problem, born.correction.torus)
        at = torus.unknowns
        distances.append(at.parameter - event.parameters[problem.index])
        assert spectrum.complete
        assert spectrum.unstable == 0
        # leading order: the next is relative to the distance from the point, 3e-4
        weak = 1.0 - spectrum.moduli[0]
        assert weak == pytest.approx(2.0 * event.transversality * distances[-1], rel=0.05)
        state, parameters = at.states[0], problem.parameters_at(at.parameter)
        period = problem.period_map.period(parameters)
        worst = 0.0
        for count in range(1, 201):
            state = problem.period_map.evaluate(state, parameters, period, event.steps).state
            there = interpolated(at.states, np.array([count * at.rotation]))[0]
            worst = max(worst, float(np.max(np.abs(state - there))))
        # the clipped film is not analytic: what few angles miss is larger than the tail of the series says,
        # and 200 turns add the error of the rotation up
        assert worst < 2e-6
        assert worst < 1e-4 * amplitude
    assert distances[1] / distances[0] == pytest.approx(4.0, rel=0.02)
