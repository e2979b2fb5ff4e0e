"""`agfb export`."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.console import Console
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import beside, existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.datasets.store import Store as OpenStore


class FileFormat(StrEnum):
    """What other programs read."""

    csv = "csv"
    netcdf = "netcdf"
    mat = "mat"
    ross = "ross"


Folder = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FOLDER", help="Default: NAME-export beside the store NAME.zarr."),
]
Kind = Annotated[
    FileFormat,
    typer.Option("--format", help="Tables, netCDF 3 (needs xarray), MATLAB, or bearings of ROSS 3."),
]
Full = Annotated[bool, typer.Option("--full", help="Also states, orbits and films, which are large.")]
Overwrite = Annotated[bool, typer.Option("--force", help="Replace existing files.")]


def export(
    store: Store,
    output: Folder = None,
    file_format: Kind = FileFormat.csv,
    case: CasePattern = None,
    full: Full = False,
    force: Overwrite = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Write a store as files for other programs.

    Comma-separated tables (one per group and dimension, with comment lines that explain the columns), netCDF
    (one file per group), MATLAB (one file per case), or the coefficients of every bearing for ROSS 3. Numbers
    keep all digits; units are included.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        folder = output or beside(path, "export")
        if file_format is FileFormat.netcdf:
            require_xarray()
        from pipelines.datasets.reading import list_cases
        from pipelines.datasets.store import open_for_reading

        opened = open_for_reading(path)
        chosen = matching(list_cases(opened), case)
        written = write(opened, chosen, folder, file_format.value, full, force)
        if json:
            console.json_data({"store": str(path), "files": [str(each) for each in written]})
        else:
            for each in written:
                console.data(str(each))


def write(
    store: OpenStore, cases: Sequence[str], folder: Path, kind: str, full: bool, force: bool
) -> list[Path]:
    """Export the cases; raises UsageError before anything is written where files would be replaced."""
    from pipelines.datasets.exporting import planned_files, write_files

    files = [planned for case in cases for planned in planned_files(store, case, folder, kind, full)]
    if kind == FileFormat.ross and not files:
        raise UsageError("no case has coefficients of bearings", "`agfb coefficients CONFIG` computes them")
    taken = [planned.path for planned in files if planned.path.exists()]
    if taken and not force:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        raise UsageError(
            f"{taken[0]}{more}: there already", "replace with --force, or name another folder with -o"
        )
    return write_files(files)


def require_xarray() -> None:
    """Raise UsageError where the optional package is missing."""
    from importlib.util import find_spec

    if find_spec("xarray") is None:
        raise UsageError("netCDF files need xarray", "pip install 'agfb[export]', or choose csv or mat")
