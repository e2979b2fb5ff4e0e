"""What a run in time leaves beside its samples."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import TRANSIENT_ANALYSIS
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.time_runs.modal_energy import modal_energy, rotor_modes, sampled_velocity
from pipelines.stages.transients import analysis as transient_analysis
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

RUN = "cases/smoke/transient/t000"
ANALYSIS = "cases/smoke/transient_analysis/t000"
PERIOD = 2.0 * np.pi / 0.7
COARSE = ("transient.steps_per_period=40", "transient.samples_per_period=40")


def run(store: Path, periods: float, *overrides: str) -> Group:
    """The analysis of a run over so many excitation periods."""
    case = tiny_case(*COARSE, *overrides, f"transient.duration={periods * PERIOD!r}")
    assert Watched("transient", case, store).result.ok
    return read_group(open_for_reading(store), ANALYSIS)


def complete() -> set[str]:
    return {spec.name for spec in TRANSIENT_ANALYSIS.arrays}


@pytest.fixture(scope="module")
def settled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Far below the instability: the start at the equilibrium of the resting rings is soon forgotten."""
    store = tmp_path_factory.mktemp("settled") / "run.zarr"
    run(store, 80.0, "operation.speed=0.9")
    return store


def test_a_settled_run_repeats_with_the_rings(settled):
    found = read_group(open_for_reading(settled), ANALYSIS)
    assert set(found.arrays) == complete()
    assert found.attributes["skipped"] == {}
    assert found.attributes["source"] == "transient/t000"
    assert found.labels("motion")[0] == "period_1"
    assert found.labels("section")[0] == "ring"
    assert found["section_period"][0] == pytest.approx(PERIOD, rel=1e-12)
    assert np.all(found["return_distance"] < 1e-3)
    assert verify(settled) == []


def test_points_of_the_rings_are_the_samples_at_whole_periods(settled):
    store = open_for_reading(settled)
    found, samples = read_group(store, ANALYSIS), read_group(store, RUN, ("journal", "time"))
    count = len(found["ring_section_time"])
    assert count >= 80  # the last one may lie behind the last sample, by rounding
    np.testing.assert_allclose(found["ring_section_time"], PERIOD * np.arange(count), rtol=0.0, atol=1e-9)
    whole = samples["journal"][::40][:count]
    np.testing.assert_allclose(found["ring_section_journal"], whole, rtol=0.0, atol=1e-11)


def test_points_of_the_rotation_lie_on_whole_turns(settled):
    """At a constant speed of 0.9; the points are those of the motion between the samples, which here repeats
    with the rings: its Fourier series tells them.
    """
    store = open_for_reading(settled)
    found, samples = read_group(store, ANALYSIS), read_group(store, RUN, ("journal", "time"))
    times = found["rotation_section_time"]
    np.testing.assert_allclose(times, 2.0 * np.pi / 0.9 * np.arange(len(times)), rtol=0.0, atol=1e-9)
    last = samples["journal"][-41:-1].reshape(40, 4)
    series = np.fft.rfft(last, axis=0)[:20] / 40.0
    late = times > samples["time"][-1] - 10.0 * PERIOD
    turns = np.outer(times[late] - samples["time"][-41], 0.7 * np.arange(20))
    doubled = np.where(np.arange(20) > 0, 2.0, 1.0)[:, None] * series
    expected = np.real(np.exp(1j * turns) @ doubled).reshape(-1, 2, 2)
    np.testing.assert_allclose(found["rotation_section_journal"][late], expected, rtol=0.0, atol=2e-5)


def test_the_spectrum_has_the_lines_of_the_rings(settled):
    """The steady motion is a Fourier series in the period of the rings: peaks are its coefficients."""
    store = open_for_reading(settled)
    found, samples = read_group(store, ANALYSIS), read_group(store, RUN, ("journal",))
    assert found["frequency"][-1] <= 4.0 * 0.9
    series = 2.0 * np.abs(np.fft.rfft(samples["journal"][-41:-1], axis=0)) / 40.0
    for order in (1, 2):
        near = np.abs(found["frequency"] - 0.7 * order) < 0.1
        np.testing.assert_allclose(found["spectrum"][near].max(axis=0), series[order], rtol=3e-3)
    last = found["waterfall"][-1].max(axis=0)
    assert np.all((last > 0.95 * series[1]) & (last < 1.01 * series[1]))


