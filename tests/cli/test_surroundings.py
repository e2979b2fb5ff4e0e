"""Nothing outside agfb's own options changes what it computes or draws, nor ends it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.helpers.tiny import CONFIG, ROOT, TINY
from tests.helpers.trees import compare_trees

SETTINGS = [word for override in TINY for word in ("--set", override)]
COMPUTE = ["linearize", str(CONFIG), *SETTINGS, "-o", "run.zarr"]
DRAW = ["figures", "run.zarr", "-o", "figures", "--figure", "linearization"]
DRAW += ["--format", "png", "--format", "svg", "--format", "pdf"]
BROKEN = "a: [ : }\n\xff"
FORMATTED = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "COLUMNS": "1", "TERM": "dumb"}


def agfb(folder: Path, words: list[str], variables: Mapping[str, str]) -> str:
    """What the program writes on stderr, where it ends well."""
    done = subprocess.run(
        [sys.executable, "-m", "agfb_cli", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | variables,
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store and its figures, made in peace."""
    folder = tmp_path_factory.mktemp("plain")
    agfb(folder, COMPUTE, {})
    agfb(folder, DRAW, {})
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    "variables",
    [
        {"PYTHONWARNINGS": "error", "NUMBA_CACHE_DIR": "/proc/self/fdinfo", **FORMATTED},
        {"NUMBA_DISABLE_JIT": "1", "NUMBA_OPT": "0", "ZARR_CODEC_PIPELINE__PATH": "nowhere"},
        {
            "OPENBLAS_CORETYPE": "Prescott",
            "NPY_PROMOTION_STATE": "legacy",
            "NPY_DISABLE_CPU_FEATURES": "AVX2",
        },
        {"ZARR_CONFIG": "broken", "DASK_CONFIG": "broken", "ZARR_THREADING__MAX_WORKERS": "many"},
    ],
    ids=lambda variables: next(iter(variables)),
)
def test_the_same_numbers(tmp_path: Path, plain: Path, variables: Mapping[str, str]) -> None:
    broken(tmp_path / "broken" / "broken.yaml")
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    agfb(tmp_path, COMPUTE, variables)
    assert compare_trees(plain / "run.zarr" / "cases", tmp_path / "run.zarr" / "cases") == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "variables",
    [
        {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "SOURCE_DATE_EPOCH": "tomorrow"},
        {"MPLBACKEND": "nonsense", "MATPLOTLIBRC": "broken/matplotlibrc", "PYTHONWARNINGS": "error"},
        {"MPLBACKEND": "TkAgg", "DISPLAY": ":99", "MPLCONFIGDIR": "/proc/self/fdinfo/mine"},
        {"MPLCONFIGDIR": "broken", **FORMATTED},
    ],
    ids=lambda variables: next(iter(variables.values())),
)
def test_the_same_figures(tmp_path: Path, plain: Path, variables: Mapping[str, str]) -> None:
    (tmp_path / "run.zarr").symlink_to(plain / "run.zarr")
    for name in ("matplotlibrc", "broken/matplotlibrc", "broken/stylelib/mine.mplstyle"):
        broken(tmp_path / name)
    assert agfb(tmp_path, DRAW, variables) == "drawing figures\n"
    assert compare_trees(plain / "figures", tmp_path / "figures") == []


def broken(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(BROKEN.encode("latin-1"))
