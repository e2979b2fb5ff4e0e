"""`agfb table`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.commands.export import require_xarray
from agfb_cli.commands.report import operating_ranges, store_ranges
from agfb_cli.console import Console, table
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.datasets.case_table import CaseTable

FORMATS = (".csv", ".nc")
File = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="Write the table: .csv, or .nc for netCDF 3 (needs xarray)."
    ),
]
Overwrite = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]


def case_table(
    store: Store,
    output: File = None,
    case: CasePattern = None,
    force: Overwrite = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Show one row for each case: its inputs and its results.

    Inputs are the configuration keys in which the cases differ. Results are what the store holds: the
    instability speed, critical speeds, the first bifurcation of the branch cycles/b000, and the best
    excitation frequency with its gain and the margin of the operating point, as of `agfb report`, which is
    done for cases with a bifurcation set.
    Missing results are empty; the last column tells which stages failed.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        if output is not None:
            refuse_file(output, force)
        found, _ = operating_ranges(path, case)
        store_ranges(path, found, console)
        rows = read_table(path, case)
        if output is not None:
            write(rows, output)
        if json:
            cases: Mapping[str, object] = as_json(rows)
            console.json_data({"store": str(path), "file": None if output is None else str(output), **cases})
        elif output is not None:
            console.data(str(output))
        else:
            console.data(shown(rows))


def refuse_file(output: Path, force: bool) -> None:
    """Raise UsageError for a file that cannot be written."""
    if output.suffix not in FORMATS:
        raise UsageError(f"{output}: its ending must be {' or '.join(FORMATS)}")
    if output.suffix == ".nc":
        require_xarray()
    if output.exists() and not force:
        raise UsageError(f"{output}: there already", "replace it with --force, or name another file with -o")


def read_table(path: Path, pattern: str | None) -> CaseTable:
    """The table of the chosen cases."""
    from pipelines.datasets.case_table import case_table as rows_of
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading

    opened = open_for_reading(path)
    return rows_of(opened, matching(list_cases(opened), pattern))


def write(rows: CaseTable, output: Path) -> None:
    """Write the file at once and whole."""
    from pipelines.datasets.case_table import csv_of, netcdf_of
    from pipelines.datasets.durable import make_folder, replace_file

    make_folder(output.parent, durable=False)
    replace_file(output, csv_of(rows) if output.suffix == ".csv" else netcdf_of(rows), durable=False)


def shown(rows: CaseTable) -> str:
    """The table with five digits."""
    header = [column.name for column in rows.columns]
    columns = [
        [f"{value:.5g}" if value == value else None for value in column.values.tolist()]
        if column.is_number
        else column.values.tolist()
        for column in rows.columns
    ]
    return table(header, list(zip(*columns, strict=True)))


def as_json(rows: CaseTable) -> dict[str, object]:
    """Units and meanings of the columns, and the rows by case; what is missing is null."""
    described = {
        role: {column.name: {"unit": column.unit, "meaning": column.meaning} for column in columns}
        for role, columns in (("inputs", rows.inputs), ("outputs", rows.outputs))
    }
    values = {
        case: {column.name: _plain(column.values[place].item()) for column in (*rows.inputs, *rows.outputs)}
        for place, case in enumerate(rows.cases)
    }
    return {**described, "cases": values}


def _plain(value: float | str) -> float | str | None:
    return None if value != value or value == "" else value
