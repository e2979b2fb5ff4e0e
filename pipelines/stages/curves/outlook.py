"""How much of a search of the plane is left: a range, since nobody knows the number of its curves before.

How many points a line has, how many halves of curves a line brings, and how many points these have was
counted on finished searches of five planes, with 2 to 6 lines and 4 to 16 halves. Work is counted in passes
over the period.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipelines.case.models import Case
from pipelines.case.survey_settings import survey_axes
from pipelines.datasets.curves import CURVE_CONTAINERS
from pipelines.datasets.records import ENDED
from pipelines.stages.curves.lines import LINES
from pipelines.stages.pass_counts import PASSES_PER_CELL, PASSES_PER_CYCLE, passes_per_curve_point

Attributes = Mapping[str, Any]
Span = tuple[float, float]  # at least, at most

LINE_POINTS: Span = (1.2, 1.6)  # of the range over the longest step
HALVES_PER_LINE: Span = (0.5, 4.0)  # halves of curves
HALF_POINTS: Span = (0.25, 0.9)  # of both ranges over the longest step
FURTHER_LINES = 1.0  # at most, of the others: those that certificates ask for
RESONANCES_PER_CRITICAL = 2  # lines at most
CRITICALS = 6  # without the group that tells
_ENOUGH = 3  # halves of curves from which the number of points of the others is judged


@dataclass(frozen=True)
class Outlook:
    """The work of a search [passes]: ``done``, and what is left at least and at most.

    ``lines``: how many there will be.
    """

    done: float
    least: float
    most: float
    lines: tuple[int, int]

    def after(self, passes: float) -> Outlook:
        """The same when some more work has been done."""
        left = [max(0.0, each - passes) for each in (self.least, self.most)]
        return Outlook(self.done + passes, left[0], left[1], self.lines)


def outlook(case: Case, groups: Mapping[str, Attributes]) -> Outlook:
    """What is left of the search of a case that has some ``groups``, with their attributes by local name."""
    lines = [each for name, each in groups.items() if name.startswith(LINES)]
    halves = [each for name, each in groups.items() if name.split("/")[0] in CURVE_CONTAINERS]
    expected = expected_lines(case, groups)
    number = max(expected[0], len(lines)), max(expected[1], len(lines))
    per_line = _points_per_line(case, lines)
    line_points = _left(lines, number, per_line)
    traced = number[0] * HALVES_PER_LINE[0], number[1] * HALVES_PER_LINE[1]
    curve_points = _left(halves, (max(traced[0], len(halves)), max(traced[1], len(halves))),
                         _points_per_half(case, halves))  # fmt: skip
    per_curve_point = passes_per_curve_point(case)
    surveyed, surveying = _on_survey(case, groups)
    done = PASSES_PER_CYCLE * _points(lines) + per_curve_point * _points(halves) + surveyed
    least, most = (
        PASSES_PER_CYCLE * on_lines + per_curve_point * on_curves + surveying
        for on_lines, on_curves in zip(line_points, curve_points, strict=True)
    )
    return Outlook(done, least, most, number)


def expected_lines(case: Case, groups: Mapping[str, Attributes]) -> tuple[int, int]:
    """The fewest and the most lines of a search: of two rounds, and of all."""
    search = case.bifurcation_set
    in_a_round = search.frequencies + search.speeds
    known = groups.get("criticals", {}).get("dimensions", {})
    resonant = RESONANCES_PER_CRITICAL * int(known.get("critical", CRITICALS)) if search.resonances else 0
    most = search.max_rounds * in_a_round + resonant
    if search.certify:
        most += round(FURTHER_LINES * most)
    return min(2, search.max_rounds) * in_a_round, most


def _points_per_line(case: Case, lines: list[Attributes]) -> Span:
    """Points of a line, judged by those that have ended."""
    found = _mean_of_ended(lines, 1)
    if found is not None:
        return found, found
    search, (first, second) = case.bifurcation_set, case.track_curves.ranges
    in_all = search.frequencies + search.speeds
    speed = case.track_curves.parameters.index("speed")
    along_speed, across = ((first, second)[index] for index in (speed, 1 - speed))
    length = (
        search.frequencies * (along_speed[1] - along_speed[0]) + search.speeds * (across[1] - across[0])
    ) / max(1, in_all)
    steps = length / search.maximum_step
    return LINE_POINTS[0] * steps, LINE_POINTS[1] * steps


def _points_per_half(case: Case, halves: list[Attributes]) -> Span:
    """Points of a half of a curve, judged by those that have ended once there are some."""
    found = _mean_of_ended(halves, _ENOUGH)
    if found is not None:
        return found, found
    table = case.track_curves
    steps = sum(high - low for low, high in table.ranges) / table.maximum_step
    least, most = (min(float(table.max_points), share * steps) for share in HALF_POINTS)
    return least, most


def _mean_of_ended(groups: list[Attributes], enough: int) -> float | None:
    ended = [int(each["n_points"]) for each in groups if each["status"] == ENDED]
    return sum(ended) / len(ended) if len(ended) >= enough else None


def _left(groups: list[Attributes], number: tuple[float, float], points: Span) -> Span:
    """Points that are missing of so many groups, of which some are there."""
    running = [each for each in groups if each["status"] != ENDED]
    unfinished = [sum(max(0.0, each - int(group["n_points"])) for group in running) for each in points]
    least, most = (
        begun + (wanted - len(groups)) * each
        for begun, wanted, each in zip(unfinished, number, points, strict=True)
    )
    return least, most


def _points(groups: list[Attributes]) -> int:
    return sum(int(each["n_points"]) for each in groups)


def _on_survey(case: Case, groups: Mapping[str, Attributes]) -> tuple[float, float]:
    """Passes of the survey that a certificate needs: of the lines that are there, and of those missing."""
    if not case.bifurcation_set.certify:
        return 0.0, 0.0
    along, across = survey_axes(case.survey, case.track_curves)
    there, each = int(groups.get("survey", {}).get("n_points", 0)), PASSES_PER_CELL * along.points
    return each * there, each * (across.points - there)
