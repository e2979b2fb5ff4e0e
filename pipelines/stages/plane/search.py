"""The search of a plane: lines, the curves that they meet, and their comparison with a survey.

    trace lines -> trace curves -> compare with the survey -> lines through the places that disagree -> ...

until no place disagrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipelines.stages.certificate.agreement import Judge
from pipelines.stages.certificate.asked import Asked
from pipelines.stages.certificate.comparison import Comparison, membership
from pipelines.stages.certificate.crossings import PlaneCurves
from pipelines.stages.certificate.summary import Summary
from pipelines.stages.curves.lines import spread
from pipelines.stages.plane.problem import PlaneOptions, PlaneProblem, cycle_at
from pipelines.stages.plane.survey import PlaneSurvey, survey_plane
from pipelines.stages.plane.tracing import PlaneCurve, trace_curves, trace_line
from pipelines.stages.survey.line import Found


@dataclass(frozen=True)
class PlaneSet:
    """The curves of a plane, the ``lines`` on which they were found, and what the survey says of them."""

    curves: tuple[PlaneCurve, ...]
    lines: tuple[Asked, ...]
    survey: PlaneSurvey
    comparison: Comparison

    @property
    def complete(self) -> bool:
        """Whether the curves explain the survey, and every curve was traced to an end of its own."""
        return self.comparison.certified and all(curve.is_finished for curve in self.curves)

    @property
    def summary(self) -> Summary:
        """The comparison in numbers and words; `Summary.disagreements` lists every place that disagrees."""
        return Summary.of(self.comparison)


def search_plane(
    plane: PlaneProblem,
    options: PlaneOptions,
    known: Sequence[PlaneCurve] = (),
    survey: PlaneSurvey | None = None,
) -> PlaneSet:
    """Trace curves of a plane until they explain its survey, or no further line is left to try.

    ``known``: curves that are there already, whose special points are not followed again; ``survey``: of the
    same plane, computed if not given.
    """
    survey = survey_plane(plane, options) if survey is None else survey
    curves, lines = list(known), []
    fresh = _first_lines(plane, options)
    for _ in range(options.rounds + 1):
        events = [event for line in fresh for event in trace_line(plane, options, line)]
        curves += trace_curves(plane, options, events, curves)
        lines += fresh
        comparison = certify_plane(plane, options, curves, survey)
        fresh = comparison.asked(lines)
        if not fresh:
            break
    return PlaneSet(tuple(curves), tuple(lines), survey, comparison)


def certify_plane(
    plane: PlaneProblem, options: PlaneOptions, curves: Sequence[PlaneCurve], survey: PlaneSurvey
) -> Comparison:
    """Compare curves with the survey of their plane: `Comparison.certified` means that they explain it."""
    between = [each.interpolated for each in curves if each.interpolated is not None]

    def cycle(along: float, across: float) -> Found:
        return cycle_at(plane, options, (along, across))

    kinds = [kind.name.lower() for kind in plane.kinds]
    judge = Judge(PlaneCurves(between), 0, kinds, belongs=membership(between, plane.names, cycle))
    return Comparison.of(judge, plane.names, survey.grid, survey.points)


def _first_lines(plane: PlaneProblem, options: PlaneOptions) -> list[Asked]:
    """Lines along either parameter, equally spaced over the other one."""
    (first, second), (of_first, of_second) = plane.names, plane.ranges
    along_first, along_second = options.lines
    return [Asked(first, value) for value in spread(along_first, of_second, 0)] + [
        Asked(second, value) for value in spread(along_second, of_first, 0)
    ]
