"""Exit codes, and the explanation of each kind of error to the user."""

from __future__ import annotations

import errno
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum

import typer

from agfb_cli.console import Console


class ExitCode(IntEnum):
    """Exit code seen by the shell."""

    DONE = 0
    BUG = 1
    USAGE = 2
    CASES_FAILED = 3
    STORE = 4
    RESOURCES = 5
    INTERRUPTED = 130
    TERMINATED = 143


class UsageError(Exception):
    """The command cannot be carried out as typed; `hint` says what to try instead."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True)
class Explanation:
    """An error in the user's terms."""

    code: ExitCode
    message: str
    hint: str = ""

    @property
    def text(self) -> str:
        """The text for stderr."""
        return f"error: {self.message}" + (f"\nhint: {self.hint}" if self.hint else "")

    def as_dict(self) -> dict[str, object]:
        """The JSON document for programs."""
        return {"code": int(self.code), "message": self.message, "hint": self.hint}


_FULL = {
    errno.ENOSPC: "no space left on the disk",
    errno.EDQUOT: "disk quota exceeded",
    errno.EFBIG: "file too large",
}
_EXHAUSTED = {
    errno.EMFILE: "too many open files",
    errno.ENFILE: "too many open files",
    errno.ENOMEM: "out of memory",
    errno.EAGAIN: "too many processes or threads",
    errno.ENOLCK: "no file locks left",
}
_FORBIDDEN = {
    errno.EACCES: "",
    errno.EPERM: "",
    errno.EROFS: "",
    errno.ENOTDIR: "a file is in the way, where a directory belongs",
    errno.EISDIR: "",
    errno.EEXIST: "a file is in the way, where a directory belongs",
    errno.ENOTEMPTY: "",
    errno.ELOOP: "a link that leads to itself",
}
"""What the system refuses to do with a path, in other words where its own do not tell."""
_WRONG_CALL = (errno.EBADF, errno.ECHILD, errno.EFAULT)  # what no state of the system brings about
_RESUMES = "committed points are kept; the same command resumes"


def explain(error: BaseException) -> Explanation:
    """Map an exception to an exit code and a message.

    The packages that define the project's own errors are looked up among the loaded modules: an error of
    theirs cannot exist before they are loaded, and loading them here would cost a second for nothing.
    """
    if isinstance(error, UsageError):
        return Explanation(ExitCode.USAGE, str(error), error.hint)
    if _is_from(error, "pipelines.case.reading", "CaseError"):
        return Explanation(ExitCode.USAGE, str(error))
    if _is_from(error, "pipelines.datasets.store", "StoreError"):
        return _explain_store_error(error)
    if _is_from(error, "pipelines.stages.scheduling.pool", "ClusterError"):
        return Explanation(ExitCode.RESOURCES, str(error), getattr(error, "advice", ""))
    if isinstance(error, MemoryError):
        return Explanation(
            ExitCode.RESOURCES, "out of memory", "use a smaller grid or fewer workers; " + _RESUMES
        )
    if isinstance(error, OSError):
        return _explain_system_error(error)
    if isinstance(error, ImportError) and (error.name or "").split(".")[0] in ("pipelines", "agfb_cli"):
        return Explanation(ExitCode.RESOURCES, f"{error}", "`agfb doctor` checks the installation")
    if isinstance(error, RuntimeError) and "no locator available" in str(error):
        return Explanation(
            ExitCode.RESOURCES,
            "numba finds no directory that it may write its compiled kernels to",
            "set the environment variable NUMBA_CACHE_DIR to a writable directory",
        )
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop"):  # pathlib's, to Python 3.12
        return _explain_system_error(OSError(errno.ELOOP, "", str(error).partition("from ")[2].strip("'")))
    return _bug(error)


def _explain_store_error(error: BaseException) -> Explanation:
    place = f"{path}: " if (path := getattr(error, "path", None)) else ""
    message, advice = getattr(error, "message", str(error)), getattr(error, "advice", "")
    return Explanation(ExitCode.STORE, place + message, advice)


def _explain_system_error(error: OSError) -> Explanation:
    where = f"{error.filename}: " if error.filename else ""
    if error.errno in _FULL:
        return Explanation(ExitCode.RESOURCES, where + _FULL[error.errno], "make room; " + _RESUMES)
    if error.errno in _EXHAUSTED:
        return Explanation(
            ExitCode.RESOURCES, where + _EXHAUSTED[error.errno], f"raise the limit (`ulimit -a`); {_RESUMES}"
        )
    if error.errno in _FORBIDDEN:
        told, elsewhere = _FORBIDDEN[error.errno], "name a directory that you may write to with -o"
        hint = elsewhere if told else f"check the permissions; to write elsewhere, {elsewhere}"
        return Explanation(ExitCode.STORE, where + (told or str(error.strerror)), hint)
    if error.errno == errno.ENAMETOOLONG:
        return Explanation(ExitCode.USAGE, where + "the name is too long", "name a shorter one")
    if error.errno == errno.ENOENT:
        return Explanation(
            ExitCode.STORE,
            f"{where}{error.strerror}",
            "was it removed or renamed while the command ran? The same command computes what is missing",
        )
    if error.errno in _WRONG_CALL:
        return _bug(error)
    if error.errno is None:  # a library's own, for instance llvmlite's where it cannot be loaded
        return Explanation(
            ExitCode.RESOURCES, f"{error}", "is there enough memory? `agfb doctor` checks the installation"
        )
    return Explanation(
        ExitCode.RESOURCES,
        f"{where}{error.strerror}",
        f"the disk, the network or its file system fails; {_RESUMES}",
    )


def _bug(error: BaseException) -> Explanation:
    return Explanation(
        ExitCode.BUG,
        f"unexpected {type(error).__name__}: {error}",
        "this is a bug in agfb: please report it with the output of the same command with --traceback",
    )


def _is_from(error: BaseException, module: str, name: str) -> bool:
    kind = getattr(sys.modules.get(module), name, None)
    return isinstance(kind, type) and isinstance(error, kind)


@contextmanager
def explained(console: Console) -> Iterator[None]:
    """Run a command's body; turn every error into a message on stderr and an exit code."""
    try:
        yield
    except typer.Exit:
        raise
    except KeyboardInterrupt:
        _report(Explanation(ExitCode.INTERRUPTED, "interrupted"), console, "interrupted")
        raise typer.Exit(ExitCode.INTERRUPTED) from None
    except Exception as error:
        if console.traceback:
            console.error("".join(traceback.format_exception(error)).rstrip())
        explanation = explain(error)
        _report(explanation, console, explanation.text)
        raise typer.Exit(explanation.code) from None


def _report(explanation: Explanation, console: Console, text: str) -> None:
    """Report the error to the user, and with `--json` also to the program that reads stdout.

    Not if stdout has its document already.
    """
    console.error(text)
    if console.json and not console.answered:
        console.json_data({"error": explanation.as_dict()})
