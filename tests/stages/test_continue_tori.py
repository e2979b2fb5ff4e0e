"""Tori into a store: rows, resume, both origins, what starts none, the ways a branch ends."""

from __future__ import annotations

import re
import shutil
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.fourier import interpolated
from pipelines.case.reading import CaseError, stage_problems
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import OtherConfigurationError, open_for_reading
from pipelines.machine.assembly import build_machine
from pipelines.orbits.machine_cycles import cycle_shape
from pipelines.stages.cycles.start import NoStart
from pipelines.stages.job import Job
from pipelines.stages.tori.rows import whirl_turn
from pipelines.stages.tori.sources import forced_cycles, unbalanced_tori
from tests.helpers.tiny import PASSIVE, Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

COARSE = "numerics.multiplier_tolerance=1e-4"  # half of the time steps
FEW_ANGLES = (COARSE, "continue_tori.tolerance=1e-4", "continue_tori.max_points=3")
UNBALANCE = (
    *FEW_ANGLES,
    "continue_tori.max_points=2",
    "continue_tori.origin=unbalance",
    "continue_tori.start=0.9",
    "unbalance.planes=[{node=2, moment=0.1}, {node=12, moment=0.05, phase=1.0}]",
)


def tori(path: Path, name: str = "q000") -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/tori/{name}")


def names(path: Path) -> list[str]:
    found = list_groups(open_for_reading(path), "smoke")
    return [name.rsplit("/", 1)[1] for name in found if "/tori/" in name]


@pytest.fixture(scope="module")
def branched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A branch of cycles with its Neimark-Sacker point."""
    path = tmp_path_factory.mktemp("branched") / "a.zarr"
    assert Watched("continue_cycles", tiny_case(COARSE), path).result.ok
    return path


@pytest.fixture(scope="module")
def born(branched: Path) -> Path:
    """The same with the tori born there."""
    path = branched.with_name("born.zarr")
    shutil.copytree(branched, path)
    result = Watched("continue_tori", tiny_case(*FEW_ANGLES), path).result
    assert result.ok
    assert result.summary == {"branches": 1, "points": 3, "unstable points": 0}
    return path


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tori with unbalance in a store without cycles."""
    path = tmp_path_factory.mktemp("driven") / "a.zarr"
    assert Watched("continue_tori", tiny_case(*UNBALANCE), path).result.ok
    return path


def assert_invariant(rows: Group, index: int, circle: PeriodCircle, period: float) -> None:
    """A pass from a place between the angles ends on the curve, a turn of rho further."""
    count = int(rows["angle_count"][index])
    section, rotation = rows["section"][index, :count], float(rows["rotation"][index])
    assert np.all(np.isnan(rows["section"][index, count:]))
    angle = 1.234
    parameters = circle.parameters_at(float(rows["speed"][index]), angle)
    state = interpolated(section, np.array([angle]))[0]
    image = circle.period_map.evaluate(state, parameters, period, circle.steps).state
    # the curve between its angles lacks what its series lacks
    there = interpolated(section, np.array([angle + rotation]))[0]
    assert np.max(np.abs(image - there)) < 1e-9 + 10.0 * rows["tail"][index]


def test_rows_of_tori_that_are_born(born: Path) -> None:
    case = tiny_case(*FEW_ANGLES).case
    machine, rows = build_machine(case), tori(born)
    event = read_group(open_for_reading(born), "cases/smoke/cycles/b000", ("event_speed", "event_angle"))
    assert rows.n_points == 3
    # at the amplitude 0.01 rotation and speed are those of the point, up to its square
    assert rows["speed"][0] == pytest.approx(event["event_speed"][0], abs=1e-3)
    assert rows["rotation"][0] == pytest.approx(event["event_angle"][0], abs=1e-3)
    assert np.all(np.diff(rows["speed"]) > 0.0), "supercritical: they exist above it"
    assert rows.labels("direction").tolist() == ["up"] * 3
    assert np.all(np.diff(rows["moduli"][:, 0]) < 0.0), "and are the more stable the farther they are"
    assert np.all(rows["moduli"][:, 0] < 1.0)
    assert np.all(rows["residual"] < 1e-9)
    assert np.all(rows["step_error"] < 1e-5)
    assert np.all(rows["amplitudes"][:, 1] > 0.005)
    circle = _circle(born, rows)
    for index in range(3):
        assert_invariant(rows, index, circle, float(rows["period"][index]))
        # half of the speed is where such a whirl lies
        assert 0.3 < rows["whirl_frequency"][index] / rows["speed"][index] < 0.5
    _assert_shape(machine, rows, 2, circle)


