"""What a reader of a report must know: what failed, ended early, is missing or in doubt."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from pipelines.datasets.curves import FINISHED
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store, case_group

FOLLOWED = ("cycles", "curve", "tori")  # kinds of groups that a continuation fills
EXPECTED = FINISHED | {"limit", "collapsed"}  # ends of a continuation that are none for numerical reasons

# Kind of group: what it would add to the page, and the command that computes it.
ADDED_BY: Mapping[str, tuple[str, str]] = {
    "linear": ("equilibria, the instability speed, modes at the operating speed", "agfb linearize"),
    "criticals": ("critical speeds, Campbell diagram", "agfb criticals"),
    "unbalance_response": ("unbalance response", "agfb unbalance-response"),
    "cycles": ("branches of cycles", "agfb continue-cycles"),
    "curve": ("bifurcation curves, stability map, operating range, margin", "agfb run"),
    "survey": ("growth rates over the plane", "agfb survey"),
    "refinement": ("errors of the bifurcations by the grid", "agfb run --refine"),
}


def warnings(store: Store, case: str, described: Mapping[str, Any]) -> list[str]:
    """Failed stages, groups that ended early with their advice, stability changes without explanation.

    ``described``: groups and failures of the case. Groups of which the same is to be said share a sentence.
    """
    found = [
        f"{stage.replace('_', '-')} failed: {why['reason']}" + (f"; {why['advice']}" if why["advice"] else "")
        for stage, why in described["failures"].items()
    ]
    alike: dict[str, list[str]] = {}
    for name, state in described["groups"].items():
        for warning in _about(store, case, name, state):
            alike.setdefault(warning, []).append(name)
    return found + [f"{', '.join(names)}: {warning}" for warning, names in alike.items()]


def _about(store: Store, case: str, name: str, state: Mapping[str, Any]) -> Iterator[str]:
    """Warnings about one group, without its name."""
    reason, advice = str(state["stop_reason"] or ""), str(state["stop_advice"] or "")
    if state["status"] == "running":
        yield "not complete: it is being computed, or was interrupted; the same command resumes it"
    elif (reason not in EXPECTED) if state["kind"] in FOLLOWED else bool(advice):
        yield f"ended ({reason.replace('_', ' ')})" + (f": {advice}" if advice else "")
    if state.get("caution"):
        yield str(state["caution"])
    if state["kind"] == "cycles":
        group = read_group(store, case_group(case, name), ("unexplained",))
        if count := int(np.sum(group.labels("unexplained") == "yes")):
            yield (
                f"the stability changes in {count} steps by no located bifurcation: "
                "take smaller steps (continue_cycles.maximum_step)"
            )


def not_stored(kinds: Collection[str]) -> list[tuple[str, str]]:
    """What the store lacks, and the command that computes it; ``kinds``: groups that it holds."""
    return [
        (what, f"{command} CONFIG -o STORE")
        for kind, (what, command) in ADDED_BY.items()
        if kind not in kinds
    ]
