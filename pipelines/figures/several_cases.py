"""Figures of several cases together: which cases share a figure, and what distinguishes them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType

from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.case_tables import RUNS, CaseTables, Notify
from pipelines.figures.contents import CaseView, FigurePlan, Table
from pipelines.figures.map_sets import Overlay, draw_map_sets
from pipelines.figures.response_envelope import Chart, comparable, draw_envelopes
from pipelines.figures.stability_map import PlaneView, curves_over, map_stem, same_plane

# Figure of several cases: kinds of groups that it needs.
JOINT_KINDS: Mapping[str, Collection[str]] = MappingProxyType(
    {"sets": ("curve", "criticals", "bifurcation_set"), "envelopes": (RUNS, "transient", "cycles")}
)
ORDER = ("foil_stiffness", "displacement", "excitation_frequency", "speed")  # of the cases in a figure
MOST_SETS = 8  # colours that are told apart
MOST_ENVELOPES = 4  # below each other on a page


def joint_plans(cases: Sequence[CaseTables], kinds: Collection[str], notify: Notify) -> Iterator[FigurePlan]:
    """The figures of several cases; ``notify`` receives the reason if one of ``kinds`` cannot be drawn."""
    ordered = sorted(cases, key=lambda case: [case.view.parameters.get(name) or 0.0 for name in ORDER])
    if "sets" in kinds:
        yield from _set_plans(ordered, notify)
    if "envelopes" in kinds:
        yield from _envelope_plans(ordered, notify)


def _set_plans(cases: Sequence[CaseTables], notify: Notify) -> Iterator[FigurePlan]:
    """A map for every pair of parameters over which several cases have curves."""
    planes = {same_plane(curve) for case in cases for curve in case.curves.values()}
    if not planes:
        notify("sets is left out: the chosen cases have no curves of bifurcations")
    for plane in sorted(planes, key=sorted):
        held = [(case, inside) for case in cases if (inside := _curves_over(case, plane))]
        if not _fits("sets", "curves over the same parameters", len(held), MOST_SETS, notify):
            continue
        views = [PlaneView.of(inside, case.single) for case, inside in held]
        members = [case.view for case, _ in held]
        x, y = views[0].x, views[0].y
        labels, shared = told_apart(members, (x, y))
        overlays = [Overlay(*each) for each in zip(labels, members, views, strict=True)]
        draw = partial(draw_map_sets, overlays, f"bifurcation sets{shared}")
        yield FigurePlan("sets", map_stem("sets", x, y), draw)


def _curves_over(case: CaseTables, plane: frozenset[str]) -> dict[str, Table]:
    """Curves of a case over two parameters; none where no curve has a point yet."""
    inside = curves_over(case.curves, plane)
    return inside if any(len(curve["speed"]) for curve in inside.values()) else {}


def _envelope_plans(cases: Sequence[CaseTables], notify: Notify) -> Iterator[FigurePlan]:
    """The first transient over the speed of every case, with its cycles."""
    held = [(case, run) for case in cases for run in [run for run in case.runs if run.over_speed][:1]]
    if not _fits("envelopes", "a run over the speed that has ended", len(held), MOST_ENVELOPES, notify):
        return
    members = [case.view for case, _ in held]
    labels, shared = told_apart(members, ("speed",))
    charts = [
        Chart(label, case.view, run, comparable(run, list(case.of_kind("cycles").values())))
        for label, (case, run) in zip(labels, held, strict=True)
    ]
    yield FigurePlan("envelopes", "envelopes", partial(draw_envelopes, charts, f"response envelopes{shared}"))


def _fits(figure: str, what: str, count: int, most: int, notify: Notify) -> bool:
    """Whether so many cases make the figure; otherwise the reason is reported."""
    if count < 2:
        notify(
            f"{figure} is left out: it needs two cases with {what}; of the chosen ones {count or 'none'} has"
        )
    elif count > most:
        notify(
            f"{figure} is left out: {count} of the chosen cases have {what}; choose at most {most} of them"
        )
    return 2 <= count <= most


def told_apart(cases: Sequence[CaseView], axes: Collection[str]) -> tuple[list[str], str]:
    """What distinguishes every case from the others, and for a title what all cases share.

    Parameters that are on the axes count for neither. Cases that differ in other keys are told apart by the
    parts of their names.
    """
    values = {
        name: [case.parameters.get(name) for case in cases] for name in PARAMETER_AXES if name not in axes
    }
    known = {name: column for name, column in values.items() if None not in column}
    differing = [name for name, column in known.items() if len(set(column)) > 1]
    labels = [_written({name: known[name][place] for name in differing}) for place in range(len(cases))]
    if len(set(labels)) < len(cases):
        parts = [case.name.split("_") for case in cases]
        common = set(parts[0]).intersection(*parts[1:])
        labels = [", ".join(part for part in own if part not in common) for own in parts]
    shared = _written({name: column[0] for name, column in known.items() if name not in differing})
    return labels, f" at {shared}" if shared else ""


def _written(values: Mapping[str, float | None]) -> str:
    return ", ".join(f"{PARAMETER_AXES[name].symbol} = {value:.4g}" for name, value in values.items())
