"""`agfb calibrate`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.commands.stage import Outcome, Request, stage_command
from agfb_cli.console import Console, table
from agfb_cli.errors import UsageError
from agfb_cli.inputs import load_cases, read_configuration, select_cases
from agfb_cli.options import OwnOption

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase
    from pipelines.stages.calibration.report import Calibration

HELP = """Fit machine parameters to measured or printed speeds.

Changes the keys of calibrate.parameters within their ranges until onset speeds, critical speeds, slopes of
the onset speed, growth rates of period doubling and corners, where Neimark-Sacker points end on period
doublings, meet calibrate.targets: bounded least squares with numerical derivatives. Every computed
machine is committed; an interrupted search resumes from the last one. Writes cases/CASE/calibration into the
store and shows target and reached values, the fitted values, how well the targets determine them, and the
--set assignments of the fitted machine. Exit code 3 if the search did not converge.
"""

WRITE = OwnOption(
    "write",
    Annotated[
        Path | None,
        typer.Option(
            "--write",
            metavar="FILE.toml",
            help="Write a copy of CONFIG with the fitted values; comments are kept.",
        ),
    ],
    None,
    before="dry_run",
)


def _admit(named_cases: Sequence[NamedCase], request: Request, _console: Console) -> None:
    """Raise UsageError for a copy that cannot be written."""
    write: Path | None = request.own["write"]
    if write is not None and len(named_cases) > 1:
        raise UsageError("--write: one case at a time", "choose the case with --case")
    if write is not None and write.exists():
        raise UsageError(f"--write {write}: this file exists already", "name another, or remove it")


def _conclude(outcome: Outcome, request: Request, console: Console) -> None:
    """Show the calibrations, as tables or as one JSON document, and write the copy if asked for."""
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages.calibration.report import read_calibration

    chosen = select_cases(load_cases(request.config, request.assignments, stages=()), request.case_pattern)
    opened = open_for_reading(request.store)
    read = [read_calibration(opened, named.case_id, named.case) for named in chosen]
    found = [calibration for calibration in read if calibration is not None]
    write: Path | None = request.own["write"]
    if write is not None and found:
        write_copy(found[0], request, write, console)
    if console.json:
        cases = {each.case_id: each.as_dict() for each in found}
        console.json_data({"store": str(request.store), "results": outcome.records(), "cases": cases})
        return
    named = {each.case_id: each for each in chosen}
    for calibration in found:
        show(calibration, named[calibration.case_id], console)


def show(found: Calibration, named: NamedCase, console: Console) -> None:
    """Show targets, parameters, undetermined directions, and assignments in the units of the file."""
    from pipelines.case.rewriting import in_units_of_file

    wanted = {"exact": "{:.6g}", "upper": "at most {:.6g}", "lower": "at least {:.6g}"}
    rows = [
        (row.target, row.unit, wanted[row.limit].format(row.wanted), row.reached, row.difference,
         row.deviation, row.bifurcation.replace("_", " ").replace("unset", "-"), row.remark)
        for row in found.targets
    ]  # fmt: skip
    header = ("target", "unit", "wanted", "reached", "difference", "in uncertainties", "bifurcation", "")
    console.data(f"\n{found.case_id}: {found.machines} machines")
    console.data(table(header, rows))
    bounds = {"": "", "lowest": "at the lowest of its range", "highest": "at the highest of its range"}
    parameters = [
        (", ".join(row.keys), row.before, row.after, row.uncertainty, row.sensitivity, bounds[row.bound])
        for row in found.parameters
    ]
    console.data("")
    console.data(table(("parameter", "before", "after", "uncertainty", "sensitivity", ""), parameters))
    for direction in found.undetermined:
        parts = ", ".join(f"{key} {part:+.2f}" for key, part in direction.items())
        console.data(f"not determined by the targets, in parts of the ranges: {parts}")
    console.data("")
    for key, value in in_units_of_file(named, found.values).items():
        console.data(f"--set {key}={value!r}")


def write_copy(found: Calibration, request: Request, path: Path, console: Console) -> None:
    """Write the configuration with the found values; raises UsageError where a key is not in its text."""
    from pipelines.case.rewriting import NotWrittenError, with_values

    try:
        text = with_values(read_configuration(request.config), found.values)
    except NotWrittenError as error:
        raise UsageError(
            f"--write: {error}", "use the --set assignments that are shown without --write"
        ) from None
    path.write_text(text, encoding="utf-8")
    if request.assignments:
        console.message(f"{path}: without the --set assignments of this command")
    console.message(f"wrote {path}")


calibrate = stage_command(("calibrate",), (WRITE,), admit=_admit, conclude=_conclude)
