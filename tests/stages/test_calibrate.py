"""The calibration finds the machine that its targets were made with, resumes, and tells what it cannot do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import OtherConfigurationError, open_for_reading
from pipelines.stages.calibration import calibrate as stage
from pipelines.stages.calibration import targets as calibration_targets
from pipelines.stages.calibration.calibrate import (
    CONVERGED,
    FAILED_TARGETS,
    NO_TABLE,
    OTHER_ONSET,
    OUT_OF_EVALUATIONS,
    position_of,
    start_position,
    value_at,
)
from pipelines.stages.calibration.onset_speed import FOUND, UNDECIDED
from pipelines.stages.calibration.report import Calibration, read_calibration
from pipelines.stages.calibration.targets import Reached, reached
from tests.helpers.prescribed_modes import PrescribedModes, on_paths
from tests.helpers.tiny import CONFIG, SHARP, TINY, Watched, tiny_case
from tests.helpers.trees import compare_trees

pytestmark = pytest.mark.slow

TOLERANCE = 1e-3
TRUE = {"bearings.foil.loss_factor": 0.6, "rotor.discs.mass": 0.07}
WIDE_STEPS = ("continue_cycles.step=0.05", "continue_cycles.maximum_step=0.1")
PARAMETERS = """
[calibrate]
tolerance = 1e-3
speed_range = [0.9, 1.4]
[[calibrate.parameters]]
keys = ["bearings.foil.loss_factor"]
range = [0.2, 0.8]
scale = "log"
[[calibrate.parameters]]
keys = ["rotor.discs.mass"]
range = [0.05, 0.12]
"""
RESTING = """
[[calibrate.targets]]
value = {values[0]}
uncertainty = 0.001
set = {{ "excitation.displacement" = 0.0, "bearings.foil.stiffness" = 3.0 }}
[[calibrate.targets]]
value = {values[1]}
uncertainty = 0.001
set = {{ "excitation.displacement" = 0.0, "bearings.foil.stiffness" = 50.0 }}
"""


def calibrated(table: str, *overrides: str) -> NamedCase:
    """The tiny case with a calibration."""
    text = CONFIG.read_text() + table
    (named,) = read_cases(text, CONFIG.name, (*TINY, *WIDE_STEPS, *overrides))
    return named


def of_the_true_machine(table: str, true: dict[str, float] = TRUE, *overrides: str) -> list[float]:
    """What the machine that is to be found reaches of the targets of a table."""
    case = calibrated(table.format(values=[1.0] * 9), *overrides).case
    assert case.calibrate is not None
    plain = case.model_copy(update={"calibrate": None})
    return [
        reached(plain, true, target, case.calibrate, None, lambda: False).value
        for target in case.calibrate.targets
    ]


def stored(path: Path) -> Group:
    return read_group(open_for_reading(path), "cases/smoke/calibration")


def told(path: Path, case: NamedCase) -> Calibration:
    found = read_calibration(open_for_reading(path), case.case_id, case.case)
    assert found is not None
    return found


def distance(found: Calibration, case: NamedCase, true: dict[str, float] = TRUE) -> np.ndarray:
    """How far the found values lie from those of the true machine, in parts of the ranges."""
    assert case.case.calibrate is not None
    return np.array([
        position_of(parameter, found.values[key]) - position_of(parameter, true[key])
        for parameter in case.case.calibrate.parameters
        for key in parameter.keys
    ])  # fmt: skip


@pytest.fixture(scope="module")
def resting() -> NamedCase:
    table = PARAMETERS + RESTING
    return calibrated(table.format(values=of_the_true_machine(table)))


@pytest.fixture(scope="module")
def finished(resting: NamedCase, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibrated") / "a.zarr"
    assert Watched("calibrate", resting, path).result.ok
    return path


def test_it_finds_the_machine_that_the_targets_were_made_with(resting: NamedCase, finished: Path) -> None:
    found = told(finished, resting)
    assert found.stop_reason == CONVERGED
    assert np.abs(distance(found, resting)).max() < TOLERANCE
    start = start_position(resting.case, resting.case.calibrate)  # type: ignore[arg-type]
    assert np.abs(start - stored(finished)["position"][-1]).min() > 0.1, "it had a way to go"
    for row in found.targets:
        assert row.deviation is not None
        assert abs(row.deviation) < 0.1
        assert row.bifurcation == "hopf"
    assert verify(open_for_reading(finished)) == []


def test_the_uncertainty_of_a_parameter_is_that_of_the_targets_carried_over(
    resting: NamedCase, finished: Path
) -> None:
    """With as many targets as unknowns: d position = J^-1 d r, each r with variance one."""
    found, jacobian = told(finished, resting), np.array(stored(finished).attributes["jacobian"])
    expected = np.sqrt(np.sum(np.linalg.inv(jacobian) ** 2, axis=1))
    loss, mass = found.parameters
    assert mass.uncertainty == pytest.approx(expected[1] * 0.07, rel=1e-6)
    assert loss.uncertainty == pytest.approx(expected[0] * np.log(4.0) * loss.after, rel=1e-6)
    assert found.undetermined == ()


def test_the_last_row_confirms_the_found_machine_from_the_lowest_speed(finished: Path) -> None:
    rows = stored(finished)
    begins = rows.labels("begin")
    assert list(begins) == ["lowest_speed"] + ["near_onset"] * (rows.n_points - 2) + ["lowest_speed"]
    best = np.flatnonzero(np.all(rows["position"] == rows["position"][-1], axis=1))
    assert len(best) == 2
    np.testing.assert_allclose(rows["onset"][best[0]], rows["onset"][best[1]], rtol=1e-6)


def test_interrupted_and_resumed_it_has_the_same_bytes(
    resting: NamedCase, finished: Path, tmp_path: Path
) -> None:
    path = tmp_path / "a.zarr"
    first = Watched("calibrate", resting, path, stop_after=4)
    assert first.result.stop_reason == "stopped on request"
    assert stored(path).n_points == 4
    assert Watched("calibrate", resting, path).result.ok
    assert compare_trees(finished, path) == []


def test_a_finished_one_computes_nothing_and_another_request_is_refused(
    resting: NamedCase, finished: Path
) -> None:
    again = Watched("calibrate", resting, finished)
    assert again.result.ok
    assert again.finished == 0
    settings = resting.case.calibrate
    assert settings is not None
    other = resting.case.model_copy(update={"calibrate": settings.model_copy(update={"tolerance": 1e-4})})
    with pytest.raises(OtherConfigurationError, match="tolerance"):
        Watched("calibrate", NamedCase.of("smoke", other), finished)


def test_a_forced_machine_is_found_through_its_neimark_sacker_point(tmp_path: Path) -> None:
    """One unknown, of the rings."""
    table = """
