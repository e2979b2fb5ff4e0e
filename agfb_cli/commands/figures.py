"""`agfb figures`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from agfb_cli.completion import figure_formats, figure_kinds
from agfb_cli.console import Console
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import beside, existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose
from agfb_cli.surroundings import load_matplotlib

Directory = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="DIRECTORY",
        help="Where to write; a file (.png, .svg, .pdf) takes one figure. Default: NAME-figures beside "
        "NAME.zarr.",
    ),
]
Formats = Annotated[
    list[str] | None,
    typer.Option(
        "--format",
        metavar="FORMAT",
        help="png (the default), svg or pdf. Repeatable.",
        autocompletion=figure_formats,
    ),
]
Kinds = Annotated[
    list[str] | None,
    typer.Option(
        "--figure", metavar="NAME", help="Only this kind of figure. Repeatable.", autocompletion=figure_kinds
    ),
]


def figures(
    store: Store,
    output: Directory = None,
    formats: Formats = None,
    kinds: Kinds = None,
    case: CasePattern = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Draw the figures of a store.

    Nothing is computed. Kinds of figures: machine, linearization, campbell, condensation, bode, bifurcation,
    multipliers, orbits, film, tree, stability, survey, certificate, tori, section, operating-point,
    coefficients, critical-map, polar; for transients: envelope, unbalance, waterfall, spectrum, poincare,
    modal-energy; for several cases together: sets (bifurcation sets in one map), envelopes (one below the
    other), tornado and scatter (results over the keys in which the cases differ), and only on request changes
    (the first bifurcation with one change of a key at a time, by foil stiffness and excitation frequency). No
    figure shows the branches of the search (cycles/s000, ...). Files are DIRECTORY/CASE/FIGURE.FORMAT,
    without CASE for several cases; equal stores give equal bytes.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        directory = output or beside(store, "figures")
        written = draw(existing_store(store), directory, formats, kinds, case, console)
        if json:
            console.json_data({"store": str(store), "figures": [str(path) for path in written]})
        else:
            for path in written:
                console.data(str(path))


def draw_beside(store: Path, case: str | None, console: Console) -> list[Path]:
    """Draw every figure of a store that was just written."""
    return draw(store, beside(store, "figures"), None, None, case, console)


def draw(
    store: Path,
    directory: Path,
    formats: Sequence[str] | None,
    kinds: Sequence[str] | None,
    case: str | None,
    console: Console,
) -> list[Path]:
    """Draw figures and return their paths; what is left out and why goes to stderr."""
    load_matplotlib()
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading
    from pipelines.figures.drawing import ALL_KINDS, draw_figures, draw_one_figure
    from pipelines.figures.style import FORMATS

    refuse_unknown("--format", formats, FORMATS)
    refuse_unknown("--figure", kinds, ALL_KINDS)
    opened = open_for_reading(store)
    matching(list_cases(opened), case)
    if (suffix := directory.suffix.removeprefix(".")) in FORMATS:
        if formats and list(formats) != [suffix]:
            raise UsageError(f"--format {', '.join(formats)}: {directory.name} says another one")
        try:
            return [draw_one_figure(opened, directory, case or "*", kinds, console.message)]
        except ValueError as error:
            raise UsageError(
                str(error), "choose one with --figure and --case, or a directory with -o"
            ) from None
    console.message("drawing figures")
    return draw_figures(opened, directory, formats or ("png",), case or "*", kinds, console.message)


def refuse_unknown(option: str, given: Sequence[str] | None, allowed: Sequence[str]) -> None:
    """Raise UsageError for a word that is not among those allowed."""
    for word in given or ():
        if word not in allowed:
            raise UsageError(f"{option} {word}: not one of {', '.join(allowed)}")
