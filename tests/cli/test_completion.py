"""What the shell is answered, by the protocol of its completion script; it is never shown an error."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agfb_cli.completion import joined
from agfb_cli.main import app
from pipelines.case.reading import read_cases
from pipelines.case.reference import settable_keys
from tests.cli.conftest import ROOT
from tests.helpers.curves import empty_store

PROGRAM = [sys.executable, "-m", "agfb_cli"]
SWEEP = "\n[sweep]\n'bearings.foil.stiffness' = [3.0, 10.0]\n'excitation.displacement' = [0.1, 0.2]\n"


def run(folder: Path, **variables: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | variables
    done = subprocess.run(PROGRAM, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout


def complete(folder: Path, *words: str) -> list[str]:
    """The answers for the last of the words, as bash asks for them."""
    asked = {
        "_AGFB_COMPLETE": "complete_bash",
        "COMP_WORDS": "\n".join(("agfb", *words)),
        "COMP_CWORD": str(len(words)),
    }
    with chdir(folder):
        done = CliRunner().invoke(app, [], prog_name="agfb", env=asked)
    assert (done.exit_code, done.stderr) == (0, "")
    return [line for line in done.stdout.splitlines() if line]


@pytest.fixture
def folder(smoke: Path) -> Path:
    """Configurations, folders, a store and what is neither."""
    folder = smoke.parent
    (folder / "swept.toml").write_text(smoke.read_text() + SWEEP)
    (folder / "broken.toml").write_text("gas = [\n")
    (folder / "notes.txt").touch()
    (folder / ".hidden.toml").touch()
    (folder / "deep" / "configs").mkdir(parents=True)
    (folder / "deep" / "configs" / "one.toml").touch()
    (folder / "deep" / "configs" / "two.toml").touch()
    empty_store(folder / "run.zarr", "stiffness=3", "stiffness=10")
    (folder / "broken.zarr").mkdir()
    (folder / "broken.zarr" / "zarr.json").write_text("{")
    return folder


@pytest.mark.parametrize(
    ("words", "answers"),
    [
        (("trans",), ["transient"]),
        (("run", ""), ["broken.toml", "broken.zarr/", "deep/", "run.zarr/", "smoke.toml", "swept.toml"]),
        (("run", "sm"), ["smoke.toml"]),
        (("run", "d"), ["deep/configs/one.toml", "deep/configs/two.toml"]),
        (("validate", "smoke.toml", "sw"), ["swept.toml"]),
        (("run", "nowhere/"), []),
        (("info", ""), ["broken.zarr", "deep/", "run.zarr"]),
        (("compare", "run.zarr", "b"), ["broken.zarr"]),
        (("run", "smoke.toml", "-o", "r"), ["run.zarr"]),
        (("run", "smoke.toml", "--case", ""), ["smoke"]),
        (("run", "smoke.toml", "--set", "name", "=", "other", "--case", ""), ["other"]),
        (("info", "run.zarr", "--case", "st"), ["stiffness=10", "stiffness=3"]),
        (("info", "run.zarr", "--case", "stiffness", "=", "1"), ["10"]),
        (("figures", "run.zarr", "--figure", "w"), ["waterfall"]),
        (("figures", "run.zarr", "--format", ""), ["png", "svg", "pdf"]),
        (("export", "run.zarr", "--format", "m"), ["mat"]),
        (("run", "smoke.toml", "--scheduler", ""), ["sync", "local", "tcp://"]),
        (("run", "--set", "excitation.fr"), ["excitation.frequency=", "excitation.frequency_hz="]),
        (("run", "--set", "numerics.scheme", "=", "b"), ["backward"]),
        (("run", "--set=numerics.scheme", "=", "b"), ["backward"]),
        (
            ("run", "--set", "numerics.sc"),
            [f"numerics.scheme={w}" for w in ("", "central", "backward", "fourth_order")],
        ),
        (("run", "--set", "nonsense"), []),
    ],
)  # fmt: skip
def test_answers(folder: Path, words: tuple[str, ...], answers: list[str]) -> None:
    assert complete(folder, *words) == answers


def test_cases_of_a_sweep(folder: Path) -> None:
    found = complete(folder, "run", "swept.toml", "--case", "stiffness", "=", "3_displacement", "=", "")
    assert found == ["0.1", "0.2"]


@pytest.mark.parametrize(
    "words",
    [
        ("run", "broken.toml", "--case", ""),
        ("run", "nowhere.toml", "--case", ""),
        ("run", "--case", ""),
        ("info", "broken.zarr", "--case", ""),
        ("info", "nowhere.zarr", "--case", ""),
        ("run", "broken.toml", "--set", "no.key", "=", ""),
        ("info", "run.zarr/cases", "--case", ""),
    ],
)
def test_what_is_broken_has_no_answer_and_no_message(folder: Path, words: tuple[str, ...]) -> None:
    assert complete(folder, *words) == []


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_other_shells(folder: Path, shell: str) -> None:
    asked = {"_AGFB_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    assert "smoke.toml" in run(folder, **asked, _TYPER_COMPLETE_ARGS="agfb run sm")
    words = "agfb info run.zarr --case stiffness=1"
    assert "stiffness=10" in run(folder, **asked, _TYPER_COMPLETE_ARGS=words)


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_in_a_real_bash(folder: Path) -> None:
    script = run(folder, _AGFB_COMPLETE="source_bash")
    program = folder / "agfb"
    program.write_text(f"#!/bin/sh\nexec {' '.join(PROGRAM)}\n")
    program.chmod(0o755)
    typed = (
        f"{script}\nCOMP_WORDS=(agfb info run.zarr --case stiffness = 1)\nCOMP_CWORD=6\n"
        f"_agfb_completion '{program}'\n"
        'echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", typed],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("10\n", "")


@pytest.mark.parametrize(
    ("typed", "current", "whole", "place"),
    [
        (["agfb", "run", "a"], 2, ["agfb", "run", "a"], 2),
        (["agfb", "--set", "a.b", "=", "1", "x"], 5, ["agfb", "--set", "a.b=1", "x"], 3),
        (["agfb", "--set", "a.b", "="], 3, ["agfb", "--set", "a.b="], 2),
        (["agfb", "--set", "a.b", "=", "--json"], 4, ["agfb", "--set", "a.b=", "--json"], 3),
        (["agfb", "run"], 2, ["agfb", "run"], 2),
    ],
)
def test_words_that_bash_took_apart(typed: list[str], current: int, whole: list[str], place: int) -> None:
    assert joined(typed, current) == (whole, place)


def test_every_example_is_a_value_of_its_key(smoke: Path) -> None:
    keys = settable_keys()
    assert {"bearings.foil.stiffness", "name", "numerics.scheme"} <= set(keys)
    assert not {"numerics", "bearings", "rotor.materials.NAME.density"} & set(keys)
    tables = ("numerics", "bifurcation_set", "linearize")
    words = {key: values for key, values in keys.items() if key.split(".")[0] in tables}
    assert len(words) > 20
    assert words.pop("linearize.units") == ("dimensionless", "si")  # which would change the file's numbers
    for key, values in words.items():
        for value in values:
            read_cases(smoke.read_text(), "smoke.toml", [f"{key}={value}"])