def test_windows_of_the_envelope(settled):
    store = open_for_reading(settled)
    found, samples = read_group(store, ANALYSIS), read_group(store, RUN, ("journal", "time"))
    assert found["envelope_low"].shape == (20, 2, 2)  # of four periods
    np.testing.assert_array_equal(found["envelope_low"][3], samples["journal"][480:640].min(axis=0))
    np.testing.assert_array_equal(found["envelope_high"][3], samples["journal"][480:640].max(axis=0))
    assert samples["time"][480] < found["window_time"][3] < samples["time"][640]
    np.testing.assert_array_equal(found["window_speed"], 0.9)


def test_energies_are_those_of_the_states(settled):
    """Checkpoints hold the velocities; here they lie on samples."""
    store, machine = open_for_reading(settled), build_machine(tiny_case().case)
    found = read_group(store, RUN, ("displacement", "time", "checkpoint_state", "checkpoint_samples"))
    rotor = machine.condensed.scaled(machine.scales.time, machine.scales.displacement, machine.scales.force)
    modes = rotor_modes(rotor.mass, rotor.stiffness)
    velocity = sampled_velocity(found["displacement"], PERIOD / 40.0)
    rows = found["checkpoint_samples"][1:-1] - 1
    start, count = machine.rotor_start, machine.rotor_freedoms
    states = found["checkpoint_state"][1:-1]
    np.testing.assert_allclose(states[:, start : start + count], found["displacement"][rows], atol=1e-12)
    exact = modal_energy(modes, found["displacement"][rows], states[:, start + count :])
    sampled = modal_energy(modes, found["displacement"][rows], velocity[rows])
    np.testing.assert_allclose(sampled.kinetic[:, :2], exact.kinetic[:, :2], rtol=1e-3)
    stored = read_group(store, ANALYSIS, ("kinetic_energy", "strain_energy"))
    whole = modal_energy(modes, found["displacement"][480:640], velocity[480:640])
    np.testing.assert_allclose(stored["kinetic_energy"][3], whole.kinetic.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(stored["strain_energy"][3], whole.strain.mean(axis=0), rtol=1e-9)


def test_what_is_missing_is_made_anew_with_the_same_bytes(tmp_path, settled):
    store = tmp_path / "run.zarr"
    shutil.copytree(settled, store)
    shutil.rmtree(store / ANALYSIS)
    again = run(store, 80.0, "operation.speed=0.9")
    assert again.labels("motion")[0] == "period_1"
    assert compare_trees(settled, store) == []


def test_a_run_that_is_stopped_has_no_analysis_yet(tmp_path):
    store = tmp_path / "run.zarr"
    case = tiny_case(*COARSE, "transient.duration=100.0", "transient.checkpoint_samples=100")
    Watched("transient", case, store, stop_after=1)
    assert ANALYSIS not in list_groups(open_for_reading(store), "smoke")
    Watched("transient", case, store)
    assert ANALYSIS in list_groups(open_for_reading(store), "smoke")


def test_a_run_up_says_what_it_cannot_give(tmp_path):
    found = run(tmp_path / "run.zarr", 70.0, "transient.times=[0.0, 700.0]", "transient.speeds=[0.8, 1.1]")
    skipped = found.attributes["skipped"]
    assert set(skipped) == {"spectrum", "motion"}
    assert skipped["motion"] == "the speed or the rings change until the end of the run"
    assert np.all(np.diff(found["window_speed"]) > 0.0)
    assert np.all(np.diff(found["piece_speed"]) > 0.0)
    turns = found["rotation_section_time"] * (0.8 + 0.5 * 0.3 / 700.0 * found["rotation_section_time"])
    np.testing.assert_allclose(turns, 2.0 * np.pi * np.arange(len(turns)), rtol=0.0, atol=1e-8)


def test_a_short_run_with_resting_rings(tmp_path):
    found = run(tmp_path / "run.zarr", 1.5, "transient.excitation=off", "operation.speed=0.8")
    skipped = found.attributes["skipped"]
    assert skipped["ring_section"] == "the rings rest"
    assert "needed" in skipped["waterfall"]
    assert "needed" in skipped["spectrum"]
    assert {"envelope_low", "kinetic_energy", "rotation_section_time"} <= set(found.arrays)


def test_a_passive_machine_at_rest_is_in_equilibrium(tmp_path):
    found = run(tmp_path / "run.zarr", 10.0, "transient.excitation=off", "operation.speed=0.8")
    assert found.labels("motion")[0] == "equilibrium"
    assert found.labels("section")[0] == "rising"
    assert found["orbit_size"][0] < 1e-6


def test_an_unbalance_alone_is_judged_once_per_turn(tmp_path):
    found = run(
        tmp_path / "run.zarr", 100.0, "transient.excitation=off", "operation.speed=0.9",
        "unbalance.grade=1.0", "unbalance.rated_speed=0.9",
    )  # fmt: skip
    assert found.labels("section")[0] == "rotation"
    assert found.labels("motion")[0] == "period_1"
    assert found["section_period"][0] == pytest.approx(2.0 * np.pi / 0.9, rel=1e-12)


def test_a_whirl_without_drive_is_judged_by_its_own_return(tmp_path):
    """Just below the instability of the passive machine, pushed by rings that are then switched off: the
    whirl dies out with the leading eigenvalue of the equilibrium.
    """
    off = ("transient.excitation=switch_off", "transient.switch_time=20.0")
    found = run(tmp_path / "run.zarr", 300.0, "operation.speed=1.06", *off)
    assert found.labels("section")[0] == "rising"
    assert found.labels("motion")[0] == "unsettled"
    case = tiny_case("operation.speed=1.06").case
    machine, parameters = build_machine(case), parameter_vector(case)
    parameters[2] = 0.0
    state = machine_equilibrium(machine, parameters).state
    eigenvalues = np.linalg.eigvals(machine.jacobian(0.0, state, parameters).toarray())
    leading = eigenvalues[np.argmax(eigenvalues.real)]
    assert found["growth_rate"][0] == pytest.approx(leading.real, rel=0.01)
    assert 2.0 * np.pi / found["section_period"][0] == pytest.approx(abs(leading.imag), rel=1e-3)


def test_few_samples_per_period_give_an_envelope_only(tmp_path):
    found = run(tmp_path / "run.zarr", 90.0, "operation.speed=0.9", "transient.samples_per_period=4")
    assert set(found.arrays) == {"window_time", "window_speed", "envelope_low", "envelope_high"}
    assert set(found.attributes["skipped"]) == {
        "modal_energy", "ring_section", "rotation_section", "spectrum", "waterfall", "motion",
    }  # fmt: skip
    assert "raise transient.samples_per_period" in found.attributes["skipped"]["motion"]


def test_sizes_stay_bounded(tmp_path, monkeypatch):
    """With smaller bounds in place of a longer run; every part keeps to its own."""
    for name, value in (
        ("MOST_WINDOWS", 20), ("MOST_SECTIONS", 30), ("MOST_SPECTRUM_SAMPLES", 800), ("MOST_PIECES", 5),
        ("MOST_POINTS", 35),
    ):  # fmt: skip
        monkeypatch.setattr(transient_analysis, name, value)
    found = run(tmp_path / "run.zarr", 80.0, "operation.speed=0.9")
    sizes = found.attributes["dimensions"]
    assert sizes["window"] <= 20
    assert sizes["ring_section"] == 30
    assert sizes["rotation_section"] == 30
    assert sizes["piece"] <= 5
    assert found["section_points"][0] <= 36
    assert np.diff(found["frequency"])[0] == pytest.approx(2.0 * np.pi / (800 * PERIOD / 40.0))
    assert found["ring_section_time"][-1] > 78.9 * PERIOD  # the last ones
