"""Provenance of a store: the attributes of its root."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pipelines.case.identity import physics_hash
from pipelines.case.reading import NamedCase

PACKAGES = ("agfb", "numpy", "scipy", "numba", "zarr", "numcodecs", "pydantic")


def provenance(cases: Sequence[NamedCase], argv: Sequence[str]) -> dict[str, Any]:
    """Root attributes: resolved configuration of every case, its hash, versions, git commit, command line.

    ``configuration`` maps case ids to resolved cases and ``configuration_hash`` covers their physics and
    numerics only, so what is asked of the same cases may change between two runs into one store. There is no
    time of day: two runs of one command make the same bytes.
    """
    return {
        "title": "Bifurcation sets of rotors on gas foil bearings",
        "source": "agfb",
        "configuration": {case.case_id: case.resolved for case in cases},
        "configuration_hash": configuration_hash({case.case_id: physics_hash(case.case) for case in cases}),
        "versions": versions(),
        "git_commit": git_commit(Path(__file__).parent),
        "argv": list(argv),
    }


def configuration_hash(hashes: Mapping[str, str]) -> str:
    """SHA-256 of the cases of a store, from case ids and the hashes of their physics."""
    lines = (f"{case} {physics}\n" for case, physics in sorted(hashes.items()))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that compute and write results."""
    return {"python": platform.python_version()} | {name: _version(name) for name in PACKAGES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def git_commit(folder: Path) -> str | None:
    """Commit of the working tree that holds ``folder`` ("-modified" appended); None outside of git."""
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
