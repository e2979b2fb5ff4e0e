"""A stored solution solves the equations again; one that was changed does not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import zarr
from typer.testing import CliRunner

from agfb_cli.main import app
from pipelines.datasets.errors import CorruptedError
from pipelines.datasets.store import open_for_reading
from pipelines.stages.reports.verify import stored_case, verify
from tests.helpers.tiny import PASSIVE, Watched, tiny_case

CYCLES = "cases/smoke/cycles/b000"


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("verify") / "a.zarr"
    case = tiny_case(
        "continue_cycles.max_points=4", "track_curves.max_points=3", "track_curves.normal_forms=false"
    )
    for stage in ("linearize", "continue_cycles", "track_ns"):
        assert Watched(stage, case, store).result.ok
    return store


@pytest.fixture
def store(computed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(computed, tmp_path / "a.zarr"))


def test_a_store_solves_its_equations(store: Path) -> None:
    findings, checked = verify(store, sample=2)
    assert findings == []
    groups = {each.group.split("/")[2] for each in checked}
    assert groups == {"linear", "cycles", "ns"}
    assert all(each.holds for each in checked)
    assert max(each.row for each in checked if each.group == CYCLES) == 3, "the last row is among them"
    assert verify(store, sample=0) == ([], [])


@pytest.mark.parametrize(
    ("group", "array"), [(CYCLES, "state"), (CYCLES, "speed"), ("cases/smoke/linear", "state")]
)
def test_a_number_that_was_changed_is_found(store: Path, group: str, array: str) -> None:
    """Written as any program could, with a checksum that fits."""
    stored = zarr.open_array(store / group / array, mode="r+")
    stored[0, ...] = stored[0, ...] + 1e-6
    findings, checked = verify(store, sample=2)
    assert [each.row for each in checked if not each.holds] == [0]
    assert len(findings) == 1
    assert "row 0 does not solve the equations" in findings[0].problem
    assert findings[0].severity == "error"


def test_a_damaged_group_is_not_evaluated(store: Path) -> None:
    chunk = next((store / CYCLES / "state").glob("c.*"))
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"\0")
    findings, checked = verify(store, sample=2)
    assert any(chunk.name in str(finding.path) or "state" in str(finding.path) for finding in findings)
    assert not [each for each in checked if each.group == CYCLES]
    assert [each for each in checked if each.group == "cases/smoke/linear"]


def test_a_branch_other_than_the_store_was_made_for(tmp_path: Path) -> None:
    """The store was made for self-excited whirl, whose rings rest; the branch moves them. Its rows hold all
    that its equations need.
    """
    path = tmp_path / "a.zarr"
    whirl = tiny_case("excitation.frequency=0.7", config=PASSIVE)
    rings = (
        "parameter=displacement",
        "formulation=stroboscopic",
        "range=[0.0, 0.2]",
        "max_points=4",
        "start=0.0",
    )
    keys = (f"continue_cycles.{key}" for key in rings)
    driven = tiny_case("excitation.frequency=0.7", *keys, config=PASSIVE)
    assert Watched("linearize", whirl, path).result.ok
    assert Watched("continue_cycles", driven, path).result.ok
    findings, checked = verify(path, sample=2)
    assert findings == []
    assert [each.row for each in checked if "cycles" in each.group] == [0, 3]


def test_the_case_of_a_store(store: Path) -> None:
    opened = open_for_reading(store)
    assert stored_case(opened, "smoke").case.numerics.circumferential == 16
    with pytest.raises(CorruptedError, match="configuration of the case other"):
        stored_case(opened, "other")


def test_the_command(store: Path) -> None:
    runner = CliRunner()
    done = runner.invoke(app, ["verify", str(store)])
    assert done.exit_code == 0
    assert done.stdout.startswith("whole; ")
    stored = zarr.open_array(store / CYCLES / "state", mode="r+")
    stored[1, 0] = 0.0
    done = runner.invoke(app, ["verify", str(store), "--sample", "4", "--json"])
    assert done.exit_code == 4
    content = json.loads(done.stdout)
    assert [each["row"] for each in content["residuals"] if not each["holds"]] == [1]
    assert content["findings"][0]["severity"] == "error"


def test_a_branch_without_its_metadata_is_told_once_with_everything_else(store: Path) -> None:
    (store / "cases" / "smoke" / "cycles" / "b000" / "zarr.json").unlink()
    (store / "cases" / "smoke" / "linear" / "zarr.json").unlink()
    findings, _ = verify(store, 3)
    wrong = {finding.path.parent.name for finding in findings if finding.severity == "error"}
    assert wrong == {"b000", "linear", "ns"}, "and the curve whose origin is on the branch"
