"""The `agfb` program: registers the commands. No numpy is imported before the body of a command runs."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from agfb_cli.commands import (
    calibrate,
    coefficients,
    compare,
    compare_paper,
    continue_cycles,
    continue_tori,
    criticals,
    doctor,
    export,
    figures,
    import_model,
    info,
    linearize,
    report,
    run,
    schema,
    status,
    survey,
    table,
    track_curves,
    transient,
    unbalance_response,
    validate,
    verify,
)
from agfb_cli.console import Console
from agfb_cli.program import ASKED_FOR_JSON, Program

BLAS_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

app = typer.Typer(
    name="agfb",
    help="Bifurcation sets of rotors on active gas foil bearings: a TOML case in, a dataset and figures out.",
    epilog=(
        "Exit codes: 0 done, 1 bug, 2 usage or configuration, 3 finished but cases failed or stores differ, "
        "4 store problem, 5 resources, 130 Ctrl-C, 143 SIGTERM."
    ),
    no_args_is_help=True,
    invoke_without_command=True,
    cls=Program,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(context: typer.Context, wanted: bool) -> None:
    if not wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        number = version("agfb")
    except PackageNotFoundError:
        number = None
    console = Console()
    if context.meta[ASKED_FOR_JSON]:
        console.json_data({"agfb": number})
    else:
        console.data(f"agfb {number or '(not installed: running from its sources)'}")
    raise typer.Exit


@app.callback()
def agfb(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Show the version as JSON.")] = False,
) -> None:
    """Prepare the process for any command.

    BLAS gets one thread: the matrices are small, and threads that spin would slow the compiled kernels
    down. A value already in the environment wins. This must precede the import of numpy.
    """
    for name in BLAS_THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    if context.invoked_subcommand is None:
        context.fail("Missing command.")
    if json:
        context.fail("--json belongs behind the command.")


app.command("linearize", help=linearize.HELP)(linearize.linearize)
app.command("criticals", help=criticals.HELP)(criticals.criticals)
app.command("coefficients", help=coefficients.HELP)(coefficients.coefficients)
app.command("unbalance-response", help=unbalance_response.HELP)(unbalance_response.unbalance_response)
app.command("survey", help=survey.HELP)(survey.survey)
app.command("continue-cycles", help=continue_cycles.HELP)(continue_cycles.continue_cycles)
app.command("continue", help="Short name of continue-cycles.")(continue_cycles.continue_cycles)
app.command("continue-tori", help=continue_tori.HELP)(continue_tori.continue_tori)
app.command("track-pd", help=track_curves.PERIOD_DOUBLING_HELP)(track_curves.track_pd)
app.command("track-ns", help=track_curves.NEIMARK_SACKER_HELP)(track_curves.track_ns)
app.command("track-folds", help=track_curves.FOLD_HELP)(track_curves.track_folds)
app.command("transient", help=transient.HELP)(transient.transient)
app.command("run", help=run.HELP)(run.run)
app.command("calibrate", help=calibrate.HELP)(calibrate.calibrate)
app.command("report")(report.report)
app.command("table")(table.case_table)
app.command("figures")(figures.figures)
app.add_typer(import_model.app, name="import", help=import_model.HELP)
app.command("validate")(validate.validate)
app.command("schema")(schema.schema)
app.command("info")(info.info)
app.command("status")(status.status)
app.command("export")(export.export)
app.command("compare")(compare.compare)
app.command("compare-paper")(compare_paper.compare_paper)
app.command("verify")(verify.verify)
app.command("doctor")(doctor.doctor)
