"""Results over the keys in which cases differ: the table of a store, its linear fit, and what is drawn."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.case.reading import read_cases
from pipelines.datasets.branch import write_group
from pipelines.datasets.case_table import CaseTable, Column, case_table, csv_of, netcdf_of
from pipelines.datasets.failures import Failure, record_failure
from pipelines.datasets.store import Store, open_for_writing
from pipelines.figures.drawing import draw_figures
from pipelines.figures.sensitivity import draw_tornado, linear_fit, table_plans, tornado_panels
from pipelines.stages.scheduling.preparation import prepare_store
from tests.helpers.tiny import CONFIG

COUNT = 8
SAMPLE = (
    f"sample.count={COUNT}",
    "sample.ranges.bearings.foil.stiffness=[8, 12]",
    "sample.tolerances.bearings.0.clearance=2e-6",
    "sample.tolerances.bearings.1.clearance=2e-6",
)
STIFFNESS, FIRST, SECOND = "bearings.foil.stiffness", "bearings.0.clearance", "bearings.1.clearance"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Eight machines whose best speed is linear in their inputs; the range of the last one is missing."""
    cases = read_cases(CONFIG.read_text(), "smoke.toml", SAMPLE, ())
    path = tmp_path_factory.mktemp("sensitivity") / "a.zarr"
    prepare_store(path, cases, ["agfb", "test"])
    opened = open_for_writing(path, durable=False)
    for named in cases[:-1]:
        first, second = named.case.bearings
        rise = 3e4 * (first.clearance - 20.4e-6) - 1e4 * (second.clearance - 20.4e-6)
        stiffness = first.foil.stiffness or 0.0
        speed = (2000.0 + 10.0 * (stiffness - 10.0) + 1e4 * rise) / named.case.scales.speed_rpm_per_unit
        best = {"excitation_frequency": 0.7, "speed": speed, "open": False, "bifurcation": "fold"}
        attributes = {"parameter": "excitation_frequency", "best": best, "passive_gain": 0.2}
        arrays = {"abscissa": np.array([0.7]), "speed": np.array([speed])}
        write_group(opened, f"cases/{named.case_id}/operating_range", "operating_range", arrays, attributes)
    record_failure(opened, Failure(cases[-1].case_id, "bifurcation_set", "no stable cycle", ""))
    return opened


@pytest.fixture(scope="module")
def table(store: Store) -> CaseTable:
    return case_table(store, [f"sample={number:04d}" for number in range(COUNT)])


def column(table: CaseTable, name: str) -> Column:
    return next(each for each in table.columns if each.name == name)


def test_inputs_are_the_keys_in_which_the_cases_differ(table: CaseTable) -> None:
    """A value that both bearings share is one input, and those that differ are two."""
    assert sorted(each.name for each in table.inputs) == sorted([STIFFNESS, FIRST, SECOND])
    named = read_cases(CONFIG.read_text(), "smoke.toml", SAMPLE, ())
    np.testing.assert_array_equal(
        column(table, SECOND).values, [each.case.bearings[1].clearance for each in named]
    )
    assert column(table, FIRST).unit == "m"
    assert column(table, FIRST).meaning == "radial clearance c"


def test_outputs_with_units_and_missing_ones(table: CaseTable) -> None:
    speed, rpm = column(table, "best_speed"), column(table, "best_speed_rpm")
    assert (speed.unit, rpm.unit) == ("1", "rpm")
    assert np.isnan(rpm.values[-1])
    assert np.ptp(rpm.values[:-1]) > 0.0
    assert column(table, "best_bound").values.tolist() == ["fold"] * (COUNT - 1) + [""]
    assert column(table, "failed").values[-1] == "bifurcation_set: no stable cycle"
    assert [each.name for each in table.outputs] == [
        *("best_excitation_frequency", "best_excitation_frequency_hz", "best_speed", "best_speed_rpm"),
        *("best_bound", "passive_gain", "failed"),
    ]


def test_files_hold_the_table(table: CaseTable, tmp_path: Path) -> None:
    lines = csv_of(table).decode().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert f"# {FIRST}: radial clearance c [m]" in comments
    rows = list(csv.DictReader(io.StringIO("\n".join(lines[len(comments) :]))))
    assert [row["case"] for row in rows] == list(table.cases)
    (tmp_path / "a.nc").write_bytes(netcdf_of(table))
    with xarray.open_dataset(tmp_path / "a.nc", engine="scipy") as dataset:
        for each in (*table.inputs, *table.outputs):
            if each.is_number:
                np.testing.assert_array_equal([float(row[each.name]) for row in rows], each.values)
                np.testing.assert_array_equal(dataset[each.name].values, each.values)
                assert dataset[each.name].attrs["units"] == each.unit
        assert dataset[FIRST].attrs["role"] == "input"


