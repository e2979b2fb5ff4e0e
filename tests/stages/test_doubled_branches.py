"""Branches of period-doubled cycles: where they start, what their cycles are, resume."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.bifurcations.switching import with_multiplied_period
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.cycles.rows import BranchRecorder
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

# across the lower edge of a tongue of period doublings
ACROSS = (
    "operation.speed=1.05",
    "continue_cycles.parameter=excitation_frequency",
    "continue_cycles.range=[0.765, 0.785]",
    "continue_cycles.start=0.765",
    "continue_cycles.step=0.002",
    "continue_cycles.amplitude=0.005",
    "continue_cycles.maximum_step=0.01",
    "continue_cycles.max_points=7",
    "continue_cycles.doublings=1",
    "numerics.multiplier_tolerance=1e-4",
)


def branch(path: Path, name: str) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/cycles/{name}")


@pytest.fixture(scope="module")
def doubled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("doubled") / "a.zarr"
    result = Watched("continue_cycles", tiny_case(*ACROSS), path).result
    assert result.ok
    assert result.summary["doubled branches"] == 1
    return path


@pytest.mark.slow
def test_doubled_cycles_close_after_two_periods(doubled: Path) -> None:
    case = tiny_case(*ACROSS).case
    simple = cycle_problem(build_machine(case), case)
    twice = with_multiplied_period(simple, 2).period_map
    rows = branch(doubled, "d000")
    assert rows.attributes["turns"] == 2
    assert rows.attributes["origin"] == {"group": "cycles/b000", "event": 0}
    for index in range(rows.n_points):
        parameters = np.array([rows[name][index] for name in PARAMETERS])
        state, steps = rows["state"][index], int(rows["steps_per_period"][index])
        assert rows["period"][index] == pytest.approx(4.0 * np.pi / parameters[1], rel=1e-12)
        image = twice.evaluate(state, parameters, float(rows["period"][index]), steps)
        assert np.max(np.abs(image.state - state)) < 1e-9
        orbit = rows["orbit"][index]
        apart = np.max(np.abs(orbit[0] - orbit[len(orbit) // 2]))
        assert apart > 1e-4, "a cycle of the simple period would close after one"


def test_they_are_born_at_the_period_doubling(doubled: Path) -> None:
    """Their amplitude grows like the square root of the distance, and they take over the stability."""
    parent, rows = branch(doubled, "b000"), branch(doubled, "d000")
    (critical,) = parent["event_excitation_frequency"]
    orbits, frequency = rows["orbit"], rows["excitation_frequency"]
    amplitude = np.linalg.norm(orbits[:, 0] - orbits[:, orbits.shape[1] // 2], axis=1)
    # frequency - critical = c amplitude^2, whatever shift of the critical one other time steps cause
    slopes = np.diff(amplitude[:4] ** 2) / np.diff(frequency[:4])
    assert slopes == pytest.approx(slopes[0], rel=0.05)
    born = frequency[0] - amplitude[0] ** 2 / slopes[0]
    assert born == pytest.approx(critical, abs=1e-4)
    # supercritical: born where the simple cycles are unstable, and stable themselves
    assert parent["unstable_count"][parent["excitation_frequency"] > critical].tolist() == [1] * int(
        np.sum(parent["excitation_frequency"] > critical)
    )
    assert np.all(frequency > born)
    assert rows["unstable_count"][0] == 0


def test_cycles_of_half_the_period_are_on_no_doubled_branch(doubled: Path) -> None:
    case = tiny_case(*ACROSS).case
    machine, simple = build_machine(case), cycle_problem(build_machine(case), case)
    parent, rows = branch(doubled, "b000"), branch(doubled, "d000")

    def said(found: Group, index: int, resumed: Group | None) -> str | None:
        parameters = np.array([found[name][index] for name in PARAMETERS])
        image = with_multiplied_period(simple, 2).period_map.evaluate(
            found["state"][index],
            parameters,
            4.0 * np.pi / parameters[1],
            2 * int(parent["steps_per_period"][-1]),
        )
        recorder = BranchRecorder(machine, None, case, lambda *_: None, 2, resumed)  # type: ignore[arg-type]
        cycle = SimpleNamespace(image=image, parameters=parameters)
        return recorder.limit(SimpleNamespace(cycle=cycle))  # type: ignore[arg-type]

    assert said(rows, rows.n_points - 1, rows) is None
    assert said(rows, 0, None) is None
    assert "has half the period" in str(said(parent, parent.n_points - 1, None))


@pytest.mark.slow
@pytest.mark.parametrize("stop", [2, 5])
def test_resuming_gives_the_same_bytes(doubled: Path, tmp_path: Path, stop: int) -> None:
    path = tmp_path / "a.zarr"
    assert Watched("continue_cycles", tiny_case(*ACROSS), path, stop_after=stop).result.ok
    assert Watched("continue_cycles", tiny_case(*ACROSS), path).result.ok
    assert compare_trees(doubled, path) == []
    assert verify(path) == []
    assert Watched("continue_cycles", tiny_case(*ACROSS), path).reported == []


@pytest.mark.slow
def test_a_branch_of_a_symmetric_machine_passes_its_pitchfork(tmp_path: Path) -> None:
    """Where the doubled cycles lose the symmetry of both bearings the corrector has no unique solution."""
    path = tmp_path / "a.zarr"
    beyond = (
        "continue_cycles.range=[0.82, 0.875]",
        "continue_cycles.start=0.82",
        "continue_cycles.maximum_step=0.04",
        "continue_cycles.max_points=20",
    )
    result = Watched("continue_cycles", tiny_case(*ACROSS, *beyond), path).result
    assert result.ok
    rows = branch(path, "d000")
    assert rows.attributes["stop_reason"] == "range"
    assert rows.labels("event_kind").tolist() == ["branch_point"]
    assert rows["event_excitation_frequency"] == pytest.approx([0.863587], abs=1e-5)
    assert rows["unstable_count"].tolist().count(0) > 0, "stable beyond it"
    film = rows["minimum_film"]
    assert film[:, 0] == pytest.approx(film[:, 1], abs=1e-4), "both bearings move alike on both sides"
