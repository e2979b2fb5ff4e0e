"""Shell completion of files, stores, cases, keys and kinds, besides commands and options.

Whatever is wrong with a file or a store, there is no answer and no message: somebody is typing. Modules that
take long to load are imported where one question needs them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from functools import wraps
from io import StringIO
from pathlib import Path
from typing import Any

import typer

from agfb_cli.surroundings import load_matplotlib

VARIABLE = "_AGFB_COMPLETE"
Answers = list[str]
Completer = Callable[[typer.Context, str], Answers]


def silent(completer: Completer) -> Completer:
    """The completer, with an empty answer where it fails."""

    @wraps(completer)
    def answer(ctx: typer.Context, incomplete: str) -> Answers:
        try:
            return completer(ctx, incomplete)
        except Exception:
            return []

    return answer


@silent
def configurations(ctx: typer.Context, incomplete: str) -> Answers:
    """TOML files, and folders on the way to them."""
    return paths(incomplete, lambda entry: entry.name.endswith(".toml") and entry.is_file())


@silent
def stores(ctx: typer.Context, incomplete: str) -> Answers:
    """Stores, and folders on the way to them."""
    return paths(incomplete, lambda entry: os.path.isfile(os.path.join(entry.path, "zarr.json")))


def paths(incomplete: str, is_wanted: Callable[[os.DirEntry[str]], bool]) -> Answers:
    """Entries of a folder that begin as typed and are wanted; other folders with a slash appended.

    The shell would put a space behind a lone folder: then the answer is what is in it.
    """
    folder, stroke, beginning = incomplete.rpartition("/")
    found = []
    for entry in sorted(os.scandir(os.path.expanduser(folder + stroke) or "."), key=lambda each: each.name):
        is_hidden = entry.name.startswith(".") and not beginning.startswith(".")
        if is_hidden or not entry.name.startswith(beginning):
            continue
        if is_wanted(entry):
            found.append(folder + stroke + entry.name)
        elif entry.is_dir():
            found.append(f"{folder}{stroke}{entry.name}/")
    if len(found) == 1 and found[0].endswith("/"):
        return paths(found[0], is_wanted) or found
    return found


@silent
def cases(ctx: typer.Context, incomplete: str) -> Answers:
    """Cases of the store or the configuration on the command line."""
    # an option that waits for its value leaves arguments unassigned
    given: Any = ctx.params.get("store") or ctx.params.get("config") or ctx.args
    files = [Path(file) for file in (given if isinstance(given, list | tuple) else [given])]
    if "store" in ctx.params:
        return sorted(entry.parent.name for file in files for entry in file.glob("cases/*/zarr.json"))
    from agfb_cli.inputs import load_cases

    assigned = ctx.params.get("assignments") or ()
    return [named.case_id for file in files for named in load_cases(file, assigned, stages=())]


@silent
def assignments(ctx: typer.Context, incomplete: str) -> Answers:
    """`key=` for every key of a configuration; with the words that a single key allows, or its default."""
    from pipelines.case.reference import settable_keys

    known = settable_keys()
    key, sign, _ = incomplete.partition("=")
    chosen = [key] if sign else [name for name in known if name.startswith(incomplete)]
    if len(chosen) > 1:
        return [f"{name}=" for name in chosen]
    return [f"{name}={value}" for name in chosen for value in ("", *known[name])]


@silent
def figure_kinds(ctx: typer.Context, incomplete: str) -> Answers:
    """Kinds of figures."""
    load_matplotlib()
    from pipelines.figures.drawing import FIGURE_KINDS

    return list(FIGURE_KINDS)


@silent
def figure_formats(ctx: typer.Context, incomplete: str) -> Answers:
    """Formats of figures."""
    load_matplotlib()
    from pipelines.figures.style import FORMATS

    return list(FORMATS)


@silent
def schedulers(ctx: typer.Context, incomplete: str) -> Answers:
    """Values of `--scheduler`."""
    return ["sync", "local", "tcp://"]


@contextmanager
def whole_words() -> Iterator[None]:
    """Let typer see words with an equals sign, as in `--set numerics.axial=2`.

    bash passes such a word in three parts, and replaces only the last of them: it is answered with what
    follows the sign.
    """
    if os.environ.get(VARIABLE) != "complete_bash":
        yield
        return
    typed, current = joined(os.environ.get("COMP_WORDS", "").split("\n"), int(os.environ["COMP_CWORD"]))
    os.environ |= {"COMP_WORDS": "\n".join(typed), "COMP_CWORD": str(current)}
    word = typed[current] if current < len(typed) else ""
    value = word.partition("=")[2] if word.startswith("--") else word
    before = value[: value.rfind("=") + 1]
    answers = StringIO()
    try:
        with redirect_stdout(answers):
            yield
    finally:
        sys.stdout.writelines(line.removeprefix(before) for line in answers.getvalue().splitlines(True))


def joined(typed: list[str], current: int) -> tuple[list[str], int]:
    """Join words around `=` again, and return the index of the current one among the new words."""
    found: list[str] = []
    place = current
    for number, word in enumerate(typed):
        belongs = word == "=" or (bool(found) and found[-1].endswith("=") and not word.startswith("--"))
        if belongs and found:
            found[-1] += word
        else:
            found.append(word)
        if number == current:
            place = len(found) - 1
    return found, place if current < len(typed) else len(found)
