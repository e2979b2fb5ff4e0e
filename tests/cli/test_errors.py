"""Every kind of error has its exit code, a message in the user's terms and, where one exists, a hint."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest
import typer

from agfb_cli.console import Console
from agfb_cli.errors import ExitCode, UsageError, explain, explained
from agfb_cli.inputs import (
    LARGEST_CONFIGURATION,
    default_store,
    existing_store,
    nearest_name,
    read_configuration,
)
from pipelines.case.reading import CaseError, Problem
from pipelines.datasets.store import LockedStoreError, OtherConfigurationError

ERRORS = [
    (UsageError("a.toml: no such file"), ExitCode.USAGE, "a.toml"),
    (
        CaseError([Problem("a.toml", 3, "gas.viscosity", "-1", "must be > 0")]),
        ExitCode.USAGE,
        "gas.viscosity",
    ),
    (OtherConfigurationError("another configuration", "Name another store"), ExitCode.STORE, "configuration"),
    (LockedStoreError("being written by process 7", "Wait for it"), ExitCode.STORE, "process 7"),
    (OSError(errno.ENOSPC, "No space left on device", "a.zarr"), ExitCode.RESOURCES, "a.zarr: no space left"),
    (OSError(errno.EDQUOT, "Disk quota exceeded", "a.zarr"), ExitCode.RESOURCES, "quota"),
    (OSError(errno.EMFILE, "Too many open files"), ExitCode.RESOURCES, "open files"),
    (OSError("Could not load shared object file 'a.so'"), ExitCode.RESOURCES, "a.so"),
    (OSError(errno.ENOMEM, "Cannot allocate memory"), ExitCode.RESOURCES, "out of memory"),
    (BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"), ExitCode.RESOURCES, "processes"),
    (BrokenPipeError(errno.EPIPE, "Broken pipe"), ExitCode.RESOURCES, "Broken pipe"),
    (OSError(errno.ESTALE, "Stale file handle", "a.zarr"), ExitCode.RESOURCES, "a.zarr: Stale"),
    (OSError(errno.ENAMETOOLONG, "File name too long", "a.zarr"), ExitCode.USAGE, "too long"),
    (OSError(errno.EIO, "Input/output error", "a.zarr"), ExitCode.RESOURCES, "Input/output"),
    (
        PermissionError(errno.EACCES, "Permission denied", "a.zarr"),
        ExitCode.STORE,
        "a.zarr: Permission denied",
    ),
    (
        FileNotFoundError(errno.ENOENT, "No such file or directory", "a.zarr/zarr.json"),
        ExitCode.STORE,
        "a.zarr/zarr.json: No such file",
    ),
    (FileExistsError(errno.EEXIST, "File exists", "a"), ExitCode.STORE, "a: a file is in the way"),
    (
        NotADirectoryError(errno.ENOTDIR, "Not a directory", "a/b"),
        ExitCode.STORE,
        "a/b: a file is in the way",
    ),
    (
        OSError(errno.ELOOP, "Too many levels", "a.zarr"),
        ExitCode.STORE,
        "a.zarr: a link that leads to itself",
    ),
    (RuntimeError("Symlink loop from '/b/a.zarr'"), ExitCode.STORE, "/b/a.zarr: a link that leads to itself"),
    (OSError(errno.EROFS, "Read-only file system", "a.zarr"), ExitCode.STORE, "Read-only"),
    (MemoryError(), ExitCode.RESOURCES, "out of memory"),
    (RuntimeError("cannot cache function: no locator available for file"), ExitCode.RESOURCES, "numba"),
    (
        ModuleNotFoundError("No module named 'pipelines.case'", name="pipelines.case"),
        ExitCode.RESOURCES,
        "pipelines",
    ),
    (ModuleNotFoundError("No module named 'nowhere'", name="nowhere"), ExitCode.BUG, "nowhere"),
    (OSError(errno.ECHILD, "No child processes"), ExitCode.BUG, "No child"),
    (ZeroDivisionError("division by zero"), ExitCode.BUG, "ZeroDivisionError: division by zero"),
]


@pytest.mark.parametrize(("error", "code", "word"), ERRORS, ids=lambda value: type(value).__name__)
def test_exit_code_and_message(error: Exception, code: ExitCode, word: str) -> None:
    explanation = explain(error)
    assert explanation.code == code
    assert word in explanation.message


def test_a_bug_asks_to_be_reported() -> None:
    assert "--traceback" in explain(ZeroDivisionError("x")).hint


def test_the_traceback_is_shown_only_when_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    for console, shown in ((Console(), False), (Console(traceback=True), True)):
        with pytest.raises(typer.Exit) as stop, explained(console):
            raise ZeroDivisionError("nothing to divide")
        assert stop.value.exit_code == ExitCode.BUG
        assert ("Traceback (most recent call last)" in capsys.readouterr().err) is shown


@pytest.mark.parametrize("answered", [False, True])
def test_a_program_gets_exactly_one_document(answered: bool, capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(json=True)
    if answered:
        console.json_data({"results": []})
    with pytest.raises(typer.Exit), explained(console):
        raise UsageError("a.toml: no such file", "did you mean b.toml?")
    document = json.loads(capsys.readouterr().out)
    told = {"code": 2, "message": "a.toml: no such file", "hint": "did you mean b.toml?"}
    assert document == ({"results": []} if answered else {"error": told})


def test_ctrl_c_before_a_computation(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as stop, explained(Console()):
        raise KeyboardInterrupt
    assert stop.value.exit_code == ExitCode.INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"


def test_a_missing_file_names_the_nearest_one(tmp_path: Path) -> None:
    (tmp_path / "smoke.toml").touch()
    with pytest.raises(UsageError, match="no such file") as caught:
        read_configuration(tmp_path / "smokr.toml")
    assert caught.value.hint == f"did you mean {tmp_path / 'smoke.toml'}?"


def test_a_missing_directory_is_named(tmp_path: Path) -> None:
    assert (
        nearest_name(tmp_path / "nowhere" / "a.toml")
        == f"there is no directory {tmp_path / 'nowhere'} either"
    )


def test_a_directory_is_not_a_configuration(tmp_path: Path) -> None:
    (tmp_path / "a.toml").touch()
    with pytest.raises(UsageError, match="is a directory") as caught:
        read_configuration(tmp_path)
    assert caught.value.hint == "it holds a.toml"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n", "not UTF-8 text \\(byte 0\\)"),
        (b"name = 'a'\0", "binary file"),
        (b"#" * (LARGEST_CONFIGURATION + 1), "larger than 4 MiB"),
    ],
)
def test_what_is_not_text_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=message):
        read_configuration(path)


def test_a_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbfname = 'a'\n")
    assert read_configuration(path) == "name = 'a'\n"


def test_what_is_not_a_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such store"):
        existing_store(tmp_path / "a.zarr")
    with pytest.raises(UsageError, match="not a Zarr v3 store"):
        existing_store(tmp_path)


def test_a_link_to_nothing_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.zarr").symlink_to("gone.zarr")
    (tmp_path / "a.toml").symlink_to("gone.toml")
    with pytest.raises(UsageError, match="no such store") as caught:
        existing_store(tmp_path / "a.zarr")
    assert caught.value.hint == "it is a link to gone.zarr, which is not there"
    with pytest.raises(UsageError, match="no such file") as caught:
        read_configuration(tmp_path / "a.toml")
    assert caught.value.hint == "it is a link to gone.toml, which is not there"


def test_the_default_store_is_named_after_the_configuration() -> None:
    assert default_store(Path("configs/paper/kb10.toml")) == Path("build/kb10.zarr")


def test_what_the_system_refuses_to_open_is_named() -> None:
    with pytest.raises(UsageError, match="cannot be read: File name too long"):
        read_configuration(Path("a" * 300 + ".toml"))
