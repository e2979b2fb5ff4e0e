"""Change the values of some keys in the text of a configuration and leave the rest as it is."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

from pipelines.case.locating import value_spans
from pipelines.case.sweeps import MisplacedError, assign


class NotWrittenError(ValueError):
    """A key whose value is not in the text."""


def with_values(text: str, values: Mapping[str, float]) -> str:
    """A configuration's text with other numbers at some dotted keys (as in `--set`); comments are kept.

    A key of the second bearing that is inherited from the first follows it.  Raises NotWrittenError for a key
    that the text does not hold, or that it sweeps.
    """
    spans = value_spans(text)
    swept = {".".join(str(part) for part in path[1:-1]) for path in spans if path[0] == "sweep"}
    replaced: dict[tuple[int, int], str] = {}
    for key, value in values.items():
        if key in swept:
            raise NotWrittenError(f"{key} is swept")
        try:
            paths = assign(tomllib.loads(text), key, value)
        except MisplacedError as error:
            raise NotWrittenError(f"{key} {error}") from None
        places = [spans[path] for path in paths if path in spans]
        if not places:
            raise NotWrittenError(f"{key} does not stand in the configuration")
        replaced |= dict.fromkeys(places, repr(float(value)))
    for (begin, end), number in sorted(replaced.items(), reverse=True):
        text = text[:begin] + number + text[end:]
    return text
