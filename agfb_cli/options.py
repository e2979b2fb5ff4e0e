"""Options that several commands share, declared once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

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
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=1000,
        help="Processes that compute cases, and parts of a case, side by side.",
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


@dataclass(frozen=True)
class OwnOption:
    """An option of single commands, and the shared option that it stands before in their help."""

    name: str
    annotation: Any
    default: Any
    before: str


REFINE = OwnOption(
    "refine",
    Annotated[
        bool,
        typer.Option(
            "--refine",
            help="Afterwards recompute located bifurcations on finer grids and estimate their errors.",
        ),
    ],
    False,
    before="workers",
)
NO_FIGURES = OwnOption(
    "no_figures",
    Annotated[bool, typer.Option("--no-figures", help="Compute only, and draw nothing.")],
    False,
    before="workers",
)


def with_own_options(command: Callable[..., None], options: Sequence[OwnOption]) -> Callable[..., None]:
    """The command, a function of the shared options and `**own`, as one that has its own options too."""
    signature = inspect.signature(command, eval_str=True)
    assert all(own.before in signature.parameters for own in options)
    parameters: list[inspect.Parameter] = []
    for shared in signature.parameters.values():
        parameters += [
            shared.replace(name=own.name, annotation=own.annotation, default=own.default)
            for own in options
            if own.before == shared.name
        ]
        if shared.kind is not shared.VAR_KEYWORD:
            parameters.append(shared)
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return command
