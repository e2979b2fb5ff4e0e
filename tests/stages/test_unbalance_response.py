"""`agfb unbalance-response`: what the group holds, when it is computed again, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.case.reading import CaseError
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.figures.bode import COLOURS, draw_bode
from pipelines.figures.case_tables import read_case
from pipelines.figures.drawing import draw_figures
from pipelines.machine.unbalance import unbalance_masses
from pipelines.orbits.equilibria.synchronous_response import peaks
from pipelines.stages.scheduling.plan import StageStatus, plan
from tests.helpers.tiny import Watched, tiny_case

STAGE = "unbalance_response"
SMALL = (
    "unbalance.planes=[{node = 0, moment = 0.2}, {node = 14, moment = 0.1, phase = 1.0}]",
    "unbalance_response.speed_range=[0.25, 0.7]",
    "unbalance_response.points=6",
    "unbalance_response.probes=[0, 7]",
)
SPEEDS = "unbalance_response.points=5"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("response") / "a.zarr"
    assert Watched(STAGE, tiny_case(*SMALL), path).result.ok
    return path


@pytest.fixture(scope="module")
def group(store: Path) -> Group:
    return read_group(open_for_reading(store), f"cases/smoke/{STAGE}")


def test_the_group(group: Group, store: Path) -> None:
    speeds, response = group["speed"], group["response"]
    assert response.shape == (len(speeds), 2, 2, 2)
    assert np.all(np.isin(np.linspace(0.25, 0.7, 6), speeds))
    assert group.attributes["inserted_speeds"] == len(speeds) - 6 > 0
    masses = unbalance_masses(tiny_case(*SMALL).case)
    np.testing.assert_array_equal(group["plane_moment"], [mass.moment for mass in masses])
    assert group["probe_node"].tolist() == [0, 7]
    total = response.sum(axis=1)
    expected = [
        (probe, axis, peak.speed, peak.amplification)
        for probe in (0, 1)
        for axis in (0, 1)
        for peak in peaks(speeds, total[:, probe, axis])
    ]
    names = ("peak_probe", "peak_axis", "peak_speed", "peak_amplification")
    np.testing.assert_array_equal(np.array(expected).T, [group[name] for name in names])
    assert len(expected) > 0
    assert verify(store) == []


def test_it_is_computed_again_for_another_request_only(store: Path) -> None:
    def state(*overrides: str) -> StageStatus:
        return next(plan((STAGE,), (tiny_case(*SMALL, *overrides),), store)).there

    before = (store / "cases" / "smoke" / STAGE / "zarr.json").stat().st_mtime_ns
    assert state() is StageStatus.COMPLETE
    assert Watched(STAGE, tiny_case(*SMALL), store).result.ok
    assert (store / "cases" / "smoke" / STAGE / "zarr.json").stat().st_mtime_ns == before
    assert state(SPEEDS) is StageStatus.NOTHING
    assert state("unbalance.planes=[{node = 0, moment = 0.3}]") is StageStatus.NOTHING


def test_a_motion_too_large_for_a_linear_response_is_told(tmp_path: Path, group: Group) -> None:
    assert group.attributes["largest_motion"] == group["journal_motion"].max()
    heavy = (*SMALL[1:], SPEEDS, "unbalance.planes=[{node = 0, moment = 20}]")
    watched = Watched(STAGE, tiny_case(*heavy), tmp_path / "a.zarr")
    assert "too much for a linear response" in watched.result.caution
    assert watched.result.ok


def test_it_stops_on_request_and_writes_nothing(tmp_path: Path) -> None:
    watched = Watched(STAGE, tiny_case(*SMALL), tmp_path / "a.zarr", stop_after=2)
    assert watched.result.stop_reason == "stopped on request"
    assert not open_for_reading(tmp_path / "a.zarr").has_group(f"cases/smoke/{STAGE}")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (SMALL[1:], "nothing excites the rotor"),
        ((*SMALL, "unbalance_response.probes=[15]"), "node 15 is not on the shaft"),
        ((*SMALL, "unbalance_response.probes=[7, 7]"), "each node once"),
        ((*SMALL, "unbalance_response.speed_range=[0, 1]"), "must be > 0"),
        ((*SMALL, "unbalance_response.speed_range=[100, 18000]"), "rpm"),
    ],
)
def test_what_is_refused(overrides: tuple[str, ...], message: str) -> None:
    with pytest.raises(CaseError, match=message):
        tiny_case(*overrides, stages=(STAGE,))


def test_the_figure(store: Path, group: Group, tmp_path: Path) -> None:
    (written,) = draw_figures(store, tmp_path, kinds=("bode",))
    assert written.name == "bode.png"
    tables = read_case(open_for_reading(store), "smoke", (STAGE,), str, [])
    assert tables is not None
    amplitude, phase = draw_bode(tables.view, tables.single[STAGE]).axes[:2]
    total = group["response"].sum(axis=1)[:, 0, 1]
    (along_y,) = (
        line for line in amplitude.lines if line.get_color() == COLOURS[1] and line.get_marker() == "None"
    )
    np.testing.assert_array_equal(along_y.get_ydata(), np.abs(total))
    turned = np.deg2rad(np.asarray(phase.lines[1].get_ydata()))
    np.testing.assert_allclose(np.exp(1j * turned), total / np.abs(total), atol=1e-12)
    marked = [line.get_xdata()[0] for line in amplitude.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(sorted(marked), sorted(group["peak_speed"][group["peak_probe"] == 0]))
