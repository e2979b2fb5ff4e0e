"""`agfb status`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agfb_cli.console import Console, table, words
from agfb_cli.errors import explained
from agfb_cli.inputs import existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose
from agfb_cli.progress import duration
from agfb_cli.streams import is_unread

if TYPE_CHECKING:
    from pipelines.datasets.failures import Failure
    from pipelines.datasets.watching import GroupState, GroupTotals

Watch = Annotated[
    float | None,
    typer.Option(
        "--watch", metavar="SECONDS", min=0.1, help="Repeat at this interval until nothing is being computed."
    ),
]


@dataclass(frozen=True)
class Snapshot:
    """The state of a store at one moment.

    The commands that compute, progress by case, the groups of each case, and every stage that failed and has
    not succeeded since.
    """

    commands: list[str]
    cases: Mapping[str, GroupTotals]
    groups: list[GroupState]
    total: GroupTotals
    failures: list[Failure]

    @property
    def is_alive(self) -> bool:
        """Whether anything is being computed."""
        return bool(self.commands or self.total.running)

    def as_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "commands": self.commands,
            "total": asdict(self.total),
            "cases": {name: asdict(progress) for name, progress in self.cases.items()},
            "groups": [asdict(state) for state in self.groups],
            "failures": [asdict(failure) for failure in self.failures],
        }


def status(
    store: Store,
    case: CasePattern = None,
    watch: Watch = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Show the progress of a run from another shell.

    For each case and in total: which groups are running, interrupted or ended, how many points are stored,
    and the age of the last one. Also every failed stage, with the reason, until it succeeds. An ended group
    is listed only with -v, or with the reason if some of its speeds have no equilibrium. Only metadata are
    read, and no lock is taken. With --json and --watch each report is one line.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        while True:
            seen = snapshot(path, case)
            if json:
                console.json_data({"store": str(path), **seen.as_dict()}, 2 if watch is None else None)
            else:
                show(seen, console)
            if watch is None or not seen.is_alive or is_unread():
                return
            time.sleep(watch)


def snapshot(path: Path, pattern: str | None) -> Snapshot:
    """The state of the chosen cases of a store."""
    from pipelines.datasets.failures import read_failures
    from pipelines.datasets.reading import list_cases
    from pipelines.datasets.store import open_for_reading
    from pipelines.datasets.watching import commands, totals, watch

    alive = commands(path)  # before the groups: a command that ends in between is looked at once more
    opened = open_for_reading(path)
    chosen = matching(list_cases(opened), pattern)
    groups = [state for state in watch(path) if state.case in chosen]
    cases = {name: totals([state for state in groups if state.case == name]) for name in chosen}
    failures = [failure for name in chosen for failure in read_failures(opened, name)]
    return Snapshot(alive, cases, groups, totals(groups), failures)


def show(seen: Snapshot, console: Console) -> None:
    """Show a line for each case and for groups that need attention (all with -v), and the sums."""
    if len(seen.cases) > 1:
        rows = [(name, case.state, case.ended, *_counts(case)) for name, case in seen.cases.items()]
        console.data(table(("case", "status", "groups ended", "points", "last commit"), rows) + "\n")
    shown = groups(seen.groups, console.verbose)
    if shown:
        console.data(table(("case", "group", "points", "status", "last commit", "written by"), shown) + "\n")
    total, begun = seen.total, sum(case.age is not None for case in seen.cases.values())
    console.data(
        f"{begun} of {len(seen.cases)} cases begun; groups: {total.running} running, "
        f"{total.interrupted} interrupted, {total.ended} ended; {total.points} points"
    )
    show_failures(seen.failures, console)
    if seen.commands:
        console.data(f"computing: {', '.join(seen.commands)}")
    elif total.interrupted and not total.running:
        console.message("the command that made the store resumes interrupted groups (agfb info shows it)")


def show_failures(failures: list[Failure], console: Console) -> None:
    """Show a line for every failed stage, and its advice."""
    for failure in failures:
        name = f"{failure.stage.replace('_', '-')} {failure.case}"
        console.data(f"{name}: failed: {words(failure.reason)}")
        if failure.advice:
            console.message(f"  {failure.advice}")


def groups(states: list[GroupState], everything: bool) -> list[tuple[object, ...]]:
    """Rows of the groups that have not ended or have speeds without equilibrium, or of all."""
    from pipelines.datasets.records import ENDED
    from pipelines.stages.linear.missing_speeds import named

    rows: list[tuple[object, ...]] = []
    for state in states:
        if state.state == ENDED and not everything and not state.speeds_without_equilibrium:
            continue
        points = None if state.points is None else f"{state.points} of at most {state.capacity}"
        told = words(state.stop_reason) if state.state == ENDED and state.stop_reason else state.state
        if state.speeds_without_equilibrium:
            told += f" ({named(state.speeds_without_equilibrium)})"
        rows.append((state.case, state.group, points, told, f"{duration(state.age)} ago", state.writer))
    return rows


def _counts(case: GroupTotals) -> tuple[object, object]:
    """Points and age of a case; neither of one that has not begun."""
    if case.age is None:
        return None, None
    return f"{case.points} of at most {case.capacity}", f"{duration(case.age)} ago"