def _circle(path: Path, rows: Group) -> PeriodCircle:
    """The map of the stored branch."""
    job = Job.of("continue-tori", tiny_case(*FEW_ANGLES), path, lambda _: None, lambda: False)
    fixed = dict(rows.attributes["fixed"])
    cycles = forced_cycles(job.machine, job.case)[1]
    parameters = np.array([fixed.get(name, np.nan) for name in PARAMETERS])
    return PeriodCircle(cycles.period_map, parameters, "speed", int(rows["steps_per_period"][0]))


def _assert_shape(machine, rows: Group, index: int, circle: PeriodCircle) -> None:  # type: ignore[no-untyped-def]
    """Extremes and film against 120 periods of simulation, which fill the torus."""
    section = rows["section"][index, : int(rows["angle_count"][index])]
    state, parameters = section[0].copy(), circle.parameters_at(float(rows["speed"][index]))
    low, high, film = [], [], []
    for _ in range(120):
        image = circle.period_map.evaluate(state, parameters, float(rows["period"][index]), circle.steps)
        shape = cycle_shape(machine, image.orbit, parameters, snapshots=0)
        low.append(shape.minimum)
        high.append(shape.maximum)
        film.append(shape.film_trace.min(axis=0))
        state = image.state
    extent = float(np.max(np.max(high, axis=0) - np.min(low, axis=0)))
    np.testing.assert_allclose(rows["orbit_minimum"][index], np.min(low, axis=0), rtol=0, atol=1e-3 * extent)
    np.testing.assert_allclose(rows["orbit_maximum"][index], np.max(high, axis=0), rtol=0, atol=1e-3 * extent)
    np.testing.assert_allclose(rows["minimum_film"][index], np.min(film, axis=0), rtol=0, atol=1e-3 * extent)
    masters = machine.masters(section)
    np.testing.assert_allclose(
        interpolated(rows["section_curve"][index], 2 * np.pi * np.arange(len(masters)) / len(masters)),
        masters,
        rtol=0,
        atol=1e-12,
    )


def test_attributes_name_origin_and_end(born: Path) -> None:
    attributes = tori(born).attributes
    assert attributes["origin"] == {"group": "cycles/b000", "event": 0}
    assert (attributes["parameter"], attributes["turns"]) == ("speed", 1)
    assert attributes["fixed"]["excitation_frequency"] == 0.7
    assert attributes["stop_reason"] == "maximum_points"
    assert "raise max_points" in attributes["stop_advice"]
    assert verify(born) == []


def test_resuming_gives_the_same_bytes(branched: Path, born: Path, tmp_path: Path) -> None:
    path = tmp_path / "stopped.zarr"
    shutil.copytree(branched, path)
    for _ in range(2):
        stopped = Watched("continue_tori", tiny_case(*FEW_ANGLES), path, stop_after=1)
        assert stopped.result.ok
        assert stopped.result.stop_reason == "stopped on request"
        assert stopped.finished == 1
    assert Watched("continue_tori", tiny_case(*FEW_ANGLES), path).result.ok
    assert compare_trees(born, path) == []


def test_an_ended_branch_is_left_alone_and_other_requests_are_refused(born: Path) -> None:
    again = Watched("continue_tori", tiny_case(*FEW_ANGLES), born)
    assert again.reported == []
    assert again.result.ok
    with pytest.raises(OtherConfigurationError, match=r"'maximum_step': 0\.02"):
        Watched("continue_tori", tiny_case(*FEW_ANGLES, "continue_tori.maximum_step=0.02"), born)


def test_rows_with_unbalance(driven: Path) -> None:
    """rho and whirl follow from the speed."""
    assert names(driven) == ["u000"]
    up = tori(driven, "u000")
    assert up["speed"][0] == 0.9 < up["speed"][1]
    np.testing.assert_allclose(up["rotation"], 2.0 * np.pi * up["speed"] / 0.7, rtol=1e-14)
    np.testing.assert_allclose(up["whirl_frequency"], up["speed"], rtol=1e-14)
    assert up.attributes["unbalance"] == [[2, 1e-7, 0.0], [12, 5e-8, 1.0]]
    assert "origin" not in up.attributes
    assert np.all(up["unstable_count"] == 0)
    case = tiny_case(*UNBALANCE)
    job = Job.of("continue-tori", case, driven, lambda _: None, lambda: False)
    circle = unbalanced_tori(job, 1).problem(int(up["steps_per_period"][0])).circle
    assert isinstance(circle, PeriodCircle)
    for index in range(2):
        assert_invariant(up, index, circle, float(up["period"][index]))


def test_resuming_with_unbalance_gives_the_same_bytes(driven: Path, tmp_path: Path) -> None:
    path = tmp_path / "stopped.zarr"
    assert Watched("continue_tori", tiny_case(*UNBALANCE), path, stop_after=1).finished == 1
    assert Watched("continue_tori", tiny_case(*UNBALANCE), path).result.ok
    assert compare_trees(driven, path) == []


