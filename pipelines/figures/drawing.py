"""All figures of a store: which exist, what each needs, and where their files go.

Of the branches of cycles those of `continue-cycles` (``b000``, ...) and their period-doubled ones (``d000``,
...) are drawn. The lines that searched the plane (``s000``, ...) are not: there are dozens, and what they
found is in the stability map.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from types import MappingProxyType

from matplotlib.figure import Figure

from pipelines.datasets.case_table import case_table
from pipelines.datasets.reading import case_attributes, list_cases
from pipelines.datasets.store import Store, StoreError, open_for_reading
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.bifurcation_diagram import draw_bifurcation_diagram
from pipelines.figures.bifurcation_tree import draw_bifurcation_tree
from pipelines.figures.bode import draw_bode
from pipelines.figures.campbell import draw_campbell
from pipelines.figures.case_tables import RUNS, CaseTables, Notify, kind_of, read_case
from pipelines.figures.certificate import draw_certificate, newest_certificate
from pipelines.figures.coefficients import draw_coefficients
from pipelines.figures.condensation import draw_condensation
from pipelines.figures.contents import CaseView, FigurePlan, MissingDataError, Table, excitation_periods
from pipelines.figures.critical_map import draw_critical_map
from pipelines.figures.linearization import draw_linearization
from pipelines.figures.machine_drawing import draw_machine
from pipelines.figures.multipliers import draw_multipliers
from pipelines.figures.operating_point import draw_operating_point
from pipelines.figures.orbits import draw_film, draw_orbits
from pipelines.figures.polar import draw_polar
from pipelines.figures.response_envelope import draw_envelope, draw_unbalance
from pipelines.figures.run_motion import draw_modal_energy, draw_poincare, draw_spectrum, draw_waterfall
from pipelines.figures.runs import RunView
from pipelines.figures.sensitivity import TABLE_KINDS, table_plans
from pipelines.figures.several_cases import JOINT_KINDS, joint_plans
from pipelines.figures.stability_map import draw_stability_map, map_stem, planes_of
from pipelines.figures.survey import draw_survey
from pipelines.figures.tori import draw_section, draw_tori, is_unbalanced

# Figure: kind of the group it is drawn from.
FIGURE_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "machine",
        "linearization": "linear",
        "operating-point": "operating_point",
        "coefficients": "coefficients",
        "campbell": "criticals",
        "critical-map": "criticals",
        "condensation": "criticals",
        "bode": "unbalance_response",
        "polar": "unbalance_response",
        "bifurcation": "cycles",
        "multipliers": "cycles",
        "orbits": "cycles",
        "film": "cycles",
        "tree": "cycles",
        "stability": "curve",
        "survey": "survey",
        "certificate": "certificate",
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
        "bode": ("linear",),
        "bifurcation": ("refinement",),
        "stability": ("criticals", "bifurcation_set", "operating_range", "refinement"),
        "survey": ("curve",),
        "certificate": ("curve",),
        "tori": ("cycles",),
        "envelope": ("transient", "cycles"),
        **dict.fromkeys(("unbalance", "waterfall", "spectrum", "poincare", "modal-energy"), ("transient",)),
    }
)
ON_REQUEST = frozenset({"changes"})
"""Kinds that are drawn only where they are asked for."""
ALL_KINDS = (*FIGURE_KINDS, *JOINT_KINDS, *TABLE_KINDS)


def _ignore(message: str) -> None:
    """Notify nobody."""


def draw_figures(
    store: Store | Path | str,
    output_folder: Path | str,
    formats: Sequence[str] = ("png",),
    cases: str = "*",
    kinds: Collection[str] | None = None,
    notify: Notify = _ignore,
) -> list[Path]:
    """Draw the figures of a store and return the files written.

    ``<output_folder>/<case>/<figure>.<format>``; those of several cases together are
    ``<output_folder>/<figure>.<format>``.

    ``cases`` is a glob over case ids; ``kinds`` chooses among ``ALL_KINDS`` (all when None). A figure
    whose data are not in the store is left out; if it was chosen, ``notify`` gets the reason once for each
    kind of group that is missing. One whose branch has no point yet says so in the picture. The store may
    still be written meanwhile. A damaged group is left out too, and raised when everything else is drawn.

    Raises ValueError for an unknown format or figure or a glob that no case matches, StoreError for a store
    that cannot be read, OSError where the files cannot be written.
    """
    _refuse_unknown("format", formats, style.FORMATS)
    written: list[Path] = []
    damaged: list[StoreError] = []
    for stem, plan in _planned(store, cases, kinds, notify, damaged):
        try:
            figure = plan.draw()
        except MissingDataError as missing:
            notify(f"{stem} is left out: {missing}")
            continue
        written += [style.save_figure(figure, Path(output_folder) / f"{stem}.{suffix}") for suffix in formats]
    if damaged:
        raise damaged[0]
    return written


def draw_one_figure(
    store: Store | Path | str,
    path: Path,
    cases: str = "*",
    kinds: Collection[str] | None = None,
    notify: Notify = _ignore,
) -> Path:
    """Draw the only figure that cases and kinds select into a file, whose suffix is the format.

    Raises ValueError where they leave none or several; else as `draw_figures`.
    """
    damaged: list[StoreError] = []
    plans = list(_planned(store, cases, kinds, notify, damaged))
    if damaged:
        raise damaged[0]
    if len(plans) != 1:
        names = ", ".join(str(stem) for stem, _ in plans[:10])
        found = (
            f"{len(plans)} figures ({names}{', ...' if len(plans) > 10 else ''})" if plans else "no figure"
        )
        raise ValueError(f"{path.name} can hold one figure, but the chosen cases and kinds make {found}")
    ((stem, plan),) = plans
    try:
        return style.save_figure(plan.draw(), path)
    except MissingDataError as missing:
        raise ValueError(f"{stem} cannot be drawn: {missing}") from missing


def _refuse_unknown(what: str, given: Collection[str], allowed: Sequence[str]) -> None:
    if unknown := [name for name in given if name not in allowed]:
        raise ValueError(f"unknown {what} {', '.join(unknown)}; allowed are {', '.join(allowed)}")


def _planned(
    store: Store | Path | str,
    cases: str,
    kinds: Collection[str] | None,
    notify: Notify,
    damaged: list[StoreError],
) -> Iterator[tuple[Path, FigurePlan]]:
    """Every figure with the stem of its file below the folder: case by case, then of several cases."""
    _refuse_unknown("figure", kinds or (), ALL_KINDS)
    opened = store if isinstance(store, Store) else open_for_reading(store)
    known = list_cases(opened)
    chosen = [case for case in known if fnmatchcase(case, cases)]
    if not chosen:
        raise ValueError(f"no case matches {cases!r}; the store holds {', '.join(known) or 'no case'}")
    # what a store lacks is told only to those who asked for it
    asked, kinds = bool(kinds), kinds or ALL_KINDS
    for case in chosen:
        for plan in _plans(opened, case, kinds, notify, damaged, asked=asked):
            yield Path(case) / plan.stem, plan
    joint = [kind for kind in kinds if kind in JOINT_KINDS]
    if joint and (asked or len(chosen) > 1):
        needed = {group for kind in joint for group in JOINT_KINDS[kind]}
        # a group that cannot be read was told with the figures of its case, if there are any
        read = [read_case(opened, case, needed, notify if asked else _ignore, damaged) for case in chosen]
        found = [case for case in read if case is not None]
        for plan in joint_plans(found, joint, notify if asked else _ignore):
            yield Path(plan.stem), plan
    of_table = [kind for kind in kinds if kind in TABLE_KINDS and (asked or kind not in ON_REQUEST)]
    if of_table and (asked or len(chosen) > 1):
        for plan in _table_plans(opened, chosen, of_table, notify if asked else _ignore, damaged):
            yield Path(plan.stem), plan


def _table_plans(
    store: Store, cases: Sequence[str], kinds: Sequence[str], notify: Notify, damaged: list[StoreError]
) -> list[FigurePlan]:
    """The figures of all cases' inputs and results; collects the error of an unreadable group."""
    try:
        table = case_table(store, cases)
        note = str(case_attributes(store, cases[0]).get("reconstruction") or "")
    except StoreError as error:
        notify(f"{' and '.join(kinds)} left out: {error.message}")
        damaged.append(error)
        return []
    return list(table_plans(table, kinds, note, notify))


