"""Options that several commands share, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from agfb_cli import completion

Config = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        readable=False,  # what cannot be read is told with the errors of the system
        help="TOML file that describes the case or cases.",
        autocompletion=completion.configurations,
    ),
]
Store = Annotated[
    Path,
    typer.Argument(
        metavar="STORE",
        readable=False,
        help="Store written by an earlier command.",
        autocompletion=completion.stores,
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="STORE",
        readable=False,
        help="Store to write. Default: build/NAME.zarr for NAME.toml.",
        autocompletion=completion.stores,
    ),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Replace one key of the configuration, for instance excitation.displacement=0.1. Repeatable.",
        autocompletion=completion.assignments,
    ),
]
CasePattern = Annotated[
    str | None,
    typer.Option(
        "--case", metavar="GLOB", help="Only the cases whose name matches.", autocompletion=completion.cases
    ),
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run", help="Show what is stored, what would be computed and how long it may take, and stop."
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Start afresh: an existing store is moved aside, never deleted.")
]
Refine = Annotated[
    bool,
    typer.Option(
        "--refine", help="Afterwards recompute located bifurcations on finer grids and estimate their errors."
    ),
]
NoFigures = Annotated[bool, typer.Option("--no-figures", help="Compute only, and draw nothing.")]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=1, max=1000, help="Processes that compute cases side by side."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="WHERE",
        help="sync: this process; local: --workers processes, by default one per core; tcp://HOST:PORT: the "
        "workers of a Dask cluster, which see the store under the same path. Default: sync, or local with "
        "--workers.",
        autocompletion=completion.schedulers,
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Errors and results only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="More details on stderr.")]
AsJson = Annotated[bool, typer.Option("--json", help="Results on stdout as JSON.")]
Traceback = Annotated[bool, typer.Option("--traceback", help="Show where in the program an error arose.")]