[calibrate]
tolerance = 1e-2
speed_range = [1.0, 1.3]
[[calibrate.parameters]]
keys = ["excitation.displacement"]
range = [0.1, 0.22]
[[calibrate.targets]]
value = {values[0]}
weight = 100.0
bifurcation = "neimark_sacker"
"""
    true = {"excitation.displacement": 0.17}
    case = calibrated(table.format(values=of_the_true_machine(table, true)))
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    found = told(tmp_path / "a.zarr", case)
    assert np.abs(distance(found, case, true)).max() < 1e-2
    assert found.targets[0].bifurcation == "neimark_sacker"
    assert found.parameters[0].uncertainty is None, "one target of unknown scatter tells none"


def test_the_slope_of_the_onset_speed_converges_with_the_square_of_the_difference() -> None:
    """slope(d) = slope + C d^2 + O(d^4): three differences, each half the one before, give a ratio of four,
    here to within the next order and the onsets' own errors (1e-6 over a difference of 0.005).
    """
    table = """
[calibrate]
speed_range = [1.0, 1.4]
[[calibrate.parameters]]
keys = ["excitation.displacement"]
range = [0.1, 0.22]
"""
    target = """
[[calibrate.targets]]
quantity = "onset_slope"
bifurcation = "neimark_sacker"
value = {values[0]}
"""
    targets = "".join(target + f"difference = {difference}\n" for difference in (0.02, 0.01, 0.005))
    wide, middle, narrow = of_the_true_machine(
        table + targets, {"excitation.displacement": 0.17}, SHARP, "excitation.frequency=0.7"
    )
    assert 3.2 < (wide - middle) / (middle - narrow) < 4.8


def test_a_machine_is_found_through_the_growth_of_period_doubling_and_the_corner(tmp_path: Path) -> None:
    """Two unknowns; the corner's frequency and speed are found together, a growth where no period doubles."""
    table = """
[calibrate]
tolerance = 1e-2
speed_range = [1.0, 1.4]
[[calibrate.parameters]]
keys = ["excitation.displacement"]
range = [0.15, 0.24]
[[calibrate.parameters]]
keys = ["bearings.clearance"]
range = [19.5e-6, 21.5e-6]
[[calibrate.targets]]
quantity = "doubling_growth"
value = {values[0]}
uncertainty = 0.001
speeds = [0.5, 0.6]
[[calibrate.targets]]
quantity = "corner_frequency"
value = {values[1]}
uncertainty = 0.002
frequency_range = [0.65, 0.95]
[[calibrate.targets]]
quantity = "corner_speed"
value = {values[2]}
uncertainty = 0.005
frequency_range = [0.65, 0.95]
"""
    true = {"excitation.displacement": 0.22, "bearings.clearance": 20.9e-6}
    wanted = of_the_true_machine(table, true)
    case = calibrated(table.format(values=wanted))
    assert wanted[0] < 0.0, "no period doubles at the case's own frequency"
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    found = told(tmp_path / "a.zarr", case)
    assert np.abs(distance(found, case, true)).max() < 0.03
    rows = stored(tmp_path / "a.zarr")
    np.testing.assert_allclose(rows["onset"][:, 1], rows["reached"][:, 2])
    assert np.all(np.isnan(rows["onset"][:, 0]))
    assert [row.target for row in found.targets] == [
        "doubling growth at speed 0.5, 0.6", "corner frequency", "corner speed"
    ]  # fmt: skip