def _plans(
    store: Store, case: str, kinds: Collection[str], notify: Notify, damaged: list[StoreError], *, asked: bool
) -> list[FigurePlan]:
    """The figures of a case, in the order of ``FIGURE_KINDS``.

    Reports which groups are missing, if ``asked`` for, and collects the errors of unreadable groups.
    """
    own = [kind for kind in FIGURE_KINDS if kind in kinds]
    needed = {FIGURE_KINDS[kind] for kind in own}.union(*(BESIDE.get(kind, ()) for kind in own))
    held = read_case(store, case, needed, notify, damaged) if own else None
    if held is None:
        return []
    if asked:
        _notify_missing(case, own, {kind_of(name) for name in held.tables}, notify)
    view, branches = held.view, held.of_kind("cycles")
    plans = [plan for kind in held.single for plan in _single_plans(view, kind, held.single)]
    plans += [
        *_bifurcation_plans(view, branches, held.single.get("refinement")),
        *_branch_plans(view, branches),
        *_tree_plans(view, branches),
        *_run_plans(view, held.runs, list(branches.values())),
        *_map_plans(held),
        *_survey_plans(held),
        *_certificate_plans(held),
        *_torus_plans(view, held.of_kind("tori"), branches),
    ]
    if asked and "tree" in own and branches and not any(plan.kind == "tree" for plan in plans):
        notify(f"{case}: tree is left out: it has no branch of doubled cycles (continue_cycles.doublings)")
    return sorted((plan for plan in plans if plan.kind in own), key=lambda plan: own.index(plan.kind))


