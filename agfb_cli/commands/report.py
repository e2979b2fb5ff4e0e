"""`agfb report`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from agfb_cli.console import Console, table, words
from agfb_cli.errors import ExitCode, UsageError, explained
from agfb_cli.inputs import existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.datasets.store import Store as StoreOnDisk
    from pipelines.stages.reports.operating_range import Best, OperatingRange, Stretch
    from pipelines.stages.reports.survey_summary import SurveySummary

Scales = Mapping[str, float]
BIFURCATIONS = {"fold": "fold", "period_doubling": "period doubling", "neimark_sacker": "Neimark-Sacker"}
CURVES = ("pd", "ns", "folds")


def report(
    store: Store,
    case: CasePattern = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Report the bifurcation-free speed range.

    For every excitation frequency the range extends from the lowest speed to the first period doubling,
    Neimark-Sacker point or fold on the stored curves of `agfb run`. Also reports the best excitation
    frequency and its gain. Computes only where the curves are crossed. Writes cases/CASE/operating_range,
    which `agfb figures` shades. Of a survey (`agfb survey`) it tells how much of the plane is unstable, and
    how the survey agrees with the curves.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        found, missing = operating_ranges(path, case)
        surveys = survey_summaries(path, case, found)
        missing = {name: why for name, why in missing.items() if name not in surveys}
        for name in missing:
            console.error(f"{name}: {missing[name]}")
        if not found and not surveys:
            raise UsageError(
                f"{store}: no bifurcation set to report on",
                "`agfb run CONFIG -o STORE` searches the plane of excitation frequency and speed",
            )
        written = store_ranges(path, found, console)
        show(path, found, surveys, missing, written, console)
        if missing:
            raise typer.Exit(ExitCode.CASES_FAILED)


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


def show(
    path: Path,
    found: Mapping[str, OperatingRange],
    surveys: Mapping[str, SurveySummary],
    missing: Mapping[str, str],
    written: bool,
    console: Console,
) -> None:
    """Tables on stdout, cautions on stderr; or one JSON document."""
    from pipelines.datasets.reading import case_attributes
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages import regularised, step_errors

    opened = open_for_reading(path)
    condensed = {case: condensation(opened, case) for case in found}
    uncertain = {case: step_errors.count_in(opened, curves_of(opened, case)) for case in found}
    smooth = {case: regularised.count_in(opened, curves_of(opened, case)) for case in found}
    if console.json:
        cases = {
            case: {
                **as_json(ranges),
                "condensation_error": condensed[case][0],
                "condensation_caution": condensed[case][1],
                "points_without_step_error": uncertain[case][0],
                **regularised.as_json(smooth[case]),
            }
            for case, ranges in found.items()
        }
        told = {case: summary.as_dict() for case, summary in surveys.items()}
        console.json_data(
            {"store": str(path), "written": written, "cases": cases, "surveys": told, "missing": missing}
        )
        return
    for number, (case, ranges) in enumerate(found.items()):
        scales: Scales = case_attributes(opened, case)["scales"]
        console.data(("\n" if number else "") + heading(case, ranges, scales))
        console.data(boundary_table(ranges, scales))
        for line in conclusions(ranges, scales):
            console.data(line)
        error, doubt = condensed[case]
        if error is not None:
            console.data(f"condensed rotor: modes below the highest speed at most {100.0 * error:.2g} % off")
        if where := regularised.in_words(smooth[case]):
            console.data(f"curves past kinks of the clipping: {regularised.NAME} {where}")
        if case in surveys:
            console.data(surveys[case].sentence())
        for caution in filter(None, (*ranges.cautions, doubt, step_errors.caution(uncertain[case]))):
            console.message(f"caution: {case}: {caution}")
    for case in surveys:
        if case not in found:
            console.data(f"{case}: {surveys[case].sentence()}")


def condensation(store: StoreOnDisk, case: str) -> tuple[float | None, str]:
    """Largest error of the condensed rotor's modes, None where not known, and the caution with it."""
    from pipelines.datasets.reading import read_group
    from pipelines.datasets.store import case_group

    group = case_group(case, "criticals")
    attributes = read_group(store, group, ()).attributes if store.has_group(group) else {}
    return attributes.get("condensation_error"), attributes.get("caution", "")


def curves_of(store: StoreOnDisk, case: str) -> list[str]:
    """Full names of the curves of a case."""
    from pipelines.datasets.reading import list_groups
    from pipelines.datasets.store import local_name

    return [name for name in list_groups(store, case) if local_name(name).split("/")[0] in CURVES]


def as_json(ranges: OperatingRange) -> dict[str, Any]:
    """Attributes and boundary of a range; what is not known is null."""
    rows = [ranges.boundary_data(boundary) for boundary in ranges.boundaries]
    for row, caution in zip(rows, ranges.caution, strict=True):
        row["caution"] = caution
    return {**ranges.attributes(), "boundary": rows}


