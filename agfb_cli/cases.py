"""From the name of a configuration file to its cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from agfb_cli.errors import UsageError
from agfb_cli.inputs import read_configuration

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase


def load_cases(config: Path, assignments: Sequence[str] = ()) -> tuple[NamedCase, ...]:
    """Every case of a configuration; raises UsageError for the file and CaseError for what it says."""
    text = read_configuration(config)
    from pipelines.case.reading import read_cases

    return read_cases(text, str(config), assignments)


def select_cases(named_cases: Sequence[NamedCase], pattern: str | None) -> tuple[NamedCase, ...]:
    """The cases whose name matches the shell pattern; raises UsageError when none does."""
    chosen = set(matching((named.case_id for named in named_cases), pattern))
    return tuple(named for named in named_cases if named.case_id in chosen)


def matching(names: Iterable[str], pattern: str | None) -> list[str]:
    """The names that match the shell pattern, all without one; raises UsageError when none does."""
    known = list(names)
    chosen = [name for name in known if pattern is None or fnmatchcase(name, pattern)]
    if known and not chosen:
        shown = ", ".join(known[:10]) + (f" and {len(known) - 10} more" if len(known) > 10 else "")
        raise UsageError(f"--case {pattern}: no case of that name", f"the cases are: {shown}")
    return chosen
