"""Times of the period map, of cycle corrections and of branch points.

All on the reconstructed machine with its rings moving.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchState
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.case.models import Case
from pipelines.machine.assembly import build_machine
from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.period_map import PeriodImage, PeriodMap
from pipelines.orbits.shooting import (
    Cycle,
    CycleProblem,
    Unknowns,
    correct,
    first_basis,
    following_basis,
    tangent_at,
)
from pipelines.orbits.time_steps import first_steps, required_steps
from pipelines.stages.cycles.problem import continuation_options, cycle_problem
from pipelines.stages.cycles.start import FirstCycle, resting_start
from tests.benchmarks.measuring import Action, Measurement, growth_exponent, interleaved
from tests.benchmarks.settings import SCHEME, Grid, Settings
from tests.machines import case

Array = NDArray[np.float64]

SWEPT_COLUMNS = 5  # of a Picard sweep
SLOW_COLUMNS = 14  # of a slow subspace
APART = 1e-6  # of the state: two passes of one correction
SPEED = 1.1  # the cycle is stable, with the Neimark-Sacker point ahead
NEXT_SPEED = 1.12


@dataclass(frozen=True)
class Start:
    """A machine on one grid, ready for its first cycle."""

    description: Case
    problem: CycleProblem
    guess: Unknowns
    steps: int

    def cycle(self) -> Cycle:
        """The cycle at ``SPEED`` with as many steps as its multipliers ask for."""
        steps, basis = self.steps, first_basis(self.problem, self.guess, self.steps)
        while True:
            found = correct(self.problem, self.guess, self.problem.fixed_parameter(SPEED), basis, steps).cycle
            assert found is not None
            wanted = required_steps(self.problem, found).steps
            if wanted <= steps:
                return found
            steps, basis = self.problem.period_map.rounded_steps(wanted), found.basis


def prepared(grid: Grid, stepper: str = "esdirk5") -> Start:
    """The machine at ``SPEED`` with the equilibrium in the mean ring as guess of its cycle."""
    numerics = {"scheme": SCHEME, "stepper": stepper}
    description = case(grid, speed=SPEED, continue_cycles={"range": (1.0, 1.6)}, numerics=numerics)
    machine = build_machine(description)
    problem = cycle_problem(machine, description)
    found = resting_start(machine, problem)
    assert isinstance(found, FirstCycle), found.reason
    guess = problem.consistent(Unknowns(found.start.state, 0.0, SPEED))
    return Start(description, problem, guess, first_steps(problem, guess))


def tangent_batch(settings: Settings) -> list[Measurement]:
    """Orbit with tangent columns against the orbit alone, default stepper and RK4."""
    grid = _name(settings.default_grid)
    columns = f"orbit + {settings.columns} tangent columns"
    found: list[Measurement] = []
    for stepper, suffix in (("esdirk5", ""), ("rk4", "_rk4")):
        start = prepared(settings.default_grid, stepper)
        cycle, period_map = start.cycle(), start.problem.period_map
        block = deterministic_block(period_map.size, settings.columns)

        def run(block: Array | None, cycle: Cycle = cycle, period_map: PeriodMap = period_map) -> PeriodImage:
            at = cycle.unknowns
            return period_map.evaluate(at.state, cycle.parameters, at.period, cycle.steps, block)

        pair = interleaved(
            lambda run=run, block=block: run(block), lambda run=run: run(None), settings.tangent_pairs
        )
        what = f"{stepper}, {cycle.steps} steps, {grid}"
        found += [
            Measurement(f"tangent_batch_ratio{suffix}", pair.ratio, "1", f"{columns} / orbit alone, {what}"),
            Measurement(f"period_map{suffix}", 1e3 * pair.second, "ms", f"informative: orbit alone, {what}"),
            Measurement(f"period_map_columns{suffix}", 1e3 * pair.first, "ms", f"informative: {columns}"),
        ]  # fmt: skip
    return found


def further_columns(settings: Settings) -> list[Measurement]:
    """A pass with columns against a further one through the same orbit, with the factors that it kept."""
    start = prepared(settings.default_grid)
    cycle, period_map = start.cycle(), start.problem.period_map
    block = deterministic_block(period_map.size, SWEPT_COLUMNS)

    def first() -> PeriodImage:
        return period_map.evaluate(*cycle.image.start, block)

    kept = period_map.evaluate(*cycle.image.start, block, keep_factors=True)

    def further() -> PeriodImage:
        return period_map.with_columns(kept, block)

    assert np.array_equal(kept.columns, further().columns)
    pair = interleaved(first, further, settings.tangent_pairs)
    told = f"orbit + {SWEPT_COLUMNS} columns / the columns with its factors, {_name(settings.default_grid)}"
    return [Measurement("further_columns_ratio", pair.ratio, "1", told)]


def shared_work(settings: Settings) -> list[Measurement]:
    """What equal bearings share, and what a pass takes over from one of an orbit beside it."""
    start = prepared(settings.default_grid)
    cycle, period_map = start.cycle(), start.problem.period_map
    block, at = deterministic_block(period_map.size, SLOW_COLUMNS), cycle.image.start
    beside = at._replace(state=at.state * (1.0 + APART))
    neighbour = period_map.evaluate(*beside, block, keep_factors=True)
    constants = period_map.system.constants.copy()
    constants[0] = np.nextafter(constants[0], 2.0)  # the clearance of one bearing in its last digit
    apart = replace(period_map, system=replace(period_map.system, constants=constants))
    told = f"orbit + {SLOW_COLUMNS} columns, {_name(settings.default_grid)}"
    found: list[Measurement] = []
    for name, first, second, what in (
        ("twin_bearings_ratio", apart, None, "bearings that differ in one bit / equal bearings"),
        ("nearby_pass_ratio", period_map, neighbour, f"alone / after a pass beside it, {APART:g} apart"),
    ):
        pair = interleaved(
            lambda first=first: first.evaluate(*at, block),
            lambda second=second: period_map.evaluate(*at, block, near=second),
            settings.tangent_pairs,
        )
        found.append(Measurement(name, pair.ratio, "1", f"{told}: {what}"))
    return found


def full_monodromy(settings: Settings) -> list[Measurement]:
    """Cycle correction with all columns against the slow subspace, from the same guess to the same cycle."""
    found: list[Measurement] = []
    for grid in settings.monodromy_grids:
        start = prepared(grid)
        problem, steps = start.problem, start.steps
        basis = first_basis(problem, start.guess, steps)
        cycle = correct(problem, start.guess, problem.fixed_parameter(SPEED), basis, steps).cycle
        assert cycle is not None
        guess, slow, whole = cycle.unknowns, following_basis(problem, cycle), np.eye(problem.period_map.size)

        def correction(
            basis: Array, problem: CycleProblem = problem, guess: Unknowns = guess, steps: int = steps
        ) -> None:
            correct_to = problem.fixed_parameter(NEXT_SPEED)
            assert correct(problem, guess, correct_to, basis, steps).cycle is not None

        pair = interleaved(
            lambda full=whole: correction(full),
            lambda part=slow: correction(part),
            settings.monodromy_pairs,
            warm_up=False,
        )
        suffix = "" if grid == settings.default_grid else f"_{_name(grid)}"
        found += [
            Measurement(
                f"full_monodromy_ratio{suffix}", pair.ratio, "1",
                f"cycle correction with all {whole.shape[0]} columns / with the slow subspace of "
                f"{slow.shape[1]}, {_name(grid)}",
            ),
            Measurement(
                f"cycle_correction{suffix}", pair.second, "s",
                f"informative: that correction in the slow subspace, {_name(grid)}",
            ),
        ]  # fmt: skip
    return found


def branch_point(settings: Settings) -> list[Measurement]:
    """A branch point with default settings against the whole monodromy matrix propagated by RK4, both from
    the cycle at ``SPEED`` to that at ``NEXT_SPEED``.
    """
    whole = next_point(prepared(settings.default_grid, "rk4"), whole=True)
    slow = next_point(prepared(settings.default_grid), whole=False)
    pair = interleaved(whole, slow, settings.monodromy_pairs, warm_up=False)
    grid = _name(settings.default_grid)
    return [
        Measurement(
            "branch_point_ratio", pair.ratio, "1",
            f"one branch point with all slow multipliers, {grid}: whole monodromy matrix by rk4 "
            f"({pair.first:.3g} s) / slow subspace, esdirk5 ({pair.second:.3g} s)",
        )
    ]  # fmt: skip


def next_point(start: Start, *, whole: bool) -> Action:
    """Correct the next point of a branch, ask for its steps and find its tangent."""
    cycle, problem = start.cycle(), start.problem
    basis = np.eye(problem.period_map.size) if whole else following_basis(problem, cycle)
    constraint = problem.fixed_parameter(NEXT_SPEED)
    direction = tangent_at(problem, cycle, constraint.row)
    assert direction is not None
    guess = cycle.unknowns.plus(direction, NEXT_SPEED - SPEED)

    def point() -> None:
        found = correct(problem, guess, constraint, basis, cycle.steps).cycle
        assert found is not None
        required_steps(problem, found)
        assert tangent_at(problem, found, constraint.row) is not None

    return point


def growth(settings: Settings) -> list[Measurement]:
    """Time per branch point against N, each from a short branch."""
    sizes, times, found = [], [], []
    for grid in settings.walked_grids:
        start = prepared(grid)
        seconds, steps = walked_point(start, settings.branch_points)
        sizes.append(start.problem.period_map.size)
        times.append(seconds)
        what = f"informative: time per branch point, N = {sizes[-1]}, {steps} steps per period"
        found.append(Measurement(f"branch_point_{_name(grid)}", seconds, "s", what))
    what = f"slope of log(time per branch point) over log(N): {_names(settings.walked_grids)}"
    return [Measurement("growth_exponent", growth_exponent(sizes, times), "1", what), *found]


def walked_point(start: Start, points: int) -> tuple[float, int]:
    """Mean CPU time [s] of the points of a short branch after the first, and its steps per period."""
    marks: list[float] = []
    steps: list[int] = []

    def record(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        marks.append(time.process_time())
        steps.append(state.steps)

    options = replace(
        continuation_options(start.description, 1),
        max_points=points + 1,
        detection=DetectionOptions(kinds=()),
    )
    continue_branch(start.problem, BranchStart(start.guess.state, SPEED), options, record)
    assert len(marks) == points + 1
    return (marks[-1] - marks[0]) / points, steps[-1]


def _name(grid: Grid) -> str:
    return f"{grid[0]}x{grid[1]}"


def _names(grids: tuple[Grid, ...]) -> str:
    return ", ".join(map(_name, grids))
