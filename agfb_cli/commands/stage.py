"""Common part of the commands that compute: from a configuration to results in a store."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from agfb_cli.console import Console, name_values, table, words
from agfb_cli.dry_run import make_plan, show_plan
from agfb_cli.errors import ExitCode, explained
from agfb_cli.inputs import default_store, load_cases, refuse_stages, select_cases
from agfb_cli.interruption import Interruption, resume_command
from agfb_cli.options import (
    AsJson,
    Assignments,
    CasePattern,
    Config,
    DryRun,
    Force,
    Output,
    OwnOption,
    Quiet,
    Scheduler,
    Traceback,
    Verbose,
    Workers,
    with_own_options,
)
from agfb_cli.pool import choose_pool, settings_of_dask
from agfb_cli.progress import ProgressReporter, seconds_spent, where_time_went

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase
    from pipelines.stages.results import StageResult
    from pipelines.stages.scheduling.pool import Pool

SECONDS_BEFORE_ANNOUNCEMENT = 2.0
Afterwards = Callable[[Path, str | None, Console], list[Path]]
Admit = Callable[[Sequence["NamedCase"], "Request", Console], None]
Conclude = Callable[["Outcome", "Request", Console], None]
Stages = Sequence[str] | Callable[[Sequence["NamedCase"]], Sequence[str]]
"""Names of stages in order, or a function that tells them from the chosen cases."""


@dataclass(frozen=True)
class Request:
    """What the user asked a computing command for; ``own``: the values of the command's own options."""

    config: Path
    store: Path
    assignments: tuple[str, ...] = ()
    case_pattern: str | None = None
    dry_run: bool = False
    force: bool = False
    pool: Pool | None = None  # None: this process
    own: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class Outcome:
    """Results by stage, in the order in which they arrived, and the seconds that passed meanwhile."""

    results: list[tuple[str, StageResult]] = field(default_factory=list)
    elapsed: float = 0.0

    def records(self) -> list[dict[str, object]]:
        """The results as plain data."""
        return [{"stage": stage, **result.as_dict()} for stage, result in self.results]

    def exit_code(self) -> ExitCode:
        """0 when every case succeeded, 4 when the store failed a case, 3 for any other failed case."""
        failed = [result.failed_by for _, result in self.results if not result.ok]
        if "store" in failed:
            return ExitCode.STORE
        return ExitCode.CASES_FAILED if failed else ExitCode.DONE


def stage_command(
    stages: Stages,
    options: Sequence[OwnOption] = (),
    admit: Admit | None = None,
    conclude: Conclude | None = None,
) -> Callable[..., None]:
    """Make the command that runs `stages` in order on every case.

    ``options``: the command's own options. `REFINE` is for stages that locate bifurcations: the user may ask
    for the stage `refine` after them.
    ``admit``: checks the chosen cases before anything is written, and raises to refuse them.
    ``conclude``: what follows the stages, by default `close`.
    """

    def command(
        config: Config,
        output: Output = None,
        assignments: Assignments = None,
        case: CasePattern = None,
        dry_run: DryRun = False,
        force: Force = False,
        workers: Workers = None,
        scheduler: Scheduler = None,
        quiet: Quiet = False,
        verbose: Verbose = False,
        json: AsJson = False,
        traceback: Traceback = False,
        **own: Any,
    ) -> None:
        console = Console(quiet, verbose, json, traceback)
        with explained(console):
            store = output or default_store(config)
            pool = choose_pool(workers, scheduler)
            request = Request(config, store, tuple(assignments or ()), case, dry_run, force, pool, own)
            asked = stages if callable(stages) or not own.get("refine") else (*stages, "refine")
            outcome = execute(asked, request, console, admit)
            if not dry_run:
                (conclude or close)(outcome, request, console)
            raise typer.Exit(outcome.exit_code())

    return with_own_options(command, options)


def close(outcome: Outcome, request: Request, console: Console, afterwards: Afterwards | None = None) -> None:
    """Do what follows the computation and show everything; what was computed is shown even if that fails."""
    files: list[Path] = []
    try:
        if afterwards is not None:
            files = afterwards(request.store, request.case_pattern, console)
    finally:
        show_outcome(outcome, request.store, files, console)


def execute(stages: Stages, request: Request, console: Console, admit: Admit | None = None) -> Outcome:
    """Run `stages` as requested and show each result as it arrives; raises typer.Exit when interrupted."""
    named_cases = load_cases(request.config, request.assignments, stages=())
    chosen = select_cases(named_cases, request.case_pattern)
    stages = stages(chosen) if callable(stages) else stages
    refuse_stages(stages, chosen)
    if request.dry_run:
        refuse_other_store(request, named_cases)
        foresee(stages, chosen, request, console)
        return Outcome()
    if admit is not None:
        refuse_other_store(request, named_cases)
        admit(chosen, request, console)
    if request.pool is not None and request.pool.address is None:
        from pipelines.stages.scheduling import pool, registry

        pool.prepare_workers(registry.modules(stages))
    with Interruption(console) as interruption:
        put_aside(request, console)
        from pipelines.datasets.watching import command_lock

        with command_lock(request.store):  # before the store is there: whoever sees it sees the command
            prepare(request, named_cases, console)
            outcome = compute(stages, chosen, request, console, interruption)
    if interruption.exit_code is not None:
        show_interruption(outcome, request, console)
        raise typer.Exit(interruption.exit_code)
    return outcome


