"""`continue-cycles` into a store: rows, events, resume, the ways a branch ends, refusals, failures."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import OtherConfigurationError, open_for_reading
from pipelines.machine.assembly import build_machine
from pipelines.orbits.machine_cycles import cycle_shape
from pipelines.stages.cycles.problem import cycle_problem
from tests.helpers.monodromy import full_monodromy
from tests.helpers.tiny import CONFIG, PASSIVE, TINY, Watched, tiny_case
from tests.helpers.trees import compare_trees

HEAVY = "rotor.gravity=1000"


def branch(path: Path, number: int = 0, case_id: str = "smoke") -> Group:
    return read_group(open_for_reading(path), f"cases/{case_id}/cycles/b{number:03d}")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished branch of five points with its Neimark-Sacker point."""
    path = tmp_path_factory.mktemp("undisturbed") / "a.zarr"
    assert Watched("continue_cycles", tiny_case(), path).result.ok
    return path


def test_every_row_is_a_cycle_with_its_multipliers(undisturbed: Path) -> None:
    case, group = tiny_case(), branch(undisturbed)
    machine, rows = build_machine(case.case), group.arrays
    problem = cycle_problem(machine, case.case)
    period_map, sharp = problem.period_map, problem.options.multiplier_tolerance
    assert group.attributes["n_points"] == len(rows["speed"]) == 5
    assert rows["speed"][0] == 1.14
    assert rows["speed"][-1] == 1.2
    for index in range(5):
        parameters = np.array([rows[name][index] for name in PARAMETERS])
        state, period = rows["state"][index], float(rows["period"][index])
        steps = int(rows["steps_per_period"][index])
        assert period == period_map.period(parameters)
        image = period_map.evaluate(state, parameters, period, steps)
        assert np.max(np.abs(image.state - state)) < 1e-9
        shape = cycle_shape(machine, image.orbit, parameters)
        for name, expected in (
            ("orbit", shape.orbit),
            ("orbit_minimum", shape.orbit.min(axis=0)),
            ("orbit_maximum", shape.orbit.max(axis=0)),
            ("minimum_film", shape.film_trace.min(axis=0)),
            ("film_pressure", shape.pressure),
            ("foil_displacement", shape.foil),
        ):
            np.testing.assert_allclose(rows[name][index], expected, rtol=0, atol=1e-12, err_msg=name)
        count = int(rows["multiplier_count"][index])
        multipliers = rows["multipliers"][index]
        assert np.all(np.isnan(multipliers[count:]))
        full = np.linalg.eigvals(full_monodromy(period_map, state, parameters, period, steps))
        slow = full[np.abs(full) > 0.1]
        assert len(slow) == np.sum(np.abs(multipliers[:count]) > 0.1)
        assert max(np.min(np.abs(multipliers[:count] - value)) for value in slow) < sharp
        assert int(rows["unstable_count"][index]) == np.sum(np.abs(full) > 1.0)
        history = rows["newton_history"][index]
        history = history[np.isfinite(history)]
        # one residual more than iterations, and another one where the steps were refined
        assert len(history) - int(rows["newton_iterations"][index]) in (1, 2)
        assert history[-1] <= case.case.numerics.newton_tolerance


def test_the_located_point_separates_stable_from_unstable_rows(undisturbed: Path) -> None:
    arrays = branch(undisturbed).arrays
    flags = KINDS["cycles"].array("event_kind").flags
    assert [flags[int(kind)] for kind in arrays["event_kind"]] == ["neimark_sacker"]
    after = int(arrays["event_after_point"][0])
    speed = arrays["event_speed"][0]
    assert arrays["speed"][after] < speed < arrays["speed"][after + 1]
    assert arrays["unstable_count"].tolist() == [0] * (after + 1) + [2] * (4 - after)
    assert arrays["event_residual"][0] < 1e-8 * abs(arrays["event_transversality"][0])
    critical = arrays["event_multipliers"][0]
    critical = critical[np.nanargmin(np.abs(np.abs(critical) - 1.0))]
    assert abs(np.angle(critical)) == pytest.approx(arrays["event_angle"][0], abs=1e-9)


