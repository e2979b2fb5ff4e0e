"""`agfb validate`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.commands.run import CHAIN
from agfb_cli.completion import configurations
from agfb_cli.console import Console, table
from agfb_cli.errors import ExitCode, explain, explained
from agfb_cli.inputs import load_cases, select_cases
from agfb_cli.options import AsJson, Assignments, CasePattern, Quiet, Traceback

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase, Problem

Configs = Annotated[
    list[Path], typer.Argument(metavar="CONFIG", help="TOML files to check.", autocompletion=configurations)
]


def validate(
    config: Configs,
    assignments: Assignments = None,
    case: CasePattern = None,
    quiet: Quiet = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Check configurations and list their cases.

    Nothing is computed or written. Reports every problem of every file, with file, line and key, and what
    `agfb run` would refuse if a table is left out. With --json prints the resolved configuration of every
    case, defaults included, or the error of a file with problems.
    """
    console = Console(quiet=quiet, json=json, traceback=traceback)
    with explained(console):
        found: list[tuple[Path, NamedCase]] = []
        failed: list[dict[str, object]] = []
        worst = ExitCode.DONE
        for path in config:
            try:
                chosen = select_cases(load_cases(path, assignments or ()), case)
                found += [(path, named) for named in chosen]
                tell_refused(chosen, console)
            except Exception as error:
                explanation = explain(error)
                if explanation.code != ExitCode.USAGE:
                    raise
                console.error(explanation.text)
                failed.append({"file": str(path), "error": explanation.as_dict()})
                worst = ExitCode.USAGE
        if json:
            console.json_data(
                [
                    {"file": str(path), "case": named.case_id, "configuration": named.resolved}
                    | {"refused": [str(problem) for problem in refused(named)]}
                    for path, named in found
                ]
                + failed
            )
        elif found:
            console.data(table(("file", "case"), [(path, named.case_id) for path, named in found]))
        raise typer.Exit(worst)


def refused(named: NamedCase) -> list[Problem]:
    """What `agfb run` would refuse in tables left out of the file: other tables are errors already."""
    from pipelines.case.reading import stage_problems

    return stage_problems(named, CHAIN)


def tell_refused(named_cases: Iterable[NamedCase], console: Console) -> None:
    """Say once what is refused, of whichever case."""
    for problem in dict.fromkeys(problem for named in named_cases for problem in refused(named)):
        console.message(f"`agfb run` would refuse {problem}")
