"""The help, what it costs, and that the README says the same as the program."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from tests.cli.conftest import leaf_commands

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
REFERENCE = (ROOT / "configs" / "commands.md").read_text(encoding="utf-8")
CONFIGURATION = (ROOT / "configs" / "configuration.md").read_text(encoding="utf-8")
HEAVY = (
    "numpy",
    "scipy",
    "numba",
    "zarr",
    "dask",
    "matplotlib",
    "pydantic",
    "rich",
    "xarray",
    "pipelines.case",
)
LEAVES = leaf_commands()
COMMANDS = sorted(LEAVES)
COMPUTING = ("linearize", "criticals", "survey", "continue-cycles", "continue", "continue-tori", "run")


def options_of(command: str) -> set[str]:
    return {name for parameter in LEAVES[command].params for name in parameter.opts if name.startswith("-")}


def fenced(page: Path, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


# Typer itself may load pydantic to describe the options of one command.
@pytest.mark.parametrize(
    ("words", "allowed"), [(["--help"], ()), (["--version"], ()), (["run", "-h"], ("pydantic",))]
)
def test_help_imports_nothing_heavy(words: list[str], allowed: tuple[str, ...]) -> None:
    script = (
        "import sys\nfrom agfb_cli.main import app\n"
        f"try:\n    app({words!r}, prog_name='agfb')\n"
        "except SystemExit as stop:\n    assert stop.code == 0\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules and name not in {allowed!r}])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_blas_gets_one_thread_before_numpy_unless_the_user_chose() -> None:
    script = (
        "import os, sys\nos.environ.pop('OMP_NUM_THREADS', None)\nos.environ['MKL_NUM_THREADS'] = '4'\n"
        "from typer.testing import CliRunner\nfrom agfb_cli.main import app\n"
        "CliRunner().invoke(app, ['info', '/nowhere'])\n"
        "assert 'numpy' not in sys.modules\n"
        "print(os.environ['OMP_NUM_THREADS'], os.environ['MKL_NUM_THREADS'])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "1 4\n"


def test_the_overview_lists_every_command_and_every_exit_code() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    for command in COMMANDS:
        assert re.search(rf"^  {command.split()[0]} ", shown, flags=re.MULTILINE)
    for code in ExitCode:
        assert re.search(rf"\b{code.value}\b", shown)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command(command: str) -> None:
    done = CliRunner().invoke(app, [*command.split(), "--help"])
    assert done.exit_code == ExitCode.DONE
    assert done.stdout.startswith(f"Usage: agfb {command}")
    for option in options_of(command):
        assert option in done.stdout


def test_without_arguments_the_overview_is_shown() -> None:
    assert "Usage: agfb" in CliRunner().invoke(app, []).output


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_and_option_is_documented(command: str) -> None:
    assert f"`agfb {command}" in README
    assert f"`agfb {command}" in REFERENCE
    for option in options_of(command):
        assert re.search(rf"`[^`]*(?<![\w-]){option}(?![\w-])", REFERENCE), option


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize("page", [README, REFERENCE], ids=["README", "commands"])
def test_every_named_command_exists(page: str) -> None:
    named = set(re.findall(r"(?:`|/|^)agfb ([a-z][a-z-]*)", page, flags=re.MULTILINE))
    assert named <= {command.split()[0] for command in COMMANDS}


def test_computing_commands_share_their_options() -> None:
    assert len({frozenset(options_of(command) - {"--refine", "--no-figures"}) for command in COMPUTING}) == 1
    assert options_of("transient") - options_of("linearize") == {"--yes"}
    assert options_of("linearize") <= options_of("transient")


def test_commands_that_locate_bifurcations_can_refine_them() -> None:
    refining = {command for command in COMMANDS if "--refine" in options_of(command)}
    assert refining == {"continue-cycles", "continue", "track-pd", "track-ns", "track-folds", "run"}


def test_every_exit_code_is_documented() -> None:
    table = REFERENCE.split("## Exit codes")[1].split("##")[0]
    codes = {
        int(code)
        for row in re.findall(r"^\| ([\d, ]+) \|", table, flags=re.MULTILINE)
        for code in row.split(",")
    }
    assert codes == {code.value for code in ExitCode}


def test_configurations_that_come_with_agfb_are_listed() -> None:
    named = set(re.findall(r"`?(configs/[\w/]+\.toml)", CONFIGURATION))
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
    assert {f"configs/{path.name}" for path in (ROOT / "configs").glob("*.toml")} <= named


def test_pictures_of_the_readme_exist() -> None:
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert shown
    assert all((ROOT / name).read_bytes().startswith(b"\x89PNG") for name in shown)


def test_make_targets_of_the_readme_exist() -> None:
    targets = set(re.findall(r"^([a-z0-9]+):.*## ", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    paper = {"figures", "fig3", "fig4", "fig5", "fig6", "readings", "map", "gain", "energy"}
    tests = {"test", "rest", "check", "torture", "lint", "format"}
    assert targets == {"help", "install", "smoke", "bench", "clean"} | tests | paper
    assert set(re.findall(r"`?make ([a-z]+[0-9]*)", README)) <= targets  # a chart's letter follows the number


OWN = ROOT / "configs" / "your_equations.md"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "printed"),
    list(zip(fenced(OWN, "python"), fenced(OWN, "text"), strict=True)),
    ids=["forced", "autonomous", "branch point", "plane"],
)
def test_the_equations_of_ones_own_run_as_printed(source: str, printed: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", source], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == printed
