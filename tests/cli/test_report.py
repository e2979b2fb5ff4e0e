"""`agfb report`: what it prints, what it writes, what it says when there is nothing to tell."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import create_store, open_for_reading
from pipelines.figures.page.stability_plane import placed
from pipelines.stages.reports.operating_range import operating_range
from pipelines.stages.scheduling.preparation import prepare_store
from tests.figures.synthetic_store import ATTRIBUTES, make_store
from tests.helpers.curves import SCALES, curve_rows, write_curve, write_cycles, write_set
from tests.helpers.surveys import write_survey
from tests.helpers.tiny import tiny_case


def report(*words: str) -> Result:
    return CliRunner().invoke(app, ["report", *words], prog_name="agfb")


@pytest.fixture
def store(tmp_path: Path) -> Path:
    make_store(tmp_path / "a.zarr", 5)
    return tmp_path / "a.zarr"


def test_a_table_a_conclusion_and_data(store: Path) -> None:
    done = report(str(store))
    assert done.exit_code == ExitCode.DONE
    assert "kb10: bifurcation-free from speed 0.2500" in done.stdout
    assert "Neimark-Sacker, supercritical" in done.stdout
    assert "best: excitation frequency" in done.stdout
    assert "operating point: not in the plane of the curves" in done.stdout, "this case has none"
    assert "against displacement 0 (unstable from 1.0500" in done.stdout
    assert "against excitation frequency 0.2" in done.stdout
    assert "caution" in done.stderr, "one of its curves stopped before its end"
    written = read_group(open_for_reading(store), "cases/kb10/operating_range")
    assert written["speed"].max() == written.attributes["best"]["speed"]


def test_the_same_as_json(store: Path) -> None:
    document = json.loads(report(str(store), "--json").stdout)
    case = document["cases"]["kb10"]
    assert document["written"] is True
    assert case["best"]["speed"] > case["passive_instability_speed"]
    assert case["passive_gain"] == pytest.approx(case["best"]["speed"] / 1.05 - 1.0)
    assert {row["bifurcation"] for row in case["boundary"]} >= {"neimark_sacker"}


@pytest.mark.parametrize(
    ("error", "caution"), [(0.1731, "the condensed rotor has a mode 17.3 % off"), (0.0021, ""), (None, "")]
)
def test_the_error_of_the_condensed_rotor_is_told_with_its_caution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: float | None, caution: str
) -> None:
    """What `agfb criticals` has stored; nothing where it could not be known."""
    monkeypatch.setitem(ATTRIBUTES, "criticals", {"condensation_error": error, "caution": caution})
    make_store(tmp_path / "a.zarr", 5)
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.DONE
    line = "condensed rotor: modes below the highest speed at most"
    assert ([each for each in done.stdout.splitlines() if each.startswith(line)]) == (
        [] if error is None else [f"{line} {'17' if error > 0.1 else '0.21'} % off"]
    )
    assert ("caution: kb10: the condensed rotor has a mode 17.3 % off" in done.stderr) is bool(caution)
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["cases"]["kb10"]
    assert told["condensation_error"] == error
    assert told["condensation_caution"] == caution


def test_without_critical_speeds_nothing_is_told_of_the_condensed_rotor(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 5, parts=("machine", "curves", "set"))
    assert "condensed rotor" not in report(str(tmp_path / "a.zarr")).output
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["cases"]["kb10"]
    assert told["condensation_error"] is None


def test_a_store_without_curves_says_what_to_run(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 3, parts=("machine", "cycles"))
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.USAGE
    assert "no bifurcation set" in done.stderr
    assert "agfb run" in done.stderr


def test_a_survey_is_told_with_the_range_and_alone(tmp_path: Path) -> None:
    """All its onsets lie at the speed of one boundary: with curves it tells how many are theirs."""
    store = make_store(tmp_path / "a.zarr", 5)
    boundaries = [each for each in operating_range(store, "kb10").boundaries if each.curve >= 0]
    speed = boundaries[len(boundaries) // 2].speed
    write_survey(store, "kb10", onset=speed, points=(37, 7))
    done = report(str(tmp_path / "a.zarr"))
    assert done.exit_code == ExitCode.DONE
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("survey: ")]
    assert "of 259 cells unstable, 1 without a usable cycle" in line
    assert re.search(
        rf"lowest onset at speed {speed:.4g} \(\d+ rpm\), excitation frequency 0.2 \([0-9.]+ Hz\) "
        r"\(period doubling\)",
        line,
    )
    assert re.search(r"within 0.011 \([0-9.]+ rpm\) of the first bifurcation of the curves", line)
    told = json.loads(report(str(tmp_path / "a.zarr"), "--json").stdout)["surveys"]["kb10"]
    assert told["lowest"]["across"] == pytest.approx(speed)
    assert 0 < told["agreeing"] < told["compared"] <= 37

    write_survey(make_store(tmp_path / "b.zarr", parts=("machine",)), "kb10")
    alone = report(str(tmp_path / "b.zarr"))
    assert alone.exit_code == ExitCode.DONE
    assert alone.stdout.startswith("kb10: survey: 30 of 70 cells unstable")
    assert alone.stderr == ""


@pytest.fixture
def with_margin(tmp_path: Path) -> Path:
    """A case that runs at speed 0.5 and excitation frequency 1.0, below a line of Neimark-Sacker points."""
    own = {"excitation_frequency": 1.0, "speed": 0.5}
    case = {"name": "a", "parameters": own, "scales": SCALES, "reconstruction": ""}
    provenance = {"configuration": {}, "configuration_hash": "0"}
    store = create_store(tmp_path / "m.zarr", {"a": case}, provenance, durable=False)
    write_set(store, "a")
    write_cycles(store, "cases/a/cycles/s000", "excitation_frequency", np.array([0.2, 0.21]), 0.25, 0)
    rows = curve_rows(lambda f: np.column_stack([f, 1.2 - 0.2 * f]), (0.2, 2.0), 4)
    write_curve(store, "cases/a/ns/c000", "neimark_sacker", rows)
    return tmp_path / "m.zarr"


def test_the_margin_is_told_in_both_units(with_margin: Path) -> None:
    """The line is 0.5 above in speed, and 1 / sqrt(1.16) away relatively (tests/stages/test_margin)."""
    lines = report(str(with_margin)).stdout.splitlines()
    assert "operating point: speed 0.5000 (9000 rpm), excitation frequency 1.0000 (300 Hz): stable" in lines
    (speed,) = [line.split("  ") for line in lines if line.startswith("higher speed")]
    assert [cell.strip() for cell in speed if cell] == [
        "higher speed", "+0.5000 (+9000 rpm)", "-", "100.0%", "Neimark-Sacker, supercritical", "ns/c000",
    ]  # fmt: skip
    (nearest,) = [line for line in lines if line.startswith("nearest")]
    assert "+0.4310 (+7759 rpm)" in nearest
    assert "+0.3448 (+103.4 Hz)" in nearest
    assert "92.8%" in nearest
    margin = json.loads(report(str(with_margin), "--json").stdout)["cases"]["a"]["margin"]
    assert margin["base"] == "stable"
    assert margin["speed_distance"] == pytest.approx(0.5)
    assert margin["speed_distance_rpm"] == pytest.approx(9000.0)
    assert margin["excitation_frequency_distance"] is None
    assert margin["excitation_frequency_distance_hz"] is None
    assert margin["nearest"]["excitation_frequency_hz"] == pytest.approx(300.0 * (1.0 + 0.4 / 1.16))
    assert margin["lower_excitation_frequency"] is None


def test_a_page_holds_what_is_told(with_margin: Path, tmp_path: Path) -> None:
    page = tmp_path / "new" / "report.html"
    done = report(str(with_margin), "--html", str(page))
    assert done.exit_code == ExitCode.DONE
    assert done.stdout.splitlines()[-1] == str(page)
    text = page.read_text(encoding="utf-8")
    assert "Operating point: speed 0.5000 (9000 rpm)" in text
    assert "<td>+0.5000 (+9000 rpm)</td>" in text
    (frame,) = [json.loads(found) for found in re.findall(r'"frame":(\{.*?\})', text)]
    (line,) = re.findall(r'class="margin" d="M(.*?),(.*?) L(.*?),(.*?)"', text)
    found = [float(number) for number in line]
    foot = 0.4 / 1.16
    expected = [*placed(frame, 1.0, 0.5), *placed(frame, 1.0 + foot, 1.0 - 0.2 * foot)]
    assert found == pytest.approx(expected, abs=0.01)
    again = report(str(with_margin), "--html", str(page))
    assert again.exit_code == ExitCode.USAGE
    assert "replace it with --force" in again.stderr
    forced = report(str(with_margin), "--html", str(page), "--force", "--json")
    assert forced.exit_code == ExitCode.DONE
    assert json.loads(forced.stdout)["page"] == str(page)
    assert page.read_text(encoding="utf-8") == text, "the same store gives the same page"


def test_a_page_needs_no_set(tmp_path: Path) -> None:
    make_store(tmp_path / "a.zarr", 3, parts=("machine", "linear"))
    page = tmp_path / "report.html"
    done = report(str(tmp_path / "a.zarr"), "--html", str(page))
    assert done.exit_code == ExitCode.DONE
    assert "no bifurcation set" in done.stderr
    assert "agfb run CONFIG -o STORE" in page.read_text(encoding="utf-8")
    other = report(str(tmp_path / "a.zarr"), "--html", str(tmp_path / "report.pdf"))
    assert other.exit_code == ExitCode.USAGE
    assert "must be .html" in other.stderr


@pytest.mark.slow
def test_a_page_of_a_computed_machine_tells_its_mass_and_loads(tmp_path: Path) -> None:
    store, case = tmp_path / "a.zarr", tiny_case("linearize.points=3")
    prepare_store(store, [case], ["agfb"])
    page = tmp_path / "report.html"
    assert report(str(store), "--html", str(page)).exit_code == ExitCode.DONE
    text = page.read_text(encoding="utf-8")
    mass, gravity = case.case.rotor.mass, case.case.rotor.gravity
    assert f"<td>{mass:.4g} kg</td>" in text
    loads = [float(load) for load in re.findall(r"static load of bearing.*?<td>([\d.]+) N</td>", text)]
    assert sum(loads) == pytest.approx(mass * gravity, rel=1e-3)