def test_a_corner_that_is_none_is_told(tmp_path: Path) -> None:
    table = """
[calibrate]
max_evaluations = 2
speed_range = [1.0, 1.4]
[[calibrate.parameters]]
keys = ["bearings.clearance"]
range = [19.5e-6, 21.5e-6]
[[calibrate.targets]]
quantity = "corner_frequency"
value = 0.7
frequency_range = [0.5, 0.55]
"""
    case = calibrated(table)
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.stop_reason == FAILED_TARGETS
    (target,) = told(tmp_path / "a.zarr", case).targets
    assert target.reached is None
    assert "widen frequency_range" in target.remark


def test_a_mass_is_found_through_a_measured_critical_speed(tmp_path: Path) -> None:
    """The critical speed that `agfb criticals` computes of the true machine, in revolutions per minute."""
    true = calibrated("", "rotor.discs.0.mass=0.1")
    assert Watched("criticals", true, tmp_path / "true.zarr").result.ok
    computed = read_group(open_for_reading(tmp_path / "true.zarr"), "cases/smoke/criticals")
    measured = true.case.scales.speed_rpm(computed["critical_speed"][0])
    table = f"""
[calibrate]
tolerance = 1e-4
[[calibrate.parameters]]
keys = ["rotor.discs.0.mass"]
range = [0.05, 0.15]
[[calibrate.targets]]
quantity = "critical_speed"
value_rpm = {measured}
uncertainty = {1e-4 * measured}
"""
    case = calibrated(table)
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    found = told(tmp_path / "a.zarr", case)
    assert found.values["rotor.discs.0.mass"] == pytest.approx(0.1, rel=1e-3)
    assert found.targets[0].reached == pytest.approx(measured, rel=1e-5)
    assert found.targets[0].bifurcation == "unset", "a critical speed is none"


def test_a_critical_speed_above_a_gap_that_hides_one_has_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """Critical speeds 0.25, 0.8 and 1.2; those below the gap are known."""

    def crossing(speed: float) -> Callable[[float], complex]:
        return lambda at: complex(-0.05, speed + 0.3 * (at - speed))

    matrix = on_paths(*map(crossing, (0.25, 0.8, 1.2)), lambda at: complex(-0.05, 3.0))
    modes = PrescribedModes(matrix, lambda speed: 0.75 < speed < 0.85)
    diagram, critical = modes.critical_speeds(monkeypatch, (0.15, 1.5), 30)
    monkeypatch.setattr(calibration_targets, "campbell_diagram", lambda *_: diagram)
    monkeypatch.setattr(calibration_targets, "critical_speeds", lambda *_: critical)
    found = []
    for number in (1, 2):
        case = calibrated(CRITICAL.format(number=number)).case
        assert case.calibrate is not None
        target = case.calibrate.targets[0]
        found.append(reached(case, {}, target, case.calibrate, None, lambda: False))
    assert (found[0].status, found[0].value) == (FOUND, pytest.approx(0.25))
    assert found[1].status == UNDECIDED