def test_the_fit_of_a_plane_is_exact_and_that_of_noise_explains_nothing() -> None:
    unit = np.random.default_rng(0).random((40, 3))
    inputs = np.array([8.0, 1e-5, 100.0]) + np.array([4.0, 2e-6, 50.0]) * unit
    slopes = np.array([2.0, 3e5, -0.1])
    fit = linear_fit(inputs, inputs @ slopes)
    np.testing.assert_allclose(fit.effects, slopes * 0.5 * np.ptp(inputs, axis=0), rtol=1e-9)
    middle = 0.5 * (inputs.min(axis=0) + inputs.max(axis=0))
    assert fit.middle == pytest.approx(float(middle @ slopes), rel=1e-12)
    assert fit.explained == pytest.approx(1.0, abs=1e-12)
    noise = [linear_fit(inputs, each).explained for each in np.random.default_rng(1).random((200, 40))]
    assert abs(np.mean(noise)) < 0.02, "adjusted: without bias for the three slopes"


def test_a_tornado_has_a_bar_for_every_input_the_longest_on_top(table: CaseTable) -> None:
    panels = {panel.output.title: panel for panel in tornado_panels(table)}
    assert set(panels) == {"best excitation frequency", "best speed"}, "the gain is the same everywhere"
    panel = panels["best speed"]
    known = np.isfinite(column(table, "best_speed").values)
    ranges = [np.ptp(each.values[known]) for each in table.inputs]
    slopes = [{STIFFNESS: 10.0, FIRST: 3e8, SECOND: -1e8}[each.name] for each in table.inputs]
    np.testing.assert_allclose(panel.fit.effects, 0.5 * np.array(slopes) * ranges, rtol=1e-6)
    assert panel.cases == COUNT - 1
    (axes,) = draw_tornado(table, [panel], "").axes
    labels = [label.get_text().split("\n")[0] for label in axes.get_yticklabels()]
    assert labels == ["stiffness", "1.clearance", "0.clearance"]
    widths = sorted(abs(patch.get_width()) for patch in axes.patches)
    np.testing.assert_allclose(widths, np.repeat(np.sort(np.abs(panel.fit.effects)), 2))


def test_figures_are_drawn_where_they_can_be(store: Store, tmp_path: Path) -> None:
    told: list[str] = []
    written = draw_figures(store, tmp_path, kinds=("tornado", "scatter"), notify=told.append)
    assert ([path.name for path in written], told) == (["tornado.png", "scatter.png"], [])
    few = draw_figures(store, tmp_path, cases="*[012]", kinds=("tornado", "scatter"), notify=told.append)
    assert [path.name for path in few] == ["scatter.png"]
    assert told == ["tornado is left out: 3 inputs need 5 cases with a result, none has"]
    assert draw_figures(store, tmp_path, cases="*0", kinds=("scatter",), notify=told.append) == []
    assert "no key with numbers in which they differ" in told[-1]


def test_a_scatter_matrix_has_eight_rows_at_most() -> None:
    draw = np.random.default_rng(0)
    columns = [Column(f"a.x{number}", "1", "", draw.random(30)) for number in range(12)]
    told: list[str] = []
    wide = CaseTable(("",) * 30, tuple(columns[:5]), tuple(columns[5:]))
    (plan,) = table_plans(wide, ("scatter",), "", told.append)
    assert len(plan.draw().axes) == 64
    assert (
        list(table_plans(CaseTable(("",) * 30, tuple(columns[:8]), ()), ("scatter",), "", told.append)) == []
    )
    assert (
        list(table_plans(CaseTable(("",) * 30, *[tuple(columns[:8])] * 2), ("scatter",), "", told.append))
        == []
    )
    assert told[-1] == "scatter is left out: 8 inputs differ; it shows at most 7"


def test_the_command(store: Store, tmp_path: Path) -> None:
    def table_of(*words: str) -> tuple[int, str, str]:
        done = CliRunner().invoke(app, ["table", str(store.path), *words])
        return done.exit_code, done.stdout, done.stderr

    code, out, _ = table_of()
    assert code == ExitCode.DONE
    assert out.splitlines()[0].split()[:2] == ["case", FIRST]
    assert len(out.splitlines()) == COUNT + 1
    file = tmp_path / "a.csv"
    assert table_of("-o", str(file))[:2] == (ExitCode.DONE, f"{file}\n")
    before = file.read_bytes()
    code, _, message = table_of("-o", str(file))
    assert (code, file.read_bytes()) == (ExitCode.USAGE, before)
    assert "--force" in message
    assert table_of("-o", str(file), "--force")[0] == ExitCode.DONE
    assert table_of("-o", str(tmp_path / "a.xlsx"))[0] == ExitCode.USAGE
    document = json.loads(table_of("--json", "--case", "*7")[1])
    assert document["cases"]["sample=0007"]["failed"] == "bifurcation_set: no stable cycle"
    assert document["inputs"] == {}, "one case differs from no other"
