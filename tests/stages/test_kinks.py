"""A Neimark-Sacker curve of the machine past the kinks of its clipping, in a store."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine
from pipelines.stages.cycles.problem import cycle_problem, kinks_of
from pipelines.stages.reports.verify import verify
from tests.helpers.tiny import ROOT, Watched
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

CONFIG = ROOT / "tests" / "reference" / "clipping_kink.toml"
# where films of both bearings begin to touch ambient pressure, and R1 behind that
SETTINGS = (
    "excitation.frequency=0.4445",
    "continue_cycles.range=[1.03, 1.07]",
    "continue_cycles.start=1.03",
    "track_curves.ranges=[[0.42, 0.446], [0.9, 1.2]]",
)
EXACT_R1 = (0.42779, 1.06899)  # with minimum_step = 1e-6 and without widths, in 46 points


def kink_case(*more: str) -> NamedCase:
    (named,) = read_cases(
        CONFIG.read_text(), CONFIG.name, (*SETTINGS, *more), ("continue_cycles", "track_ns")
    )
    return named


@pytest.fixture(scope="module")
def branched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A branch along the speed with its Neimark-Sacker point."""
    path = tmp_path_factory.mktemp("branched") / "a.zarr"
    assert Watched("continue_cycles", kink_case(), path).result.ok
    return path


def tracked(branched: Path, name: str, *more: str) -> tuple[Path, Watched]:
    path = branched.with_name(f"{name}.zarr")
    shutil.copytree(branched, path)
    return path, Watched("track_ns", kink_case(*more), path)


@pytest.fixture(scope="module")
def whole(branched: Path) -> tuple[Path, Watched]:
    return tracked(branched, "whole")


def leftwards(path: Path) -> Group:
    """The half of the curve towards low excitation frequencies."""
    halves = [read_group(open_for_reading(path), f"cases/kink/ns/c00{half}") for half in (0, 1)]
    return min(halves, key=lambda half: float(half["excitation_frequency"].min()))


def test_the_curve_reaches_its_resonance(whole: tuple[Path, Watched]) -> None:
    path, watched = whole
    curve = leftwards(path)
    assert curve.attributes["stop_reason"] == "resonance_1"
    end = [curve[name][-1] for name in ("excitation_frequency", "speed")]
    assert end == pytest.approx(EXACT_R1, abs=2e-4)
    smooth = curve["clipping_width"] > 0.0
    assert 0 < np.count_nonzero(smooth) < curve.n_points
    assert set(curve["clipping_width"]) <= {0.0, 0.0025, 0.005}
    assert np.all(curve["width_effect"][~smooth] == 0.0)
    assert np.nanmax(curve["width_effect"][smooth]) < 5e-3
    assert f"{np.count_nonzero(smooth)} of" in watched.result.summary["regularised clipping"]


def test_the_film_grazes_where_the_first_smoother_map_is_needed(whole: tuple[Path, Watched]) -> None:
    curve = leftwards(whole[0])
    first = int(np.flatnonzero(curve["clipping_width"] > 0.0)[0])
    assert abs(curve["grazing_gauge"][first - 1]) < 2e-3
    assert abs(curve["grazing_gauge"][0]) > abs(curve["grazing_gauge"][first - 1])
    assert curve["grazing_bearing"][first - 1] in (0, 1)
    assert 0.0 < curve["grazing_angle"][first - 1] < 2.0 * np.pi


def test_without_widths_it_ends_at_the_kink(branched: Path, whole: tuple[Path, Watched]) -> None:
    path, _ = tracked(branched, "without", "track_curves.clipping_widths=[]")
    curve, other = leftwards(path), leftwards(whole[0])
    assert curve.attributes["stop_reason"] == "minimum_step"
    assert np.all(curve["clipping_width"] == 0.0)
    first = int(np.flatnonzero(other["clipping_width"] > 0.0)[0])
    assert curve.n_points >= first
    assert curve["speed"][:first].tobytes() == other["speed"][:first].tobytes()
    assert float(curve["excitation_frequency"].min()) > 0.44 > float(other["excitation_frequency"].min())


def test_resumed_on_a_smoother_map_it_has_the_same_bytes(branched: Path, whole: tuple[Path, Watched]) -> None:
    curve = leftwards(whole[0])
    first = int(np.flatnonzero(curve["clipping_width"] > 0.0)[0])
    path = branched.with_name("resumed.zarr")
    shutil.copytree(branched, path)
    stopped = 0
    while "stopped" in Watched("track_ns", kink_case(), path, stop_after=first).result.stop_reason:
        stopped += 1
    assert stopped > 2
    assert compare_trees(path, whole[0]) == []


def test_points_of_smoother_maps_solve_the_equations_of_these(whole: tuple[Path, Watched]) -> None:
    path, _ = whole
    findings, checked = verify(path, 1000)
    assert findings == []
    name = f"cases/kink/ns/c00{leftwards(path).attributes['half']}"
    assert sum(each.group == name for each in checked) == leftwards(path).n_points


def test_clipped_machines_have_kinks() -> None:
    case = kink_case().case
    machine = build_machine(case)
    period_map = cycle_problem(machine, case).period_map
    kinks = kinks_of(case, machine, period_map)
    assert kinks is not None
    assert kinks.widths == case.track_curves.clipping_widths
    assert kinks.regularised(0.01) is kinks.regularised(0.01)
    assert kinks.regularised(0.01).size == period_map.size
    none = case.track_curves.model_copy(update={"clipping_widths": ()})
    assert kinks_of(case.model_copy(update={"track_curves": none}), machine, period_map) is None
    full = tuple(bearing.model_copy(update={"clipping": "full"}) for bearing in case.bearings)
    assert kinks_of(case.model_copy(update={"bearings": full}), machine, period_map) is None
