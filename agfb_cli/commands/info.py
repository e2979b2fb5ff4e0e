"""`agfb info`."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from agfb_cli.console import Console, table, words
from agfb_cli.errors import explained
from agfb_cli.inputs import existing_store, matching
from agfb_cli.options import AsJson, CasePattern, Quiet, Store, Traceback, Verbose


def info(
    store: Store,
    case: CasePattern = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Show what a store holds.

    Lists its cases, and for each branch the points, the events, why it ended, and at how many points the
    time-step error is unknown or the clipping was regularised; also while a run is writing. With -v also the
    advice stored with each branch.
    """
    console = Console(quiet, verbose, json, traceback)
    with explained(console):
        path = existing_store(store)
        from pipelines.datasets.reading import describe

        content = describe(path)
        content["cases"] = {name: content["cases"][name] for name in matching(content["cases"], case)}
        add_doubts(content)
        add_open_ends(content)
        if json:
            console.json_data(content)
            return
        show(content, console)


def add_doubts(content: Mapping[str, Any]) -> None:
    """Add to every group at how many of its points the time-step error is unknown or clipping regularised."""
    from pipelines.datasets.store import case_group, open_for_reading
    from pipelines.stages import regularised, step_errors

    store = open_for_reading(content["path"])
    for name, described in content["cases"].items():
        for group, state in described["groups"].items():
            path = case_group(name, group)
            state["points_without_step_error"] = step_errors.count_in(store, [path])[0]
            found = regularised.count_in(store, [path])
            state |= regularised.as_json(found) | {"regularised_clipping": regularised.in_words(found)}


def add_open_ends(content: Mapping[str, Any]) -> None:
    """Add to every case the ends of its curves from which no curve goes on."""
    from pipelines.datasets.store import open_for_reading
    from pipelines.stages.curves.open_ends import caution, open_ends

    store = open_for_reading(content["path"])
    for name, described in content["cases"].items():
        ends = open_ends(store, name)
        described["open_ends"] = [end.as_dict() for end in ends]
        described["open_ends_caution"] = caution(ends)


def show(content: Mapping[str, Any], console: Console) -> None:
    """One line per group on stdout; origin, cautions and advice on stderr."""
    from pipelines.stages import regularised, step_errors
    from pipelines.stages.linear.missing_speeds import named_in_both

    attributes = content["attributes"]
    version = attributes.get("versions", {}).get("agfb", "of an unknown version")
    console.message(f"written by agfb {version}: {shlex.join(attributes.get('argv', ()))}")
    rows: list[tuple[object, ...]] = []
    for name, described in content["cases"].items():
        for group, state in described["groups"].items():
            if group == "machine":
                continue
            capacity = state["capacity"]
            points = None if state["n_points"] is None else f"{state['n_points']} of at most {capacity}"
            reason = words(state["stop_reason"] or state["status"])
            if missing := state["speeds_without_equilibrium"]:
                reason += f" ({named_in_both(missing, described['scales'])})"
            if (error := state.get("condensation_error")) is not None:
                reason += f", condensation error {error:.2g}"
            unknown = state["points_without_step_error"], state["n_points"] or 0
            if where := step_errors.in_words(unknown):
                reason += f", {step_errors.NAME} {where}"
            if where := state["regularised_clipping"]:
                reason += f", {regularised.NAME} {where}"
            for caution in filter(None, (state.get("caution"), step_errors.caution(unknown))):
                console.message(f"caution: {name} {group}: {caution}")
            rows.append((name, group, points, state["n_events"], reason))
            if state["stop_advice"]:
                console.detail(f"{name} {group}: {state['stop_advice']}")
        if described["open_ends_caution"]:
            console.message(f"caution: {name}: {described['open_ends_caution']}")
        for stage, why in described["failures"].items():
            rows.append((name, stage.replace("_", "-"), None, None, f"failed: {words(why['reason'])}"))
        if not set(described["groups"]) - {"machine"} and not described["failures"]:
            rows.append((name, "nothing computed yet", None, None, None))
    console.data(table(("case", "group", "points", "events", "status"), rows))
