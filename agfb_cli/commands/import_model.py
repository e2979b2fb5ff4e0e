"""`agfb import ross` and `agfb import sections`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.completion import configurations
from agfb_cli.console import Console
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import read_configuration
from agfb_cli.options import AsJson, Quiet, Traceback

if TYPE_CHECKING:
    from pipelines.case.imports.parts import Imported

HELP = (
    "Write a configuration from a rotor of another program or a drawing; foil bearings are left to fill in."
)

Saved = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL",
        readable=False,
        help="TOML file written by ROSS: rotor.save('rotor.toml').",
        autocompletion=configurations,
    ),
]
Sections = Annotated[
    Path, typer.Argument(metavar="FILE.csv", readable=False, help="CSV table of shaft sections.")
]
Written = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE.toml", help="Configuration to write; must not exist.")
]
FoilNodes = Annotated[
    list[int] | None, typer.Option("--foil", metavar="NODE", help="Node of a foil bearing; give it twice.")
]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@app.command("ross")
def ross(
    model: Saved,
    output: Written,
    foil: FoilNodes = None,
    quiet: Quiet = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Write a configuration from a rotor saved by ROSS 2.

    Shaft elements, materials, discs and bearings are carried over; bearings become linear supports, but for
    the two whose places the foil bearings take (the outermost ones, or those of --foil). Prints what was
    changed, what could not be carried over, and which keys are to be filled in.
    """
    console = Console(quiet=quiet, json=json, traceback=traceback)
    with explained(console):
        from pipelines.case.imports.ross import read_ross

        refuse_existing(output)
        write(placed(read_ross(read_configuration(model), str(model)), foil), output, console)


@app.command("sections")
def sections(
    table: Sections,
    output: Written,
    foil: FoilNodes = None,
    quiet: Quiet = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Write a configuration from a CSV table of shaft sections.

    Columns by their header: length, outer_diameter, outer_diameter_right, inner_diameter,
    inner_diameter_right, material, count; lengths in m, or with a unit as in "length [mm]". A section without
    count is divided into elements about as long as they are thick. Prints which keys are to be filled in.
    """
    console = Console(quiet=quiet, json=json, traceback=traceback)
    with explained(console):
        from pipelines.case.imports.sections import read_sections

        refuse_existing(output)
        write(
            placed(read_sections(read_configuration(table, "CSV table"), str(table)), foil), output, console
        )


def refuse_existing(output: Path) -> None:
    """Raise UsageError for a file that would be replaced."""
    if output.exists():
        raise UsageError(f"{output}: this file exists already", "name another, or remove it")


def write(rotor: Imported, output: Path, console: Console) -> None:
    """Write the configuration of a rotor, and tell what is left to do."""
    from pipelines.case.imports.draft import case_name, draft_text
    from pipelines.datasets.durable import make_folder, replace_file

    draft = draft_text(rotor, case_name(output.stem))
    missing = to_fill_in(draft, output)
    make_folder(output.parent, durable=False)
    replace_file(output, draft.encode(), durable=False)
    if console.json:
        told = {"changed": rotor.changed, "not_carried_over": rotor.lost, "fill_in": missing}
        console.json_data({"file": str(output), **told})
        return
    for headline, lines in (
        ("changed", rotor.changed),
        ("not carried over", rotor.lost),
        ("fill in", missing),
    ):
        if lines:
            console.data("\n".join([f"{headline}:", *(f"  {line}" for line in lines)]))
    console.message(f"wrote {output}")


def placed(rotor: Imported, foil: list[int] | None) -> Imported:
    """The rotor with its foil bearings where the user wants them; raises UsageError for other nodes."""
    if not foil:
        return rotor
    if len(set(foil)) != 2:
        raise UsageError("--foil: name two nodes", "repeat the option: --foil 2 --foil 8")
    if min(foil) < 0 or max(foil) > rotor.last_node:
        raise UsageError(f"--foil: the nodes of this shaft are 0 to {rotor.last_node}")
    return replace(rotor, foil_nodes=tuple(sorted(foil)))


def to_fill_in(text: str, output: Path) -> list[str]:
    """What `agfb validate` will say about the configuration."""
    from pipelines.case.reading import CaseError, read_cases

    try:
        read_cases(text, str(output))
    except CaseError as error:
        return [str(problem) for problem in error.problems]
    return []
