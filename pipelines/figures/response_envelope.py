"""Envelopes of transients: over branches of cycles, of several cases, and for several unbalances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import limits
from pipelines.figures.bifurcation_diagram import (
    EVENT_MARKS,
    draw_threaded,
    envelope,
    event_handles,
    event_looks,
    event_names,
    stability_handles,
    thread_events,
    turns_colour,
)
from pipelines.figures.contents import CaseView, MissingDataError, Table, excitation_periods
from pipelines.figures.runs import AXIS_LABELS, RunView, bearing_title, label_along

VERTICAL = 1
LEADING = 4  # moduli drawn
SAME_PARAMETER = 1e-9


def comparable(run: RunView, branches: Sequence[Table]) -> list[Table]:
    """Branches along the speed, also of doubled cycles, with the other parameters of the transient.

    Its parameters while its rings move count.

    Those it has while its rings move.
    """
    # None: the machine has no such parameter, which the branches hold as NaN
    _, frequency, displacement, stiffness = np.array(run.run.attributes["parameters"], dtype=float)
    own = {"excitation_frequency": frequency, "displacement": displacement, "foil_stiffness": stiffness}
    moves = run.excitation_frequency is not None
    if not moves:
        own = {"displacement": 0.0, "foil_stiffness": stiffness}
    return [
        branch
        for branch in branches
        if branch.attributes.get("parameter") == "speed"
        and len(branch["speed"])
        and all(
            np.allclose(branch[name], value, rtol=SAME_PARAMETER, atol=0.0, equal_nan=True)
            for name, value in own.items()
        )
    ]


@dataclass(frozen=True)
class Chart:
    """One of several envelopes below each other: what distinguishes the case, its run and its cycles."""

    label: str
    case: CaseView
    run: RunView
    cycles: Sequence[Table]


@style.in_style
def draw_envelope(case: CaseView, run: RunView, branches: Sequence[Table]) -> Figure:
    """Vertical envelope of a transient in each bearing, over that of stored cycles (the paper's Fig. 4).

    The cycles have the same parameters; the moduli of their leading multipliers are drawn below.
    """
    cycles = comparable(run, branches) if run.over_speed else []
    rows = case.bearings + (1 if cycles else 0)
    figure = style.new_figure(1.3 + 2.1 * rows)
    panels = np.atleast_1d(figure.subplots(rows, 1, sharex=True))
    for bearing in range(case.bearings):
        draw_chart(panels[bearing], case, run, cycles, bearing)
        panels[bearing].set_title(bearing_title(bearing))
    if cycles:
        _draw_moduli(panels[-1], cycles)
        panels[-1].set_title(f"{LEADING} largest Floquet multipliers of the cycles")
    panels[0].set_xlim(*limits(run.along("window"), 0.01))
    label_along(panels[0], run.over_speed, case.scales, bottom=False)
    label_along(panels[-1], run.over_speed, case.scales, top=False)
    style.legend_below(figure, envelope_handles([run], cycles), 4)
    return style.finish(figure, f"{case.name}: envelope of {run.title}", case.note)


@style.in_style
def draw_envelopes(charts: Sequence[Chart], title: str) -> Figure:
    """Vertical envelopes of the first bearing for several cases below each other (the paper's Fig. 4).

    For each case a transient over the speed with its cycles; under each the moduli of the multipliers.
    """
    shares = [share for chart in charts for share in ((1.9, 1.0) if chart.cycles else (1.9,))]
    figure = style.new_figure(1.4 + 1.14 * sum(shares))
    panels = figure.subplots(len(shares), 1, sharex=True, height_ratios=shares)
    following = iter(panels)
    for chart in charts:
        axes = next(following)
        draw_chart(axes, chart.case, chart.run, chart.cycles, 0)
        axes.set_title(f"{chart.label}: {bearing_title(0)}")
        if chart.cycles:
            _draw_moduli(next(following), chart.cycles)
    runs = [chart.run for chart in charts]
    panels[0].set_xlim(*limits(np.concatenate([run.along("window") for run in runs]), 0.01))
    scales = charts[0].case.scales
    label_along(panels[0], True, scales, bottom=False, top=all(c.case.scales == scales for c in charts))
    label_along(panels[-1], True, scales, top=False)
    style.legend_below(
        figure, envelope_handles(runs, [branch for chart in charts for branch in chart.cycles]), 4
    )
    return style.finish(figure, title, charts[0].case.note)


def draw_chart(axes: Axes, case: CaseView, run: RunView, cycles: Sequence[Table], bearing: int) -> None:
    """The envelope of a transient in one bearing over the envelopes of the cycles."""
    values = [*_draw_run(axes, run, bearing, style.SKY, 0.55)]
    values += [value for branch in cycles for value in _draw_cycles(axes, case, branch, bearing)]
    axes.set_ylim(*limits(np.concatenate(values), 0.08))
    axes.set_ylabel(AXIS_LABELS[VERTICAL])
    case.add_micrometres(axes, "vertical", bearing)


def _draw_run(
    axes: Axes, run: RunView, bearing: int, colour: str, alpha: float, label: str = ""
) -> tuple[NDArray[np.float64], ...]:
    """Draw the filled envelope between two lines; returns both."""
    along = run.along("window")
    low = run.needed("envelope_low")[:, bearing, VERTICAL]
    high = run.needed("envelope_high")[:, bearing, VERTICAL]
    axes.fill_between(along, low, high, color=colour, alpha=alpha, linewidth=0.0, label=label)
    for edge in (low, high):
        axes.plot(along, edge, color=colour, linewidth=0.9)
    return low, high


def _draw_cycles(axes: Axes, case: CaseView, branch: Table, bearing: int) -> list[NDArray[np.float64]]:
    """Envelope of the cycles, dashed where they are unstable."""
    curve = thread_events(branch, "speed", envelope(VERTICAL)(case, branch, bearing))
    draw_threaded(axes, curve, branch, {"color": turns_colour(excitation_periods(branch))})
    return list(curve.values.T)


def _draw_moduli(axes: Axes, branches: Sequence[Table]) -> None:
    """Moduli of the leading multipliers of the cycles, each over its own period."""
    highest = 1.0
    for branch in branches:
        moduli = -np.sort(-np.abs(branch["multipliers"]), axis=1)[:, :LEADING]  # NaN stays last
        highest = max(highest, float(np.nanmax(moduli)))
        colour = turns_colour(excitation_periods(branch))
        axes.plot(branch["speed"], moduli, color=colour, marker="o", markersize=2.2, linewidth=0.8)
        for kind, look, speed in zip(
            event_names(branch), event_looks(branch), branch.optional("event_speed"), strict=True
        ):
            axes.axvline(float(speed), color=EVENT_MARKS[kind].colour, linewidth=1.0, linestyle=":")
            axes.plot(float(speed), 1.0, zorder=5, **look)
    axes.axhline(1.0, color="#333333", linewidth=0.9)
    lowest = min(float(np.nanmin(np.nanmax(np.abs(branch["multipliers"]), axis=1))) for branch in branches)
    axes.set_ylim(max(0.0, lowest - 0.25), highest + 0.04)
    axes.set_ylabel(r"$|\mu|$")


def envelope_handles(runs: Sequence[RunView], cycles: Sequence[Table]) -> list[Patch | Line2D]:
    """Legend entries of transients and of the cycles under them."""
    unbalances = {run.unbalance for run in runs}
    label = f"time integration, {unbalances.pop()}" if len(unbalances) == 1 else "time integration"
    handles: list[Patch | Line2D] = [Patch(color=style.SKY, alpha=0.55, label=label)]
    if not cycles:
        return handles
    handles += stability_handles("cycles, stable", "cycles, unstable", style.BLACK)
    handles += [
        Line2D([], [], color=turns_colour(turns), label=rf"cycles of ${turns}\,T_{{ex}}$")
        for turns in sorted({excitation_periods(branch) for branch in cycles} - {1})
    ]
    return [*handles, *event_handles({kind for branch in cycles for kind in event_names(branch)})]


def together(views: Sequence[RunView]) -> list[RunView]:
    """Transients for one chart: those over the speed, or those over time if these are more.

    Raises MissingDataError for fewer than two.
    """
    over_speed = [view for view in views if view.over_speed]
    over_time = [view for view in views if not view.over_speed]
    chosen = over_time if len(over_time) > len(over_speed) else over_speed
    if len(chosen) < 2:
        raise MissingDataError("it needs two runs over the speed, or two over time")
    return chosen


@style.in_style
def draw_unbalance(case: CaseView, views: Sequence[RunView]) -> Figure:
    """Vertical envelopes of several transients in one chart, labelled by unbalance (the paper's Fig. 6)."""
    chosen = together(views)
    # the widest first, so that the others stay visible on it
    chosen.sort(key=lambda view: -float(np.ptp(view.run["journal"][..., VERTICAL])))
    figure = style.new_figure(1.3 + 2.3 * case.bearings)
    panels = np.atleast_1d(figure.subplots(case.bearings, 1, sharex=True))
    labels = _labels(chosen)
    for bearing in range(case.bearings):
        axes = panels[bearing]
        values: list[NDArray[np.float64]] = []
        for number, (view, label) in enumerate(zip(chosen, labels, strict=True)):
            values += _draw_run(axes, view, bearing, style.CYCLE[number % len(style.CYCLE)], 0.3, label)
        axes.set_ylim(*limits(np.concatenate(values), 0.08))
        axes.set(ylabel=AXIS_LABELS[VERTICAL], title=bearing_title(bearing))
        case.add_micrometres(axes, "vertical", bearing)
    over_speed = chosen[0].over_speed
    panels[0].set_xlim(*limits(np.concatenate([view.along("window") for view in chosen]), 0.01))
    label_along(panels[0], over_speed, case.scales, bottom=False)
    label_along(panels[-1], over_speed, case.scales, top=False)
    style.legend_below(figure, panels[0].get_legend_handles_labels()[0], 4)
    return style.finish(figure, f"{case.name}: envelopes of {len(chosen)} runs by their unbalance", case.note)


def _labels(views: Sequence[RunView]) -> list[str]:
    """Labels by unbalance; with more detail where several transients share it."""
    plain = [view.unbalance + ("" if view.excitation_frequency else ", rings at rest") for view in views]
    return [
        label if plain.count(label) == 1 else f"{label}, {view.speed_text} ({view.name})"
        for label, view in zip(plain, views, strict=True)
    ]
