"""The overhung turbine with the masters that `criticals` advises, through all stages of its motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.reports.verify import verify
from tests.helpers.tiny import Watched, tiny_case
from tests.stages.test_doubled_branches import ACROSS
from tests.stages.test_slopes import SLOPES

pytestmark = pytest.mark.slow

ADVISED = "{ node = 0, slopes = true }, 2, 3, 6, 9, { node = 12, slopes = true }"
PLAIN = "0, 2, 3, 6, 9, 12"
FULL = ", ".join(f"{{ node = {node}, slopes = true }}" for node in range(13))
MICRO_TURBINE = Path(__file__).parents[1] / "reference" / "micro_turbine.toml"
KEYS = (
    "numerics.circumferential=16",
    "numerics.axial=1",
    "numerics.max_columns=30",
    "numerics.multiplier_tolerance=1e-4",
    "continue_cycles.start=0.98",
    "continue_cycles.range=[0.9, 1.3]",
    "continue_cycles.maximum_step=0.1",
    "continue_cycles.step=0.1",
    "continue_cycles.max_points=4",
    "track_curves.ranges=[[0.5, 1.1], [0.9, 1.3]]",
    "track_curves.max_points=3",
    "track_curves.normal_forms=false",
    "continue_tori.max_points=2",
    "continue_tori.range=[0.9, 1.3]",
    "transient.start=cycles/b000",
    "transient.start_row=0",
    "transient.duration=30.0",
    "unbalance.grade=2.5",
    "unbalance.rated_speed_rpm=80000.0",
)
NODES = [0, 0, 0, 0, 2, 2, 3, 3, 6, 6, 9, 9, 12, 12, 12, 12]


def turbine_case(masters: str) -> NamedCase:
    named, *_ = read_cases(
        MICRO_TURBINE.read_text(), MICRO_TURBINE.name, (*KEYS, f"rotor.masters=[{masters}]")
    )
    return named


@pytest.fixture(scope="module")
def turbine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("turbine") / "a.zarr"
    for stage in ("continue_cycles", "track_ns", "continue_tori", "transient"):
        result = Watched(stage, turbine_case(ADVISED), store).result
        assert result.ok, (stage, result)
    return store


def test_every_motion_has_the_coordinates_of_the_slopes(turbine: Path) -> None:
    store = open_for_reading(turbine)
    for name in ("cycles/b000", "ns/c000", "ns/c001", "tori/q000", "transient/t000"):
        group = read_group(store, f"cases/mgt/{name}")
        assert group.n_points > 1, name
        np.testing.assert_array_equal(group["coordinate_node"], NODES)
        axes = group.labels("coordinate_axis")
        np.testing.assert_array_equal(axes[[2, 3, 14, 15]], ["alpha", "beta"] * 2)
        extent = group["orbit_maximum" if name[0] != "t" or name[1] == "o" else "displacement"]
        assert np.all(np.isfinite(extent[: group.n_points]))


def test_the_stored_motions_solve_the_equations(turbine: Path) -> None:
    findings, checked = verify(turbine, sample=2)
    assert findings == []
    assert {each.group.split("/")[2] for each in checked} == {"cycles", "ns"}


def test_the_cycles_lose_their_stability_where_those_of_the_full_rotor_do(
    turbine: Path, tmp_path: Path
) -> None:
    def onset(store: Path) -> float:
        branch = read_group(open_for_reading(store), "cases/mgt/cycles/b000")
        assert branch.labels("event_kind").tolist() == ["neimark_sacker"]
        return float(branch["event_speed"][0])

    found = {}
    for name, masters in (("full", FULL), ("plain", PLAIN)):
        path = tmp_path / f"{name}.zarr"
        assert Watched("continue_cycles", turbine_case(masters), path).result.ok
        found[name] = onset(path)
    off = {
        name: abs(value / found["full"] - 1.0) for name, value in (found | {"own": onset(turbine)}).items()
    }
    assert off["own"] < 5e-6 < 5e-4 < off["plain"]


def test_period_doublings_are_followed_with_slopes(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    table = ("track_curves.max_points=2", "track_curves.normal_forms=false",
             "track_curves.ranges=[[0.5, 1.0], [0.8, 1.3]]")  # fmt: skip
    for stage in ("continue_cycles", "track_pd"):
        assert Watched(stage, tiny_case(*ACROSS, SLOPES, *table), path).result.ok
    store = open_for_reading(path)
    for name in ("cycles/d000", "pd/c000", "pd/c001"):
        group = read_group(store, f"cases/smoke/{name}")
        assert group.n_points > 1, name
        assert group["orbit_maximum"].shape[1] == 18
    findings, checked = verify(path, sample=2)
    assert findings == []
    assert {each.group.split("/")[2] for each in checked} == {"cycles", "pd"}
