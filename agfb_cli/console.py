"""Output: data to stdout, messages and progress to stderr."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Timer
from typing import Any, TextIO

_IN_UNITS = re.compile(r"(.*) \[(.*)\]")
_CLEAR_LINE = "\r\x1b[K"


@dataclass
class Console:
    """Output of one command. `quiet` keeps errors and data only; `verbose` adds details.

    `answered` says whether a JSON document has been written.
    """

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    traceback: bool = False
    answered: bool = field(default=False, init=False)

    @property
    def error_stream(self) -> TextIO:
        """The stream of messages; looked up when used, so that redirection by a caller is respected."""
        return sys.stderr

    @property
    def animated(self) -> bool:
        """Whether a line may be overwritten: only on a terminal."""
        return not self.quiet and self.error_stream.isatty()

    def data(self, text: str) -> None:
        """Write a result to stdout."""
        print(text, file=sys.stdout, flush=True)

    def json_data(self, value: Any, indent: int | None = 2) -> None:
        """Write a result to stdout as JSON, in ASCII; NaN is refused because JSON has none.

        Without `indent` it is one line, so that several documents can follow each other.
        """
        self.data(json.dumps(value, indent=indent, allow_nan=False))
        self.answered = True

    def message(self, text: str) -> None:
        """Write a message, unless quiet."""
        if not self.quiet:
            self._line(text)

    def detail(self, text: str) -> None:
        """Write a message that only `--verbose` shows."""
        if self.verbose and not self.quiet:
            self._line(text)

    def error(self, text: str) -> None:
        """Write an error, quiet or not."""
        self._line(text)

    def transient(self, text: str) -> None:
        """Overwrite the current line of a terminal."""
        self.error_stream.write(_CLEAR_LINE + text)
        self.error_stream.flush()

    def _line(self, text: str) -> None:
        start = _CLEAR_LINE if self.error_stream.isatty() else ""
        print(start + text, file=self.error_stream, flush=True)

    @contextmanager
    def announce_if_slow(self, text: str, seconds: float) -> Iterator[None]:
        """Write `text` once if the body takes longer than `seconds`."""
        timer = Timer(seconds, self.message, (text,))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Columns of text, left-aligned, two spaces apart; numbers to six significant digits."""
    cells = [list(header), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "\n".join(line.rstrip() for line in lines)


def finite(value: Any) -> Any:
    """Plain data without NaN and infinities, which JSON lacks: they become None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def words(identifier: str) -> str:
    """`maximum_points` as a reader would write it; sentences are unchanged."""
    return identifier if " " in identifier else identifier.replace("_", " ")


def name_values(values: Mapping[str, object]) -> str:
    """Names and values on one line, underscores of the names as spaces; nothing is `none`.

    A value under `name [rpm]` follows that of `name` in parentheses.
    """
    units = {name: _IN_UNITS.fullmatch(name) for name in values}
    told = []
    for name, value in values.items():
        if units[name]:
            continue
        same = [
            f" ({_rounded(values[other])} {found[2]})"
            for other, found in units.items()
            if found and found[1] == name
        ]
        told.append(f"{name.replace('_', ' ')} {'none' if value is None else _cell(value)}{''.join(same)}")
    return ", ".join(told)


def _rounded(value: object) -> str:
    from pipelines.case.units import rounded

    return rounded(value) if isinstance(value, float) else str(value)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
