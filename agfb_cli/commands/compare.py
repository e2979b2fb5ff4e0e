"""`agfb compare`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agfb_cli.completion import stores
from agfb_cli.console import Console, finite, table, words
from agfb_cli.errors import ExitCode, explained
from agfb_cli.inputs import existing_store
from agfb_cli.options import AsJson, Quiet, Traceback, Verbose

if TYPE_CHECKING:
    from pipelines.datasets.comparison import EventMatch, GroupComparison, StoreComparison

First = Annotated[Path, typer.Argument(metavar="A", help="A store.", autocompletion=stores)]
Second = Annotated[
    Path, typer.Argument(metavar="B", help="The store to compare it with.", autocompletion=stores)
]
Tolerance = Annotated[
    float,
    typer.Option(
        "--rtol", metavar="X", min=0.0, help="Allowed difference, relative to the array's largest value."
    ),
]


def compare(
    first: First,
    second: Second,
    rtol: Tolerance = 1e-6,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Compare the results of two stores.

    Shows cases and groups that only one store has; whether each array is identical, equal within --rtol or
    different, and where it differs most; how far located bifurcations moved; and the distance of curves,
    whose points may lie elsewhere. Exit code 0: equal within --rtol, 3: different. With -v every array and
    bifurcation is listed, otherwise only those that differ.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        paths = existing_store(first), existing_store(second)
        from pipelines.datasets.comparison import compare_stores
        from pipelines.datasets.store import open_for_reading

        found = compare_stores(open_for_reading(paths[0]), open_for_reading(paths[1]), rtol)
        if json:
            console.json_data(as_json(found) | {"first": str(first), "second": str(second), "rtol": rtol})
        else:
            show(found, console)
        if not found.are_equal:
            raise typer.Exit(ExitCode.CASES_FAILED)


def show(found: StoreComparison, console: Console) -> None:
    """Show what only one store has, the differences of every group, and the conclusion."""
    for sentence in found.configuration:
        console.message(f"configuration of {sentence}")
    for which, names in (("A", found.only_first), ("B", found.only_second)):
        for name in names:
            console.data(f"only in {which}: {name}")
    if found.groups:
        console.data(table(("group", "verdict", "largest difference", "bifurcations", "curve"), _rows(found)))
    for group in found.groups:
        for line in _details(group, console.verbose):
            console.data(f"{group.group}: {line}")
    console.data("equal" if found.are_equal else "different")


def _rows(found: StoreComparison) -> list[tuple[object, ...]]:
    from pipelines.datasets.comparison import DIAGNOSTICS

    return [
        (
            group.group,
            group.verdict,
            _largest([a.difference for a in group.arrays if a.array not in DIAGNOSTICS]),
            _largest([match.distance for match in group.matches]),
            None if group.curve is None else group.curve.distance,
        )
        for group in found.groups
    ]


def _largest(values: list[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _details(group: GroupComparison, everything: bool) -> list[str]:
    """Sentences on the differences; on all arrays and bifurcations if requested."""
    lines = [*group.attributes, *(words_of(sentence) for sentence in group.unmatched)]
    lines += _of_arrays(group, everything)
    lines += [_moved(match) for match in group.matches if everything or match.distance > group.tolerance]
    if group.curve is not None:
        where = ", ".join(f"{words(name)} {value:.6g}" for name, value in group.curve.place.items())
        lines.append(f"the curves lie {group.curve.distance:.3g} apart at most, at {where}")
    return lines


def _of_arrays(group: GroupComparison, everything: bool) -> list[str]:
    """Arrays of other shapes, which more rows give to all, in one sentence unless everything is asked for."""
    lines, misfits = [], []
    for array in group.arrays:
        if not everything and not array.is_wrong:
            continue
        if array.difference is None and not everything:
            misfits.append(array.array)
        elif array.verdict == "identical":
            lines.append(f"{array.array}: identical")
        else:
            at = "" if array.difference is None else f" by {array.difference:.3g} at {list(array.place)}"
            lines.append(f"{array.array}: {array.verdict}{at} ({array.reason})")
    if misfits:
        shown = ", ".join(misfits[:3]) + (f" and {len(misfits) - 3} more" if len(misfits) > 3 else "")
        lines.append(f"other shapes, or only in one store: {shown}")
    return lines


def words_of(sentence: str) -> str:
    """A sentence with the names of bifurcations as a reader would write them."""
    kind, comma, rest = sentence.partition(",")
    return words(kind) + comma + rest


def _moved(match: EventMatch) -> str:
    moves = ", ".join(f"{words(name)} {change:+.3g}" for name, change in match.differences.items() if change)
    return f"{words(match.kind)}, event {match.first} / {match.second}: {moves or 'the same place'}"


def as_json(found: StoreComparison) -> dict[str, Any]:
    """The same as plain data; an infinite difference (a number against none) is null."""
    groups = [asdict(group) | {"verdict": group.verdict} for group in found.groups]
    document: dict[str, Any] = finite(asdict(found) | {"groups": groups, "equal": found.are_equal})
    return document
