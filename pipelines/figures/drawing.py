"""All figures of a store: which there are, what each of them needs, and where their files go.

Of the branches of cycles those of `continue-cycles` (``b000``, ...) and their period-doubled ones (``d000``,
...) are drawn. The lines that searched the plane (``s000``, ...) are not: there are dozens, and what they
found is in the stability map.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from types import MappingProxyType

from matplotlib.figure import Figure

from pipelines.datasets.reading import case_attributes, list_cases, list_groups, read_group
from pipelines.datasets.store import Store, StoreError, open_for_reading
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, Scales
from pipelines.figures.bifurcation_diagram import draw_bifurcation_diagram
from pipelines.figures.bifurcation_tree import draw_bifurcation_tree
from pipelines.figures.campbell import draw_campbell
from pipelines.figures.condensation import draw_condensation
from pipelines.figures.contents import CaseView, MissingDataError, Table, excitation_periods
from pipelines.figures.linearization import draw_linearization
from pipelines.figures.machine_drawing import draw_machine
from pipelines.figures.multipliers import draw_multipliers
from pipelines.figures.orbits import draw_film, draw_orbits
from pipelines.figures.response_envelope import draw_envelope, draw_unbalance
from pipelines.figures.run_motion import draw_modal_energy, draw_poincare, draw_spectrum, draw_waterfall
from pipelines.figures.runs import RUN_ARRAYS, RunView
from pipelines.figures.stability_map import PlaneView, draw_stability_map, same_plane
from pipelines.figures.tori import draw_section, draw_tori, is_unbalanced

Report = Callable[[str], None]

RUNS = "transient_analysis"
# Figure: kind of the group it is drawn from.
FIGURE_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "machine",
        "linearization": "linear",
        "campbell": "criticals",
        "condensation": "criticals",
        "bifurcation": "cycles",
        "multipliers": "cycles",
        "orbits": "cycles",
        "film": "cycles",
        "tree": "cycles",
        "stability": "curve",
        "tori": "tori",
        "section": "tori",
        "envelope": RUNS,
        "unbalance": RUNS,
        "waterfall": RUNS,
        "spectrum": RUNS,
        "poincare": RUNS,
        "modal-energy": RUNS,
    }
)
# Figure: kinds of groups that add to it where the store has them.
BESIDE: Mapping[str, Collection[str]] = MappingProxyType(
    {
        "bifurcation": ("refinement",),
        "stability": ("criticals", "bifurcation_set", "operating_range", "refinement"),
        "tori": ("cycles",),
        "envelope": ("transient", "cycles"),
        **dict.fromkeys(("unbalance", "waterfall", "spectrum", "poincare", "modal-energy"), ("transient",)),
    }
)
CURVE_CONTAINERS = ("pd", "ns", "folds")


@dataclass(frozen=True)
class Plan:
    """One figure still to be drawn: the stem of its file and the call that draws it."""

    kind: str
    stem: str
    draw: Callable[[], Figure]


def draw_figures(
    store: Store | Path | str,
    output_folder: Path | str,
    formats: Sequence[str] = ("png",),
    cases: str = "*",
    kinds: Collection[str] | None = None,
    report: Report | None = None,
) -> list[Path]:
    """Draw the figures of a store and give the files written, ``<output_folder>/<case>/<figure>.<format>``.

    ``cases`` is a glob over case ids; ``kinds`` chooses among ``FIGURE_KINDS`` (all when None). A figure
    whose data are not in the store is left out, and ``report`` is told why if it was chosen: once for each
    kind of group that is missing. One whose branch has no point yet says so in the picture. The store may
    still be written meanwhile. A damaged group is left out too, and raised when everything else is drawn.

    Raises ValueError for an unknown format or figure or a glob that no case matches, StoreError for a store
    that cannot be read, OSError where the files cannot be written.
    """
    _refuse_unknown("format", formats, style.FORMATS)
    _refuse_unknown("figure", kinds or (), tuple(FIGURE_KINDS))
    opened = store if isinstance(store, Store) else open_for_reading(store)
    known = list_cases(opened)
    chosen = [case for case in known if fnmatchcase(case, cases)]
    if not chosen:
        raise ValueError(f"no case matches {cases!r}; the store holds {', '.join(known) or 'no case'}")
    tell = report if report is not None else _say_nothing
    written: list[Path] = []
    damaged: list[StoreError] = []
    for case in chosen:
        # what a store lacks is told only to those who asked for it
        for plan in _plans(opened, case, kinds or tuple(FIGURE_KINDS), tell, damaged, asked=bool(kinds)):
            try:
                figure = plan.draw()
            except MissingDataError as missing:
                tell(f"{case}: {plan.stem} is left out: {missing}")
                continue
            for suffix in formats:
                path = Path(output_folder) / case / f"{plan.stem}.{suffix}"
                written.append(style.save_figure(figure, path))
    if damaged:
        raise damaged[0]
    return written


def _say_nothing(message: str) -> None:
    """A report that nobody reads."""


def _refuse_unknown(what: str, given: Collection[str], allowed: Sequence[str]) -> None:
    if unknown := [name for name in given if name not in allowed]:
        raise ValueError(f"unknown {what} {', '.join(unknown)}; allowed are {', '.join(allowed)}")


def _plans(
    store: Store, case: str, kinds: Collection[str], tell: Report, damaged: list[StoreError], *, asked: bool
) -> list[Plan]:
    """The figures of a case, in the order of ``FIGURE_KINDS``; tells which groups are not there, if ``asked``
    for, and collects the errors of those that cannot be read.
    """
    try:
        groups = list_groups(store, case)
        view = _case_view(store, case, groups)
    except StoreError as error:
        tell(f"{case} is left out: {error.message}")
        damaged.append(error)
        return []
    needed = {FIGURE_KINDS[kind] for kind in kinds}.union(*(BESIDE.get(kind, ()) for kind in kinds))
    wanted = [name for name in groups if _kind(name) in needed and not _is_search_line(name)]
    tables = {}
    for name in wanted:
        try:
            tables[name] = _table(store, name)
        except StoreError as error:
            tell(f"{name} is left out: {error.message}")
            damaged.append(error)
    if asked:
        _tell_missing(case, kinds, {_kind(name) for name in wanted}, tell)
    plans = [plan for name, table in tables.items() for plan in _single_plans(view, _kind(name), table)]
    branches = {name.rsplit("/", 1)[1]: table for name, table in tables.items() if _kind(name) == "cycles"}
    refinement = tables.get(f"cases/{case}/refinement")
    plans += [
        *_bifurcation_plans(view, branches, refinement),
        *_branch_plans(view, branches),
        *_tree_plans(view, branches),
    ]
    plans += _run_plans(view, _run_views(tables), list(branches.values()))
    curves = {name.split("/", 2)[2]: table for name, table in tables.items() if _kind(name) == "curve"}
    plans += _map_plans(view, curves, {_kind(name): table for name, table in tables.items()})
    tori = {name.rsplit("/", 1)[1]: table for name, table in tables.items() if _kind(name) == "tori"}
    plans += _torus_plans(view, tori, branches)
    order = list(FIGURE_KINDS)
    return sorted((plan for plan in plans if plan.kind in kinds), key=lambda plan: order.index(plan.kind))


def _tell_missing(case: str, kinds: Collection[str], held: Collection[str], tell: Report) -> None:
    """Say once for every kind of group that is not there which figures it costs."""
    missing: dict[str, list[str]] = {}
    for kind, group in FIGURE_KINDS.items():
        if kind in kinds and group not in held:
            missing.setdefault(group, []).append(kind)
    for group, figures in missing.items():
        left = f"{', '.join(figures)} {'are' if len(figures) > 1 else 'is'} left out"
        tell(f"{case}: {left}: the store has no group {group!r} for this case")


def _kind(group: str) -> str:
    """Kind of a group from its path: cases/kb10/cycles/b000 holds cycles, cases/kb10/ns/c000 a curve."""
    container = group.split("/")[2]
    return "curve" if container in CURVE_CONTAINERS else container


def _is_search_line(group: str) -> bool:
    """Whether a group is one of the branches that searched the plane."""
    return _kind(group) == "cycles" and group.rsplit("/", 1)[1].startswith("s")


def _table(store: Store, name: str) -> Table:
    group = read_group(store, name, RUN_ARRAYS if _kind(name) == "transient" else None)
    return Table(group.labelled(), group.attributes)


def _case_view(store: Store, case: str, groups: Collection[str]) -> CaseView:
    attributes = case_attributes(store, case)
    machine = f"cases/{case}/machine"
    return CaseView(
        name=str(attributes.get("name") or case),
        note=str(attributes.get("reconstruction") or ""),
        scales=_scales(attributes["scales"]),
        machine=_table(store, machine) if machine in groups else Table({}),
    )


def _scales(stored: Mapping[str, float]) -> Scales:
    """Scales of the axes from those of the case, which are in SI units."""
    return Scales(
        rpm=stored["speed_rpm_per_unit"],
        hertz=stored["hertz_per_unit"],
        micrometres=1e6 * stored["displacement"],
        stiffness=1e-9 * stored["pressure"] / stored["displacement"],
    )


def _single_plans(view: CaseView, kind: str, table: Table) -> list[Plan]:
    """Figures of a group that a case has once."""
    if kind == "machine":
        return [Plan("machine", "machine", partial(draw_machine, view))]
    if kind == "criticals":
        return [
            Plan("campbell", "campbell", partial(draw_campbell, view, table)),
            Plan("condensation", "condensation", partial(draw_condensation, view, table)),
        ]
    if kind == "linear":
        draw = partial(draw_linearization, view, table)
        return [Plan("linearization", "linearization", draw if len(table["speed"]) else _nothing_yet(view))]
    return []


def _bifurcation_plans(view: CaseView, branches: Mapping[str, Table], refinement: Table | None) -> list[Plan]:
    """One diagram for all branches along the same parameter."""
    plans = []
    for parameter in PARAMETER_AXES:
        along = [branch for branch in branches.values() if branch.attributes.get("parameter") == parameter]
        started = [branch for branch in along if len(branch["speed"])]
        diagram = partial(draw_bifurcation_diagram, view, parameter, started, refinement)
        draw = diagram if started else _nothing_yet(view)
        if along:
            plans.append(Plan("bifurcation", f"bifurcation-{parameter}", draw))
    return plans


def _branch_plans(view: CaseView, branches: Mapping[str, Table]) -> list[Plan]:
    """Figures of every single branch."""
    plans = []
    for name, branch in branches.items():
        parameter = str(branch.attributes["parameter"])
        for kind, draw in (("multipliers", draw_multipliers), ("orbits", draw_orbits), ("film", draw_film)):
            started = len(branch["speed"]) > 0
            call = partial(draw, view, parameter, branch, name) if started else _nothing_yet(view, name)
            plans.append(Plan(kind, f"{kind}-{name}", call))
    return plans


def _tree_plans(view: CaseView, branches: Mapping[str, Table]) -> list[Plan]:
    """A tree for every parameter along which there are period-doubled branches."""
    plans = []
    for parameter in PARAMETER_AXES:
        along = {n: b for n, b in branches.items() if b.attributes.get("parameter") == parameter}
        started = {name: branch for name, branch in along.items() if len(branch[parameter])}
        if any(excitation_periods(branch) > 1 for branch in started.values()):
            draw = partial(draw_bifurcation_tree, view, parameter, started)
            plans.append(Plan("tree", f"tree-{parameter}", draw))
    return plans


def _torus_plans(view: CaseView, tori: Mapping[str, Table], cycles: Mapping[str, Table]) -> list[Plan]:
    """A diagram for every parameter and origin of tori, and the invariant curves of every branch."""
    plans = []
    for parameter in PARAMETER_AXES:
        along = [branch for branch in tori.values() if branch.attributes["parameter"] == parameter]
        behind = [b for b in cycles.values() if b.attributes["parameter"] == parameter and len(b["speed"])]
        for ending, unbalanced in (("", False), ("-unbalance", True)):
            chosen = [branch for branch in along if is_unbalanced(branch) == unbalanced]
            started = [branch for branch in chosen if len(branch["speed"])]
            diagram = partial(draw_tori, view, parameter, started, behind)
            if chosen:
                draw = diagram if started else _nothing_yet(view)
                plans.append(Plan("tori", f"tori-{parameter}{ending}", draw))
    for name, branch in tori.items():
        section = partial(draw_section, view, str(branch.attributes["parameter"]), branch, name)
        draw = section if len(branch["speed"]) else _nothing_yet(view, name)
        plans.append(Plan("section", f"section-{name}", draw))
    return plans


def _map_plans(view: CaseView, curves: Mapping[str, Table], others: Mapping[str, Table]) -> list[Plan]:
    """A map for every pair of parameters over which there are curves."""
    plans = []
    for plane in sorted({same_plane(curve) for curve in curves.values()}, key=sorted):
        inside = {name: curve for name, curve in curves.items() if same_plane(curve) == plane}
        content = PlaneView.of(inside, others)
        default = (content.x, content.y) == ("excitation_frequency", "speed")
        stem = "stability-map" if default else f"stability-map-{content.x}-{content.y}"
        started = any(len(curve["speed"]) for curve in inside.values())
        draw = partial(draw_stability_map, view, content) if started else _nothing_yet(view)
        plans.append(Plan("stability", stem, draw))
    return plans


def _run_views(tables: Mapping[str, Table]) -> list[RunView]:
    """The runs in time that have ended, with their analysis."""
    ended = {name: table for name, table in tables.items() if _kind(name) == RUNS}
    samples = {name: name.replace(f"/{RUNS}/", "/transient/") for name in ended}
    return [
        RunView(name.rsplit("/", 1)[1], table, tables[samples[name]])
        for name, table in ended.items()
        if samples[name] in tables
    ]


def _run_plans(view: CaseView, runs: Sequence[RunView], branches: Sequence[Table]) -> list[Plan]:
    """Figures of every run in time, and one of all of them."""
    kinds = {
        "waterfall": draw_waterfall,
        "spectrum": draw_spectrum,
        "poincare": draw_poincare,
        "modal-energy": draw_modal_energy,
    }
    plans = [
        Plan(kind, f"{kind}-{run.name}", partial(draw, view, run))
        for kind, draw in kinds.items()
        for run in runs
    ]
    plans += [
        Plan("envelope", f"envelope-{run.name}", partial(draw_envelope, view, run, branches)) for run in runs
    ]
    if len(runs) > 1:
        plans.append(Plan("unbalance", "unbalance", partial(draw_unbalance, view, runs)))
    return plans


def _nothing_yet(view: CaseView, branch: str = "") -> Callable[[], Figure]:
    title = f"{view.name}: branch {branch}" if branch else view.name
    return partial(style.placeholder, title, "no points yet", view.note)
