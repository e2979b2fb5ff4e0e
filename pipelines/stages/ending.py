"""How branches and curves end: the reason stored in their group, and whether it counts as success."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from enum import Enum
from typing import Any

from pipelines.bifurcations.continuation import Result
from pipelines.datasets.branch import BranchWriter
from pipelines.datasets.records import ENDED, Group


def stop_reasons(stops: Iterable[Enum]) -> frozenset[str]:
    """The reasons to stop as named in a store."""
    return frozenset(stop.name.lower() for stop in stops)


def store_end(branch: BranchWriter, result: Result[Any], further: str = "") -> None:
    """Store why a continuation ended; an interrupted one stays open.

    ``further``: a sentence behind the advice.
    """
    if result.stop.name == "INTERRUPTED":
        return
    # the limit is the stage's own, and its message says all
    advice = "" if result.stop.name == "LIMIT" else result.stop.advice
    branch.finish(result.stop.name.lower(), "; ".join(filter(None, (result.message, advice, further))))


def is_success(group: Group, complete: Collection[Enum]) -> bool:
    """Whether a branch or curve is complete or merely interrupted; without a single point it is a failure."""
    ended = group.attributes["status"] == ENDED
    return not ended or (group.attributes["stop_reason"] in stop_reasons(complete) and group.n_points > 0)
