"""What other programs read back is what the store holds."""

from __future__ import annotations

import csv
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.io import loadmat
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.exporting import planned_files, write_files
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store, open_for_reading
from tests.helpers.synthetic import GROUP
from tests.helpers.tiny import Watched, tiny_case


def export_case(store: Store, case: str, folder: Path, kind: str, full: bool) -> list[Path]:
    return write_files(planned_files(store, case, folder, kind, full))


def test_tables(finished: Path, tmp_path: Path) -> None:
    store = open_for_reading(finished)
    written = export_case(store, "synthetic", tmp_path, "csv", full=False)
    assert tmp_path / "synthetic-criticals-critical.csv" in written
    lines = (tmp_path / "synthetic-cycles-b000-point.csv").read_text().splitlines()
    told = [line for line in lines if line.startswith("#")]
    assert "# speed: rotating speed, dimensionless [1]" in told
    rows = list(csv.DictReader(lines[len(told) :]))
    group = read_group(store, GROUP)
    assert [float(row["speed"]) for row in rows] == group["speed"].tolist(), "every digit"
    found = [complex(float(row["multipliers[1].re"]), float(row["multipliers[1].im"])) for row in rows]
    np.testing.assert_array_equal(found, group["multipliers"][:, 1])
    assert [row["direction"] for row in rows] == group.labels("direction").tolist()
    assert not any(name.startswith("orbit[") for name in rows[0]), "960 numbers a row are too wide"
    export_case(store, "synthetic", tmp_path, "csv", full=True)
    header = (tmp_path / "synthetic-cycles-b000-point.csv").read_text().splitlines()
    assert any(line.startswith("# orbit:") for line in header)


def test_netcdf(finished: Path, tmp_path: Path) -> None:
    store = open_for_reading(finished)
    export_case(store, "synthetic", tmp_path, "netcdf", full=True)
    with xarray.open_dataset(tmp_path / "synthetic-cycles-b000.nc", engine="scipy") as dataset:
        group = read_group(store, GROUP)
        np.testing.assert_array_equal(dataset["orbit"].values, group["orbit"])
        found = dataset["multipliers_real"].values + 1j * dataset["multipliers_imag"].values
        np.testing.assert_array_equal(found, group["multipliers"])
        assert dataset["speed"].attrs["units"] == "1"
        assert dataset["direction"].attrs["flag_meanings"] == "unset down up"
        assert dataset.attrs["stop_reason"] == "maximum_points"


def test_matlab(finished: Path, tmp_path: Path) -> None:
    store = open_for_reading(finished)
    (path,) = export_case(store, "synthetic", tmp_path, "mat", full=False)
    branch = loadmat(path, simplify_cells=True)["cycles_b000"]
    group = read_group(store, GROUP)
    np.testing.assert_array_equal(branch["speed"], group["speed"])
    np.testing.assert_array_equal(branch["multipliers"], group["multipliers"])
    assert branch["direction"].tolist() == group.labels("direction").tolist()
    assert branch["units"]["speed"] == "1"
    assert json.loads(branch["attributes"])["stop_reason"] == "maximum_points"


def test_the_command_replaces_nothing_unasked(finished: Path, tmp_path: Path) -> None:
    runner, folder = CliRunner(), tmp_path / "out"
    words = ["export", str(finished), "-o", str(folder), "--format", "mat"]
    done = runner.invoke(app, words)
    assert (done.exit_code, done.stdout) == (0, f"{folder / 'synthetic.mat'}\n")
    before = (folder / "synthetic.mat").stat().st_mtime_ns
    refused = runner.invoke(app, words)
    assert refused.exit_code == 2
    assert "there already" in refused.stderr
    assert (folder / "synthetic.mat").stat().st_mtime_ns == before
    assert runner.invoke(app, [*words, "--force"]).exit_code == 0


