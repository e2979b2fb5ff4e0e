"""Table of the survey: the grid of the plane, and how accurate its cycles are."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field, ValidationInfo, field_validator

from pipelines.case.curve_settings import Interval, TrackCurves
from pipelines.case.fields import InconsistentError, UnitsTable, quantity, table

Count = Annotated[int, Field(strict=True)]
MOST_POINTS = 1000  # along either parameter
ACCURACY = "at a tenth of it a cell takes about twice as long"


class Survey(UnitsTable):
    """Stability of the cycles over a grid of the plane of [track_curves], without continuation."""

    points: tuple[Count, Count] = table(
        "values of the two parameters of track_curves.parameters, equally spaced over the ranges", (40, 30)
    )
    ranges: tuple[Interval, Interval] | None = table(
        "values of the two parameters between which the grid lies; default: track_curves.ranges",
        None,
        measured_by="track_curves.parameters",
    )
    harmonics: int = quantity(
        "harmonics of a cycle; twice as many are tried where they do not suffice",
        "",
        3,
        at_least=1,
        at_most=50,
        because="with very many the time integration of Newton's method is faster",
    )
    phases: int = quantity(
        "equally spaced phases at which the equations are evaluated; more than twice the harmonics",
        "",
        10,
        at_least=3,
        at_most=1000,
        because="the harmonics are a Fourier transform over them",
    )
    tolerance: float = quantity(
        "miss after a period, relative to the largest state, beyond which Newton's method corrects a cycle",
        "1",
        5e-4,
        above=0,
        below=0.1,
        because="a multiplier is off by a few times as much",
    )
    multiplier_tolerance: float = quantity(
        "error that the time steps may leave in the leading Floquet multipliers",
        "1",
        5e-4,
        above=0,
        below=0.1,
        because=ACCURACY,
    )

    @field_validator("points")
    @classmethod
    def _two_at_least(cls, value: tuple[int, int]) -> tuple[int, int]:
        problems = [
            ((index,), f"must lie within 2 and {MOST_POINTS}: both ends of the range, and a store that opens")
            for index, number in enumerate(value)
            if not 2 <= number <= MOST_POINTS
        ]
        if problems:
            raise InconsistentError(*problems)
        return value

    @field_validator("ranges")
    @classmethod
    def _rising(cls, value: tuple[Interval, Interval] | None) -> tuple[Interval, Interval] | None:
        problems = [
            ((index,), f"must be [low, high] with low < high, given [{low:g}, {high:g}]")
            for index, (low, high) in enumerate(value or ())
            if not low < high
        ]
        if problems:
            raise InconsistentError(*problems)
        return value

    @field_validator("phases")
    @classmethod
    def _enough(cls, value: int, info: ValidationInfo) -> int:
        harmonics = info.data.get("harmonics", 1)
        if value <= 2 * harmonics:
            raise InconsistentError(f"must exceed twice the harmonics, 2 x {harmonics}")
        return value


class Axis(NamedTuple):
    """So many ``points`` of a parameter, equally spaced over a range."""

    parameter: str
    low: float
    high: float
    points: int


def survey_axes(survey: Survey, curves: TrackCurves) -> tuple[Axis, Axis]:
    """The two axes of the grid: the one along its lines, and the one across.

    An excitation frequency runs along the lines: the state at rest does not depend on it.
    """
    axes = [
        Axis(name, low, high, points)
        for name, (low, high), points in zip(
            curves.parameters, survey.ranges or curves.ranges, survey.points, strict=True
        )
    ]
    along, across = sorted(axes, key=lambda axis: axis.parameter != "excitation_frequency")
    return along, across
