"""Every command that prints can print JSON: one strict document on stdout, errors too."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from agfb_cli.errors import ExitCode
from tests.cli.conftest import Program, leaf_commands
from tests.figures.synthetic_store import make_store

COMMANDS = leaf_commands()
ARGUMENTS = {
    "CONFIG": "smoke.toml", "STORE": "a.zarr", "STORE...": "a.zarr", "A": "a.zarr", "B": "a.zarr",
    "MODEL": "smoke.toml", "FILE.csv": "smoke.toml",
}  # fmt: skip
MISSING = {name: f"no-{value}" for name, value in ARGUMENTS.items()}


def arguments(command: str, values: dict[str, str]) -> list[str]:
    """What a command needs; a command with an argument of a new kind has to name an example here."""
    needed = [each for each in COMMANDS[command].params if each.param_type_name == "argument"]
    required = [each for each in COMMANDS[command].params if each.required and each not in needed]
    options = [word for each in required for word in (each.opts[0], "new.toml")]
    return [*(values[str(each.metavar)] for each in needed), *options]


def strict(text: str) -> Any:
    """The one JSON document of a text, without NaN and infinities."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with something for every command."""
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    make_store(path, 3, parts=("machine", "curves", "set"))
    return path


@pytest.fixture
def folder(program: Program, smoke: Path, store: Path) -> Program:
    """The program beside a configuration and that store."""
    shutil.copytree(store, smoke.with_name("a.zarr"))
    return program


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_answers_with_one_document(folder: Program, command: str) -> None:
    done = folder(*command.split(), *arguments(command, ARGUMENTS), "--json")
    assert done.exit_code != ExitCode.BUG, done.output
    assert strict(done.stdout)


@pytest.mark.parametrize("command", [name for name in COMMANDS if arguments(name, MISSING)])
def test_every_command_answers_that_something_is_missing(folder: Program, command: str) -> None:
    done = folder(*command.split(), *arguments(command, MISSING), "--json")
    assert done.exit_code == ExitCode.USAGE
    (document,) = told if isinstance(told := strict(done.stdout), list) else [told]
    assert document["error"]["code"] == ExitCode.USAGE
    assert "no such" in document["error"]["message"]


@pytest.mark.parametrize("command", COMMANDS)
def test_what_cannot_be_a_command_line_is_told_too(folder: Program, command: str) -> None:
    done = folder(*command.split(), "--json", "--colour")
    assert done.exit_code == ExitCode.USAGE
    assert "--colour" in strict(done.stdout)["error"]["message"]
    assert "No such option" in done.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "Missing command"),
        (["nowhere"], "No such command"),
        (["run", "smoke.toml"], "behind the command"),
    ],
)
def test_the_program_itself(folder: Program, words: list[str], told: str) -> None:
    done = folder("--json", *words)
    assert done.exit_code == ExitCode.USAGE
    assert told in strict(done.stdout)["error"]["message"]
    assert folder.computed == []


@pytest.mark.parametrize("words", [["--version", "--json"], ["--json", "--version"]])
def test_the_version(folder: Program, words: list[str]) -> None:
    number = strict(folder(*words).stdout)["agfb"]
    assert folder("--version").stdout == f"agfb {number}\n"


def test_a_configuration_with_problems_stands_beside_those_without(folder: Program) -> None:
    Path("wrong.toml").write_text("gas = 1\n")
    done = folder("validate", "wrong.toml", "smoke.toml", "--json")
    assert done.exit_code == ExitCode.USAGE
    right, wrong = strict(done.stdout)
    assert (right["file"], right["case"]) == ("smoke.toml", "smoke")
    assert wrong["file"] == "wrong.toml"
    assert "gas" in wrong["error"]["message"]


def test_each_look_is_one_line(folder: Program) -> None:
    (line,) = folder("status", "a.zarr", "--json", "--watch", "0.1").stdout.splitlines()
    assert strict(line)["total"]["running"] == 0
