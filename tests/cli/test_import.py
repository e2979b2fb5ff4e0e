"""`agfb import`: what it writes and says, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agfb_cli.errors import ExitCode
from tests.cli.conftest import ROOT, Program
from tests.helpers.configurations import MODELS


def test_a_rotor_of_ross_becomes_a_configuration(program: Program, tmp_path: Path) -> None:
    done = program("import", "ross", str(MODELS / "ross_rotor.toml"), "-o", "drafts/mine.toml")
    assert done.exit_code == ExitCode.DONE
    assert done.stderr == "wrote drafts/mine.toml\n"
    assert "not carried over:\n  axial and torsional motion" in done.stdout
    said = [line.strip() for line in done.stdout.partition("fill in:\n")[2].splitlines()]
    checked = program("validate", "drafts/mine.toml")
    assert checked.exit_code == ExitCode.USAGE
    assert checked.stderr.removeprefix("error: ").splitlines() == said
    assert (tmp_path / "drafts" / "mine.toml").read_text().count('\nname = "mine"\n') == 1
    again = program("import", "ross", str(MODELS / "ross_rotor.toml"), "-o", "drafts/mine.toml")
    assert again.exit_code == ExitCode.USAGE
    assert "exists already" in again.stderr


def test_a_table_of_sections_becomes_a_configuration(program: Program) -> None:
    table = str(MODELS / "sections.csv")
    done = program("import", "sections", table, "-o", "mine.toml", "--foil", "9", "--foil", "2", "--json")
    assert done.exit_code == ExitCode.DONE
    told = json.loads(done.stdout)
    assert told["file"] == "mine.toml"
    assert (told["changed"], told["not_carried_over"]) == ([], [])
    keys = (
        "bearings.radius=0.01",
        "bearings.length=0.02",
        "bearings.clearance=2e-5",
        "operation.speed_rpm=2e4",
    )
    foil = ("bearings.foil.areal_stiffness=5e9", "bearings.foil.loss_factor=0.4")
    material = [
        f"rotor.materials.titanium.{value}"
        for value in ("young_modulus=114e9", "density=4430.0", "poisson_ratio=0.34")
    ]
    settings = [word for key in (*keys, *foil, *material) for word in ("--set", key)]
    checked = program("validate", "mine.toml", "--json", *settings)
    assert checked.exit_code == ExitCode.DONE, checked.output
    bearings = json.loads(checked.stdout)[0]["configuration"]["bearings"]
    assert [bearing["node"] for bearing in bearings] == [2, 9]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("ross", "nowhere.toml", "-o", "a.toml"), "nowhere.toml: no such file"),
        (("ross", str(MODELS), "-o", "a.toml"), "is a directory, a TOML file is needed"),
        (("sections", str(MODELS), "-o", "a.toml"), "is a directory, a CSV table is needed"),
        (("ross", str(MODELS / "sections.csv"), "-o", "a.toml"), "sections.csv:2: not TOML"),
        (("ross", str(ROOT / "configs" / "smoke.toml"), "-o", "a.toml"), "no rotor saved by ROSS"),
        (("ross", str(MODELS / "ross_rotor.toml"), "-o", "a.toml", "--foil", "3"), "--foil: name two nodes"),
        (
            ("ross", str(MODELS / "ross_rotor.toml"), "-o", "a.toml", "--foil", "3", "--foil", "10"),
            "the nodes of this shaft are 0 to 9",
        ),
    ],
)
def test_what_cannot_be_imported(
    program: Program, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    done = program("import", *words)
    assert done.exit_code == ExitCode.USAGE
    assert message in done.stderr
    assert not (tmp_path / "a.toml").exists()


def test_usage_errors_are_json_too(program: Program) -> None:
    done = program("import", "ross", "--json")
    assert done.exit_code == ExitCode.USAGE
    assert json.loads(done.stdout)["error"]["code"] == ExitCode.USAGE


@pytest.mark.parametrize(
    "words", [("import", "--help"), ("import", "ross", "-h"), ("import", "sections", "-h")]
)
def test_help(program: Program, words: tuple[str, ...]) -> None:
    done = program(*words)
    assert done.exit_code == ExitCode.DONE
    assert done.stdout.startswith(f"Usage: agfb {' '.join(words[:-1])}")
