"""Read the cases of a configuration file."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from agfb_cli.errors import UsageError
from agfb_cli.inputs import read_configuration

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase


def load_cases(
    config: Path, assignments: Sequence[str] = (), stages: Collection[str] | None = None
) -> tuple[NamedCase, ...]:
    """Every case of a configuration.

    Raises UsageError for the file and CaseError for its content; stages check by default all tables that
    the file contains.
    """
    text = read_configuration(config)
    from pipelines.case.reading import read_cases

    return read_cases(text, str(config), assignments, stages)


def refuse_stages(stages: Collection[str], named_cases: Iterable[NamedCase]) -> None:
    """Raise CaseError where a stage cannot compute a case."""
    from pipelines.case.reading import CaseError, stage_problems

    problems = [problem for named in named_cases for problem in stage_problems(named, stages)]
    if problems:
        raise CaseError(problems)


def select_cases(named_cases: Sequence[NamedCase], pattern: str | None) -> tuple[NamedCase, ...]:
    """The cases whose name matches the shell pattern; raises UsageError when none does."""
    chosen = set(matching((named.case_id for named in named_cases), pattern))
    return tuple(named for named in named_cases if named.case_id in chosen)


def matching(names: Iterable[str], pattern: str | None) -> list[str]:
    """The names that match the shell pattern, all without a pattern; raises UsageError when none does."""
    known = list(names)
    chosen = [name for name in known if pattern is None or fnmatchcase(name, pattern)]
    if known and not chosen:
        shown = ", ".join(known[:10]) + (f" and {len(known) - 10} more" if len(known) > 10 else "")
        raise UsageError(f"--case {pattern}: no case of that name", f"the cases are: {shown}")
    return chosen
