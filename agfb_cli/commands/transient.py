"""`agfb transient`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.commands.stage import SECONDS_BEFORE_ANNOUNCEMENT, Request, close, execute
from agfb_cli.console import Console
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import default_store
from agfb_cli.options import (
    AsJson,
    Assignments,
    CasePattern,
    Config,
    DryRun,
    Force,
    Output,
    Quiet,
    Scheduler,
    Traceback,
    Verbose,
    Workers,
)
from agfb_cli.pool import choose_pool
from agfb_cli.progress import in_words

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase

HELP = """Time integration with unbalance, run-up and coast-down.

Constant or changing speed, unbalance from the table unbalance, excitation on, off or switched. The initial
condition is an equilibrium, a stored cycle or a checkpoint of an earlier run. Samples and full states are
committed block by block; an interrupted run resumes from its last checkpoint. Writes
cases/CASE/transient/t000 into the store and, when the run has ended, its analysis (envelopes, spectra, kind
of motion) into transient_analysis/t000; changed tables transient or unbalance give the next run, t001.
"""

LONGEST_UNASKED = 3600.0  # s
Yes = Annotated[bool, typer.Option("--yes", help="Start even if the run will take longer than an hour.")]


def transient(
    config: Config,
    output: Output = None,
    assignments: Assignments = None,
    case: CasePattern = None,
    yes: Yes = False,
    dry_run: DryRun = False,
    force: Force = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """The command: `HELP` is what the user reads."""
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        store = output or default_store(config)
        pool = choose_pool(workers, scheduler)
        request = Request(config, store, tuple(assignments or ()), case, dry_run, force, pool)

        def admit(named_cases: Sequence[NamedCase]) -> None:
            refuse(named_cases, None if force else store, console, yes)

        outcome = execute(("transient",), request, console, admit)
        if not dry_run:
            close(outcome, request, None, console)
        raise typer.Exit(outcome.exit_code())


def refuse(named_cases: Sequence[NamedCase], store: Path | None, console: Console, yes: bool) -> None:
    """Raise UsageError for a run that cannot start, or that takes long unless `yes`; nothing is written."""
    with console.announce_if_slow("compiling kernels (first run only)", SECONDS_BEFORE_ANNOUNCEMENT):
        from pipelines.stages.transients.transient import CannotRunError, outlook

    steps, seconds = 0, 0.0
    for named in named_cases:
        try:
            ahead = outlook(named, store)
        except CannotRunError as error:
            raise UsageError(f"case {named.case_id}: {error.reason}", error.advice) from None
        steps, seconds = steps + ahead.steps, seconds + ahead.seconds
    told = f"{steps} time steps, about {in_words(seconds)}"
    if seconds > LONGEST_UNASKED and not yes:
        raise UsageError(
            f"the run takes {told}",
            "start it with --yes, or shorten transient.duration, or raise transient.tolerance",
        )
    console.detail(told)
