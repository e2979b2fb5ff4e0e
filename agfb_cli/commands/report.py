"""`agfb report`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agfb_cli import range_text
from agfb_cli.console import Console, table
from agfb_cli.errors import ExitCode, UsageError, explained
from agfb_cli.inputs import existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose
from agfb_cli.surroundings import load_matplotlib

if TYPE_CHECKING:
    from pipelines.datasets.store import Store as StoreOnDisk
    from pipelines.stages.curves.open_ends import OpenEnd
    from pipelines.stages.regularised import Regularised
    from pipelines.stages.reports.operating_range import OperatingRange
    from pipelines.stages.reports.survey_summary import SurveySummary

Page = Annotated[
    Path | None,
    typer.Option(
        "--html", metavar="FILE", help="Write a report of all that the store holds as one HTML page."
    ),
]
Overwrite = Annotated[bool, typer.Option("--force", help="Replace an existing page.")]


def report(
    store: Store,
    html: Page = None,
    case: CasePattern = None,
    force: Overwrite = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Report the bifurcation-free speed range.

    For every excitation frequency the range extends from the lowest speed to the first period doubling,
    Neimark-Sacker point or fold on the stored curves of `agfb run`. Also reports the best excitation
    frequency and its gain, and the margin of the operating point: its distances from the boundaries of
    stable cycles. Computes only where the curves are crossed. Writes cases/CASE/operating_range,
    which `agfb figures` shades. Of a survey (`agfb survey`) it tells how much of the plane is unstable, and
    how the survey agrees with the curves.

    With --html also writes a page with figures, tables and warnings that needs no network. On its stability
    map a click shows the nearest stored cycle. It holds whatever the store holds, and says what is missing.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        if html is not None:
            refuse_page(html, force)
        found, missing = operating_ranges(path, case)
        surveys = survey_summaries(path, case, found)
        missing = {name: why for name, why in missing.items() if name not in surveys}
        for name in missing:
            console.error(f"{name}: {missing[name]}")
        if not found and not surveys and html is None:
            raise UsageError(
                f"{store}: no bifurcation set to report on",
                "`agfb run CONFIG -o STORE` searches the plane of excitation frequency and speed; "
                "--html FILE reports on what there is",
            )
        written = store_ranges(path, found, console)
        told = gather(path, found, surveys)
        if html is not None:
            write_page(path, html, case, told, missing, console)
        show(path, html, told, missing, written, console)
        if missing and html is None:
            raise typer.Exit(ExitCode.CASES_FAILED)


def refuse_page(html: Path, force: bool) -> None:
    """Raise UsageError for a page that cannot be written."""
    if html.suffix != ".html":
        raise UsageError(f"{html}: its ending must be .html")
    if html.exists() and not force:
        raise UsageError(
            f"{html}: there already", "replace it with --force, or name another file with --html"
        )


def operating_ranges(path: Path, pattern: str | None) -> tuple[dict[str, OperatingRange], dict[str, str]]:
    """The ranges of the chosen cases, and why others have none."""
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages.reports.operating_range import NoSetError, operating_range

    opened = open_for_reading(path)
    found: dict[str, OperatingRange] = {}
    missing: dict[str, str] = {}
    for case in matching(list_cases(opened), pattern):
        try:
            found[case] = operating_range(opened, case)
        except NoSetError as error:
            missing[case] = str(error)
    return found, missing


def survey_summaries(
    path: Path, pattern: str | None, ranges: Mapping[str, OperatingRange]
) -> dict[str, SurveySummary]:
    """What there is to say of the surveys of the chosen cases."""
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages.reports.survey_summary import survey_summary

    opened = open_for_reading(path)
    chosen = matching(list_cases(opened), pattern)
    summaries = {case: survey_summary(opened, case, ranges.get(case)) for case in chosen}
    return {case: summary for case, summary in summaries.items() if summary is not None}


def store_ranges(path: Path, found: Mapping[str, OperatingRange], console: Console) -> bool:
    """Write the ranges into their store; False, with a message, if it is read-only."""
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages.reports.operating_range import write_operating_range

    opened = open_for_reading(path)
    written = [write_operating_range(opened, case, ranges) for case, ranges in found.items()]
    if not all(written):
        console.message(f"{path} cannot be written: the range is shown only")
    return all(written)


@dataclass(frozen=True)
class Told:
    """What there is to say of a case: its range and its survey, as far as it has them, and doubts.

    ``condensation``: largest error of the condensed rotor's modes; ``uncertain``: points of the curves whose
    error by the time steps is unknown; ``regularised``: points with regularised clipping; ``open_ends``: of
    curves inside the plane.
    """

    scales: range_text.Scales
    ranges: OperatingRange | None
    survey: SurveySummary | None
    condensation: float | None
    condensation_caution: str
    uncertain: int
    regularised: Regularised
    open_ends: tuple[OpenEnd, ...]
    cautions: tuple[str, ...]

    def sentences(self) -> list[str]:
        """Conclusions before the tables of the margin."""
        if self.ranges is None:
            return []
        conclusions = range_text.conclusions(self.ranges, self.scales)
        return [*conclusions, range_text.operating_point(self.ranges, self.scales)]

    def remarks(self) -> list[str]:
        """Sentences behind the tables."""
        from pipelines.stages import regularised

        found = []
        if self.ranges is not None and self.condensation is not None:
            error = f"{100.0 * self.condensation:.2g} %"
            found.append(f"condensed rotor: modes below the highest speed at most {error} off")
        if self.ranges is not None and (where := regularised.in_words(self.regularised)):
            found.append(f"curves past kinks of the clipping: {regularised.NAME} {where}")
        return found if self.survey is None else [*found, self.survey.sentence()]

    def caution(self, console: Console, case: str) -> None:
        """Tell the doubts, a line each."""
        for caution in self.cautions:
            console.message(f"caution: {case}: {caution}")


def gather(
    path: Path, found: Mapping[str, OperatingRange], surveys: Mapping[str, SurveySummary]
) -> dict[str, Told]:
    """What there is to say of each case with a range, then of those with a survey alone."""
    from pipelines.datasets.reading import case_attributes
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages import regularised, step_errors
    from pipelines.stages.curves.open_ends import caution as caution_of
    from pipelines.stages.curves.open_ends import open_ends

    opened, told = open_for_reading(path), {}
    for case in [*found, *(case for case in surveys if case not in found)]:
        ranges = found.get(case)
        error, doubt = condensation(opened, case)
        curves = curves_of(opened, case)
        uncertain = step_errors.count_in(opened, curves)
        loose = () if ranges is None else tuple(open_ends(opened, case))
        doubts = (doubt, step_errors.caution(uncertain), caution_of(loose))
        cautions = (*(() if ranges is None else ranges.cautions), *doubts)
        told[case] = Told(
            case_attributes(opened, case)["scales"],
            ranges,
            surveys.get(case),
            error,
            doubt,
            uncertain[0],
            regularised.count_in(opened, curves),
            loose,
            tuple(filter(None, cautions)),
        )
    return told


def show(
    path: Path,
    html: Path | None,
    told: Mapping[str, Told],
    missing: Mapping[str, str],
    written: bool,
    console: Console,
) -> None:
    """Tables on stdout, cautions on stderr; or one JSON document."""
    if console.json:
        console.json_data(
            {
                "store": str(path),
                "written": written,
                "page": None if html is None else str(html),
                "cases": {case: as_json(each) for case, each in told.items() if each.ranges is not None},
                "surveys": {
                    case: each.survey.as_dict() for case, each in told.items() if each.survey is not None
                },
                "missing": dict(missing),
            }
        )
        return
    first = True
    for case, each in told.items():
        if each.ranges is None:
            console.data("\n".join(f"{case}: {remark}" for remark in each.remarks()))
            each.caution(console, case)
            continue
        console.data(("" if first else "\n") + range_text.heading(case, each.ranges, each.scales))
        first = False
        console.data(table(*range_text.boundary_rows(each.ranges, each.scales)))
        for sentence in each.sentences():
            console.data(sentence)
        if each.ranges.margin is not None:
            console.data(table(*range_text.margin_rows(each.ranges.margin, each.scales)))
        for remark in each.remarks():
            console.data(remark)
        each.caution(console, case)
    if html is not None:
        console.data(str(html))


def as_json(told: Told) -> dict[str, Any]:
    """Attributes and boundary of a range; what is not known is null."""
    from pipelines.stages import regularised

    ranges = told.ranges
    assert ranges is not None
    rows = [ranges.boundary_data(boundary) for boundary in ranges.boundaries]
    for row, caution in zip(rows, ranges.caution, strict=True):
        row["caution"] = caution
    attributes = ranges.attributes()
    if attributes["margin"] is not None:
        attributes["margin"] = range_text.with_units(attributes["margin"], told.scales)
    return {
        **attributes,
        "boundary": rows,
        "condensation_error": told.condensation,
        "condensation_caution": told.condensation_caution,
        "points_without_step_error": told.uncertain,
        **regularised.as_json(told.regularised),
        "open_ends": [end.as_dict() for end in told.open_ends],
    }


def condensation(store: StoreOnDisk, case: str) -> tuple[float | None, str]:
    """Largest error of the condensed rotor's modes, None where not known, and the caution with it."""
    from pipelines.datasets.reading import read_group
    from pipelines.datasets.store import case_group

    group = case_group(case, "criticals")
    attributes = read_group(store, group, ()).attributes if store.has_group(group) else {}
    return attributes.get("condensation_error"), attributes.get("caution", "")


