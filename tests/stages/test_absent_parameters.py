"""Parameters that a machine does not have: none in the store, and everything that reads its rows goes on."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.scales import PARAMETERS
from pipelines.datasets.exporting import planned_files, write_files
from pipelines.datasets.reading import case_attributes, list_groups, read_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import open_for_reading
from pipelines.figures.case_tables import read_case
from pipelines.figures.response_envelope import comparable
from pipelines.figures.several_cases import told_apart
from pipelines.stages.parameter_columns import parameter_columns, stored_parameters
from pipelines.stages.reports.verify import verify
from tests.helpers.tiny import PASSIVE, Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

RIGID = (
    "bearings.foil={rigid=true}",
    "continue_cycles.max_points=5",
    "track_curves.max_points=2",
    "track_curves.normal_forms=false",
    "refine.factors=[1.25, 1.5]",
    "refine.points_per_curve=1",
    "transient.start=cycles/b000",
    "transient.start_row=0",
    "transient.duration=20.0",
    "transient.times=[0.0, 20.0]",
    "transient.speeds=[1.14, 1.18]",
    "continue_tori.max_points=1",
)
STAGES = ("continue_cycles", "track_ns", "refine", "transient", "continue_tori")
WHIRL = (
    "linearize.speed_range=[0.7, 1.3]",
    "continue_cycles.range=[0.7, 1.3]",
    "continue_cycles.max_points=2",
)
GROUPS = ("cycles/b000", "ns/c000", "ns/c001", "refinement", "tori/q000")


@pytest.fixture(scope="module")
def rigid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine without foils through every stage that reads rows back."""
    store = tmp_path_factory.mktemp("rigid") / "a.zarr"
    for stage in STAGES:
        result = Watched(stage, tiny_case(*RIGID), store).result
        assert result.ok, (stage, result)
    return store


def test_rows_of_rigid_bearings_have_no_foil_stiffness(rigid: Path) -> None:
    store = open_for_reading(rigid)
    assert {f"cases/smoke/{name}" for name in GROUPS} < set(list_groups(store, "smoke"))
    for name in GROUPS:
        group = read_group(store, f"cases/smoke/{name}")
        assert group.n_points > 0, name
        assert np.isnan(group["foil_stiffness"]).all(), name
        assert np.isfinite(group["excitation_frequency"]).all(), name
        np.testing.assert_array_equal(group["displacement"], 0.2)
    branch = read_group(store, "cases/smoke/cycles/b000")
    assert branch.labels("event_kind").tolist() == ["neimark_sacker"]
    assert np.isnan(branch["event_foil_stiffness"]).all()
    assert case_attributes(store, "smoke")["parameters"]["foil_stiffness"] is None
    parameters = read_group(store, "cases/smoke/transient/t000", ()).attributes["parameters"]
    assert parameters == [1.14, 0.7, 0.2, None]
    fixed = read_group(store, "cases/smoke/tori/q000", ()).attributes["fixed"]
    assert fixed == {"excitation_frequency": 0.7, "displacement": 0.2, "foil_stiffness": None}


def test_the_rows_solve_the_equations_and_the_store_is_whole(rigid: Path) -> None:
    findings, checked = verify(rigid, sample=2)
    assert findings == []
    assert {each.group.split("/")[2] for each in checked} == {"cycles", "ns"}


@pytest.mark.parametrize("stop", [1, 3])
def test_a_rigid_branch_resumes_to_the_same_bytes(rigid: Path, tmp_path: Path, stop: int) -> None:
    path = tmp_path / "a.zarr"
    for stage in ("continue_cycles", "track_ns"):
        assert Watched(stage, tiny_case(*RIGID), path, stop_after=stop).result.ok
        assert Watched(stage, tiny_case(*RIGID), path).result.ok
    for name in ("cycles", "ns"):
        assert compare_trees(rigid / "cases" / "smoke" / name, path / "cases" / "smoke" / name) == []


def test_exported_tables_have_none(rigid: Path, tmp_path: Path) -> None:
    store = open_for_reading(rigid)
    write_files(planned_files(store, "smoke", tmp_path, "csv", full=False))
    for table, column in (("point", "foil_stiffness"), ("event", "event_foil_stiffness")):
        lines = (tmp_path / f"smoke-cycles-b000-{table}.csv").read_text().splitlines()
        told = next(line for line in lines if line.startswith(f"# {column}:"))
        assert "none (NaN) where the machine has none" in told
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        assert {row[column] for row in rows} == {"nan"}
    write_files(planned_files(store, "smoke", tmp_path, "netcdf", full=False))
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "smoke-cycles-b000.nc", engine="scipy") as dataset:
        assert np.isnan(dataset["foil_stiffness"].values).all()
    with xarray.open_dataset(tmp_path / "smoke-transient-t000.nc", engine="scipy") as dataset:
        assert json.loads(dataset.attrs["parameters"]) == [1.14, 0.7, 0.2, None]


def test_the_run_is_drawn_over_the_branch_that_it_left(rigid: Path) -> None:
    found = read_case(
        open_for_reading(rigid), "smoke", ("cycles", "transient_analysis", "transient"), print, []
    )
    assert found is not None
    (run,), branches = found.runs, list(found.of_kind("cycles").values())
    assert comparable(run, branches) == branches
    assert "k" not in told_apart([found.view], ())[1]


def test_a_passive_machine_has_no_excitation_frequency_unless_it_is_given(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    case = tiny_case(*WHIRL, config=PASSIVE)
    assert Watched("continue_cycles", case, path).result.ok
    branch = read_group(open_for_reading(path), f"cases/{case.case_id}/cycles/b000")
    assert np.isnan(branch["excitation_frequency"]).all()
    np.testing.assert_array_equal(branch["displacement"], 0.0)
    np.testing.assert_array_equal(branch["foil_stiffness"], 10.0)
    findings, checked = verify(path, sample=1)
    assert findings == []
    assert checked
    given = tiny_case("excitation.frequency=0.7", config=PASSIVE).case
    assert parameter_columns(given, np.array([1.0, 0.7, 0.0, 10.0]))["excitation_frequency"] == 0.7


def test_the_foil_stiffness_is_that_of_the_first_bearing_with_a_foil() -> None:
    case = tiny_case("bearings.0.foil={rigid=true}", "bearings.1.foil={stiffness=4.0, loss_factor=0.2}").case
    assert parameter_columns(case, np.array([1.1, 0.7, 0.2, 4.0]))["foil_stiffness"] == 4.0


def test_a_stand_in_is_the_same_from_a_row_and_from_the_case() -> None:
    case = tiny_case(*RIGID).case
    own = np.array([1.1, 0.7, 0.2, 1.0])
    arrays = {name: np.array([value]) for name, value in parameter_columns(case, own).items()}
    np.testing.assert_array_equal(stored_parameters(arrays, 0), own)


def test_every_parameter_of_a_row_says_what_it_is_where_there_is_none() -> None:
    for kind in KINDS.values():
        for spec in kind.arrays:
            if spec.name.removeprefix("event_") in ("excitation_frequency", "foil_stiffness"):
                assert "none (NaN)" in spec.long_name, (kind.kind, spec.name)
    assert set(PARAMETERS) == {"speed", "excitation_frequency", "displacement", "foil_stiffness"}
