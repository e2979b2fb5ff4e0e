"""Read what the user names: configuration files, their cases, and stores."""

from __future__ import annotations

import difflib
import os
from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from agfb_cli.errors import UsageError

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase

LARGEST_CONFIGURATION = 4 * 1024 * 1024


def read_configuration(path: Path, kind: str = "TOML file") -> str:
    """The text of a TOML file, or of another kind of file.

    Raises UsageError when there is no such file, or it is a directory, unreadable, too large or not text.
    """
    if os.path.isdir(path):  # pathlib would raise for a name that is too long
        raise UsageError(f"{path}: is a directory, a {kind} is needed", _configurations_in(path))
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST_CONFIGURATION + 1)
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file", _dangling(path) or nearest_name(path)) from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    if len(raw) > LARGEST_CONFIGURATION:
        raise UsageError(f"{path}: larger than {LARGEST_CONFIGURATION // 2**20} MiB, not a configuration")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{path}: not UTF-8 text (byte {error.start})", f"save it as {kind} in UTF-8"
        ) from None
    if "\0" in text:
        raise UsageError(f"{path}: binary file", "a configuration is a TOML file in UTF-8")
    return text


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


def existing_store(path: Path) -> Path:
    """The path of a store to read; raises UsageError when there is none."""
    if not path.exists():
        raise UsageError(f"{path}: no such store", _dangling(path) or nearest_name(path))
    # a store that has lost its own description is damaged, which opening it says
    known = (path / "zarr.json", path / "cases" / "zarr.json")
    if not path.is_dir() or not any(file.is_file() for file in known):
        raise UsageError(
            f"{path}: not a Zarr v3 store",
            "a store is a directory with a file zarr.json, written by `agfb run`",
        )
    return path


def _dangling(path: Path) -> str:
    """A hint where the path is a link to nothing, or an empty string."""
    return f"it is a link to {os.readlink(path)}, which is not there" if path.is_symlink() else ""


def default_store(configuration: Path) -> Path:
    """Default of `-o`: `build/NAME.zarr` in the working directory for `NAME.toml`."""
    return Path("build") / f"{configuration.stem}.zarr"


def nearest_name(path: Path) -> str:
    """A hint naming the entry most similar to `path` in its directory, or an empty string."""
    directory = path.parent
    if not directory.is_dir():
        return f"there is no directory {directory} either"
    try:
        names = sorted(entry.name for entry in directory.iterdir())
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.6)
    return f"did you mean {directory / near[0]}?" if near else ""


def _configurations_in(directory: Path) -> str:
    try:
        names = sorted(entry.name for entry in directory.glob("*.toml"))
    except OSError:
        return ""
    return f"it holds {', '.join(names[:5])}" if names else ""


def beside(store: Path, what: str) -> Path:
    """Default folder for the figures or the export of a store: `NAME-figures` beside `NAME.zarr`."""
    name = store.resolve().name.removesuffix(".zarr")
    return store.parent / f"{name}-{what}"
