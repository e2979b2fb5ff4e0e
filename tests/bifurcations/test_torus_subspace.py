"""Tori of a system whose directions mostly contract strongly: few columns must do what all of them do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, ContinuationOptions
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.bifurcations.tori.fourier import angles, interpolated
from pipelines.bifurcations.tori.slow_bases import SlowBases, aligned_frames, constant_bases, leading_columns
from pipelines.bifurcations.tori.stability import converged_spectrum, torus_spectrum
from pipelines.bifurcations.tori.start import torus_from_event
from pipelines.bifurcations.tori.torus import TorusOptions, TorusState, TorusStop
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import ESDIRK5
from tests.benchmarks.brusselator import chain
from tests.bifurcations.torus_runs import trace_torus

FREQUENCY, STEPS = 2.6, 48
SLOW = BasisOptions(multiplier_cut=1e-2, buffer=2, initial_columns=12)


def chain_problem(cells: int) -> tuple[CycleProblem, Event]:
    """The forced Brusselator chain with its Neimark-Sacker point between B = 5.4 and 5.7."""
    period_map = PeriodMap(chain(cells), ESDIRK5, samples=16, steps_per_period=STEPS)
    options = ShootingOptions(tolerance=1e-11, picard_tolerance=1e-2, checked_modulus=0.3, basis=SLOW)
    problem = CycleProblem(period_map, np.array([5.4, FREQUENCY]), "B", options)
    events: list[Event] = []
    step = 0.02 * np.sqrt(cells)
    continue_branch(
        problem,
        BranchStart(np.tile([2.0, 2.7], cells), 5.4),
        ContinuationOptions((5.4, 5.7), step=step, maximum_step=step),
        lambda point, state, found: events.extend(found),
    )
    (event,) = (found for found in events if found.kind is EventKind.NEIMARK_SACKER)
    return problem, event


@pytest.fixture(scope="module")
def short_chain() -> tuple[CycleProblem, Event]:
    return chain_problem(20)


def test_few_columns_and_all_of_them(short_chain: tuple[CycleProblem, Event]) -> None:
    """12 of 40 columns give the same torus and multipliers as Newton's method with the whole matrices."""
    problem, event = short_chain
    whole = replace(problem, options=replace(problem.options, basis=BasisOptions(initial_columns=40)))
    few, all_of_them = (torus_from_event(one, event, 0.1) for one in (problem, whole))
    assert few is not None
    assert all_of_them is not None
    slow, full = few.correction.torus, all_of_them.correction.torus
    assert slow is not None
    assert full is not None
    assert slow.bases.columns.shape[2] == 12
    assert full.bases.whole
    # both are within the tolerance of Newton's method, over the smallest |1 - mu| of about 1e-3
    assert np.max(np.abs(slow.unknowns.states - full.unknowns.states)) < 1e-8
    assert slow.unknowns.parameter == pytest.approx(full.unknowns.parameter, abs=1e-9)
    assert slow.unknowns.rotation == pytest.approx(full.unknowns.rotation, abs=1e-9)
    settled, found = converged_spectrum(few.problem, slow)
    exact = torus_spectrum(all_of_them.problem, full)
    assert found.complete
    # 0.9959, then pairs: residuals of 1e-5 leave less than that
    assert found.moduli[:3] == pytest.approx(exact.moduli[:3], abs=1e-5)
    assert settled.bases.leading < 12
    # the linearisation is exact up to the Picard part: superlinear, four iterations from 2e-3 to 1e-11
    assert few.correction.iterations <= 5


