"""`agfb doctor` sees what is wrong with a machine."""

from __future__ import annotations

import fcntl
import json
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from agfb_cli.commands import doctor
from tests.cli.conftest import Program


def test_every_check_is_listed_and_the_exit_code_says_whether_all_are_in_order(program: Program) -> None:
    done = program("doctor", "--json")
    checks = {check["name"]: check for check in json.loads(done.stdout)}
    assert {"python", "module pipelines", "numba cache", "disk space", "file locks", "BLAS threads"} <= set(
        checks
    )
    problems = [check for check in checks.values() if not check["ok"]]
    assert done.exit_code == (5 if problems else 0)
    assert all(check["advice"] in done.stderr for check in problems)


def test_another_module_named_pipelines_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.own_package().ok
    other = ModuleSpec("pipelines", None, origin="/elsewhere/site-packages/pipelines/__init__.py")
    monkeypatch.setattr(doctor, "find_spec", lambda name: other)
    check = doctor.own_package()
    assert not check.ok
    assert check.found == "/elsewhere/site-packages/pipelines/__init__.py"


def test_a_package_that_is_too_old_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "requires", lambda name: ["zarr<4,>=3.1.6", "xarray>=1; extra == 'export'"])
    monkeypatch.setattr(doctor, "version", lambda name: "3.0.9")
    own, zarr = doctor.required_packages()
    assert own.ok
    assert (zarr.name, zarr.ok) == ("zarr", False)


def test_a_cache_that_cannot_be_written_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new"))
    assert doctor.numba_cache().ok
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/self/fdinfo")
    # numba goes on to the next place
    assert doctor.numba_cache().found == str(Path(doctor.__file__).parents[2] / "pipelines")
    monkeypatch.setattr(doctor, "can_write", lambda directory: False)
    assert not doctor.numba_cache().ok


def test_a_directory_that_cannot_be_written_is_seen(tmp_path: Path) -> None:
    assert doctor.writable(tmp_path, tmp_path / "new").ok
    assert list(tmp_path.iterdir()) == []
    unwritable = Path("/proc/self/fdinfo")
    assert not doctor.writable(unwritable, unwritable / "new").ok


def test_a_file_in_the_way_is_seen(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for output in (tmp_path / "file", tmp_path / "file/below"):
        (check,) = (each for each in doctor.examine(output) if each.name == "output directory")
        assert not check.ok
        assert check.found == f"{tmp_path / 'file'} is a file"


def test_a_full_disk_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LEAST_FREE_BYTES", sys.maxsize)
    assert not doctor.free_space(tmp_path).ok


def test_locks_that_exclude_nobody_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.file_locks(tmp_path).ok
    monkeypatch.setattr(fcntl, "flock", lambda *arguments: None)
    assert not doctor.file_locks(tmp_path).ok


def test_threads_of_blas_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    assert not doctor.blas_threads().ok


def test_the_deepest_directory_that_exists(tmp_path: Path) -> None:
    assert doctor.existing_ancestor(tmp_path / "a" / "b") == tmp_path