@pytest.mark.parametrize("stops", [[1, 1], [3]])
def test_resuming_gives_the_same_bytes(tmp_path: Path, undisturbed: Path, stops: list[int]) -> None:
    path = tmp_path / "stopped.zarr"
    for stop in stops:
        stopped = Watched("continue_cycles", tiny_case(), path, stop_after=stop)
        assert stopped.result.ok
        assert stopped.result.stop_reason == "stopped on request"
        assert stopped.finished == stop
        assert branch(path).attributes["status"] == "running"
    resumed = Watched("continue_cycles", tiny_case(), path)
    assert resumed.finished == 5 - sum(stops)
    assert compare_trees(undisturbed, path) == []
    assert verify(path) == []


def test_an_ended_branch_is_not_computed_again(undisturbed: Path) -> None:
    again = Watched("continue_cycles", tiny_case(), undisturbed)
    assert again.reported == []
    assert again.result.ok
    assert again.result.stop_reason == "range"
    assert again.result.summary["points"] == 5


def test_more_points_extend_a_branch(tmp_path: Path, undisturbed: Path) -> None:
    """All but the capacity is as if the larger number had been asked for at once."""
    path = tmp_path / "a.zarr"
    few = Watched("continue_cycles", tiny_case("continue_cycles.max_points=3"), path)
    assert few.result.stop_reason == "maximum_points"
    assert "max_points" in few.result.advice
    assert Watched("continue_cycles", tiny_case("continue_cycles.max_points=3"), path).reported == []
    more = Watched("continue_cycles", tiny_case(), path)
    assert more.finished == 2
    assert more.result.stop_reason == "range"
    whole, grown = branch(undisturbed), branch(path)
    assert whole.attributes == grown.attributes
    for name, values in whole.arrays.items():
        np.testing.assert_array_equal(grown.arrays[name], values, err_msg=name)


def test_both_directions_are_two_branches_from_one_cycle(tmp_path: Path, undisturbed: Path) -> None:
    path = tmp_path / "a.zarr"
    both = tiny_case("continue_cycles.direction=both")
    first = Watched("continue_cycles", both, path, stop_after=7)  # inside the second branch
    assert first.result.stop_reason == "range, stopped on request"
    result = Watched("continue_cycles", both, path).result
    assert result.ok
    assert result.stop_reason == "range, range"
    store = open_for_reading(path)
    assert [name.rsplit("/", 1)[1] for name in list_groups(store, "smoke")][:2] == ["b000", "b001"]
    up, down = branch(path, 0).arrays, branch(path, 1).arrays
    np.testing.assert_array_equal(up["state"], branch(undisturbed).arrays["state"])
    np.testing.assert_array_equal(up["state"][0], down["state"][0])
    assert np.all(np.diff(up["speed"]) > 0.0)
    assert np.all(np.diff(down["speed"]) < 0.0)
    assert (up["speed"][-1], down["speed"][-1]) == (1.2, 1.05)


def test_self_excited_whirl_starts_at_the_hopf_point(tmp_path: Path) -> None:
    """The first cycle of the passive machine lies beside the instability speed and leads away from it."""
    case = tiny_case("continue_cycles.max_points=4", "continue_cycles.amplitude=0.01", config=PASSIVE)
    path = tmp_path / "a.zarr"
    hopf = Watched("linearize", case, path).result.summary
    assert Watched("continue_cycles", case, path).result.stop_reason == "maximum_points"
    rows = branch(path, case_id="passive").arrays
    assert abs(rows["speed"][0] - hopf["instability speed"]) < 1e-4
    assert rows["period"][0] == pytest.approx(2.0 * np.pi / hopf["whirl frequency"], abs=1e-2)
    distance = np.abs(rows["speed"] - hopf["instability speed"])
    assert np.all(np.diff(distance) > 0.0)
    amplitude = np.max(rows["orbit_maximum"] - rows["orbit_minimum"], axis=1)
    assert np.all(np.diff(amplitude) > 0.0)
    stable = rows["speed"][1] > hopf["instability speed"]
    assert rows["unstable_count"].tolist() == [0 if stable else 1] * 4


