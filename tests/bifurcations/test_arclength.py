"""The continuation loop: ends of branches, closed curves, restart to the bit, every way to stop."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import (
    BranchPoint,
    BranchResult,
    BranchStart,
    BranchState,
    BranchStop,
    ContinuationOptions,
)
from pipelines.bifurcations.continuation import extrapolated
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions, Unknowns
from pipelines.orbits.steppers import BUTCHER6, DOPRI8, RK4
from pipelines.orbits.system import ode_system
from tests.orbits.cluster_system import cluster_system
from tests.systems import duffing, hopf_pair, tondl

Row = tuple[BranchPoint, BranchState, tuple[Event, ...]]


def run(
    problem: CycleProblem, start, options: ContinuationOptions, **callbacks
) -> tuple[BranchResult, list[Row]]:  # type: ignore[no-untyped-def]
    rows: list[Row] = []
    result = continue_branch(problem, start, options, lambda *row: rows.append(row), **callbacks)
    return result, rows


def duffing_problem(**options: float) -> CycleProblem:
    return CycleProblem(
        PeriodMap(duffing(), DOPRI8), np.array([0.5, 0.3]), "omega", ShootingOptions(**options)
    )  # type: ignore[arg-type]


START = BranchStart(np.array([0.3, 0.0]), 0.5)


def test_range_is_hit_exactly_in_both_directions() -> None:
    for direction, end in ((1, 0.75), (-1, 0.4)):
        options = ContinuationOptions((0.4, 0.75), direction=direction)
        result, rows = run(duffing_problem(), START, options)
        assert result.stop is BranchStop.RANGE
        assert rows[-1][1].parameter == end
        assert rows[-1][0].cycle.residual <= 1e-10
        assert [row[1].index for row in rows] == list(range(len(rows)))
        parameters = [row[1].parameter for row in rows]
        assert parameters == sorted(parameters, reverse=direction < 0)
        # a finished branch has nothing more to do
        again, more = run(duffing_problem(), result.state, options)
        assert again.stop is BranchStop.RANGE
        assert more == []


def test_points_lie_on_the_branch_at_the_asked_distance() -> None:
    """Steps follow the Newton count between the bounds, and every point solves the periodicity condition."""
    options = ContinuationOptions((0.4, 2.0), step=0.01, maximum_step=0.08, max_points=60)
    _, rows = run(duffing_problem(tolerance=1e-12), START, options)
    lengths = np.diff([row[1].arclength for row in rows])
    assert np.all(lengths <= 0.08 * 1.02)
    assert lengths[0] == pytest.approx(0.01, rel=0.05)
    assert np.max(lengths) > 0.04
    assert all(row[0].cycle.residual <= 1e-12 for row in rows)
    for _, state, _ in rows:
        norm = float(np.mean(state.tangent_state**2)) + state.tangent_parameter**2
        assert norm == pytest.approx(1.0, abs=1e-12)


def test_any_parameter_can_be_continued() -> None:
    problem = CycleProblem(PeriodMap(tondl(), BUTCHER6), np.array([0.03, 1.3]), "eta")
    result, rows = run(
        problem, BranchStart(np.array([0.33, 0.05, 0, 0]), 1.3), ContinuationOptions((1.3, 1.5))
    )
    assert result.stop is BranchStop.RANGE
    for point, state, _ in rows:
        assert state.period == pytest.approx(2.0 * math.pi / state.parameter, rel=1e-15)
        assert point.cycle.parameters[0] == 0.03


def isola() -> CycleProblem:
    """s' = 0.4 (1 - s^2 - level^2) + 0.1 cos(phase): the averaged cycles form the circle s^2 + level^2 ~
    1.
    """
    system = ode_system(
        lambda phase, s, p: [0.4 * (1.0 - s[0] ** 2 - p[1] ** 2) + 0.1 * math.cos(phase)],
        lambda phase, s, p: [[-0.8 * s[0]]],
        1,
        ("omega", "level"),
        "omega",
    )
    return CycleProblem(
        PeriodMap(system, DOPRI8, samples=16, minimum_steps=16), np.array([4.0, 0.0]), "level"
    )


@pytest.mark.parametrize("direction", [1, -1])
def test_closed_curve_is_recognised(direction: int) -> None:
    options = ContinuationOptions(
        (-2.0, 2.0), direction=direction, step=0.1, maximum_step=0.1, max_points=300
    )
    result, rows = run(isola(), BranchStart(np.array([1.0]), 0.0), options)
    assert result.stop is BranchStop.CLOSED
    events = [event for row in rows for event in row[2]]
    assert [event.kind for event in events] == [EventKind.FOLD, EventKind.FOLD]
    assert events[0].parameters[1] == pytest.approx(-events[1].parameters[1], abs=1e-7)
    # the last point is the first again, so the chords go round once: the averaged circle is 0.2 % too small
    assert np.allclose(rows[-1][1].state, rows[0][1].state, rtol=0, atol=1e-9)
    assert rows[-1][1].parameter == pytest.approx(0.0, abs=1e-9)
    assert rows[-1][1].arclength == pytest.approx(2.0 * math.pi, rel=0.005)
    # a loop followed from the middle of itself through a restart closes at the same point
    middle = rows[len(rows) // 2][1]
    restarted, rest = run(isola(), BranchState.from_arrays(middle.arrays()), options)
    assert restarted.stop is BranchStop.CLOSED
    assert rest[-1][1].index == rows[-1][1].index


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.02, 0.07, 0.1])
@pytest.mark.parametrize("level", [0.0, 0.6, -0.95])
def test_closed_curve_stays_closed_after_a_restart(step: float, level: float) -> None:
    """The last state alone tells that the branch is complete, wherever it began; the state before it does
    not.
    """
    options = ContinuationOptions((-2.0, 2.0), step=step, maximum_step=0.1, max_points=300)
    result, rows = run(isola(), BranchStart(np.array([math.sqrt(1.0 - level**2)]), level), options)
    assert result.stop is BranchStop.CLOSED
    lengths = np.diff([row[1].arclength for row in rows])
    assert 0.04 * lengths[-2] < lengths[-1] < 1.06 * lengths[-2]
    again, more = run(isola(), BranchState.from_arrays(rows[-1][1].arrays()), options)
    assert again.stop is BranchStop.CLOSED
    assert more == []
    last, one = run(isola(), BranchState.from_arrays(rows[-2][1].arrays()), options)
    assert last.stop is BranchStop.CLOSED
    assert [row[1].index for row in one] == [rows[-1][1].index]


def test_first_step_onto_a_near_end_of_the_range_is_no_closed_curve() -> None:
    """The last point is within the tolerance of the first without having left it."""
    first = run(duffing_problem(), START, ContinuationOptions((0.4, 2.0), max_points=1))[1][0][1]
    start = BranchStart(first.state, 0.5)
    result, rows = run(duffing_problem(), start, ContinuationOptions((0.4, 0.5 + 1e-7), step=0.05))
    assert result.stop is BranchStop.RANGE
    assert len(rows) == 2


def cluster_problem() -> CycleProblem:
    options = ShootingOptions(basis=BasisOptions(initial_columns=16))
    period_map = PeriodMap(cluster_system(), RK4, minimum_steps=64, samples=32)
    return CycleProblem(period_map, np.array([2.0, 0.5, 1.0]), "load", options)


def tondl_extended() -> CycleProblem:
    period_map = PeriodMap(tondl(), BUTCHER6, Formulation.AUTONOMOUS)
    return CycleProblem(period_map, np.array([0.0, 1.45]), "c1")


RESTARTED = {
    "slow basis": (cluster_problem, BranchStart(np.zeros(90), 0.5), (0.5, 20.0), 5),
    "events": (duffing_problem, START, (0.4, 2.5), 60),
    "unknown period": (
        tondl_extended,
        BranchStart(np.array([0.33, 0.05, 0, 0, 0, 1.0]), 0.0, 2 * math.pi / 1.45),
        (0.0, 0.6),
        5,
    ),
}


def bits(row: Row) -> bytes:
    point, state, events = row
    cycle = point.cycle
    return pickle.dumps(
        [
            {name: np.asarray(value).tobytes() for name, value in state.arrays().items()},
            cycle.spectrum.multipliers.tobytes(),
            cycle.spectrum.residuals.tobytes(),
            cycle.image.orbit.tobytes(),
            point.residual_norms,
            point.update_norms,
            point.unstable,
            [
                (e.kind, e.state.tobytes(), e.parameters.tobytes(), e.multipliers.tobytes(), e.transversality)
                for e in events
            ],
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", list(RESTARTED))
def test_restart_from_copied_arrays_gives_the_same_bits(name: str) -> None:
    """Twice n points in one go; n points, a new state from copied arrays in another memory order, n more."""
    make, start, interval, half = RESTARTED[name]
    options = ContinuationOptions(interval, step=0.02, maximum_step=0.05, max_points=2 * half)
    _, whole = run(make(), start, options)
    first, rows = run(make(), start, replace(options, max_points=half))
    assert first.stop is BranchStop.MAXIMUM_POINTS
    assert first.state is not None
    copied = {
        key: np.array(value, order="F") if np.ndim(value) else np.float64(value)
        for key, value in first.state.arrays().items()
    }
    _, rest = run(make(), BranchState.from_arrays(copied), options)
    assert len(whole) == 2 * half == len(rows) + len(rest)
    for left, right in zip(whole, rows + rest, strict=True):
        assert bits(left) == bits(right)
    if name == "events":
        assert any(row[2] for row in rest)


def test_limit_ends_the_branch_before_the_forbidden_point() -> None:
    def limit(point: BranchPoint) -> str | None:
        return "too wide" if np.max(point.cycle.image.orbit[:, 0]) > 0.6 else None

    result, rows = run(duffing_problem(), START, ContinuationOptions((0.4, 2.0)), limit=limit)
    assert (result.stop, result.message) == (BranchStop.LIMIT, "too wide")
    assert 0.5 < max(np.max(row[0].cycle.image.orbit[:, 0]) for row in rows) <= 0.6
    first, none = run(
        duffing_problem(), START, ContinuationOptions((0.4, 2.0)), limit=lambda point: "never allowed"
    )
    assert first.stop is BranchStop.LIMIT
    assert none == []


def test_interruption_comes_after_a_complete_point_and_resumes() -> None:
    options = ContinuationOptions((0.4, 0.75))
    rows: list[Row] = []
    result = continue_branch(
        duffing_problem(), START, options, lambda *row: rows.append(row), should_stop=lambda: len(rows) == 3
    )
    assert result.stop is BranchStop.INTERRUPTED
    assert len(rows) == 3
    assert result.state is not None
    after, rest = run(duffing_problem(), result.state, options)
    assert after.stop is BranchStop.RANGE
    assert rest[0][1].index == 3


def test_failures_are_results_with_advice() -> None:
    nowhere, rows = run(isola(), BranchStart(np.array([0.5]), 1.5), ContinuationOptions((-2.0, 2.0)))
    assert nowhere.stop is BranchStop.START_FAILED
    assert rows == []
    assert nowhere.state is None
    assert nowhere.message
    # one Newton iteration is not enough for any step that matters
    strict = duffing_problem(tolerance=1e-13, iterations=3)
    options = ContinuationOptions(
        (0.5, 2.0), step=0.5, minimum_step=0.4, maximum_step=0.5, minimum_cosine=-1.0
    )
    good = run(duffing_problem(), START, replace(options, step=0.4, max_points=1))[0].state
    stuck, _ = run(strict, good, options)
    assert stuck.stop is BranchStop.MINIMUM_STEP
    assert stuck.message
    assert all(stop.advice for stop in BranchStop)


def test_steps_per_period_grow_with_stiffness_and_only_then() -> None:
    """The relaxing state's rate is the continued parameter; RK4 must stay inside its stability interval."""
    system = ode_system(
        lambda phase, s, p: [s[1], -s[0] - 0.3 * s[1] + math.cos(phase), -p[1] * (s[2] - s[0])],
        lambda phase, s, p: [[0, 1, 0], [-1, -0.3, 0], [p[1], 0, -p[1]]],
        3,
        ("omega", "rate"),
        "omega",
    )
    problem = CycleProblem(
        PeriodMap(system, RK4, samples=16, minimum_steps=16), np.array([1.5, 10.0]), "rate"
    )
    options = ContinuationOptions((10.0, 60.0), step=2.0, maximum_step=4.0, parameter_scale=1.0)
    result, rows = run(problem, BranchStart(np.zeros(3), 10.0), options)
    assert result.stop is BranchStop.RANGE
    steps = [row[1].steps for row in rows]
    assert steps == sorted(steps)
    assert steps[-1] > steps[0]
    assert len(set(steps)) < len(steps)
    for (_, former, _), (point, state, _) in itertools.pairwise(rows):
        # a point corrected twice, before and after its steps grew, shows both histories
        assert len(point.residual_norms) == point.iterations + (2 if state.steps > former.steps else 1)
    for _, state, _ in rows:
        assert state.parameter * state.period / state.steps < RK4.real_stability_interval


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match="range is"):
        ContinuationOptions((1.0, 0.0))
    with pytest.raises(ValueError, match="direction is 2"):
        ContinuationOptions((0.0, 1.0), direction=2)
    with pytest.raises(ValueError, match="minimum_step"):
        ContinuationOptions((0.0, 1.0), step=0.1, maximum_step=0.05)
    with pytest.raises(ValueError, match="lies outside the range"):
        run(duffing_problem(), START, ContinuationOptions((0.6, 1.0)))
    with pytest.raises(ValueError, match="parameter_scale is 0"):
        ContinuationOptions((0.0, 1.0), parameter_scale=0.0)


