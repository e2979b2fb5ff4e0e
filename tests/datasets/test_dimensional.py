"""Exported files have rpm, Hz, s, um, N/m and N s/m beside the dimensionless numbers of the store."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.io import loadmat

from pipelines.case.fields import SI_UNITS
from pipelines.case.reading import read_cases
from pipelines.datasets.case_table import case_table
from pipelines.datasets.dimensional import StoredScales, quantity_of
from pipelines.datasets.exporting import planned_files, write_files
from pipelines.datasets.reading import read_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, open_for_reading
from pipelines.stages.scheduling.preparation import prepare_store
from tests.helpers.tiny import CONFIG, Watched, tiny_case

# The second bearing differs from the first in all that its films are scaled by.
OTHER = ("bearings.1.clearance=25e-6", "bearings.1.radius=0.015", "bearings.1.length=0.02")
WORDS = (*OTHER, "linearize.points=3", "linearize.speed_range=[0.7, 0.9]", "linearize.whirl_ratios=[0.5]")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    path = tmp_path_factory.mktemp("dimensional") / "a.zarr"
    case = tiny_case(*WORDS, "criticals.points=4", "criticals.speed_range=[0.3, 0.6]")
    for stage in ("linearize", "criticals"):
        Watched(stage, case, path)
    return open_for_reading(path)


@pytest.fixture(scope="module")
def lengths() -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float]:
    """Radius, length and clearance [m] of the bearings, p0 [Pa] and t0 [s], from the configuration."""
    case = tiny_case(*WORDS).case
    radius, length, clearance = (
        np.array([getattr(bearing, name) for bearing in case.bearings])
        for name in ("radius", "length", "clearance")
    )
    p0 = case.gas.ambient_pressure
    return radius, length, clearance, p0, 6 * case.gas.viscosity * radius[0] ** 2 / (p0 * clearance[0] ** 2)


def test_tables_have_columns_in_si_units(store: Store, tmp_path: Path, lengths) -> None:
    radius, length, clearance, p0, t0 = lengths
    write_files(planned_files(store, "smoke", tmp_path, "csv", full=False))
    lines = (tmp_path / "smoke-linear-speed.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert "# speed_rpm: the same [rpm]" in lines
    for name, unit in (("journal", "um"), ("eccentricity", "um"), ("stiffness", None)):
        spec = KINDS["operating_point"].array(name)
        found = StoredScales(store, "smoke").si_unit(read_group(store, "cases/smoke/operating_point"), spec)
        assert (None if found is None else found.unit) == unit
        if found is not None:
            assert found.factor.ravel() == pytest.approx(1e6 * clearance, rel=1e-14)
    for row in rows:
        rpm = float(row["speed"]) / t0 * 30 / math.pi
        assert float(row["speed_rpm"]) == pytest.approx(rpm, rel=1e-14)
        for bearing in range(2):
            own, k0 = f"[0,{bearing},0,1]", p0 * radius[bearing] * length[bearing] / clearance[bearing]
            stiffness, damping = row["bearing_stiffness" + own], row["bearing_damping" + own]
            found = (
                float(row["bearing_stiffness_n_per_m" + own]),
                float(row["bearing_damping_ns_per_m" + own]),
            )
            assert found == pytest.approx((k0 * float(stiffness), k0 * t0 * float(damping)), rel=1e-14)
            film = float(row[f"minimum_film[{bearing}]"]) * clearance[bearing] * 1e6
            assert float(row[f"minimum_film_um[{bearing}]"]) == pytest.approx(film, rel=1e-14)
    lines = (tmp_path / "smoke-criticals-speed.csv").read_text().splitlines()
    (row, *_) = csv.DictReader(line for line in lines if not line.startswith("#"))
    hertz = float(row["frequency[0]"]) / (2 * math.pi * t0)
    assert float(row["frequency_hz[0]"]) == pytest.approx(hertz, rel=1e-14)


def test_netcdf_and_matlab_state_unit_and_factor(store: Store, tmp_path: Path, lengths) -> None:
    *_, clearance, _, t0 = lengths
    write_files(planned_files(store, "smoke", tmp_path, "netcdf", full=True))
    with xarray.open_dataset(tmp_path / "smoke-linear.nc", engine="scipy") as dataset:
        assert dataset["speed"].attrs["si_units"] == "rpm"
        assert dataset["speed"].attrs["si_factor"] == pytest.approx(30 / math.pi / t0, rel=1e-14)
        assert dataset["minimum_film"].attrs["si_factor"] == pytest.approx(1e6 * clearance, rel=1e-14)
        assert "si_units" not in dataset["whirl_ratio"].attrs
    write_files(planned_files(store, "smoke", tmp_path, "mat", full=False))
    linear = loadmat(tmp_path / "smoke.mat", simplify_cells=True)["linear"]
    assert linear["si_units"]["speed"] == "rpm"
    assert linear["si_factor"]["speed"] == pytest.approx(30 / math.pi / t0, rel=1e-14)


def test_slopes_have_no_micrometres(tmp_path: Path) -> None:
    """Of a rotor whose masters keep slopes, displacements alone are lengths."""
    masters = "rotor.masters=[{node = 0, slopes = true}, 2, 4, 7, 10, 12, 14]"
    case = tiny_case(masters, "continue_cycles.max_points=1")
    Watched("continue_cycles", case, tmp_path / "a.zarr")
    opened = open_for_reading(tmp_path / "a.zarr")
    group = read_group(opened, "cases/smoke/cycles/b000")
    found = StoredScales(opened, "smoke").si_unit(group, KINDS["cycles"].array("orbit_minimum"))
    assert found is not None
    is_slope = np.isin(group.labels("coordinate_axis"), ("alpha", "beta"))
    factor = found.factor.ravel()
    assert np.isnan(factor).tolist() == is_slope.tolist()
    assert is_slope.sum() == 2
    assert factor[~is_slope] == pytest.approx(1e6 * case.case.bearings[0].clearance, rel=1e-14)


def test_every_array_called_dimensionless_has_a_unit() -> None:
    """But rates of growth, which are per unit of time, and onsets of a calibration, of other machines."""
    specs = [spec for group in KINDS.values() for spec in group.arrays if "dimensionless" in spec.long_name]
    called = [spec for spec in specs if "growth" not in spec.name and spec.name != "onset"]
    assert len(called) > 20
    for spec in called:
        assert quantity_of(spec, {}) in SI_UNITS, spec.name
    named = {"parameter": "excitation_frequency", "parameters": ["excitation_frequency", "speed"]}
    assert quantity_of(KINDS["operating_range"].array("abscissa"), named) == "frequency"
    assert quantity_of(KINDS["survey"].array("across"), named) == "speed"
    assert quantity_of(KINDS["refinement"].array("error"), {}) is None


def test_a_key_of_one_value_in_si_units_is_no_input_of_a_table(tmp_path: Path) -> None:
    """Clearances alone differ: dimensionless ends, strokes and steps do so for no other reason."""
    words = (
        *("linearize.units=si", "linearize.speed_range=[13000, 24000]"),
        *("excitation.units=si", "excitation.frequency=150", "excitation.displacement=2"),
        *("continue_cycles.units=si", "continue_cycles.range=[13000, 24000]", "continue_cycles.start=18000"),
        *("continue_cycles.step=300", "continue_cycles.minimum_step=0.1", "continue_cycles.maximum_step=600"),
    )
    cases = read_cases(CONFIG.read_text(), "smoke.toml", (*words, "sweep.bearings.clearance=[19e-6, 22e-6]"))
    prepare_store(tmp_path / "a.zarr", cases, ["agfb"])
    opened = open_for_reading(tmp_path / "a.zarr")
    ranges = {case.case.linearize.speed_range for case in cases}
    assert len(ranges) == len({case.case.excitation.displacement for case in cases}) == 2
    table = case_table(opened, [case.case_id for case in cases])
    assert [column.name for column in table.inputs] == ["bearings.clearance"]
