"""The page: contents, the cases of a store side by side, a section for each case, versions.

Style and script are inside; nothing is loaded from anywhere. The bytes depend on the store and on the
version of matplotlib, which the page tells.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template

import matplotlib as mpl

from pipelines.datasets.case_table import CaseTable, case_table
from pipelines.datasets.store import Store
from pipelines.figures.case_tables import Notify
from pipelines.figures.page import elements
from pipelines.figures.page.case_section import Conclusions, case_section

CYCLES_OF_A_MAP, CYCLES_OF_A_PAGE = 200, 1000  # at most, so that a page stays below a few megabytes


def report_page(store: Store, cases: Sequence[str], told: Mapping[str, Conclusions], notify: Notify) -> bytes:
    """The page of some cases of a store as UTF-8; ``told``: conclusions of those that have any.

    Raises StoreError for a case that cannot be read.
    """
    most = min(CYCLES_OF_A_MAP, CYCLES_OF_A_PAGE // max(len(cases), 1))
    sections = [
        case_section(store, case, number, told.get(case, Conclusions()), most, notify)
        for number, case in enumerate(cases, start=1)
    ]
    title = f"{store.path.name}: report"
    page = Template(_file("page.html")).substitute(
        title=escape(title),
        style=_file("page.css"),
        script=_file("page.js"),
        contents=_contents(cases) if len(cases) > 1 else "",
        overview=_overview(case_table(store, cases)) if len(cases) > 1 else "",
        cases="\n".join(sections),
        origin=_origin(store),
    )
    return page.encode()


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _contents(cases: Sequence[str]) -> str:
    links = (
        f'<li><a href="#case-{number}">{escape(case)}</a></li>' for number, case in enumerate(cases, start=1)
    )
    return f'<nav aria-label="Cases"><ul>{"".join(links)}</ul></nav>'


def _overview(rows: CaseTable) -> str:
    """One row for each case, as `agfb table` shows it."""
    cells = [column.values.tolist() for column in rows.columns]
    header = [column.name.replace("_", " ") for column in rows.columns]
    return elements.heading(2, "All cases") + elements.table(
        header, list(zip(*cells, strict=True)), "Inputs in which the cases differ, and results"
    )


def _origin(store: Store) -> str:
    """Versions, commit and command line with which the store was written, and what drew the page."""
    attributes = store.attributes
    rows = [(f"{name} (computed)", str(version)) for name, version in attributes.get("versions", {}).items()]
    rows.append(("matplotlib (drawn)", mpl.__version__))
    if attributes.get("git_commit"):
        rows.append(("commit", str(attributes["git_commit"])))
    if attributes.get("argv"):
        rows.append(("command", shlex.join(attributes["argv"])))
    if attributes.get("configuration_hash"):
        rows.append(("hash of the configuration", str(attributes["configuration_hash"])))
    rows.append(("schema of the store", str(attributes.get("schema_version", "not known"))))
    return elements.table(("origin", "value"), rows, "Origin of the store")
