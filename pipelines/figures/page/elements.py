"""Tables, lists and figures as HTML; every text is escaped here."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pipelines.figures import style

Cell = str | float | None
WORDS = 32  # letters: longer texts of words are broken into lines in cells


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph; ``kind``: its class."""
    return f"<p{_class(kind)}>{escape(text)}</p>"


def heading(level: int, text: str, identifier: str = "") -> str:
    """A heading of a level from 1 to 6."""
    named = f' id="{identifier}"' if identifier else ""
    return f"<h{level}{named}>{escape(text)}</h{level}>"


def listing(items: Iterable[str], kind: str = "") -> str:
    """A list of texts."""
    return f"<ul{_class(kind)}>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"


def table(header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str) -> str:
    """A table that scrolls on its own where the screen is narrow; the first column heads the rows."""
    head = "".join(f'<th scope="col">{escape(title)}</th>' for title in header)
    body = "".join(f"<tr>{_row(row)}</tr>" for row in rows)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(cells: Sequence[Cell]) -> str:
    first, *others = cells
    return f'<th scope="row"{_broken(first)}>{cell(first)}</th>' + "".join(
        f"<td{_broken(other)}>{cell(other)}</td>" for other in others
    )


def _broken(value: Cell) -> str:
    return _class("words") if isinstance(value, str) and len(value) > WORDS and " " in value else ""


def cell(value: Cell) -> str:
    """A number to five digits, a text, or a dash where there is nothing."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "–"
    return escape(value) if isinstance(value, str) else number(value)


def number(value: float) -> str:
    """A number to five digits."""
    return f"{value:.5g}"


def picture(figure: Figure, description: str) -> str:
    """A figure with its drawing inside the page."""
    return f'<figure class="plate">{image(figure, description)}</figure>'


def image(figure: Figure, description: str) -> str:
    """The drawing of a figure as an element ``img``."""
    drawing = b64encode(style.figure_bytes(figure, "svg")).decode()
    return f'<img alt="{escape(description)}" src="data:image/svg+xml;base64,{drawing}">'


def folded(title: str, text: str) -> str:
    """A preformatted text behind a title that opens it."""
    return f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>"


def embedded(data: Any) -> str:
    """Data for the script of the page: JSON in which nothing can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for letter in "<>&":  # JSON is ASCII here, so no other character matters
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return f'<script type="application/json">{text}</script>'


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""
