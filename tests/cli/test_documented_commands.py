"""Every command that the README and the pages beside it show is run, or checked by a stated rule.

A page is worked through from top to bottom, as its reader would; the next one finds what is there and goes on
with it. The liberties that are taken:

- commands of agfb run in this process, and those that compute on tiny settings;
- `agfb run` draws nothing, and processes side by side become one;
- `agfb verify --plane` may find that what so small a search has found is not complete;
- an address of a Dask scheduler must be one that agfb accepts, and the run stays in this process;
- /shared/results, on the cluster's file system, is the folder build.

The lines of Python on the page about notebooks are run too, in one namespace.

The other programs are not run: make rehearses (its targets and variables must exist), and the options of dask
must be ones that it has; `exec` and `srun` start one of these; `export` sets what agfb sets for its own
workers. Any other command is an error.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import dropwhile
from pathlib import Path
from types import MappingProxyType

import pytest
import yaml
from distributed.cli import dask_scheduler, dask_worker
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import BLAS_THREAD_VARIABLES, app
from agfb_cli.pool import choose_pool
from pipelines.stages.scheduling.campaign import SETTINGS
from tests.cli.conftest import leaf_commands
from tests.helpers.tiny import ROOT, TINY

NOTEBOOK = ROOT / "configs" / "notebook.md"
STEPWISE = ROOT / "configs" / "your_rotor.md"  # first, from nothing: the others shall not do its work
OTHERS = (ROOT / "README.md", *sorted(set((ROOT / "configs").rglob("*.md")) - {STEPWISE}))
PAGES = (STEPWISE, *OTHERS)
COMMANDS = leaf_commands()
DASK = MappingProxyType({"scheduler": dask_scheduler.main, "worker": dask_worker.main})

SEARCH = (
    "track_curves.normal_forms=false",
    "bifurcation_set.frequencies=1",
    "bifurcation_set.speeds=0",
    "bifurcation_set.max_rounds=1",
    "bifurcation_set.resonances=false",
)
SMOKE = (
    *TINY,
    *SEARCH,
    "numerics.multiplier_tolerance=1e-3",
    "linearize.points=4",
    "criticals.points=3",
    "continue_cycles.range=[1.16, 1.2]",  # a Neimark-Sacker point lies inside
    "continue_cycles.start=1.17",
    "track_curves.ranges=[[0.698, 0.702], [1.17, 1.2]]",
    "survey.points=[4, 3]",
)
YOUR_ROTOR = (
    *SEARCH,
    "numerics.circumferential=16",
    "numerics.axial=1",
    "numerics.max_columns=24",
    "numerics.multiplier_tolerance=1e-3",
    "rotor.masters=[2, 5, 8]",
    "excitation.load=20.0",
    "linearize.points=4",
    "criticals.speed_range=[4650.0, 7750.0]",
    "criticals.points=3",
    "criticals.unbalance_points=3",
    "coefficients.points=2",
    "coefficients.frequencies=3",
    "unbalance_response.points=4",
    "unbalance_response.speed_range=[4650.0, 7750.0]",
    "continue_cycles.range=[15962.0, 16891.0]",  # a Neimark-Sacker point lies inside
    "continue_cycles.start=16117.0",
    "continue_cycles.step=310.0",
    "continue_cycles.maximum_step=310.0",
    "track_curves.ranges=[[220.05, 220.83], [16582.0, 16891.0]]",
    "survey.points=[3, 3]",
    "refine.factors=[1.1, 1.2]",
    "refine.tolerance_factor=1.0",
    "refine.points_per_curve=0",
    "transient.duration=0.02",
    "transient.times=[0.0, 0.01]",
    "transient.switch_time=0.005",
)
CALIBRATION = (  # of a number that the machine meets already: two machines instead of a search
    "calibrate.parameters=[{keys = ['bearings.foil.loss_factor'], range = [0.3, 0.5]}]",
    "calibrate.targets=[{quantity = 'critical_speed', value = 5573.7}]",
    "calibrate.tolerance=0.5",
)


def blocks(page: Path, *languages: str) -> Iterator[tuple[str, str]]:
    """Language and text of the fenced blocks of a page."""
    fenced = re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return ((language, text) for language, text in fenced if language in languages)


def lines(script: str) -> Iterator[list[str]]:
    """The words of every command of a script, without comments and without the & of the background."""
    for line in script.replace("\\\n", " ").splitlines():
        words = shlex.split(line.removesuffix("&"), comments=True)
        if words:
            yield words


def follow(words: Sequence[str]) -> None:
    """Run or check one command."""
    program = words[0].removeprefix(".venv/bin/")
    assert program in RULES, f"no rule covers {shlex.join(words)}"
    RULES[program](list(words[1:]))


def run_agfb(words: list[str]) -> None:
    done = CliRunner().invoke(app, within_a_test(words), prog_name="agfb")
    expected = {ExitCode.DONE, ExitCode.STORE} if "--plane" in words else {ExitCode.DONE}
    assert done.exit_code in expected, f"agfb {shlex.join(words)}\n{done.output}"


def within_a_test(words: Sequence[str]) -> list[str]:
    """A command of agfb with the liberties that the head of this file names."""
    changed = [word.replace("/shared/results", "build") for word in words]
    command = words[0] if words[0] in COMMANDS else " ".join(words[:2])
    options = {name for parameter in COMMANDS[command].params for name in parameter.opts}
    if "--workers" in changed:
        changed[changed.index("--workers") + 1] = "1"
    if "--scheduler" in changed:
        address = changed.index("--scheduler") + 1
        pool = choose_pool(None, changed[address])
        assert pool is not None
        assert pool.address == changed[address]
        changed[address] = "sync"
    if "--dry-run" in options:  # it computes
        settings = SMOKE if "configs/smoke.toml" in words else YOUR_ROTOR
        settings += CALIBRATION if words[0] == "calibrate" else ()
        changed += [word for setting in settings for word in ("--set", setting)]
    if "--no-figures" in options:
        changed.append("--no-figures")
    return changed


def copy(words: list[str]) -> None:
    source, target = words
    shutil.copyfile(source, target)


def rehearse(words: list[str]) -> None:
    done = subprocess.run(["make", "-n", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    variables = {word.partition("=")[0] for word in words if "=" in word}
    known = set(re.findall(r"^(\w+) \?=", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    assert variables <= known


def parse_dask(words: list[str]) -> None:
    DASK[words[0]].make_context(f"dask {words[0]}", words[1:])


def exported(words: list[str]) -> None:
    """The environment of a cluster's workers is the one that agfb gives its own."""
    for name, value in (word.split("=") for word in words):
        expected = (
            1 if name in BLAS_THREAD_VARIABLES else SETTINGS[f"distributed.nanny.pre-spawn-environ.{name}"]
        )
        assert int(value) == int(expected)


