"""`agfb status`."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.cases import matching
from agfb_cli.console import Console, table, words
from agfb_cli.errors import explained
from agfb_cli.inputs import existing_store
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose
from agfb_cli.progress import duration

if TYPE_CHECKING:
    from pipelines.datasets.failures import Failure
    from pipelines.datasets.watching import GroupState

Watch = Annotated[
    float | None,
    typer.Option(
        "--watch", metavar="SECONDS", min=0.1, help="Look again so often, until nothing is written."
    ),
]


def status(
    store: Store,
    case: CasePattern = None,
    watch: Watch = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Show how far a run is, from another shell.

    Of each case what is being written, what was interrupted and what has ended, how many points there are and
    how long ago the last one was committed; and every stage that failed, with the reason, until it succeeds.
    Only metadata are read, and no lock is taken. With -v groups that have ended are listed too, each with the
    reason.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        from pipelines.datasets.failures import read_failures
        from pipelines.datasets.reading import list_cases
        from pipelines.datasets.records import RUNNING
        from pipelines.datasets.store import open_for_reading
        from pipelines.datasets.watching import watch as look

        opened = open_for_reading(path)
        chosen = matching(list_cases(opened), case)
        while True:
            states = [state for state in look(path) if state.case in chosen]
            failures = [failure for name in chosen for failure in read_failures(opened, name)]
            if json:
                groups, failed = [asdict(state) for state in states], [asdict(each) for each in failures]
                console.json_data({"store": str(path), "groups": groups, "failures": failed})
            else:
                show(chosen, states, console)
                show_failures(failures, console)
            if watch is None or not any(state.state == RUNNING for state in states):
                return
            time.sleep(watch)


def show(cases: list[str], states: list[GroupState], console: Console) -> None:
    """A line for everything that has not ended, or everything with -v, and a line of sums."""
    from pipelines.datasets.records import ENDED, RUNNING
    from pipelines.datasets.watching import INTERRUPTED

    rows: list[tuple[object, ...]] = []
    for state in states:
        if state.state == ENDED and not console.verbose:
            continue
        points = None if state.points is None else f"{state.points} of at most {state.capacity}"
        told = words(state.stop_reason) if state.state == ENDED else state.state
        rows.append((state.case, state.group, points, told, f"{duration(state.age)} ago", state.writer))
    if rows:
        console.data(table(("case", "group", "points", "status", "last commit", "written by"), rows))
    found = [state.state for state in states]
    counts = {name: found.count(name) for name in (RUNNING, INTERRUPTED, ENDED)}
    begun = len({state.case for state in states})
    console.data(
        f"{begun} of {len(cases)} cases begun; groups: "
        + ", ".join(f"{number} {name}" for name, number in counts.items())
    )
    if counts[INTERRUPTED] and not counts[RUNNING]:
        console.message(
            "the command that made the store goes on with what was interrupted (agfb info shows it)"
        )


def show_failures(failures: list[Failure], console: Console) -> None:
    """A line for every stage that failed, and the advice that came with it."""
    for failure in failures:
        name = f"{failure.stage.replace('_', '-')} {failure.case}"
        console.data(f"{name}: failed: {words(failure.reason)}")
        if failure.advice:
            console.message(f"  {failure.advice}")