def heading(case: str, ranges: OperatingRange, scales: Scales) -> str:
    """Heading of the table."""
    lowest = f"{_speed(ranges.speeds[0], scales)}"
    return f"{case}: bifurcation-free from speed {lowest} up to the first bifurcation"


def boundary_table(ranges: OperatingRange, scales: Scales) -> str:
    """One row for every part of the boundary."""
    hertz = scales["hertz_per_unit"] if ranges.parameter == "excitation_frequency" else None
    header = [words(ranges.parameter), "Hz", "up to speed", "rpm", "first bifurcation", "curve", ""]
    rows = []
    for part in ranges.stretches():
        ends = part.first.abscissa, part.last.abscissa
        rows.append(
            (
                _interval(*ends, ".4f"),
                None if hertz is None else _interval(hertz * ends[0], hertz * ends[1], ".1f"),
                *_reached(part, scales),
                _bifurcation(part),
                None if part.first.curve < 0 else ranges.curves[part.first.curve],
                "incomplete curve near" if part.caution else "",
            )
        )
    return table(header, rows)


def _reached(part: Stretch, scales: Scales) -> tuple[str | None, str | None]:
    """Speeds reached in a part, dimensionless and in rpm."""
    if part.first.base == "unstable":
        return None, None
    rpm = scales["speed_rpm_per_unit"]
    least = "at least " if part.first.is_open else ""
    return (
        least + _interval(part.lowest, part.highest, ".4f"),
        least + _interval(rpm * part.lowest, rpm * part.highest, ".0f"),
    )


def _bifurcation(part: Stretch) -> str:
    if part.first.base == "unstable":
        return "unstable from the lowest speed"
    if part.first.is_open:
        return "none in the plane"
    if part.first.bifurcation == "fold":  # which is neither supercritical nor subcritical
        return "fold"
    kinds = [kind for kind in part.criticalities if kind != "unset"]
    known = " and ".join(kinds) + (
        ", partly unknown" if kinds and len(kinds) < len(part.criticalities) else ""
    )
    return BIFURCATIONS[part.first.bifurcation] + f", {known or 'type unknown'}"


def conclusions(ranges: OperatingRange, scales: Scales) -> list[str]:
    """The best excitation frequency and its gains, a sentence each."""
    if ranges.best is None:
        return ["no excitation frequency of the plane leaves a stable cycle at the lowest speed"]
    lines = [_best_sentence(ranges, ranges.best, scales)]
    least = "at least " if ranges.best.boundary.is_open else ""
    if ranges.passive_gain is not None and ranges.passive is not None:
        passive = _speed(ranges.passive, scales)
        lines.append(f"against displacement 0 (unstable from {passive}): {least}{ranges.passive_gain:+.1%}")
    reference = ranges.reference
    if reference is not None:
        where = f"against {words(ranges.parameter)} {reference.abscissa:.4g}"
        if ranges.reference_gain is not None:
            speed = _speed(reference.speed, scales)
            lines.append(f"{where} (up to {speed}): {least}{ranges.reference_gain:+.1%}")
        else:
            why = "no bifurcation in the plane" if reference.is_open else "unstable from the lowest speed"
            lines.append(f"{where}: gain not defined, {why}")
    return lines


def _best_sentence(ranges: OperatingRange, best: Best, scales: Scales) -> str:
    found = best.boundary
    frequency = _abscissa(ranges, found.abscissa, scales)
    from_to = f"{_speed(ranges.speeds[0], scales)} to {_speed(found.speed, scales)}"
    interval = " to ".join(_abscissa(ranges, value, scales) for value in best.interval)
    if found.is_open:
        return f"best: {words(ranges.parameter)} {frequency}, nothing bounds {from_to}, nor from {interval}"
    sentence = f"best: {words(ranges.parameter)} {frequency}, free from {from_to}"
    if ranges.passive is not None and best.interval[0] < best.interval[1] and found.speed > ranges.passive:
        sentence += f"; better than displacement 0 from {interval}"
    return sentence


def _abscissa(ranges: OperatingRange, value: float, scales: Scales) -> str:
    if ranges.parameter != "excitation_frequency":
        return f"{value:.4g}"
    return f"{value:.4f} ({scales['hertz_per_unit'] * value:.1f} Hz)"


def _speed(value: float, scales: Scales) -> str:
    return f"{value:.4f} ({scales['speed_rpm_per_unit'] * value:.0f} rpm)"


def _interval(low: float, high: float, form: str) -> str:
    """Two numbers with a dash, or one if they look alike."""
    first, last = format(low, form), format(high, form)
    return first if first == last or math.isclose(low, high) else f"{first} - {last}"