def test_without_xarray(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    done = CliRunner().invoke(app, ["export", str(finished), "-o", str(tmp_path), "--format", "netcdf"])
    assert done.exit_code == 2
    assert "netCDF files need xarray" in done.stderr
    assert list(tmp_path.iterdir()) == []


def read_long(path: Path) -> list[dict[str, str]]:
    lines = path.read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


@pytest.fixture(scope="module")
def linear_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("linear") / "a.zarr"
    case = tiny_case("linearize.points=2", "coefficients.points=2", "coefficients.frequencies=3")
    for stage in ("linearize", "criticals", "coefficients"):
        assert Watched(stage, case, path).result.ok
    return path


def test_modes_are_one_long_table(linear_store: Path, tmp_path: Path) -> None:
    store = open_for_reading(linear_store)
    export_case(store, "smoke", tmp_path, "csv", full=False)
    group = read_group(store, "cases/smoke/linear")
    rows = read_long(tmp_path / "smoke-linear-modes.csv")
    assert len(rows) == np.isfinite(group["logarithmic_decrement"]).sum() > 0
    for row in rows:
        index = group["speed"].tolist().index(float(row["speed"]))
        mode = group["eigenvalues"][index].imag.tolist().index(float(row["frequency"]))
        assert float(row["logarithmic_decrement"]) == group["logarithmic_decrement"][index, mode]
        assert float(row["frequency_rpm"]) == pytest.approx(60.0 * float(row["frequency_hz"]), rel=1e-12)
        assert float(row["speed_rpm"]) / float(row["speed"]) == pytest.approx(
            float(row["frequency_rpm"]) / float(row["frequency"]), rel=1e-12
        )
        assert row["direction"] == group.labels("direction")[index, mode]
    followed = read_group(store, "cases/smoke/criticals")
    rows = read_long(tmp_path / "smoke-criticals-modes.csv")
    for row in rows:
        index = followed["speed"].tolist().index(float(row["speed"]))
        assert float(row["frequency"]) == followed["frequency"][index, int(row["mode"]) - 1]


def units_of_coefficients() -> tuple[float, float]:
    """p0 R L / c in N/m, and that times t0 in N s/m, from the configuration; both bearings are equal."""
    case = tiny_case().case
    bearing = case.bearings[0]
    stiffness = case.gas.ambient_pressure * bearing.radius * bearing.length / bearing.clearance
    return stiffness, stiffness * case.scales.time


def test_coefficients_are_one_long_table_for_each_bearing(linear_store: Path, tmp_path: Path) -> None:
    store = open_for_reading(linear_store)
    export_case(store, "smoke", tmp_path, "csv", full=False)
    group = read_group(store, "cases/smoke/coefficients")
    _, damping_unit = units_of_coefficients()
    for bearing in (0, 1):
        rows = read_long(tmp_path / f"smoke-coefficients-bearing_{bearing + 1}.csv")
        assert [(float(row["speed"]), float(row["frequency"])) for row in rows] == [
            (speed, frequency) for speed in group["speed"] for frequency in group["frequency"]
        ]
        found = np.array([[float(row[f"k{entry}"]) for entry in ("xx", "xy", "yx", "yy")] for row in rows])
        np.testing.assert_array_equal(found, group["stiffness"][:, :, bearing].reshape(-1, 4))
        in_si = np.array([float(row["cxy_ns_per_m"]) for row in rows])
        expected = group["damping"][:, :, bearing, 0, 1].ravel() * damping_unit
        np.testing.assert_allclose(in_si, expected, rtol=1e-13)


def test_bearings_of_ross_hold_tables_over_speed_and_frequency(linear_store: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["export", str(linear_store), "-o", str(tmp_path), "--format", "ross"])
    assert done.exit_code == 0, done.output
    group = read_group(open_for_reading(linear_store), "cases/smoke/coefficients")
    stiffness_unit, _ = units_of_coefficients()
    time = tiny_case().case.scales.time
    for bearing in (0, 1):
        text = (tmp_path / f"smoke-coefficients-bearing_{bearing + 1}-ross.toml").read_text()
        ((name, table),) = tomllib.loads(text).items()
        assert name == f"BearingElement_{table['tag']}"
        assert table["n"] == group["bearing_node"][bearing]
        np.testing.assert_allclose(table["speed"], group["speed"] / time, rtol=1e-14)
        np.testing.assert_allclose(table["frequency"], group["frequency"] / time, rtol=1e-14)
        expected = group["stiffness"][:, :, bearing, 1, 0] * stiffness_unit
        np.testing.assert_allclose(table["kyx"], expected, rtol=1e-13)


def test_without_coefficients_there_is_nothing_for_ross(finished: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["export", str(finished), "-o", str(tmp_path), "--format", "ross"])
    assert done.exit_code == 2
    assert "agfb coefficients" in done.output
    assert list(tmp_path.iterdir()) == []
