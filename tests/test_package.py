"""What a user gets from the package index: the built wheel, looked at and started."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, text=True)
    (built,) = folder.glob("agfb-*.whl")
    return built


def test_the_wheel_holds_every_module_and_nothing_else(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = {
        path.relative_to(ROOT).as_posix()
        for package in ("agfb_cli", "pipelines")
        for path in (ROOT / package).rglob("*")
        if path.suffix in {".py", ".html", ".css", ".js"} or path.name == "py.typed"
    }
    page = {f"pipelines/figures/page/page.{ending}" for ending in ("html", "css", "js")}
    assert {"agfb_cli/py.typed", "pipelines/py.typed", *page} <= sources
    packaged = {name for name in names if ".dist-info/" not in name}
    assert packaged == sources


def test_the_metadata(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (metadata_name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = Parser().parsestr(archive.read(metadata_name).decode())
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert metadata["Name"] == "agfb"
    assert metadata["Version"] == declared["version"]
    assert metadata["License-Expression"] == "MIT"
    required = [line for line in metadata.get_all("Requires-Dist") if "extra ==" not in line]
    assert len(required) == len(declared["dependencies"])
    assert any(name.endswith("/licenses/LICENSE") for name in archive.namelist())


def test_the_script_of_the_wheel_starts(wheel: Path, tmp_path: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    archive.extractall(tmp_path)
    (entry_points,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
    assert "agfb = agfb_cli.main:app" in archive.read(entry_points).decode()
    done = subprocess.run(
        [sys.executable, "-m", "agfb_cli", "--version"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("agfb ")
    where = subprocess.run(
        [sys.executable, "-c", "import agfb_cli, pipelines; print(agfb_cli.__file__, pipelines.__file__)"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert where.stdout.count(str(tmp_path)) == 2
