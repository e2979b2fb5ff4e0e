"""Line numbers of keys in TOML text, which the standard parser does not provide.

The text is one that `tomllib` accepts, so that the scanner needs to know only where keys, strings, arrays and
inline tables begin and end.  On any other text it stops early and never raises.
"""

from __future__ import annotations

import bisect
import contextlib
import re
import tomllib

from pipelines.case.fields import Path

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' r"|'''.*?'{3,5}" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'", re.DOTALL
)
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_BARE_VALUE = re.compile(r"[^,\]}#\r\n]+")


def key_lines(text: str) -> dict[Path, int]:
    """Line (from 1) of every key, table header and array item, by its path; array items count from 0."""
    scanner = _Scanner(text)
    with contextlib.suppress(_LostError, RecursionError):
        scanner.document()
    return scanner.found


def value_spans(text: str) -> dict[Path, tuple[int, int]]:
    """Begin and end (characters from 0) of every string, number and other plain value, by its path."""
    scanner = _Scanner(text)
    with contextlib.suppress(_LostError, RecursionError):
        scanner.document()
    return scanner.spans


class _LostError(Exception):
    """The text is not TOML at this place."""


class _Scanner:
    """A position in the text and the lines found so far."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.found: dict[Path, int] = {}
        self.spans: dict[Path, tuple[int, int]] = {}
        self._line_ends = [match.start() for match in re.finditer("\n", text)]
        self._array_tables: dict[Path, int] = {}

    def document(self) -> None:
        table: Path = ()
        self._match(_BLANK)
        while self.at < len(self.text):
            if self._accept("[["):
                table = self._array_table(self._key())
                self._expect("]]")
            elif self._accept("["):
                table = self._resolve(self._key())
                self.found[table] = self._line()
                self._record(table)
                self._expect("]")
            else:
                self._pair(table)
            self._match(_BLANK)

    def _array_table(self, key: Path) -> Path:
        array = (*self._resolve(key[:-1]), key[-1])
        index = self._array_tables.get(array, 0)
        self._array_tables[array] = index + 1
        self._record((*array, index))
        return (*array, index)

    def _resolve(self, key: Path) -> Path:
        """A header's key as a path: below an array of tables its last table is meant."""
        path: Path = ()
        for part in key:
            path = (*path, part)
            if path in self._array_tables:
                path = (*path, self._array_tables[path] - 1)
        return path

    def _pair(self, table: Path) -> None:
        path = (*table, *self._key())
        self._record(path)
        self._expect("=")
        self._value(path)

    def _value(self, path: Path) -> None:
        self._match(_BLANK)
        if self._accept("["):
            index = 0
            while not self._closed("]"):
                self._record((*path, index))
                self._value((*path, index))
                index += 1
        elif self._accept("{"):
            while not self._closed("}"):
                self._pair(path)
        else:
            begin = self.at
            plain = self._match(_STRING) or self._match(_BARE_VALUE)
            if not plain:
                raise _LostError
            self.spans[path] = (begin, begin + len(plain.rstrip()))

    def _closed(self, bracket: str) -> bool:
        """Step over blanks and commas; True once the closing bracket was passed."""
        self._match(_BLANK)
        while self._accept(","):
            self._match(_BLANK)
        return self._accept(bracket)

    def _key(self) -> Path:
        parts: list[str] = []
        while True:
            self._match(_SPACE)
            if literal := self._match(_STRING):
                parts.append(_unquoted(literal))
            elif bare := self._match(_BARE_KEY):
                parts.append(bare)
            else:
                raise _LostError
            self._match(_SPACE)
            if not self._accept("."):
                return tuple(parts)

    def _record(self, path: Path) -> None:
        """Store the line of a path, and of the tables above it that no earlier line has opened."""
        while path and path not in self.found:
            self.found[path] = self._line()
            path = path[:-1]

    def _line(self) -> int:
        return bisect.bisect_left(self._line_ends, self.at) + 1

    def _match(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        if match is None:
            return ""
        self.at = match.end()
        return match.group()

    def _accept(self, token: str) -> bool:
        if not self.text.startswith(token, self.at):
            return False
        self.at += len(token)
        return True

    def _expect(self, token: str) -> None:
        if not self._accept(token):
            raise _LostError


def _unquoted(literal: str) -> str:
    try:
        return str(tomllib.loads(f"key = {literal}")["key"])
    except ValueError:
        raise _LostError from None
