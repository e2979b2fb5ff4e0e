"""`criticals` into a store: crossings with the synchronous line, predicted resonances, resume, failure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.stages.linear.criticals import _missing_attributes, _without_equilibrium
from pipelines.stages.results import StageResult
from pipelines.stages.scheduling import registry, tasks
from pipelines.stages.scheduling.preparation import prepare_store
from tests.helpers.prescribed_modes import PrescribedModes, on_paths
from tests.helpers.rotors import HEAVY_ON_SOFT_FOILS
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees


def group(path: Path) -> Group:
    return read_group(open_for_reading(path), "cases/smoke/criticals")


def test_at_a_critical_speed_a_mode_whirls_synchronously(tmp_path: Path) -> None:
    case = tiny_case()
    result = Watched("criticals", case, tmp_path / "a.zarr").result
    assert result.ok
    arrays, machine = group(tmp_path / "a.zarr").arrays, build_machine(case.case)
    critical = arrays["critical_speed"]
    assert result.summary["critical speeds"] == len(critical) >= 2
    assert result.summary["lowest"] == critical.min() == critical[0]
    for speed, ratio, shape in zip(
        critical, arrays["critical_damping_ratio"], arrays["critical_mode_shape"], strict=True
    ):
        parameters = at_speed(parameter_vector(case.case), speed)
        state = machine_equilibrium(machine, parameters).state
        values = np.linalg.eigvals(machine.jacobian(0.0, state, at_rest(parameters)).toarray())
        crossing = values[np.argmin(np.abs(values - complex(-ratio * speed, speed)))]
        assert abs(crossing.imag - speed) < 1e-6
        assert abs(-crossing.real / abs(crossing) - ratio) < 1e-6
        assert np.max(np.abs(shape)) == pytest.approx(1.0, rel=1e-14)


def test_resonances_are_built_from_the_critical_speeds(tmp_path: Path) -> None:
    """Every 2 Omega_j/n and |Omega_j +- Omega_k|/n with n <= 3, once."""
    Watched("criticals", tiny_case(), tmp_path / "a.zarr")
    arrays = group(tmp_path / "a.zarr").arrays
    names = KINDS["criticals"].array("resonance_kind").flags
    critical = arrays["critical_speed"]
    expected = {
        ("principal", j + 1, j + 1, n, round(2 * critical[j] / n, 12))
        for j in range(len(critical))
        for n in (1, 2, 3)
    }
    for j in range(len(critical)):
        for k in range(j + 1, len(critical)):
            for n in (1, 2, 3):
                expected.add(("sum", j + 1, k + 1, n, round((critical[j] + critical[k]) / n, 12)))
                expected.add(("difference", j + 1, k + 1, n, round(abs(critical[j] - critical[k]) / n, 12)))
    found = {
        (names[int(kind)], int(j), int(k), int(n), round(float(frequency), 12))
        for kind, j, k, n, frequency in zip(
            arrays["resonance_kind"],
            arrays["resonance_j"],
            arrays["resonance_k"],
            arrays["resonance_order"],
            arrays["resonance_frequency"],
            strict=True,
        )
    }
    assert found == expected


def test_a_stopped_run_leaves_nothing_half_done(tmp_path: Path) -> None:
    case = tiny_case()
    Watched("criticals", case, tmp_path / "undisturbed.zarr")
    for stop in (0, 3, 7):  # before the first speed, in the diagram, in the comparison
        stopped = Watched("criticals", case, tmp_path / "stopped.zarr", stop_after=stop)
        assert stopped.result.stop_reason == "stopped on request"
        assert not (tmp_path / "stopped.zarr" / "cases" / "smoke" / "criticals").exists()
    resumed = Watched("criticals", case, tmp_path / "stopped.zarr")
    assert compare_trees(tmp_path / "undisturbed.zarr", tmp_path / "stopped.zarr") == []
    again = Watched("criticals", case, tmp_path / "stopped.zarr")
    assert again.reported == [], "what is finished is not computed again"
    assert again.result == resumed.result


def test_another_table_is_computed_anew(tmp_path: Path) -> None:
    Watched("criticals", tiny_case(), tmp_path / "a.zarr")
    other = tiny_case("criticals.points=5")
    assert Watched("criticals", other, tmp_path / "a.zarr").reported
    Watched("criticals", other, tmp_path / "fresh.zarr")
    folder = Path("cases/smoke/criticals")
    assert compare_trees(tmp_path / "a.zarr" / folder, tmp_path / "fresh.zarr" / folder) == []
    assert len(group(tmp_path / "a.zarr").arrays["speed"]) == 5


def test_a_range_without_critical_speed_says_what_to_change(tmp_path: Path) -> None:
    strict = tiny_case("criticals.max_damping_ratio=1e-9", "criticals.points=2")
    result = Watched("criticals", strict, tmp_path / "a.zarr").result
    assert result.ok
    assert result.stop_reason == "no critical speed lies inside the range"
    assert "max_damping_ratio" in result.advice


def test_no_equilibrium_is_a_result(tmp_path: Path) -> None:
    heavy = tiny_case("rotor.gravity=1000", "criticals.points=2", "criticals.unbalance_points=2")
    result = Watched("criticals", heavy, tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == "no speed of the range has an equilibrium"
    assert "of the rotor's weight" in result.advice
    content = group(tmp_path / "a.zarr")
    assert len(content.attributes["speeds_without_equilibrium"]) == 2
    assert content.arrays["critical_speed"].size == 0


def heavy(**tables: Any) -> NamedCase:
    """A rotor whose films close on 24 x 2 between the speeds 0.103 and 0.209."""
    return NamedCase.of("smoke", HEAVY_ON_SOFT_FOILS.case((24, 2), **tables))


@pytest.mark.slow
def test_critical_speeds_that_may_be_lost_are_a_failure(tmp_path: Path) -> None:
    """2 speeds of 11 have no equilibrium; where they are, the count of modes changes."""
    table = {"speed_range": (0.1, 0.6), "points": 11, "unbalance_points": 3}
    result = Watched("criticals", heavy(criticals=table), tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == "critical speeds may be missing"
    assert re.match(
        r"between the speeds 0\.10\d+ and 0\.2\d+ there is no equilibrium; the number of", result.advice
    )
    assert "raise numerics.circumferential" in result.advice
    assert result.summary["without equilibrium"] == "0.15, 0.2"
    content = group(tmp_path / "a.zarr")
    assert content.attributes["stop_reason"] == result.stop_reason
    assert len(content.attributes["speeds_without_equilibrium"]) == 2
    assert content.attributes["inserted_speeds"] == len(content.arrays["speed"]) - 11
    gone = np.isnan(content.arrays["frequency"]).all(axis=1)
    assert content.arrays["speed"][gone].min() > 0.1
    assert content.arrays["speed"][gone].max() < 0.21
    again = Watched("criticals", heavy(criticals=table), tmp_path / "a.zarr")
    assert again.reported == []
    assert again.result == result


def test_the_count_of_modes_is_stored_with_the_crossings(tmp_path: Path) -> None:
    Watched("criticals", tiny_case(), tmp_path / "a.zarr")
    attributes = group(tmp_path / "a.zarr").attributes
    first, last = attributes["modes_above_synchronous"]
    assert last - first == attributes["crossings"] + attributes["damping_passages"]
    assert attributes["undecided_stretches"] == []
    assert attributes["stop_reason"] == "all speeds are computed"


def test_a_gap_between_the_speeds_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """All speeds asked for have an equilibrium, one inserted between them has none."""

    def close(speed: float) -> complex:
        return complex(-0.02, speed + 0.01 + 10.0 * (speed - 0.725) ** 2)

    modes = PrescribedModes(on_paths(close, lambda speed: complex(-0.05, 3.0)), lambda w: 0.7 < w < 0.75)
    diagram, critical = modes.critical_speeds(monkeypatch, (0.15, 1.5), 9)
    told = _missing_attributes(diagram, critical, np.linspace(0.15, 1.5, 9))
    assert told["speeds_without_equilibrium"] == []
    assert told["stop_reason"] == "some speeds have no equilibrium"
    assert re.match(r"between the speeds 0\.69\d+ and 0\.75\d+ there is no equil", told["stop_advice"])
    gap = _without_equilibrium(told, {"speed": 1e4})
    assert re.fullmatch(r"0\.69\d+ to 0\.75\d+", str(gap["without equilibrium"]))
    assert re.fullmatch(r"69\d\d to 75\d\d", str(gap["without equilibrium [rpm]"]))


MICRO_TURBINE = Path(__file__).parents[1] / "reference" / "micro_turbine.toml"
QUICK = (
    "numerics.circumferential=16",
    "numerics.axial=1",
    "criticals.points=12",
    "criticals.unbalance_points=12",
)
ADVISED = "[{ node = 0, slopes = true }, 2, 3, 6, 9, { node = 12, slopes = true }]"
ALL = f"[{', '.join(f'{{ node = {node}, slopes = true }}' for node in range(13))}]"


def micro_turbine(store: Path, *overrides: str) -> tuple[StageResult, Group]:
    named, *_ = read_cases(MICRO_TURBINE.read_text(), MICRO_TURBINE.name, (*QUICK, *overrides))
    result = Watched("criticals", named, store).result
    return result, read_group(open_for_reading(store), "cases/mgt/criticals")


def test_overhung_wheels_without_their_slopes_are_a_caution_with_masters_that_help(tmp_path: Path) -> None:
    result, stored = micro_turbine(tmp_path / "plain.zarr")
    error = stored.attributes["condensation_error"]
    assert result.ok
    assert result.summary["condensation error"] == error == stored["checked_error"].max()
    assert 0.15 < error < 0.2
    assert stored["checked_full_frequency"].max() <= 2.2
    # at the operating speed, at the highest and at every critical speed
    speeds = np.linspace(0.1, 2.2, 12)
    nearest = {int(np.argmin(np.abs(speeds - speed))) for speed in stored["critical_speed"]}
    checked = speeds[sorted(nearest | {10, 11})]
    np.testing.assert_allclose(np.unique(stored["checked_speed"]), checked)
    assert stored.attributes["caution"] == result.caution
    assert ADVISED in result.caution
    assert "Hz" in result.caution


@pytest.mark.slow
def test_what_the_caution_names_has_the_critical_speeds_of_the_full_rotor(tmp_path: Path) -> None:
    full_result, full = micro_turbine(tmp_path / "full.zarr", f"rotor.masters={ALL}")
    assert full_result.summary["condensation error"] < 1e-9
    result, stored = micro_turbine(tmp_path / "advised.zarr", f"rotor.masters={ADVISED}")
    assert result.summary["condensation error"] < 1e-3
    assert result.caution == full_result.caution == stored.attributes["caution"] == ""
    np.testing.assert_allclose(stored["critical_speed"], full["critical_speed"], rtol=1e-3)
    assert stored["critical_speed"].max() > 1.5, "the bending mode is one of them"
    largest = full["unbalance_full"].max()
    np.testing.assert_allclose(
        stored["unbalance_condensed"], stored["unbalance_full"], rtol=0.0, atol=1e-2 * largest
    )


def test_without_equilibrium_there_is_no_condensation_error(tmp_path: Path) -> None:
    heavy = tiny_case("rotor.gravity=1000", "criticals.points=2", "criticals.unbalance_points=2")
    result = Watched("criticals", heavy, tmp_path / "a.zarr").result
    assert result.summary["condensation error"] is None
    assert result.caution == ""


@pytest.mark.parametrize(("masters", "cautioned"), [((), True), ((f"rotor.masters={ADVISED}",), False)])
def test_motions_of_a_condensed_rotor_that_is_off_are_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, masters: tuple[str, ...], cautioned: bool
) -> None:
    """By how much at the operating and the highest speed, or as the critical speeds in the store say it."""
    named, *_ = read_cases(MICRO_TURBINE.read_text(), MICRO_TURBINE.name, (*QUICK, *masters))
    store = tmp_path / "a.zarr"
    prepare_store(store, [named], ["agfb", "test"])
    ended = StageResult("mgt", True, "range")
    monkeypatch.setattr(registry, "stage_function", lambda name: lambda *arguments: ended)

    def told(stage: str, stopped: bool = False) -> str:
        record = tasks.run_task(tasks.task(stage, named, store), lambda p: None, lambda: stopped)
        return str(record["caution"])

    motions = {told(stage) for stage in sorted(registry.MOTIONS)}
    assert len(motions) == 1
    (caution,) = motions
    assert ("17.3 % off" in caution and ADVISED in caution) is cautioned
    assert bool(caution) is cautioned
    assert told("continue_cycles", stopped=True) == told("refine") == ""
    _, stored = micro_turbine(store, *masters)
    assert bool(stored.attributes["caution"]) is cautioned
    assert told("continue_cycles") == stored.attributes["caution"]
