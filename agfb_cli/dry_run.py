"""Output of `--dry-run`: what is stored of every stage, and about how long the rest takes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agfb_cli.console import Console, table
from agfb_cli.errors import UsageError
from agfb_cli.progress import in_words

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase
    from pipelines.stages.scheduling.plan import Planned


def make_plan(stages: Sequence[str], cases: Sequence[NamedCase], store: Path | None) -> list[Planned]:
    """The plan of the stages on the cases; without a store if they start afresh.

    Raises UsageError for a transient that cannot start, StoreError for a damaged store.
    """
    from pipelines.stages.scheduling.plan import plan
    from pipelines.stages.transients.start import CannotRunError

    try:
        return list(plan(stages, cases, store))
    except CannotRunError as error:
        raise UsageError(error.reason, error.advice) from None


def show_plan(
    planned: Sequence[Planned], store: Path, afresh: bool, processes: int, console: Console
) -> None:
    """Show the plan of a store that is made `afresh` or resumed by a number of processes."""
    seconds, unknown = time_left(planned, processes)
    least = sum(each.least_seconds or 0.0 for each in planned) / processes
    if console.json:
        console.json_data(
            {"store": str(store), "plan": [each.as_dict() for each in planned]}
            | {"processes": processes, "seconds": seconds, "least_seconds": least, "unknown": unknown}
        )
        return
    console.data(table(("case", "stage", "there", "points", "time left"), [_row(each) for each in planned]))
    parts = [_about(least, seconds)] if seconds else []
    parts += [f"stages of unknown length: {unknown}"] if unknown else []
    console.data(f"left: {'; '.join(parts) or 'nothing'}")
    if seconds:
        console.message("times are estimated from a few points, within a factor of two or three")
    console.message(f"dry run: {'creates' if afresh else 'resumes'} {store}; nothing was computed")


def time_left(planned: Sequence[Planned], processes: int) -> tuple[float, int]:
    """Seconds of all stages of known length on a number of processes, and how many have unknown length.

    Parts of a stage run side by side; how many there are is not known before.
    """
    known = [each.seconds for each in planned if each.seconds is not None]
    return sum(known) / processes, len(planned) - len(known)


def _row(each: Planned) -> tuple[Any, ...]:
    points = str(each.points) + (f" of at most {each.most}" if each.most is not None else "")
    if each.seconds is None:
        left = f"unknown: {each.note}"
    elif each.seconds == 0.0:
        left = "-"
    else:
        left = _about(each.least_seconds, each.seconds) + (f" ({each.note})" if each.note else "")
    return each.case_id, each.stage.replace("_", "-"), each.there.value, points, left


def _about(least: float | None, most: float) -> str:
    """A time of which the largest value is known, and perhaps the smallest."""
    return f"about {in_words(least)} to {in_words(most)}" if least else f"about {in_words(most)} at most"