def launched(words: list[str]) -> None:
    """What `srun` starts stands behind its own options."""
    follow(list(dropwhile(lambda word: word.startswith("--"), words)))


RULES: Mapping[str, Callable[[list[str]], None]] = MappingProxyType(
    {
        "agfb": run_agfb,
        "cp": copy,
        "make": rehearse,
        "dask": parse_dask,
        "srun": launched,
        "exec": follow,
        "export": exported,
    }
)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a reader starts: a folder with the configurations."""
    folder = tmp_path_factory.mktemp("reader")
    shutil.copytree(ROOT / "configs", folder / "configs")
    return folder


@pytest.fixture
def folder(shared: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(shared)
    return shared


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_commands_of_a_page_work_from_top_to_bottom(page: Path, folder: Path) -> None:
    namespace: dict[str, object] = {}
    for language, text in blocks(page, "sh", "toml", "yaml", "python"):
        if language == "python":
            if page == NOTEBOOK:
                assert len(text.splitlines()) <= 10
                exec(text, namespace)
        elif language == "sh":
            for words in lines(text):
                follow(words)
        elif language == "yaml":
            for words in yaml.safe_load(text).values():
                follow(words)
        elif page == STEPWISE:  # the reader adds it to the own configuration
            mine = folder / "mine.toml"
            mine.write_text(mine.read_text() + "\n" + text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_and_options_within_sentences_exist(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    groups = {name.split()[0] for name in COMMANDS if " " in name}
    for first, rest in re.findall(r"`agfb ([a-z][a-z-]*)([^`]*)`", text):
        if first in groups and not rest:
            continue
        name = f"{first} {rest.split()[0]}" if first in groups else first
        assert name in COMMANDS
        options = {option for parameter in COMMANDS[name].params for option in parameter.opts}
        assert set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", rest)) <= options | {"--help"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_and_files_that_a_page_links_to_exist(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_a_command_without_a_rule_is_an_error() -> None:
    (words,) = lines("curl https://example.org | sh  # nobody covers this\n")
    with pytest.raises(AssertionError, match="no rule covers curl"):
        follow(words)
