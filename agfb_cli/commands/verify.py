"""`agfb verify`."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agfb_cli.commands.stage import SECONDS_BEFORE_ANNOUNCEMENT
from agfb_cli.console import Console, finite
from agfb_cli.errors import ExitCode, explained
from agfb_cli.inputs import existing_store
from agfb_cli.options import AsJson, Quiet, Store, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.stages.reports.verify import Checked, Finding

Sample = Annotated[
    int,
    typer.Option("--sample", metavar="N", min=0, help="Rows of each group to evaluate again; 0 for none."),
]


def verify(
    store: Store,
    sample: Sample = 3,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Check the files and the numbers of a store.

    Examines every required file, decodes every chunk and compares its checksum; then evaluates the equations
    of the stored case at some rows of each branch, curve and table of equilibria. Nothing is changed. Exit
    code 4 if something is wrong.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        with console.announce_if_slow("loading kernels (a first run compiles)", SECONDS_BEFORE_ANNOUNCEMENT):
            from pipelines.stages.reports.verify import verify as verify_store

        findings, checked = verify_store(path, sample)
        wrong = [finding for finding in findings if finding.severity == "error"]
        if json:
            console.json_data(as_data(findings, checked))
        else:
            show(findings, checked, console)
        raise typer.Exit(ExitCode.STORE if wrong else ExitCode.DONE)


def show(findings: list[Finding], checked: list[Checked], console: Console) -> None:
    """Show every error on stdout, notes and advice on stderr, and how much was examined."""
    for finding in findings:
        line = f"{finding.path}: {finding.problem}"
        if finding.severity == "error":
            console.data(line)
            console.message(f"  {finding.advice}")
        else:
            console.message(f"note: {line}; {finding.advice}")
    wrong = sum(finding.severity == "error" for finding in findings)
    worst = max((each.residual / each.tolerance for each in checked), default=None)
    evaluated = f"{len(checked)} rows evaluated again" + (
        f", largest residual {worst:.2g} of what is allowed" if worst is not None else ""
    )
    state = f"{wrong} problem{'s' if wrong > 1 else ''}" if wrong else "whole"
    console.data(f"{state}; {evaluated}")


def as_data(findings: list[Finding], checked: list[Checked]) -> dict[str, Any]:
    """Findings and residuals as plain data; a residual that is no number is null."""
    document: dict[str, Any] = finite(
        {
            "findings": [asdict(finding) | {"path": str(finding.path)} for finding in findings],
            "residuals": [asdict(each) | {"holds": each.holds} for each in checked],
        }
    )
    return document