CRITICAL = """
[calibrate]
[[calibrate.parameters]]
keys = ["rotor.discs.0.mass"]
range = [0.05, 0.15]
[[calibrate.targets]]
quantity = "critical_speed"
number = {number}
value = 1.0
"""

Values = Callable[[float, float, float | None], Reached]
TWO_MASSES = """
[calibrate]
max_evaluations = {machines}
[[calibrate.parameters]]
keys = ["rotor.discs.0.mass"]
range = [0.0, 1.0]
[[calibrate.parameters]]
keys = ["rotor.discs.1.mass"]
range = [0.0, 1.0]
[[calibrate.targets]]
value = 0.9
uncertainty = 0.01
"""


@pytest.fixture
def machine_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[Values], None]:
    """Puts a function of both discs' masses and the expected onset in the place of the machine."""

    def put(function: Values) -> None:
        def instead(case: object, values: dict[str, float], *more: Any) -> Reached:
            first, second = values["rotor.discs.0.mass"], values["rotor.discs.1.mass"]
            return function(first, second, more[2])

        monkeypatch.setattr(stage, "reached", instead)

    return put


def simple(first: float, second: float, expected: float | None) -> Reached:
    value = 0.5 + first + 0.5 * second**2
    return Reached(FOUND, value, value, "hopf")


@pytest.mark.parametrize(
    ("limit", "lowest", "highest"), [("upper", 0.58, 0.585), ("lower", 0.898, 2.0), ("exact", 0.898, 0.902)]
)
def test_a_limit_moves_a_machine_from_beyond_it_alone(
    machine_of: Callable[[Values], None], tmp_path: Path, limit: str, lowest: float, highest: float
) -> None:
    """The start, both masses 0.08, reaches 0.5832 of the target value 0.9."""
    machine_of(simple)
    table = TWO_MASSES.format(machines=60).replace("value = 0.9", f'value = 0.9\nlimit = "{limit}"')
    case = calibrated(table)
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    (target,) = told(tmp_path / "a.zarr", case).targets
    assert target.limit == limit
    assert target.reached is not None
    assert lowest < target.reached < highest
    assert target.deviation == pytest.approx(0.0, abs=0.2)


def test_with_more_machines_allowed_it_goes_on(machine_of: Callable[[Values], None], tmp_path: Path) -> None:
    machine_of(simple)
    few, many = (calibrated(TWO_MASSES.format(machines=machines)) for machines in (5, 60))
    stopped = Watched("calibrate", few, tmp_path / "a.zarr").result
    assert not stopped.ok
    assert stopped.stop_reason == OUT_OF_EVALUATIONS
    assert "max_evaluations" in stopped.advice
    assert told(tmp_path / "a.zarr", few).machines == 5
    for name in ("a.zarr", "b.zarr"):
        assert Watched("calibrate", many, tmp_path / name).result.ok
    first, second = (stored(tmp_path / name) for name in ("a.zarr", "b.zarr"))
    assert first.n_points > 5
    np.testing.assert_array_equal(first["reached"], second["reached"])


def test_what_the_targets_do_not_feel_is_told(machine_of: Callable[[Values], None], tmp_path: Path) -> None:
    """One target for two parameters leaves the direction open in which it does not change."""
    machine_of(simple)
    case = calibrated(TWO_MASSES.format(machines=60))
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    found = told(tmp_path / "a.zarr", case)
    (direction,) = found.undetermined
    slopes = np.array([1.0, found.values["rotor.discs.1.mass"]])  # of `simple`
    parts = np.array([direction["rotor.discs.0.mass"], direction.get("rotor.discs.1.mass", 0.0)])
    assert abs(parts @ slopes) < 0.02  # the error of one-sided differences: half a step
    assert [row.uncertainty for row in found.parameters] == [None, None]