def _notify_missing(case: str, kinds: Collection[str], held: Collection[str], notify: Notify) -> None:
    """Report once for every missing kind of group which figures need it."""
    missing: dict[str, list[str]] = {}
    for kind, group in FIGURE_KINDS.items():
        if kind in kinds and group not in held:
            missing.setdefault(group, []).append(kind)
    for group, figures in missing.items():
        left = f"{', '.join(figures)} {'are' if len(figures) > 1 else 'is'} left out"
        notify(f"{case}: {left}: the store has no group {group!r} for this case")


def _single_plans(view: CaseView, kind: str, groups: Mapping[str, Table]) -> list[FigurePlan]:
    """Figures of one kind among the ``groups`` that a case has at most once."""
    table = groups[kind]
    if kind == "machine":
        return [FigurePlan("machine", "machine", partial(draw_machine, view))]
    if kind == "criticals":
        critical_map = FigurePlan("critical-map", "critical-map", partial(draw_critical_map, view, table))
        return [
            FigurePlan("campbell", "campbell", partial(draw_campbell, view, table)),
            *([critical_map] if "support_stiffness" in table else []),
            FigurePlan("condensation", "condensation", partial(draw_condensation, view, table)),
        ]
    if kind == "operating_point":
        return [FigurePlan("operating-point", "operating-point", partial(draw_operating_point, view, table))]
    if kind == "coefficients":
        return [FigurePlan("coefficients", "coefficients", partial(draw_coefficients, view, table))]
    if kind == "unbalance_response":
        return [
            FigurePlan("bode", "bode", partial(draw_bode, view, table, groups.get("linear"))),
            FigurePlan("polar", "polar", partial(draw_polar, view, table)),
        ]
    if kind == "linear":
        draw = partial(draw_linearization, view, table)
        return [
            FigurePlan("linearization", "linearization", draw if len(table["speed"]) else _nothing_yet(view))
        ]
    return []


def _bifurcation_plans(
    view: CaseView, branches: Mapping[str, Table], refinement: Table | None
) -> list[FigurePlan]:
    """One diagram for all branches along the same parameter."""
    plans = []
    for parameter in PARAMETER_AXES:
        along = [branch for branch in branches.values() if branch.attributes.get("parameter") == parameter]
        started = [branch for branch in along if len(branch["speed"])]
        diagram = partial(draw_bifurcation_diagram, view, parameter, started, refinement)
        draw = diagram if started else _nothing_yet(view)
        if along:
            plans.append(FigurePlan("bifurcation", f"bifurcation-{parameter}", draw))
    return plans


