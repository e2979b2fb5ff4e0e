"""Times of the period map, of cycle corrections and of branch points.

All on the reconstructed machine with its rings moving.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchState
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.case.models import Case
from pipelines.machine.assembly import build_machine
from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.period_map import Inhomogeneity, PeriodImage, PeriodMap, PhaseReference
from pipelines.orbits.shooting import (
    CycleProblem,
    Unknowns,
    correct,
    first_basis,
    following_basis,
    needed_steps,
)
from pipelines.stages.cycle_problem import continuation_options, cycle_problem
from pipelines.stages.cycle_start import FirstCycle, resting_start
from tests.benchmarks.measuring import Measurement, cpu_seconds, growth_exponent, interleaved
from tests.benchmarks.settings import Grid, Settings
from tests.machines import case

Array = NDArray[np.float64]

SPEED = 1.1  # the cycle is stable, with the Neimark-Sacker point ahead
NEXT_SPEED = 1.12
PROBE_STEPS = 128  # of a pass cut short to time one step


@dataclass(frozen=True)
class Pass:
    """One run of the integration loop: how many columns it carried and how many steps it took."""

    columns: int
    steps: int


@dataclass(frozen=True)
class CountingMap(PeriodMap):
    """A period map that keeps a list of its passes."""

    passes: list[Pass] = field(default_factory=list)

    def evaluate(
        self,
        state: Array,
        parameters: Array,
        period: float,
        steps: int,
        columns: Array | None = None,
        inhomogeneous: tuple[Inhomogeneity, ...] = (),
        reference: PhaseReference | None = None,
    ) -> PeriodImage:
        width = (0 if columns is None else columns.shape[1]) + len(inhomogeneous)
        self.passes.append(Pass(width, steps))
        return super().evaluate(state, parameters, period, steps, columns, inhomogeneous, reference)


@dataclass(frozen=True)
class Start:
    """A machine on one grid, ready for its first cycle."""

    description: Case
    problem: CycleProblem
    guess: Unknowns
    steps: int

    def one_step(self, columns: int) -> float:
        """CPU time [s] of one step of a pass with that many columns: a piece of the orbit, timed three
        times.
        """
        block = deterministic_block(self.problem.period_map.size, columns)
        piece = self.guess.period * PROBE_STEPS / self.steps

        def run() -> PeriodImage:
            return self.problem.period_map.evaluate(
                self.guess.state, self.problem.parameters, piece, PROBE_STEPS, block
            )

        return statistics.median(cpu_seconds(run) for _ in range(3)) / PROBE_STEPS


def prepared(grid: Grid) -> Start:
    """The machine at ``SPEED`` with the equilibrium in the mean ring as guess of its cycle."""
    description = case(grid, speed=SPEED, continue_cycles={"range": (1.0, 1.6)})
    machine = build_machine(description)
    problem = cycle_problem(machine, description)
    known = {item.name: getattr(problem.period_map, item.name) for item in fields(problem.period_map)}
    problem = replace(problem, period_map=CountingMap(**known))
    found = resting_start(machine, problem)
    assert isinstance(found, FirstCycle), found.reason
    guess = problem.consistent(Unknowns(found.start.state, 0.0, SPEED))
    return Start(description, problem, guess, needed_steps(problem, guess))


def tangent_batch(settings: Settings) -> list[Measurement]:
    """Orbit with tangent columns against the orbit alone."""
    start, grid = prepared(settings.default_grid), _name(settings.default_grid)
    period_map, guess = start.problem.period_map, start.guess
    block = deterministic_block(period_map.size, settings.columns)

    def orbit() -> PeriodImage:
        return period_map.evaluate(guess.state, start.problem.parameters, guess.period, start.steps)

    def batch() -> PeriodImage:
        return period_map.evaluate(guess.state, start.problem.parameters, guess.period, start.steps, block)

    pair = interleaved(batch, orbit, settings.tangent_pairs)
    columns = f"orbit + {settings.columns} tangent columns"
    return [
        Measurement(
            "tangent_batch_ratio", pair.ratio, "1",
            f"{columns} / orbit alone, {period_map.stepper.name}, {grid}",
        ),
        Measurement(
            "period_map", 1e3 * pair.second, "ms",
            f"informative: orbit alone over one period, {start.steps} steps, {grid}",
        ),
        Measurement(
            "period_map_with_columns", 1e3 * pair.first, "ms", f"informative: {columns}, one period, {grid}"
        ),
    ]  # fmt: skip


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


def growth(settings: Settings) -> list[Measurement]:
    """Time per branch point against N.

    A grid too large for a bench is composed: the passes of a branch point on the largest walked grid, times
    the steps which the composed grid needs, times the measured time of its step.  The same is done for the
    largest walked grid itself, to show how far composition can be trusted.
    """
    sizes, times, found = [], [], []
    typical: tuple[int, ...] = ()
    for grid in settings.walked_grids:
        start = prepared(grid)
        seconds, typical = _walked_point(start, settings.branch_points)
        sizes.append(start.problem.period_map.size)
        times.append(seconds)
        found.append(_point_time(grid, start, seconds, "mean of a short branch"))
    composition_ratio = _composed_point(start, typical) / seconds
    for grid in settings.composed_grids:
        start = prepared(grid)
        sizes.append(start.problem.period_map.size)
        times.append(_composed_point(start, typical))
        found.append(_point_time(grid, start, times[-1], "composed of steps"))
    walked, composed = _names(settings.walked_grids), _names(settings.composed_grids)
    return [
        Measurement(
            "growth_exponent", growth_exponent(sizes, times), "1",
            f"slope of log(time per branch point) over log(N): {walked} walked, {composed} composed of steps",
        ),
        Measurement(
            "growth_exponent_walked", growth_exponent(sizes[: len(settings.walked_grids)],
                                                      times[: len(settings.walked_grids)]), "1",
            f"the same of {walked} alone",
        ),
        Measurement(
            "composition_ratio", composition_ratio, "1",
            f"time of a branch point composed of steps / walked, {_name(settings.walked_grids[-1])}",
        ),
        *found,
    ]  # fmt: skip


def _walked_point(start: Start, points: int) -> tuple[float, tuple[int, ...]]:
    """Mean CPU time [s] of the points of a short branch after the first, and the columns of the last one's
    passes.
    """
    marks: list[float] = []
    passes: list[int] = []
    log = start.problem.period_map
    assert isinstance(log, CountingMap)

    def record(point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        marks.append(time.process_time())
        passes.append(len(log.passes))

    options = replace(
        continuation_options(start.description, 1),
        max_points=points + 1,
        detection=DetectionOptions(kinds=()),
    )
    continue_branch(start.problem, BranchStart(start.guess.state, SPEED), options, record)
    assert len(marks) == points + 1
    return (marks[-1] - marks[0]) / points, tuple(one.columns for one in log.passes[passes[-2] : passes[-1]])


def _composed_point(start: Start, typical: tuple[int, ...]) -> float:
    """Sum over the passes of a branch point: steps times the time of one."""
    step = {columns: start.one_step(columns) for columns in set(typical)}
    return start.steps * sum(step[columns] for columns in typical)


def _point_time(grid: Grid, start: Start, seconds: float, how: str) -> Measurement:
    what = (
        f"informative: time per branch point, N = {start.problem.period_map.size}, {start.steps} steps, {how}"
    )
    return Measurement(f"branch_point_{_name(grid)}", seconds, "s", what)


def _name(grid: Grid) -> str:
    return f"{grid[0]}x{grid[1]}"


def _names(grids: tuple[Grid, ...]) -> str:
    return ", ".join(map(_name, grids))
