"""`agfb transient`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.commands.stage import SECONDS_BEFORE_ANNOUNCEMENT, Request, stage_command
from agfb_cli.console import Console
from agfb_cli.errors import UsageError
from agfb_cli.options import OwnOption
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
YES = OwnOption(
    "yes",
    Annotated[bool, typer.Option("--yes", help="Start even if the run will take longer than an hour.")],
    False,
    before="dry_run",
)


def _admit(named_cases: Sequence[NamedCase], request: Request, console: Console) -> None:
    """Raise UsageError for a run that cannot start, or that takes long unless the user says `--yes`."""
    with console.announce_if_slow("loading kernels (a first run compiles)", SECONDS_BEFORE_ANNOUNCEMENT):
        from pipelines.stages.transients.transient import CannotRunError, outlook

    steps, seconds = 0, 0.0
    for named in named_cases:
        try:
            ahead = outlook(named, None if request.force else request.store)
        except CannotRunError as error:
            raise UsageError(f"case {named.case_id}: {error.reason}", error.advice) from None
        steps, seconds = steps + ahead.steps, seconds + ahead.seconds
    told = f"{steps} time steps, about {in_words(seconds)}"
    if seconds > LONGEST_UNASKED and not request.own["yes"]:
        raise UsageError(
            f"the run takes {told}",
            "start it with --yes, or shorten transient.duration, or raise transient.tolerance",
        )
    console.detail(told)


transient = stage_command(("transient",), (YES,), admit=_admit)
