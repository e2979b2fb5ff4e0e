"""Console, progress and interruption, without any computation."""

from __future__ import annotations

import io
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from agfb_cli.console import Console, name_values, table
from agfb_cli.interruption import Interruption, resume_command
from agfb_cli.progress import ProgressReporter, describe, duration
from pipelines.stages.results import Progress

ROOT = Path(__file__).resolve().parents[2]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    """Time that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def reports(count: int, clock: Clock, reporter: ProgressReporter, seconds: float, first: int = 1) -> None:
    for done in range(first, first + count):
        clock.now += seconds
        reporter(Progress("continue-cycles", "smoke", done, 200))


def test_data_goes_to_stdout_and_messages_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(verbose=True)
    console.data("number")
    console.message("message")
    console.detail("detail")
    console.error("error")
    out, err = capsys.readouterr()
    assert out == "number\n"
    assert err == "message\ndetail\nerror\n"


def test_quiet_keeps_errors_and_data(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(quiet=True, verbose=True)
    console.data("number")
    console.message("message")
    console.detail("detail")
    console.error("error")
    assert capsys.readouterr() == ("number\n", "error\n")


def test_json_refuses_numbers_that_json_does_not_have() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Console(json=True).json_data({"speed": float("nan")})


def test_json_data_can_be_read_back(capsys: pytest.CaptureFixture[str]) -> None:
    Console(json=True).json_data({"speed": 1.0778, "unit": "Ω"})
    assert json.loads(capsys.readouterr().out) == {"speed": 1.0778, "unit": "Ω"}


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_streams_and_foreign_encodings_are_no_error(closed: str, tmp_path: Path) -> None:
    (tmp_path / "größe.toml").write_text((ROOT / "configs" / "smoke.toml").read_text())
    command = f"{shlex.quote(sys.executable)} -m agfb_cli validate größe.toml"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "ascii:strict"}
    for words in (command, f"{command} --json", f"{command} {closed}"):
        done = subprocess.run(
            ["sh", "-c", words], cwd=tmp_path, env=environment, capture_output=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, b"")
        if "--json" in words:
            assert json.loads(done.stdout)[0]["file"] == "größe.toml"


def test_table_aligns_columns() -> None:
    assert table(("case", "speed"), [("smoke", 1.23456789), ("a", None)]) == (
        "case   speed\nsmoke  1.23457\na      -"
    )


def test_names_and_values_of_a_summary() -> None:
    assert (
        name_values({"instability_speed": 1.0781234, "points": 41}) == "instability speed 1.07812, points 41"
    )


def test_a_summary_shows_both_units_and_what_is_not_there() -> None:
    values = {"speeds": 7, "instability speed": 1.0781234, "instability speed [rpm]": 19954.5}
    values |= {"neimark sacker": "1.1, 1.2", "neimark sacker [rpm]": "20359, 22210", "lowest": None}
    assert name_values(values) == (
        "speeds 7, instability speed 1.07812 (19954 rpm), neimark sacker 1.1, 1.2 (20359, 22210 rpm), "
        "lowest none"
    )


def test_slow_work_is_announced_and_fast_work_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    with Console().announce_if_slow("compiling", 60.0):
        pass
    assert capsys.readouterr().err == ""
    with Console().announce_if_slow("compiling", 0.01):
        time.sleep(0.3)
    assert capsys.readouterr().err == "compiling\n"


def test_without_a_terminal_a_line_every_few_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    reporter = ProgressReporter(Console(), clock)
    reports(30, clock, reporter, seconds=1.0)
    reporter.ended("continue_cycles", "smoke")
    err = capsys.readouterr().err
    assert "\r" not in err
    assert "\x1b" not in err
    # the first report, then one every five seconds
    assert [line.split()[2] for line in err.splitlines()] == [
        f"{n}/200," if n > 1 else "1/200" for n in range(1, 31, 5)
    ]


def test_the_last_report_is_shown_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    reporter = ProgressReporter(Console(), clock)
    reports(200, clock, reporter, seconds=0.01)
    assert capsys.readouterr().err.splitlines()[-1].startswith("continue-cycles smoke: 200/200")


def test_on_a_terminal_one_line_is_overwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    clock = Clock()
    reporter = ProgressReporter(Console(), clock)
    reports(10, clock, reporter, seconds=1.0)
    reporter.ended("continue_cycles", "smoke")
    frames = terminal.getvalue().split("\r\x1b[K")
    assert len(frames) == 1 + 10 + 1
    assert frames[1].startswith("continue-cycles smoke: 1/200")
    assert frames[-1] == ""
    assert "\n" not in terminal.getvalue()


def test_quiet_shows_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    clock = Clock()
    reporter = ProgressReporter(Console(quiet=True), clock)
    reports(10, clock, reporter, seconds=10.0)
    reporter.ended("continue_cycles", "smoke")
    assert terminal.getvalue() == ""


def test_the_rate_counts_only_what_this_run_computed(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    reporter = ProgressReporter(Console(), clock)
    reports(6, clock, reporter, seconds=2.0, first=100)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "continue-cycles smoke: 103/200, 2 s each, at most 3 min 14 s left"


def test_progress_without_a_total() -> None:
    assert (
        describe(Progress("linearize", "a", 3, None, "speed 0.5"), 2, 1.0) == "linearize a: 3, 2/s, speed 0.5"
    )


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (185, "3 min 05 s"), (7620, "2 h 07 min")],
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_first_signal_sets_a_flag(number: int, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(number)
    with Interruption(Console()) as interruption:
        assert not interruption.requested()
        assert interruption.exit_code is None
        os.kill(os.getpid(), number)
        assert interruption.requested()
        assert interruption.exit_code == code
    assert signal.getsignal(number) is before
    assert "finishing the current point" in capsys.readouterr().err


STUBBORN = """
import os, signal, sys, time
from agfb_cli.console import Console
from agfb_cli.interruption import Interruption
with Interruption(Console()) as interruption:
    print("ready", flush=True)
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        time.sleep(0.01)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_second_signal_ends_the_process_at_once(number: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STUBBORN], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert "finishing the current point" in process.stderr.readline()
        assert process.poll() is None
        process.send_signal(number)
        assert process.wait(timeout=5) == -number


def test_the_resume_command_is_quoted_and_does_not_start_afresh(tmp_path: Path) -> None:
    script = tmp_path / "bin dir" / "agfb"
    words = [
        "continue-cycles",
        "my case.toml",
        "--set",
        "excitation.displacement=0.1",
        "--force",
        "-o",
        "a b.zarr",
    ]
    command = resume_command([str(script), *words])
    assert shlex.split(command) == [str(script), *(word for word in words if word != "--force")]


def test_the_resume_command_is_short_when_agfb_is_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "agfb"
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert resume_command([str(script), "run", "a.toml"]) == "agfb run a.toml"


def test_the_resume_command_of_the_module(tmp_path: Path) -> None:
    main = str(tmp_path / "agfb_cli" / "__main__.py")
    assert shlex.split(resume_command([main, "run", "a.toml"])) == [
        sys.executable,
        "-m",
        "agfb_cli",
        "run",
        "a.toml",
    ]
