"""The sections of one case."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from pipelines.datasets.reading import case_attributes, describe_case
from pipelines.datasets.store import Store, StoreError
from pipelines.figures.case_tables import Notify, kind_of, read_case
from pipelines.figures.contents import MissingDataError
from pipelines.figures.page import elements
from pipelines.figures.page.branch_section import branches, errors, survey
from pipelines.figures.page.linear_section import linear
from pipelines.figures.page.machine_section import inputs, machine, units
from pipelines.figures.page.stability_plane import map_sections
from pipelines.figures.page.warnings import ADDED_BY, not_stored, warnings

KINDS = ("machine", *ADDED_BY, "operating_point", "bifurcation_set", "certificate", "operating_range")


@dataclass(frozen=True)
class ToldTable:
    """A table of conclusions."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[elements.Cell]]


@dataclass(frozen=True)
class Conclusions:
    """What `agfb report` concludes of a case; ``missing``: why there is no operating range."""

    sentences: Sequence[str] = ()
    tables: Sequence[ToldTable] = ()
    cautions: Sequence[str] = ()
    missing: str = ""


def case_section(
    store: Store, case: str, number: int, told: Conclusions, most_cycles: int, notify: Notify
) -> str:
    """All sections of a case, below a heading with its name.

    Raises StoreError where the case itself cannot be read; a damaged group is a warning.
    """
    damaged: list[StoreError] = []
    held = read_case(store, case, KINDS, notify, damaged)
    if held is None:
        raise damaged[0]
    described = describe_case(store, case)
    doubts = [*told.cautions, *warnings(store, case, described), *(str(error) for error in damaged)]
    scales = case_attributes(store, case)["scales"]
    lacking = not_stored({kind_of(name) for name in described["groups"]})
    parts = {
        "Conclusions": _conclusions(told),
        "Warnings": [elements.listing(doubts, "warnings") if doubts else elements.paragraph("None.")],
        "Operating point and units": [*inputs(held.view), units(held.view, scales)],
        "Machine": _drawn(partial(machine, held.view)),
        "Linear behaviour": _drawn(partial(linear, held.view, held.single)),
        "Stability map": _drawn(partial(map_sections, store, case, held, number, most_cycles)),
        "Branches of cycles": _drawn(partial(branches, held)),
        "Survey": _drawn(partial(survey, held)),
        "Estimated errors": _drawn(partial(errors, held)),
        "Not in this store": _lacking(lacking),
        "Configuration": [_configuration(store, case)],
    }  # fmt: skip
    note = [elements.paragraph(held.view.note, "note")] if held.view.note else []
    name = elements.heading(2, held.view.name, f"case-{number}")
    body = "".join(
        f"<section>{elements.heading(3, title)}{''.join(content)}</section>"
        for title, content in parts.items()
        if content
    )
    return f'<article aria-labelledby="case-{number}">{name}{"".join(note)}{body}</article>'


def _drawn(section: Callable[[], Sequence[str]]) -> list[str]:
    """A section, or why it cannot be drawn from what the store holds."""
    try:
        return list(section())
    except MissingDataError as missing:
        return [elements.paragraph(f"Not shown: {missing}.")]


def _conclusions(told: Conclusions) -> list[str]:
    found = [elements.paragraph(_capital(sentence)) for sentence in told.sentences]
    found += [elements.table(table.header, table.rows, table.caption) for table in told.tables]
    if told.missing:
        found.append(elements.paragraph(f"No operating range: {told.missing}."))
    return found


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:] + ("" if sentence.endswith(".") else ".")


def _lacking(lacking: Sequence[tuple[str, str]]) -> list[str]:
    if not lacking:
        return []
    caption = "CONFIG is the configuration of this store, STORE its path"
    return [elements.table(("not computed", "command"), lacking, caption)]


def _configuration(store: Store, case: str) -> str:
    resolved = store.attributes.get("configuration", {}).get(case)
    if resolved is None:
        return elements.paragraph("The store does not hold the configuration of this case.")
    title = "All keys with their values, defaults included"
    return elements.folded(title, json.dumps(resolved, indent=1, ensure_ascii=False))