def test_branch_against_simulation(short_chain: tuple[CycleProblem, Event]) -> None:
    """From the Neimark-Sacker point on; 200 periods of simulation stay on the last torus."""
    problem, event = short_chain
    born = torus_from_event(problem, event, 0.1)
    assert born is not None
    assert born.direction == 1
    options = TorusOptions((5.0, 6.0), step=0.02, maximum_step=0.02, max_points=3)
    run = trace_torus(born.problem, born.start, options)
    assert run.result.stop is TorusStop.MAXIMUM_POINTS
    # moving bases and all: from a copy of the first state the same bits follow
    again = trace_torus(born.problem, TorusState.from_arrays(run.states[0].arrays()), options)
    assert len(again.states) == 2
    for mine, theirs in zip(again.states, run.states[1:], strict=True):
        for name, value in mine.arrays().items():
            assert np.asarray(value).tobytes() == np.asarray(theirs.arrays()[name]).tobytes(), name
    assert run.states[0].leading < run.states[0].bases.shape[2] < run.states[0].bases.shape[1]
    at = run.points[-1].torus.unknowns
    # to leading order in the distance from the Neimark-Sacker point, up to 0.01 here
    for point in run.points:
        expected = 2.0 * event.transversality * (point.torus.unknowns.parameter - event.parameters[0])
        assert 1.0 - point.spectrum.moduli[0] == pytest.approx(expected, rel=0.15)
        assert point.stable
    state, period = at.states[0], problem.period_map.period(event.parameters)
    parameters = problem.parameters_at(at.parameter)
    worst = 0.0
    for count in range(1, 201):
        state = problem.period_map.evaluate(state, parameters, period, event.steps).state
        there = interpolated(at.states, np.array([count * at.rotation]))[0]
        worst = max(worst, float(np.max(np.abs(state - there))))
    # the Fourier error below 1e-8, summed by a multiplier of about 0.99 and 200 steps of rotation
    assert worst < 2e-6


def test_longer_chain_needs_no_more_columns() -> None:
    """N = 100: the same 12 columns."""
    problem, event = chain_problem(50)
    born = torus_from_event(problem, event, 0.1)
    assert born is not None
    torus = born.correction.torus
    assert torus is not None
    assert torus.bases.columns.shape == (15, 100, 12)
    assert torus.residual <= problem.options.tolerance
    _, spectrum = converged_spectrum(born.problem, torus)
    growth = event.transversality * (torus.unknowns.parameter - event.parameters[0])
    assert spectrum.moduli[0] == pytest.approx(1.0 - 2.0 * growth, abs=1e-4)


def test_leading_block_ends_at_a_gap() -> None:
    moduli = np.array([1.0, 0.9, 0.5, 0.49, 0.48, 0.47, 0.46, 0.45, 0.02, 0.019])
    assert leading_columns(moduli, 0.95) == 2  # 0.45/0.02 is too far away
    assert leading_columns(moduli, 0.7) == 2
    assert leading_columns(moduli, 0.4) == 8
    assert leading_columns(0.9 ** np.arange(12), 0.5) == 12  # no gap


def test_aligned_frames_are_smooth_and_nested() -> None:
    """Frames of a turning plane, given by columns that rotate arbitrarily at every angle: aligned with a
    constant plane their wave numbers fall, and they span the same planes.
    """
    at = angles(31)
    plane = np.stack(
        [
            np.stack([np.cos(0.4 * np.cos(at)), np.sin(0.4 * np.cos(at)), 0.0 * at, 0.0 * at], axis=1),
            np.stack([0.0 * at, 0.0 * at, np.cos(0.3 * np.sin(at)), np.sin(0.3 * np.sin(at))], axis=1),
        ],
        axis=2,
    )
    generator = np.random.default_rng(3)
    turn = generator.normal(size=(31, 2, 2)) + 2.0 * np.eye(2)
    rough = np.concatenate([plane @ turn, generator.normal(size=(31, 4, 1))], axis=2)
    old = constant_bases(np.eye(4)[:, [0, 2, 1]], 31).columns
    found = SlowBases(aligned_frames(rough, old, 2), 2)
    smooth = found.columns[:, :, :2]
    assert np.max(np.abs(np.swapaxes(found.columns, 1, 2) @ found.columns - np.eye(3))) < 1e-13
    assert np.max(np.abs(smooth @ (np.swapaxes(smooth, 1, 2) @ plane) - plane)) < 1e-13
    waves = np.abs(np.fft.rfft(smooth, axis=0)).max(axis=(1, 2)) / 31
    assert waves[12:].max() < 1e-8