def test_no_self_excited_whirl_is_a_result(tmp_path: Path) -> None:
    quiet = tiny_case("continue_cycles.start=0.9", "continue_cycles.range=[0.8, 1.0]", config=PASSIVE)
    result = Watched("continue_cycles", quiet, tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == "no_start"
    assert "no self-excited whirl" in result.advice
    assert "widen the range" in result.advice


def test_a_branch_ends_where_the_journal_touches_the_foil(tmp_path: Path) -> None:
    """With a limit inside the range of films of the branch, every row has a thicker film than the limit."""
    path = tmp_path / "free.zarr"
    down = ("continue_cycles.direction=down", "continue_cycles.range=[0.8, 1.2]")
    Watched("continue_cycles", tiny_case(*down, "continue_cycles.max_points=4"), path)
    films = branch(path).arrays["minimum_film"].min(axis=1)
    assert np.all(np.diff(films) < 0.0), "the film shrinks as the speed falls"
    limit = 0.5 * (films[1] + films[2])
    touching = tiny_case(*down, f"continue_cycles.minimum_film={limit}")
    result = Watched("continue_cycles", touching, tmp_path / "a.zarr").result
    assert result.ok
    assert result.stop_reason == "limit"
    assert "the journal touches the foil of bearing" in result.advice
    assert "continue_cycles.minimum_film" in result.advice
    np.testing.assert_array_equal(branch(tmp_path / "a.zarr").arrays["minimum_film"].min(axis=1), films[:2])
    # nothing to follow from the start is a failure
    never = Watched("continue_cycles", tiny_case("continue_cycles.minimum_film=0.6"), tmp_path / "b.zarr")
    assert not never.result.ok
    assert never.result.summary["points"] == 0


def test_another_request_is_refused(undisturbed: Path) -> None:
    with pytest.raises(OtherConfigurationError, match=r"'step': 0\.01"):
        Watched("continue_cycles", tiny_case("continue_cycles.step=0.01"), undisturbed)
    with pytest.raises(OtherConfigurationError, match=r"numerics\.max_columns"):
        Watched("continue_cycles", tiny_case("numerics.max_columns=28"), undisturbed)


# --- As the shell sees it -------------------------------------------------------------------------


def shell(monkeypatch: pytest.MonkeyPatch, store: Path, *overrides: str) -> tuple[int, str]:
    """Exit code and messages of `agfb continue` on the tiny case."""
    assignments = [word for override in (*TINY, *overrides) for word in ("--set", override)]
    words = ["continue", str(CONFIG), "-o", str(store), *assignments]
    monkeypatch.setattr(sys, "argv", ["agfb", *words])
    done = CliRunner().invoke(app, words, prog_name="agfb")
    return done.exit_code, done.stderr


def test_a_rotor_too_heavy_to_float_fails_its_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code, messages = shell(monkeypatch, tmp_path / "a.zarr", HEAVY)
    assert code == ExitCode.CASES_FAILED
    assert "there is no equilibrium to start from" in messages
    assert "of the rotor's weight at this speed" in messages
    attributes = branch(tmp_path / "a.zarr").attributes
    assert attributes["stop_reason"] == "no_start"
    assert "lighten the rotor" in attributes["stop_advice"]


def test_a_store_of_another_request_is_a_store_problem(
    undisturbed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, messages = shell(monkeypatch, undisturbed, "continue_cycles.step=0.01")
    assert code == ExitCode.STORE
    assert "'step': 0.01" in messages
    code, messages = shell(monkeypatch, undisturbed, "gas.viscosity=2e-5")
    assert code == ExitCode.STORE
    assert "gas.viscosity" in messages
