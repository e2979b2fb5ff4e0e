"""Change the values of some keys in the text of a configuration and leave the rest as it is."""

from __future__ import annotations

import contextlib
import copy
import tomllib
from collections.abc import Mapping

from pipelines.case.locating import value_spans
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.sweeps import MisplacedError, assign, inherit_bearing
from pipelines.case.units import Written, dimensionless, scale_of


class NotWrittenError(ValueError):
    """A key whose value is not in the text."""


def in_units_of_file(named: NamedCase, values: Mapping[str, float]) -> dict[str, float]:
    """The numbers of a validated case at some dotted keys in the units that its file has there."""
    scale, written = named.case.with_values(values).scales.si_per_unit, named.places.units.written
    found = {}
    for key, value in values.items():
        (path, *_) = assign(copy.deepcopy(named.resolved), key, value)
        measures = written[path].measures if path in written else ()
        found[key] = value * scale[measures[0]] if measures else value
    return found


def with_values(text: str, values: Mapping[str, float]) -> str:
    """A configuration's text with other numbers at some dotted keys (as in `--set`); comments are kept.

    The numbers are those of a validated case; the text has them in its own units.  A key of the second
    bearing that is inherited from the first follows it.  Raises NotWrittenError for a key that the text does
    not hold, or that it sweeps.
    """
    spans, document, changed = value_spans(text), tomllib.loads(text), tomllib.loads(text)
    inherit_bearing(document)
    written = dimensionless(Case, document).written
    for key, value in values.items():
        with contextlib.suppress(MisplacedError):
            assign(changed, key, value)
    scale = scale_of(changed)  # of the new clearance, if that is among the keys
    swept = {".".join(str(part) for part in path[1:-1]) for path in spans if path[0] == "sweep"}
    replaced: dict[tuple[int, int], str] = {}
    for key, value in values.items():
        if key in swept:
            raise NotWrittenError(f"{key} is swept")
        try:
            paths = assign(tomllib.loads(text), key, value)
        except MisplacedError as error:
            raise NotWrittenError(f"{key} {error}") from None
        origins = [written.get(path, Written(path, None, (), {})) for path in paths]
        places = [(spans[each.path], each.measures) for each in origins if each.path in spans]
        if not places:
            raise NotWrittenError(f"{key} does not stand in the configuration")
        for span, measures in places:
            factor = scale[measures[0]] if measures and scale else 1.0
            replaced[span] = repr(float(value * factor))
    for (begin, end), number in sorted(replaced.items(), reverse=True):
        text = text[:begin] + number + text[end:]
    return text