def test_an_onset_that_only_a_branch_from_the_lowest_speed_sees_is_no_success(
    machine_of: Callable[[Values], None], tmp_path: Path
) -> None:
    def hidden(first: float, second: float, expected: float | None) -> Reached:
        lost = first > 0.1 and expected is None
        return Reached(FOUND, 0.4, 0.4, "period_doubling") if lost else simple(first, second, expected)

    machine_of(hidden)
    case = calibrated(TWO_MASSES.format(machines=60))
    result = Watched("calibrate", case, tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == OTHER_ONSET
    (target,) = told(tmp_path / "a.zarr", case).targets
    assert target.reached == 0.4
    assert target.bifurcation == "period_doubling"


def test_machines_that_fail_are_left_again(machine_of: Callable[[Values], None], tmp_path: Path) -> None:
    """The first step towards the target leads where there is no cycle."""

    def hole(first: float, second: float, expected: float | None) -> Reached:
        return Reached("no_cycle") if first > 0.42 else simple(first, second, expected)

    machine_of(hole)
    table = TWO_MASSES.format(machines=60).replace("value = 0.9", "value = 0.85")
    case = calibrated(table)
    assert Watched("calibrate", case, tmp_path / "a.zarr").result.ok
    found = told(tmp_path / "a.zarr", case)
    assert found.targets[0].reached == pytest.approx(0.85, abs=1e-4)


def test_targets_that_fail_at_the_found_machine_are_no_success(
    machine_of: Callable[[Values], None], tmp_path: Path
) -> None:
    machine_of(lambda first, second, expected: Reached("film_limit"))
    case = calibrated(TWO_MASSES.format(machines=60))
    result = Watched("calibrate", case, tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == FAILED_TARGETS
    assert told(tmp_path / "a.zarr", case).targets[0].remark.startswith("the film touches the foil")


def test_censored_and_failed_targets_are_recorded_and_told(tmp_path: Path) -> None:
    """Below, above, and a film thinner than allowed."""
    table = """
[calibrate]
max_evaluations = 2
[[calibrate.parameters]]
keys = ["rotor.discs.mass"]
range = [0.05, 0.12]
[[calibrate.targets]]
value = 1.1
speed_range = [1.2, 1.3]
set = { "excitation.displacement" = 0.0 }
[[calibrate.targets]]
value = 1.1
speed_range = [0.7, 0.8]
set = { "excitation.displacement" = 0.0 }
[[calibrate.targets]]
value = 1.1
speed_range = [1.25, 1.3]
[[calibrate.targets]]
value = 1.1
speed_range = [1.0, 1.02]
[[calibrate.targets]]
value = 1.1
speed_range = [1.0, 1.02]
set = { "continue_cycles.minimum_film" = 0.9 }
"""
    case = calibrated(table)
    result = Watched("calibrate", case, tmp_path / "a.zarr").result
    assert result.stop_reason == FAILED_TARGETS
    rows = stored(tmp_path / "a.zarr")
    below, above = "censored_below", "censored_above"
    assert list(rows.labels("status")[0][:4]) == [below, above, below, above]
    assert rows.labels("status")[0][4] == "film_limit"
    np.testing.assert_array_equal(rows["reached"][0], [1.2, 0.8, 1.25, 1.02, np.nan])
    remarks = [row.remark for row in told(tmp_path / "a.zarr", case).targets]
    assert remarks[0].startswith("unstable from the lowest speed")
    assert remarks[1].startswith("none up to the highest speed")
    assert told(tmp_path / "a.zarr", case).targets[4].reached is None
    assert told(tmp_path / "a.zarr", case).sum_of_squares is None


def test_a_case_without_a_table_says_what_to_give(tmp_path: Path) -> None:
    result = Watched("calibrate", tiny_case(), tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == NO_TABLE
    assert "calibrate.targets" in result.advice


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_positions_and_values_are_inverse(scale: Any) -> None:
    case = calibrated(PARAMETERS + RESTING.format(values=[1.0, 1.0])).case
    assert case.calibrate is not None
    parameter = case.calibrate.parameters[0].model_copy(update={"scale": scale})
    for value in (0.2, 0.425, 0.8):
        assert value_at(parameter, position_of(parameter, value)) == pytest.approx(value, rel=1e-9)
    assert [position_of(parameter, value) for value in parameter.range] == [0.0, 1.0]