def foresee(
    stages: Sequence[str], named_cases: Sequence[NamedCase], request: Request, console: Console
) -> None:
    """Show the plan of `--dry-run`; nothing is written."""
    afresh = request.force or not request.store.exists()
    with console.announce_if_slow("measuring (the first run compiles kernels)", SECONDS_BEFORE_ANNOUNCEMENT):
        planned = make_plan(stages, named_cases, None if afresh else request.store)
    processes = 1 if request.pool is None else request.pool.workers
    show_plan(planned, request.store, afresh, processes, console)


def refuse_other_store(request: Request, named_cases: Sequence[NamedCase]) -> None:
    """Raise what the run would raise if the existing store belongs to another configuration."""
    if request.force or not request.store.exists():
        return
    from pipelines.datasets.provenance import provenance
    from pipelines.datasets.store import open_for_writing

    open_for_writing(request.store, provenance(named_cases, []))


def show_interruption(outcome: Outcome, request: Request, console: Console) -> None:
    """Say what is stored and how to resume."""
    resume = resume_command(sys.argv)
    console.error(f"stopped; everything committed is in {request.store}. To resume:")
    console.error(f"  {resume}")
    if console.json:
        console.json_data({"store": str(request.store), "results": outcome.records(), "resume": resume})


def compute(
    stages: Sequence[str],
    named_cases: Sequence[NamedCase],
    request: Request,
    console: Console,
    interruption: Interruption,
) -> Outcome:
    """Run the stages on all cases: one after the other here, side by side in a pool."""
    from pipelines.stages.scheduling import registry
    from pipelines.stages.scheduling.tasks import recorded, run_stages

    outcome, begin = Outcome(), time.monotonic()
    cautioned: set[str] = set()
    tasks = len(stages) * len(named_cases) if len(named_cases) > 1 else None
    reporter = ProgressReporter(console, tasks=tasks)
    with console.announce_if_slow("loading kernels (a first run compiles)", SECONDS_BEFORE_ANNOUNCEMENT):
        for stage in stages:  # also for the workers, which load what is compiled here
            registry.stage_function(stage)
    work = (stages, named_cases, request.store)
    with ExitStack() as stack:
        if request.pool is None:
            arriving = run_stages(*work, reporter, interruption.requested)
        else:
            stack.enter_context(settings_of_dask(request.pool))
            from pipelines.stages.scheduling.campaign import run_campaign

            arriving = run_campaign(*work, request.pool, reporter, interruption.requested)
        for stage, result in recorded(arriving, request.store, interruption.requested):
            outcome.results.append((stage, result))
            reporter.ended(stage, result.case_id)
            if not interruption.requested():
                announce(stage, result, console, with_tables=len(named_cases) == 1)
                caution = f"{result.case_id}: {result.caution}"
                if result.caution and caution not in cautioned:  # once, not with every stage of the case
                    console.message(f"caution: {caution}")
                    cautioned.add(caution)
    outcome.elapsed = time.monotonic() - begin
    return outcome


def put_aside(request: Request, console: Console) -> None:
    """Move a store that exists out of the way of `--force`."""
    from pipelines.datasets.store import move_aside

    if request.force and request.store.exists():
        console.message(f"moved the old store to {relative(move_aside(request.store))}")


def prepare(request: Request, named_cases: Sequence[NamedCase], console: Console) -> None:
    """Create the store, or check that the one that exists was made from the same configuration."""
    from pipelines.stages.scheduling.first_run import compiling_beside

    compiling = "loading kernels (a first run compiles)"
    with console.announce_if_slow(compiling, SECONDS_BEFORE_ANNOUNCEMENT), compiling_beside():
        from pipelines.stages.scheduling.preparation import prepare_store

    prepare_store(request.store, named_cases, ["agfb", *sys.argv[1:]])


def relative(path: Path) -> Path:
    """The path as seen from the working directory where it lies below it."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def announce(stage: str, result: StageResult, console: Console, with_tables: bool = False) -> None:
    """Show one result: a line on stdout when it succeeded, the reason and the advice on stderr when not.

    ``with_tables``: its tables too.
    """
    name = f"{stage.replace('_', '-')} {result.case_id}"
    if result.ok and not console.json:
        numbers = name_values(result.summary)
        console.data(f"{name}: {words(result.stop_reason)}" + (f" ({numbers})" if numbers else ""))
        for title, rows in result.tables.items() if with_tables else ():
            console.data(f"\n{words(title)}")
            console.data(table(list(rows[0]), [list(row.values()) for row in rows]) if rows else "none")
    if not result.ok:
        console.error(f"{name}: failed: {words(result.stop_reason)}")
        if result.advice:
            console.error(f"  {result.advice}")
        if console.traceback and result.traceback:
            console.error(result.traceback.rstrip())
    if result.ok and result.advice:
        console.detail(f"  {result.advice}")


def show_outcome(outcome: Outcome, store: Path, files: Sequence[Path], console: Console) -> None:
    """Close a finished run: draw figures and show how it ended.

    The JSON document if requested, the time of several cases by stage, and how many cases failed.
    """
    if console.json:
        figures = [str(path) for path in files]
        seconds = seconds_spent(outcome.results, outcome.elapsed)
        console.json_data(
            {"store": str(store), "results": outcome.records(), "figures": figures, "seconds": seconds}
        )
    else:
        for path in files:
            console.data(str(path))
    if len({result.case_id for _, result in outcome.results}) > 1:
        console.message(where_time_went(outcome.results, outcome.elapsed))
    failed = sum(not result.ok for _, result in outcome.results)
    if failed:
        others = f"; the others are in {store}" if failed < len(outcome.results) else ""
        console.error(f"{failed} of {len(outcome.results)} results failed{others}")
    else:
        console.message(f"results are in {store}")
