"""Tables of the bifurcation curves: which curves to trace, in which plane, and how to search it."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipelines.case.fields import (
    InconsistentError,
    Number,
    Parameter,
    UnitsTable,
    arclength_step,
    choice,
    most_points,
    quantity,
    steps_in_order,
    table,
)

Kind = Literal["period_doubling", "neimark_sacker", "fold"]
Interval = tuple[Number, Number]


class TrackCurves(UnitsTable):
    """Curves of period doublings, Neimark-Sacker points and folds over two parameters."""

    parameters: tuple[Parameter, Parameter] = table(
        "the two parameters of the plane: horizontal, vertical", ("excitation_frequency", "speed")
    )
    ranges: tuple[Interval, Interval] = table(
        "values of the two parameters between which curves are followed",
        ((0.2, 2.0), (0.2, 1.4)),
        measured_by="parameters",
    )
    formulation: Literal["bordered", "extended"] = choice(
        "`bordered`: one test function closes the system; `extended`: eigenvectors as unknowns", "bordered"
    )
    step: float = arclength_step("first arclength step", 0.02, measured_by="parameters")
    minimum_step: float = arclength_step(
        "a curve ends when a step would be shorter; on smoothed clipping a 16th",
        1e-6,
        measured_by="parameters",
    )
    maximum_step: float = arclength_step("longest arclength step", 0.05, measured_by="parameters")
    max_points: int = most_points("a curve ends after this many points, in each of its two directions", 400)
    max_curves: int = quantity(
        "maximum number of curves of each kind",
        "",
        50,
        at_least=1,
        at_most=999,
        because="they are numbered c000 to c999",
    )
    normal_forms: bool = table(
        "whether every point gets its normal form, which separates sub- and supercritical", True
    )

    normal_form_widths: tuple[Number, ...] = table(
        "half widths, as parts of ambient pressure, over which `gumbel` clipping is smoothed for the normal "
        "forms: the first gives the coefficient, others its error; with none the clipped equations are used",
        (0.005, 0.01),
        unit="1",
        max_length=5,
    )

    clipping_widths: tuple[Number, ...] = table(
        "half widths, as parts of ambient pressure, over which `gumbel` clipping is smoothed to lead a curve "
        "past its kinks, tried in this order; with none a curve ends there",
        (0.005, 0.01, 0.02, 0.04),
        unit="1",
        max_length=10,
    )

    @field_validator("normal_form_widths", "clipping_widths")
    @classmethod
    def _positive_widths(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if any(not 0.0 < width <= 1.0 for width in value):
            raise InconsistentError("must lie in 0 < width <= 1, in parts of ambient pressure")
        return value

    @field_validator("clipping_widths")
    @classmethod
    def _increasing_widths(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if list(value) != sorted(set(value)):
            raise InconsistentError("must increase: a small width displaces a curve least and is tried first")
        return value

    @field_validator("parameters")
    @classmethod
    def _two(cls, value: tuple[str, str]) -> tuple[str, str]:
        if value[0] == value[1]:
            raise InconsistentError("must be two different parameters: a curve needs a plane")
        return value

    @field_validator("ranges")
    @classmethod
    def _rising(cls, value: tuple[Interval, Interval], info: ValidationInfo) -> tuple[Interval, Interval]:
        names = info.data.get("parameters", ("", ""))
        problems: list[tuple[tuple[int | str, ...], str]] = []
        for index, ((low, high), name) in enumerate(zip(value, names, strict=True)):
            if not low < high:
                problems.append(((index,), f"must be [low, high] with low < high, given [{low:g}, {high:g}]"))
            elif name == "displacement" and not (low >= 0 and high < 1):
                problems.append(((index,), "must lie within 0 <= displacement < 1: the ring closes the film"))
            elif name != "displacement" and low <= 0:
                problems.append(((index,), "must be > 0: this parameter is positive"))
        if problems:
            raise InconsistentError(*problems)
        return value

    _steps = field_validator("maximum_step")(steps_in_order)


class BifurcationSet(UnitsTable):
    """The search of `agfb run` for all curves of the plane excitation frequency x speed of [track_curves]."""

    kinds: tuple[Kind, ...] = table(
        "kinds of curves that are followed; without `fold` the search is faster where films "
        "touch ambient pressure, but most losses of stability by folds are missing",
        ("period_doubling", "neimark_sacker", "fold"),
        min_length=1,
        max_length=3,
        because="something must be followed",
    )
    boundaries: bool = table(
        "whether to trace only curves that bound stable cycles where a branch or another curve meets them; "
        "curves of cycles that are unstable there are skipped, even if they bound stable cycles elsewhere",
        False,
    )
    continue_boundaries: bool = table(
        "whether to follow, at the end of a Neimark-Sacker curve that bounds stable cycles, the folds or "
        "period doublings that continue the boundary, even if `kinds` leaves these out; folds of large "
        "cycles whose films touch ambient pressure may take longer than all other curves",
        True,
    )
    frequencies: int = quantity(
        "branches along the speed in the first round, at equally spaced excitation frequencies",
        "",
        6,
        at_least=0,
        at_most=1000,
        because="0 leaves them out",
    )
    speeds: int = quantity(
        "branches along the excitation frequency in the first round, at equally spaced speeds",
        "",
        4,
        at_least=0,
        at_most=1000,
        because="0 leaves them out",
    )
    resonances: bool = table(
        "whether the first round also has branches along the speed at the predicted parametric resonances",
        True,
    )
    max_rounds: int = quantity(
        "maximum number of rounds of new branches; the search is complete when a round meets no new curve",
        "",
        4,
        at_least=1,
        at_most=50,
        because="each round has about as many branches as the first",
    )
    maximum_step: float = arclength_step(
        "longest arclength step of these branches",
        0.05,
        because="a tongue narrower than a step can be missed; arclength is dimensionless",
        measured_by="track_curves.parameters",
    )
    certify: bool = table(
        "whether to compare the curves with a survey ([survey]) and 100 random points of the plane, and to "
        "add branches through the places that disagree; the search is then complete when none is left",
        False,
    )
    smallest_film: float = quantity(
        "branches along the speed begin at the lowest speed with at least this film thickness at equilibrium",
        "1",
        0.05,
        above=0,
        below=1,
        because="with a thinner film the equilibrium is of no use",
    )
