"""`agfb doctor`: checks that this machine can run agfb."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from agfb_cli.console import Console, table
from agfb_cli.errors import ExitCode, explained
from agfb_cli.options import AsJson, Quiet, Traceback

LEAST_FREE_BYTES = 2**30
Directory = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIRECTORY", help="Directory for your stores.")
]


@dataclass(frozen=True)
class Check:
    """One check; `advice` is empty if it passes."""

    name: str
    ok: bool
    found: str
    advice: str = ""


def doctor(
    output: Directory = Path("build"),
    quiet: Quiet = False,
    json: AsJson = False,
    traceback: Traceback = False,
) -> None:
    """Check the installation and this machine.

    Exit code 5 if something would make a run fail; stderr then says what to do.
    """
    console = Console(quiet=quiet, json=json, traceback=traceback)
    with explained(console):
        checks = list(examine(output))
        if json:
            console.json_data([asdict(check) for check in checks])
        else:
            rows = [("ok" if check.ok else "PROBLEM", check.name, check.found) for check in checks]
            console.data(table(("", "check", "found"), rows))
        problems = [check for check in checks if not check.ok]
        for check in problems:
            console.error(f"{check.name}: {check.advice}")
        raise typer.Exit(ExitCode.RESOURCES if problems else ExitCode.DONE)


def examine(output: Path) -> Iterator[Check]:
    """Every check in the order in which it is shown."""
    yield python_version()
    yield from required_packages()
    yield own_package()
    yield numba_cache()
    yield processors()
    yield blas_threads()
    directory = existing_ancestor(output)
    yield free_space(directory)
    yield writable(directory, output)
    yield file_locks(directory)


def python_version() -> Check:
    """The version of Python."""
    found = ".".join(map(str, sys.version_info[:3]))
    return Check("python", sys.version_info >= (3, 11), found, "Python 3.11 or newer is needed")


def required_packages() -> Iterator[Check]:
    """Every package that agfb's metadata ask for, at a version that they allow."""
    from packaging.requirements import Requirement

    try:
        requirements = [Requirement(line) for line in requires("agfb") or ()]
    except PackageNotFoundError:
        yield Check("agfb", False, "not installed", "install it: `make install`, or `pip install .`")
        return
    yield Check("agfb", True, version("agfb"))
    for requirement in requirements:
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found = version(requirement.name)
        except PackageNotFoundError:
            found = "not installed"
        ok = found != "not installed" and requirement.specifier.contains(found, prereleases=True)
        yield Check(requirement.name, ok, found, f"{requirement} is needed; run `make install`")


def own_package() -> Check:
    """Whether the top-level module `pipelines` belongs to agfb, not to another distribution."""
    spec = find_spec("pipelines")
    expected = Path(__file__).resolve().parents[2] / "pipelines" / "__init__.py"
    found = spec.origin if spec is not None and spec.origin is not None else "not found"
    return Check(
        "module pipelines",
        Path(found).resolve() == expected,
        found,
        f"{expected} is needed: another package installs a module of that name; use a fresh environment",
    )


def numba_cache() -> Check:
    """The folder where numba keeps compiled kernels.

    The first writable one of NUMBA_CACHE_DIR, the folder of the sources and the user's cache. Without any,
    numba refuses to load the kernels.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(__file__).resolve().parents[2] / "pipelines"
    user = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    candidates = [*([Path(chosen)] if chosen else []), beside, user]
    for directory in candidates:
        if can_write(existing_ancestor(directory)):
            return Check("numba cache", True, str(directory))
    return Check(
        "numba cache",
        False,
        f"not writable: {', '.join(map(str, candidates))}",
        "set NUMBA_CACHE_DIR to a writable directory: no kernel can be loaded otherwise",
    )


def processors() -> Check:
    """How many processors this process may use."""
    return Check("processors", True, str(usable_processors()))


def usable_processors() -> int:
    """The processors of this process's affinity mask where the system has one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def blas_threads() -> Check:
    """Threads of BLAS: one is best; more slow down the small matrices here."""
    found = os.environ.get("OMP_NUM_THREADS", "1")
    return Check("BLAS threads", found == "1", found, "unset OMP_NUM_THREADS or set it to 1")


def free_space(directory: Path) -> Check:
    """Free space on the disk of the output directory."""
    free = shutil.disk_usage(directory).free
    return Check(
        "disk space",
        free >= LEAST_FREE_BYTES,
        f"{free / 2**30:.1f} GiB free in {directory}",
        "make room, or use -o",
    )


def writable(directory: Path, output: Path) -> Check:
    """Whether stores can be created in ``output``, on the way to which ``directory`` is the deepest."""
    inner = output.absolute().relative_to(directory).parts[:1]
    if inner and os.path.exists(directory / inner[0]):
        found = f"{directory / inner[0]} is a file"
        return Check("output directory", False, found, "name another directory with -o")
    return Check("output directory", can_write(directory), str(directory), "name another directory with -o")


def file_locks(directory: Path) -> Check:
    """Whether `flock` excludes a second writer there; some network file systems do not offer it."""
    advice = "put stores on a file system that supports flock, or never run two writers on one store"
    try:
        ok = _with_scratch_file(directory, _lock_excludes)
    except OSError as error:
        return Check("file locks", False, f"{directory}: {error.strerror}", advice)
    return Check("file locks", ok, f"flock {'works' if ok else 'excludes nobody'} in {directory}", advice)


def _lock_excludes(path: Path) -> bool:
    import fcntl

    # Two open files of one process hold independent flocks, so this sees what two processes would see.
    with path.open("wb") as first, path.open("wb") as second:
        fcntl.flock(first, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            fcntl.flock(second, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        return False


def can_write(directory: Path) -> bool:
    """Whether a file can really be created there; permission bits alone do not tell."""
    try:
        return _with_scratch_file(directory, Path.exists)
    except OSError:
        return False


def _with_scratch_file(directory: Path, use: Callable[[Path], bool]) -> bool:
    with tempfile.TemporaryDirectory(prefix=".agfb-doctor-", dir=directory) as scratch:
        path = Path(scratch) / "probe"
        path.touch()
        return use(path)


def existing_ancestor(path: Path) -> Path:
    """The deepest directory on the way to `path` that exists."""
    path = path.absolute()
    while not path.is_dir():
        path = path.parent
    return path
