"""Time of a cell of a survey against that of a branch point: both give a cycle with its slow multipliers."""

from __future__ import annotations

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.stages.survey.line import compute_line, survey_problem
from tests.benchmarks.cycles import SPEED, next_point, prepared
from tests.benchmarks.measuring import Measurement, interleaved
from tests.benchmarks.settings import SCHEME, Settings
from tests.machines import case

CELLS = 8
FREQUENCIES = (0.5, 0.9)


def survey_cell(settings: Settings) -> list[Measurement]:
    """Both on the grid of the figures; a line of the survey has its own equilibrium."""
    grid = settings.monodromy_grids[0]
    table = {"points": (CELLS, 2), "ranges": (FREQUENCIES, (SPEED, 1.2 * SPEED))}
    description = case(grid, speed=SPEED, survey=table, numerics={"scheme": SCHEME})
    problem = survey_problem(build_machine(description), description, parameter_vector(description))
    branch = next_point(prepared(grid), whole=False)
    pair = interleaved(branch, lambda: compute_line(problem, 0), settings.tangent_pairs)
    told = f"a branch point / a cell of a survey, {grid[0]}x{grid[1]}"
    return [
        Measurement("survey_cell_ratio", CELLS * pair.ratio, "1", told),
        Measurement(
            "survey_cell", 1e3 * pair.second / CELLS, "ms", f"informative: that cell, {grid[0]}x{grid[1]}"
        ),
    ]