def test_both_directions_begin_with_the_same_torus(driven: Path, tmp_path: Path) -> None:
    path = tmp_path / "both.zarr"
    both = tiny_case(*UNBALANCE, "continue_tori.direction=both", "continue_tori.max_points=1")
    assert Watched("continue_tori", both, path).result.summary["branches"] == 2
    up, down = tori(path, "u000"), tori(path, "u001")
    np.testing.assert_array_equal(up["section"], down["section"])
    np.testing.assert_array_equal(up["section"][0], tori(driven, "u000")["section"][0])
    assert [*up.labels("direction"), *down.labels("direction")] == ["up", "down"]


def test_another_unbalance_is_another_branch(driven: Path) -> None:
    heavier = "unbalance.planes=[{node=2, moment=0.2}]"
    with pytest.raises(OtherConfigurationError, match="unbalance is"):
        Watched("continue_tori", tiny_case(*UNBALANCE, heavier), driven)


def test_a_torus_grows_with_its_unbalance(driven: Path) -> None:
    """The way that is taken where the balanced cycle is no good guess ends at the same torus."""
    job = Job.of("continue-tori", tiny_case(*UNBALANCE), driven, lambda _: None, lambda: False)
    _, grown = islice(unbalanced_tori(job, 1).starts(job), 2)
    assert not isinstance(grown, NoStart)
    rows = tori(driven, "u000")
    stored = rows["section"][0, : int(rows["angle_count"][0])]
    assert grown.start.parameter == 0.9
    assert np.max(np.abs(grown.start.states - stored)) < 1e-9


def test_what_starts_no_torus(branched: Path, tmp_path: Path) -> None:
    """Every refusal says what to do, and writes nothing."""

    def refused(*overrides: str, store: Path = branched) -> str:
        result = Watched("continue_tori", tiny_case(*FEW_ANGLES, *overrides), store).result
        assert not result.ok
        return f"{result.stop_reason}; {result.advice}"

    assert "run `agfb continue-cycles`" in refused(store=tmp_path / "empty.zarr")
    assert "no branch cycles/d000" in refused("continue_tori.branch=cycles/d000")
    away = refused("continue_tori.range=[0.5, 0.6]")
    assert "no Neimark-Sacker point with speed in [0.5, 0.6]" in away
    assert "run `agfb continue-cycles`" in away
    assert names(branched) == []
    with pytest.raises(
        CaseError, match=r"does not contain the case's own speed = 1\.1 \(.* rpm\), .*: give start"
    ):
        tiny_case("continue_tori.origin=unbalance", UNBALANCE[-1], "continue_tori.range=[0.5, 0.6]")
    (problem,) = stage_problems(tiny_case(config=PASSIVE), ("continue_tori",))
    assert "give excitation.frequency" in problem.message


def test_a_branch_ends_where_the_film_is_too_thin(branched: Path, born: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(branched, path)
    films = tori(born)["minimum_film"].min(axis=1)
    assert np.all(np.diff(films) < 0.0), "the film shrinks as the torus grows"
    limit = float(0.5 * (films[0] + films[1]))
    thin = tiny_case(*FEW_ANGLES, f"continue_cycles.minimum_film={limit}")
    result = Watched("continue_tori", thin, path).result
    assert result.ok
    assert result.stop_reason == "limit"
    assert "the journal touches the foil" in result.advice
    np.testing.assert_array_equal(tori(path)["minimum_film"].min(axis=1), films[:1])


def test_a_branch_ends_where_its_series_does_not_fall(branched: Path, tmp_path: Path) -> None:
    """With few angles long before the torus locks; the advice names the resonance that is nearest."""
    path = tmp_path / "a.zarr"
    shutil.copytree(branched, path)
    rough = tiny_case(
        COARSE,
        "continue_tori.tolerance=1e-7",
        "continue_tori.max_angles=15",
        "continue_tori.minimum_step=6e-3",
    )
    result = Watched("continue_tori", rough, path).result
    assert result.ok
    assert result.stop_reason == "rough"
    assert re.search(r"with 15 angles .* is missing at 1\.1.*from \d+/\d+", result.advice)
    assert "raise continue_tori.max_angles or tolerance" in result.advice
    assert tori(path).n_points >= 1
    again = Watched("continue_tori", rough, path)
    assert again.reported == []


def test_the_whirl_is_the_strongest_frequency() -> None:
    """x = cos((rho + 2 pi k) s + theta) with a weaker companion one excitation frequency above."""
    samples, count, rotation = 32, 7, 2.1
    s = np.arange(samples) / samples
    theta = 2.0 * np.pi * np.arange(count)[:, None] / count
    for number in (-3, 0, 2):
        turn = rotation + 2.0 * np.pi * number
        motion = np.cos(turn * s + theta) + 0.4 * np.cos((turn + 2.0 * np.pi) * s + theta)
        assert whirl_turn(motion[:, :, None], rotation) == pytest.approx(turn, rel=1e-14)