def test_autonomous_branch_keeps_its_phase_condition() -> None:
    """The Hopf cycle grows as sqrt(mu): radius, period and phase-free multipliers stay exact along the
    branch.
    """
    period_map = PeriodMap(hopf_pair(), DOPRI8, Formulation.AUTONOMOUS)
    problem = CycleProblem(period_map, np.array([0.1, 0.5]), "mu", ShootingOptions(tolerance=1e-12))
    start = BranchStart(np.array([math.sqrt(0.1), 0.0, 0.1, 0.1]), 0.1, 2.0 * math.pi / 1.05)
    result, rows = run(problem, start, ContinuationOptions((0.05, 0.6), maximum_step=0.1, step=0.05))
    assert result.stop is BranchStop.RANGE
    for _, state, events in rows:
        assert events == ()
        assert float(state.state[:2] @ state.state[:2]) == pytest.approx(state.parameter, abs=1e-10)
        assert state.period == pytest.approx(2.0 * math.pi / (1.0 + 0.5 * state.parameter), abs=1e-9)


def test_the_prediction_is_of_fourth_order() -> None:
    """On a circle of radius one, with steps of equal and of different lengths."""

    def at(angle: float) -> tuple[Unknowns, Unknowns]:
        state = np.array([math.cos(angle), math.sin(angle)])
        return Unknowns(state, 0.0, 0.0), Unknowns(np.array([-state[1], state[0]]), 0.0, 0.0)

    for longer in (1.0, 2.0, 0.5):
        errors = [
            float(np.linalg.norm(extrapolated(at(-h), at(0.0), h, longer * h).minus(at(longer * h)[0]).state))
            for h in (0.1, 0.05)
        ]
        assert math.log2(errors[0] / errors[1]) > 3.8
    here = at(0.3)
    assert np.array_equal(extrapolated(here, here, 0.0, 0.1).state, here[0].plus(here[1], 0.1).state)
