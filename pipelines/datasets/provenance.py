"""Where a store comes from: the attributes of its root."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("agfb", "numpy", "scipy", "numba", "zarr", "numcodecs", "pydantic")


def provenance(
    configuration: Mapping[str, Any], configuration_hash: str, argv: Sequence[str], title: str = ""
) -> dict[str, Any]:
    """Root attributes: resolved configuration, its hash, versions, git commit (None without), command line.

    There is no time of day among them: two runs of the same command make the same bytes.
    """
    return {
        "title": title or "Bifurcation sets of a rotor on gas foil bearings",
        "source": "agfb",
        "configuration": dict(configuration),
        "configuration_hash": configuration_hash,
        "versions": versions(),
        "git_commit": git_commit(Path(__file__).parent),
        "argv": list(argv),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that compute and write results."""
    return {"python": platform.python_version()} | {name: _version(name) for name in PACKAGES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def git_commit(folder: Path) -> str | None:
    """Commit of the working tree that holds ``folder`` ("-modified" appended), None where git knows none."""
    commit = _git(folder, "rev-parse", "HEAD")
    if commit is None or _git(folder, "ls-files", "--error-unmatch", Path(__file__).name) is None:
        return (
            None  # no repository, or one that does not track this package (a virtual environment inside it)
        )
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return commit + ("-modified" if changed else "")


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