def _branch_plans(view: CaseView, branches: Mapping[str, Table]) -> list[FigurePlan]:
    """Figures of each single branch."""
    plans = []
    for name, branch in branches.items():
        parameter = str(branch.attributes["parameter"])
        for kind, draw in (("multipliers", draw_multipliers), ("orbits", draw_orbits), ("film", draw_film)):
            started = len(branch["speed"]) > 0
            call = partial(draw, view, parameter, branch, name) if started else _nothing_yet(view, name)
            plans.append(FigurePlan(kind, f"{kind}-{name}", call))
    return plans


def _tree_plans(view: CaseView, branches: Mapping[str, Table]) -> list[FigurePlan]:
    """A tree for every parameter along which there are period-doubled branches."""
    plans = []
    for parameter in PARAMETER_AXES:
        along = {n: b for n, b in branches.items() if b.attributes.get("parameter") == parameter}
        started = {name: branch for name, branch in along.items() if len(branch[parameter])}
        if any(excitation_periods(branch) > 1 for branch in started.values()):
            draw = partial(draw_bifurcation_tree, view, parameter, started)
            plans.append(FigurePlan("tree", f"tree-{parameter}", draw))
    return plans


def _torus_plans(view: CaseView, tori: Mapping[str, Table], cycles: Mapping[str, Table]) -> list[FigurePlan]:
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
                plans.append(FigurePlan("tori", f"tori-{parameter}{ending}", draw))
    for name, branch in tori.items():
        section = partial(draw_section, view, str(branch.attributes["parameter"]), branch, name)
        draw = section if len(branch["speed"]) else _nothing_yet(view, name)
        plans.append(FigurePlan("section", f"section-{name}", draw))
    return plans


def _map_plans(case: CaseTables) -> list[FigurePlan]:
    """A map for every pair of parameters over which there are curves."""
    plans = []
    for content in planes_of(case.curves, case.single):
        started = any(len(curve["speed"]) for curve in content.tables.values())
        draw = partial(draw_stability_map, case.view, content) if started else _nothing_yet(case.view)
        plans.append(FigurePlan("stability", map_stem("stability-map", content.x, content.y), draw))
    return plans


def _survey_plans(case: CaseTables) -> list[FigurePlan]:
    """The map of a survey, under the curves of its plane."""
    table = case.single.get("survey")
    if table is None:
        return []
    draw = partial(draw_survey, case.view, table, case.curves)
    started = len(table["across"]) > 0
    return [FigurePlan("survey", "survey", draw if started else _nothing_yet(case.view))]


def _certificate_plans(case: CaseTables) -> list[FigurePlan]:
    """The newest certificate."""
    newest = newest_certificate(case)
    if newest is None:
        return []
    draw = partial(draw_certificate, case.view, newest, case.curves)
    return [FigurePlan("certificate", "certificate", draw)]


def _run_plans(view: CaseView, runs: Sequence[RunView], branches: Sequence[Table]) -> list[FigurePlan]:
    """Figures of every transient, and one figure of all of them."""
    kinds = {
        "waterfall": draw_waterfall,
        "spectrum": draw_spectrum,
        "poincare": draw_poincare,
        "modal-energy": draw_modal_energy,
    }
    plans = [
        FigurePlan(kind, f"{kind}-{run.name}", partial(draw, view, run))
        for kind, draw in kinds.items()
        for run in runs
    ]
    plans += [
        FigurePlan("envelope", f"envelope-{run.name}", partial(draw_envelope, view, run, branches))
        for run in runs
    ]
    if len(runs) > 1:
        plans.append(FigurePlan("unbalance", "unbalance", partial(draw_unbalance, view, runs)))
    return plans


def _nothing_yet(view: CaseView, branch: str = "") -> Callable[[], Figure]:
    title = f"{view.name}: branch {branch}" if branch else view.name
    return partial(style.placeholder, title, "no points yet", view.note)
