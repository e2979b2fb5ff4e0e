"""`agfb compare-paper`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agfb_cli.console import Console, table
from agfb_cli.errors import UsageError, explained
from agfb_cli.inputs import existing_store
from agfb_cli.options import AsJson, Quiet, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.stages.reports.paper_rows import Row

Stores = Annotated[
    list[Path], typer.Argument(metavar="STORE", help="Stores with the bifurcation sets of `agfb run`.")
]


def compare_paper(
    stores: Stores,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Compare the numbers and statements of the paper with those computed here.

    Threshold speeds, anti-resonances, gains and period doublings for foil stiffness 3, 10, 20 and 50, found
    in the stores by the parameters of the cases, or the reason why a number is missing. Each has a verdict:
    met (within 0.03, or half a unit of the last printed digit), nearly met (within 0.06), not met, or not
    compared where the stores do not tell. Computes only where the curves are crossed. The machine is a
    reconstruction. With --verbose also a sentence for each number, and the place in the paper.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        from pipelines.datasets.store import open_for_reading
        from pipelines.stages.reports.paper_comparison import RECONSTRUCTION, compare_paper
        from pipelines.stages.reports.paper_planes import read_cases_of_paper
        from pipelines.stages.reports.paper_rows import IN_THE_PAPER

        cases = read_cases_of_paper([open_for_reading(existing_store(path)) for path in stores])
        if all(case.stored is None for case in cases):
            why = cases[0].reason if cases else "no case has a foil stiffness and a displacement of the rings"
            raise UsageError(
                f"nothing to compare: {why}", "`agfb run CONFIG -o STORE` makes bifurcation sets"
            )
        rows = compare_paper(cases)
        if json:
            told = [row.as_dict() | {"in_the_paper": IN_THE_PAPER[row.source]} for row in rows]
            verdicts = verdict_counts(rows)
            console.json_data({"rows": told, "verdicts": verdicts, "reconstruction": RECONSTRUCTION})
            return
        console.data(comparison_table([row for row in rows if not row.is_statement]))
        console.data("")
        console.data(statement_table([row for row in rows if row.is_statement]))
        console.data("")
        console.data(", ".join(f"{count} {verdict}" for verdict, count in verdict_counts(rows).items()))
        for row in rows:
            if not row.is_statement and row.sentence:
                console.detail(f"{_named(row)}: {row.verdict}: {row.sentence}")
        for source in dict.fromkeys(row.source for row in rows):
            console.detail(f"{source}: {IN_THE_PAPER[source]}")
        for case in cases:
            name = f"k_b = {case.foil_stiffness:g}, displacement {case.displacement:g}"
            for caution in case.stored.stored.cautions if case.stored is not None else (case.reason,):
                console.message(f"caution: {name}: {caution}")
        console.data(RECONSTRUCTION)


def comparison_table(rows: list[Row]) -> str:
    """One line for every number."""
    header = ("quantity", "k_b", "displacement", "printed", "ours", "difference", "%", "verdict", "")
    return table(
        header,
        [
            (
                row.quantity,
                row.foil_stiffness,
                row.displacement,
                row.printed,
                *(None if value is None else f"{value:.4f}" for value in (row.ours, row.difference)),
                None if row.relative is None else f"{row.relative:+.1%}",
                row.verdict,
                row.remark,
            )
            for row in rows
        ],
    )


def statement_table(rows: list[Row]) -> str:
    """One line for every statement in words."""
    header = ("statement", "k_b", "displacement", "verdict", "here")
    return table(
        header,
        [(row.quantity, row.foil_stiffness, row.displacement, row.verdict, row.sentence) for row in rows],
    )


def verdict_counts(rows: list[Row]) -> dict[str, int]:
    """How many numbers and statements have each verdict."""
    from pipelines.stages.reports.paper_rows import VERDICTS

    return {verdict: sum(row.verdict == verdict for row in rows) for verdict in VERDICTS}


def _named(row: Row) -> str:
    return row.quantity if row.foil_stiffness is None else f"{row.quantity}, k_b = {row.foil_stiffness:g}"
