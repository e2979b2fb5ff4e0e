"""What other programs read back is what the store holds."""

from __future__ import annotations

import csv
import json
import sys
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
