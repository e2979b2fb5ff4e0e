"""Runs of the stage: starts, resuming, events, what is stored."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.branch import open_branch
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import describe, read_group
from pipelines.datasets.store import open_for_reading, open_for_writing
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.stages.scheduling.preparation import prepare_store
from pipelines.stages.transients.run import prepare_run
from pipelines.stages.transients.transient import CannotRunError, outlook
from tests.helpers.tiny import SHARP, Watched, tiny_case
from tests.helpers.trees import compare_trees

GROUP = "cases/smoke/transient/t000"
SHORT = ("transient.duration=20.0", "transient.checkpoint_samples=40", "transient.steps_per_period=40")
UNBALANCE = ("unbalance.grade=6.3", "unbalance.rated_speed=1.1")
RUN_UP = ("transient.times=[0.0, 12.0]", "transient.speeds=[0.7, 1.0]")
SWITCHED = ("transient.excitation=switch_on", "transient.switch_time=4.0", "transient.switch_ramp=6.0")
EVERYTHING = (*SHORT, *UNBALANCE, *RUN_UP, *SWITCHED)


def run(store: Path, *overrides: str, stop_after: int | None = None) -> Watched:
    return Watched("transient", tiny_case(*overrides), store, stop_after)


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("everything") / "run.zarr"
    assert run(store, *EVERYTHING).result.stop_reason == "finished"
    return store


def test_what_a_run_stores(everything):
    found = read_group(open_for_reading(everything), GROUP)
    period = found.attributes["reference_period"]
    assert period == pytest.approx(2.0 * np.pi / 0.7, rel=1e-14)  # that of the rings
    time = found["time"]
    np.testing.assert_allclose(time, np.arange(len(time)) * period / 64.0, rtol=0.0, atol=1e-12)
    assert len(time) == found.attributes["dimensions"]["sample"] == int(20.0 / period * 64.0) + 1
    np.testing.assert_allclose(found["speed"], np.minimum(0.7 + 0.025 * time, 1.0), rtol=1e-13)
    angle = np.where(time < 12.0, 0.7 * time + 0.0125 * time**2, 10.2 + (time - 12.0))
    np.testing.assert_allclose(found["angle"], angle, rtol=0.0, atol=1e-12)
    x = np.clip((time - 4.0) / 6.0, 0.0, 1.0)
    np.testing.assert_allclose(found["ring_displacement"], 0.2 * x**3 * (10 - 15 * x + 6 * x**2), atol=1e-15)
    np.testing.assert_array_equal(found["journal"][:, 0], found["displacement"][:, 2:4])  # master 1 is node 2
    assert np.all(found["minimum_film"] > 0.0)
    assert np.all(found["minimum_pressure"] <= found["maximum_pressure"])
    assert np.all(found["minimum_foil"] <= found["maximum_foil"])


def test_checkpoints_hold_the_state_behind_the_samples(everything):
    found = read_group(open_for_reading(everything), GROUP)
    machine = build_machine(tiny_case(*EVERYTHING).case)
    assert found["checkpoint_time"][0] == 0.0
    assert found["checkpoint_time"][-1] == 20.0
    assert np.all(np.diff(found["checkpoint_step"]) > 0)
    np.testing.assert_array_equal(found["checkpoint_samples"][[0, -1]], [1, len(found["time"])])
    np.testing.assert_allclose(
        machine.masters(found["checkpoint_state"][0]), found["displacement"][0], rtol=0.0, atol=0.0
    )
    for row in range(1, found.n_events):  # the state lies between its two neighbouring samples
        sample = int(found["checkpoint_samples"][row])
        before, after = found["time"][sample - 1], found["time"][min(sample, len(found["time"]) - 1)]
        assert before <= found["checkpoint_time"][row] + 1e-9
        assert found["checkpoint_time"][row] <= max(after, 20.0 if sample == len(found["time"]) else 0.0)


def test_the_store_is_whole_and_described(everything):
    assert verify(everything) == []
    group = describe(everything)["cases"]["smoke"]["groups"]["transient/t000"]
    assert group["status"] == "ended"
    assert group["n_points"] == group["capacity"]


def test_a_run_starts_in_the_equilibrium_and_stays_there_without_any_forcing(tmp_path):
    """The passive machine below its instability: nothing moves."""
    watched = run(tmp_path / "run.zarr", *SHORT, "transient.excitation=off", "operation.speed=0.8")
    found = read_group(open_for_reading(tmp_path / "run.zarr"), GROUP, ("displacement",))
    case = tiny_case("operation.speed=0.8").case
    parameters = parameter_vector(case)
    parameters[2] = 0.0
    machine = build_machine(case)
    resting = machine.masters(machine_equilibrium(machine, parameters).state)
    np.testing.assert_allclose(found["displacement"], np.tile(resting, (found.n_points, 1)), atol=1e-9)
    assert watched.result.summary["samples"] == found.n_points


@pytest.mark.parametrize("stop_after", [1, 2, 3])
def test_an_interrupted_run_resumes_to_the_same_bytes(tmp_path, everything, stop_after):
    store = tmp_path / "run.zarr"
    stopped = run(store, *EVERYTHING, stop_after=stop_after)
    assert stopped.result.stop_reason == "stopped on request"
    assert stopped.finished == stop_after
    assert outlook(tiny_case(*EVERYTHING), store).steps > 0
    assert run(store, *EVERYTHING).result.ok
    assert compare_trees(everything, store) == []
    assert outlook(tiny_case(*EVERYTHING), store).steps == 0


def test_a_finished_run_is_not_computed_again(tmp_path, everything):
    again = run(everything, *EVERYTHING)
    assert again.reported == []
    assert again.result.stop_reason == "finished"


def test_another_request_makes_the_next_run(tmp_path):
    store = tmp_path / "run.zarr"
    first = run(store, *SHORT)
    second = run(store, *SHORT, *UNBALANCE)
    again = run(store, *SHORT)
    groups = [watched.result.summary["group"] for watched in (first, second, again)]
    assert groups == ["transient/t000", "transient/t001", "transient/t000"]
    assert again.reported == []
    planes = read_group(open_for_reading(store), "cases/smoke/transient/t001", ("plane_node", "plane_moment"))
    case = tiny_case(*SHORT).case
    time = describe(store)["cases"]  # one store, two runs
    assert set(time["smoke"]["groups"]) >= {"transient/t000", "transient/t001"}
    np.testing.assert_array_equal(planes["plane_node"], [2, 12])
    scales = build_machine(case).scales
    # U = G m / Omega_rated, half of it in either bearing's plane
    expected = 6.3e-3 * case.rotor.mass / (1.1 / scales.time) / 2.0
    np.testing.assert_allclose(planes["plane_moment"], expected, rtol=1e-12)


@pytest.mark.parametrize(("formulation", "tolerance"), [("stroboscopic", 1e-8), ("autonomous", 1e-7)])
def test_from_a_stored_cycle_the_run_stays_on_it(tmp_path, formulation, tolerance):
    """Twenty periods with the cycle's own time steps and no unbalance: periodic to 1e-8.

    An autonomous cycle integrates the phase of its rings, with an error of the time steps that a run, whose
    phase is exact, does not make.
    """
    store = tmp_path / "run.zarr"
    overrides = (
        "continue_cycles.start=1.06",
        "continue_cycles.max_points=2",
        f"continue_cycles.formulation={formulation}",
        SHARP,
    )
    assert Watched("continue_cycles", tiny_case(*overrides), store).result.ok
    branch = read_group(open_for_reading(store), "cases/smoke/cycles/b000")
    assert np.all(branch["unstable_count"] == 0)
    period, steps = 2.0 * np.pi / 0.7, int(branch["steps_per_period"][0])
    started = run(
        store,
        *overrides,
        "transient.start=cycles/b000",
        "transient.start_row=0",
        f"transient.duration={20 * period!r}",
        f"transient.steps_per_period={steps}",
    )
    assert started.result.stop_reason == "finished"
    found = read_group(open_for_reading(store), GROUP, ("displacement", "checkpoint_state", "speed"))
    assert found["speed"][0] == branch["speed"][0]
    motion = found["displacement"][: 20 * 64].reshape(20, 64, -1)
    assert np.ptp(motion[0], axis=0).max() > 1e-3
    np.testing.assert_allclose(motion, np.tile(motion[-1], (20, 1, 1)), rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(motion[0], branch["orbit"][0], rtol=0.0, atol=tolerance)
    state = branch["state"][0][: found["checkpoint_state"].shape[1]]  # without the oscillator of Eq. 17
    np.testing.assert_allclose(found["checkpoint_state"][-1], state, rtol=0.0, atol=tolerance)


def test_a_run_goes_on_from_a_checkpoint_of_another(tmp_path, everything):
    """The last checkpoint of a short run with its angles and speed: the next one continues the motion."""
    store = tmp_path / "run.zarr"
    period = 2.0 * np.pi / 0.7
    table = (*UNBALANCE, "transient.steps_per_period=60", "operation.speed=0.7")
    one, two = f"transient.duration={period!r}", f"transient.duration={2 * period!r}"
    run(store, *table, two)
    run(store, *table, one)
    run(store, *table, one, "transient.start=transient/t001")
    opened = open_for_reading(store)
    whole, _, second = (read_group(opened, f"cases/smoke/transient/t00{n}") for n in range(3))
    np.testing.assert_allclose(second["angle"], whole["angle"][64:], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(second["displacement"], whole["displacement"][64:], rtol=0.0, atol=1e-9)


def test_seconds_and_rpm_are_the_same_run(tmp_path):
    case = tiny_case(*EVERYTHING)
    scales = build_machine(case.case).scales
    table = {"duration": 20.0, "switch_time": 4.0, "switch_ramp": 6.0}
    words = [f"transient.{name}={value * scales.time!r}" for name, value in table.items()]
    words.append(f"transient.times=[0.0, {12.0 * scales.time!r}]")
    words.append(f"transient.speeds=[{scales.speed_rpm(0.7)!r}, {scales.speed_rpm(1.0)!r}]")
    drives = [
        prepare_run(named, None).drive
        for named in (case, tiny_case(*EVERYTHING, *words, "transient.units=si"))
    ]
    assert drives[1].duration == pytest.approx(20.0, rel=1e-13)
    np.testing.assert_allclose(drives[1].pieces, drives[0].pieces, rtol=1e-12, atol=1e-12)


def test_a_touching_journal_ends_the_run(tmp_path):
    store = tmp_path / "run.zarr"
    heavy = ("unbalance.planes=[{node = 2, moment = 6.0}]", "transient.minimum_film=0.1")
    watched = run(store, *SHORT, *heavy)
    assert watched.result.ok
    assert watched.result.stop_reason == "touch"
    assert "touches the foil of bearing" in watched.result.advice
    found = read_group(open_for_reading(store), GROUP)
    assert 0 < found.n_points < found.attributes["dimensions"]["sample"]
    assert np.min(found["checkpoint_extremes"][-1, :2]) < 0.1
    assert np.all(found["minimum_film"][:-2] >= 0.1)  # a step holds two samples at most
    assert verify(store) == []
    assert run(store, *SHORT, *heavy).reported == []


def refused(store: Path, *overrides: str) -> CannotRunError:
    """What is said about a run that cannot start; the stage fails for the same reason and makes no group."""
    case = tiny_case(*overrides)
    with pytest.raises(CannotRunError) as caught:
        outlook(case, store)
    before = set(describe(store)["cases"]["smoke"]["groups"])
    result = Watched("transient", case, store).result
    assert not result.ok
    assert (result.stop_reason, result.advice) == (caught.value.reason, caught.value.advice)
    assert set(describe(store)["cases"]["smoke"]["groups"]) == before
    return caught.value


def test_starts_that_are_not_there(everything):
    missing = refused(everything, *EVERYTHING, "transient.start=cycles/b000")
    assert "transient.start = cycles/b000" in missing.reason
    assert "there are transient/t000" in missing.reason
    assert "agfb continue" in missing.advice
    row = refused(everything, *EVERYTHING, "transient.start=transient/t000", "transient.start_row=99")
    assert "transient.start_row" in row.reason
    assert "checkpoints, counted from 0; 99" in row.reason


def test_a_start_whose_rings_would_jump(everything):
    """The first checkpoint of a run that switches on has its rings at rest."""
    plain = [word for word in SHORT if not word.startswith("transient.excitation")]
    start = ("transient.start=transient/t000", "transient.start_row=0")
    error = refused(everything, *plain, *start)
    assert "transient.excitation = on" in error.reason
    assert "would jump" in error.reason


@pytest.mark.parametrize("units", ["dimensionless", "si"])
def test_a_start_whose_speed_would_jump(everything, units):
    """The last checkpoint turns with the speed 1, which a table must begin with; a copied number will do."""
    scales = build_machine(tiny_case().case).scales
    rpm, second = (1.0, 1.0) if units == "dimensionless" else (scales.speed_rpm_per_unit, scales.time)
    length = (f"transient.duration={20.0 * second!r}", f"transient.times=[0.0, {12.0 * second!r}]")
    words = (*SHORT, *UNBALANCE, "transient.start=transient/t000", f"transient.units={units}", *length)

    def beginning(speed: float) -> str:
        return f"transient.speeds=[{speed!r}, {0.8 * rpm!r}]"

    error = refused(everything, *words, beginning(0.6 * rpm))
    assert error.reason.startswith("transient.speeds: ")
    assert f"turns with 1 ({scales.speed_rpm_per_unit:.7g} rpm)" in error.reason
    assert "would jump" in error.reason
    told = re.search(r"begin the table with (\S+) \((\S+) rpm\), or", error.advice)
    copied = float(told[1 if units == "dimensionless" else 2])
    assert copied == pytest.approx(rpm, rel=1e-9)
    drive = prepare_run(tiny_case(*words, beginning(copied)), open_for_reading(everything)).drive
    assert float(drive.speed(np.array(0.0))) == pytest.approx(1.0, rel=1e-9)


def test_a_cycle_of_another_speed_would_jump(tmp_path):
    store = tmp_path / "run.zarr"
    Watched("continue_cycles", tiny_case("continue_cycles.max_points=1"), store)
    error = refused(store, *SHORT, *RUN_UP, "transient.start=cycles/b000")
    assert "the run begins with the speed 0.7" in error.reason
    assert "its start state cycles/b000 turns with 1.14" in error.reason


def test_a_start_of_another_grid(tmp_path):
    """A group whose states have another size, as after copying it from another store."""
    store = tmp_path / "run.zarr"
    case = tiny_case(*SHORT)
    prepare_store(store, [case], ["agfb"])
    run(store, *SHORT)
    source = read_group(open_for_reading(store), GROUP)
    row = {name: source[f"checkpoint_{name}"][0] for name in ("time", "step", "samples", "speed", "angle")}
    event = {f"checkpoint_{name}": value for name, value in row.items()} | {
        "checkpoint_ring_phase": 0.0,
        "checkpoint_ring_displacement": 0.2,
        "checkpoint_state": np.ones(50),
        "checkpoint_extremes": np.zeros(10),
    }
    sizes = dict(source.attributes["dimensions"]) | {"component": 50}
    static = {
        n: source[n]
        for n in ("coordinate_node", "coordinate_axis", "plane_node", "plane_moment", "plane_phase")
    }
    attributes = {"request": {}, "parameters": [1.1, 0.7, 0.2, 10.0]}
    opened = open_for_writing(store)
    with open_branch(opened, "cases/smoke/transient/t001", "transient", sizes, static, attributes) as branch:
        branch.extend([], [event])
    error = refused(store, *SHORT, "transient.start=transient/t001")
    assert "50 components" in error.reason
    assert "another grid" in error.reason


def test_too_many_samples_are_refused_with_a_number_that_fits(everything):
    error = refused(everything, *SHORT, "transient.duration=1e9")
    assert "transient.samples_per_period" in error.reason
    fitting = error.advice.split("at most ")[1].split(",")[0]
    case = tiny_case(*SHORT, "transient.duration=1e9", f"transient.samples_per_period={fitting}")
    long = outlook(case, everything)
    assert long.steps > 1e9
    assert long.seconds > 3600.0
