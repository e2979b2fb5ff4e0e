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
    from pipelines.stages.reports.machine_summary import MachineSummary

HEADER = (
    *("file", "case", "speed 1 is", "frequency 1 is"),
    *("operating speed", "excitation frequency", "displacement"),
)
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
    `agfb run` would refuse if a table is left out. Tells for every case what the dimensionless speed and
    frequency 1 are, and the operating point in both units; for the first case of each file also mass, bearing
    loads, bearing numbers, foils and strokes, in which typing errors of a drawing show. With --json prints
    the resolved configuration of every case, defaults included, or the error of a file with problems.
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
                    | {"si_per_unit": named.case.scales.si_per_unit, "machine": machine_of(named).as_dict()}
                    for path, named in found
                ]
                + failed
            )
        elif found:
            console.data(table(HEADER, [(path, named.case_id, *in_units(named)) for path, named in found]))
            for path in dict.fromkeys(path for path, _ in found):
                first = next(named for other, named in found if other == path)
                console.data(f"\n{path}, {first.case_id}:")
                console.data(table(("machine", ""), machine_of(first).rows()))
            for sentence in dict.fromkeys(each for _, named in found for each in outside(named)):
                console.message(f"caution: {sentence}")
        raise typer.Exit(worst)


def in_units(named: NamedCase) -> tuple[str | None, ...]:
    """The units of speed and frequency, and speed, excitation frequency and ring displacement in both."""
    from pipelines.case.fields import MEASURES
    from pipelines.case.scales import PARAMETERS
    from pipelines.case.units import in_both, in_si

    scale = named.case.scales.si_per_unit
    point = zip(PARAMETERS[:3], named.case.parameters[:3], strict=True)
    return (
        in_si("speed", 1.0, scale),
        in_si("frequency", 1.0, scale),
        *(None if value != value else in_both(MEASURES[name], value, scale) for name, value in point),
    )


def machine_of(named: NamedCase) -> MachineSummary:
    """Masses, loads and stiffnesses of a case's machine."""
    from pipelines.stages.reports.machine_summary import machine_summary

    return machine_summary(named.case)


def outside(named: NamedCase) -> Iterable[str]:
    """The ranges of speed that do not contain the operating speed, of stages that compute without it."""
    from pipelines.case.scales import PARAMETERS
    from pipelines.case.stage_checks import ranges_of_speed
    from pipelines.case.units import in_both

    scale = named.case.scales.si_per_unit
    speed = named.case.parameters[PARAMETERS.index("speed")]
    for key, (low, high) in ranges_of_speed(named.case):
        if not low <= speed <= high:
            ends = f"[{in_both('speed', low, scale)}, {in_both('speed', high, scale)}]"
            yield f"{key} {ends} does not contain the operating speed {in_both('speed', speed, scale)}"


def refused(named: NamedCase) -> list[Problem]:
    """What `agfb run` would refuse in tables left out of the file: other tables are errors already."""
    from pipelines.case.reading import stage_problems

    return stage_problems(named, CHAIN)


def tell_refused(named_cases: Iterable[NamedCase], console: Console) -> None:
    """Say once what is refused, of whichever case."""
    for problem in dict.fromkeys(problem for named in named_cases for problem in refused(named)):
        console.message(f"`agfb run` would refuse {problem}")