def curves_of(store: StoreOnDisk, case: str) -> list[str]:
    """Full names of the curves of a case."""
    from pipelines.datasets.curves import CURVE_CONTAINERS
    from pipelines.datasets.reading import list_groups
    from pipelines.datasets.store import local_name

    return [name for name in list_groups(store, case) if local_name(name).split("/")[0] in CURVE_CONTAINERS]


def write_page(
    path: Path,
    html: Path,
    pattern: str | None,
    told: Mapping[str, Told],
    missing: Mapping[str, str],
    console: Console,
) -> None:
    """Write the page of the chosen cases at once and whole."""
    load_matplotlib()
    from pipelines.datasets.durable import make_folder, replace_file
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading
    from pipelines.figures.page.report_page import report_page

    opened = open_for_reading(path)
    cases = matching(list_cases(opened), pattern)
    console.message("drawing the page")
    concluded = {case: conclusions(told.get(case), missing.get(case, "")) for case in cases}
    page = report_page(opened, cases, concluded, console.message)
    make_folder(html.parent, durable=False)
    replace_file(html, page, durable=False)


def conclusions(told: Told | None, missing: str) -> Any:
    """What the page repeats of the report of a case."""
    from pipelines.figures.page.case_section import Conclusions, ToldTable

    if told is None:
        return Conclusions(missing=missing)
    tables = []
    if told.ranges is not None:
        header, rows = range_text.boundary_rows(told.ranges, told.scales)
        tables.append(ToldTable("Bifurcation-free operating range", header, rows))
        if told.ranges.margin is not None:
            header, rows = range_text.margin_rows(told.ranges.margin, told.scales)
            tables.append(ToldTable("Margin of the operating point", header, rows))
    # the page itself tells the cautions of the groups, that of the condensation with them
    cautions = [caution for caution in told.cautions if caution != told.condensation_caution]
    return Conclusions([*told.sentences(), *told.remarks()], tables, cautions, missing)
