"""The operating point that `agfb linearize` stores: statics, bearings and modes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.shaft import NODE_FREEDOMS
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.static_deflection import (
    bearing_reactions,
    full_displacement,
    static_deflection,
)
from pipelines.stages.linear.operating_point import tables
from tests.helpers.tiny import ROOT, Watched, tiny_case

TURBINE = ROOT / "tests" / "reference" / "micro_turbine.toml"
FEW = ("linearize.points=2", "linearize.speed_range=[2.0, 2.1]")


def stored(path: Path, case: str = "mgt") -> Group:
    return read_group(open_for_reading(path), f"cases/{case}/operating_point")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("operation") / "a.zarr"
    assert Watched("linearize", tiny_case(*FEW, config=TURBINE), path).result.ok
    return path


def test_reactions_carry_the_weight_and_its_moment(store: Path) -> None:
    group, machine = stored(store), build_machine(tiny_case(config=TURBINE).case)
    weight = machine.rotor.gravity_load[1::NODE_FREEDOMS]
    assert group["reaction"].sum(axis=0) == pytest.approx([0.0, -weight.sum()], rel=1e-9, abs=1e-9)
    position = machine.rotor.node_position
    own = group["reaction"][:, 1] @ position[group["bearing_node"]]
    assert own == pytest.approx(-weight @ position, rel=1e-9), "node forces: the weight has no moments else"
    assert verify(store) == []


def test_every_node_of_the_shaft_is_in_equilibrium() -> None:
    """K u = weight + reactions at all freedoms, those that the condensation drops included."""
    case = tiny_case(config=TURBINE).case
    machine, parameters = build_machine(case), parameter_vector(case)
    state = machine_equilibrium(machine, parameters).state
    forces = machine.rotor.gravity_load.copy()
    for table, reaction in zip(case.bearings, bearing_reactions(machine, parameters, state), strict=True):
        forces[NODE_FREEDOMS * table.node : NODE_FREEDOMS * table.node + 2] += reaction
    rest = machine.rotor.stiffness @ full_displacement(machine, state) - forces
    assert np.max(np.abs(rest)) < 1e-7 * np.max(np.abs(machine.rotor.gravity_load))


def test_the_deflection_does_not_depend_on_the_masters() -> None:
    every = ", ".join(f"{{node = {node}, slopes = true}}" for node in range(13))
    found = []
    for masters in ("[0, 2, 3, 6, 9, 12]", f"[{every}]"):
        case = tiny_case(f"rotor.masters={masters}", config=TURBINE).case
        machine, parameters = build_machine(case), parameter_vector(case)
        found.append(static_deflection(machine, machine_equilibrium(machine, parameters).state))
    assert np.max(np.abs(found[0] - found[1])) < 1e-8 * np.max(np.abs(found[1]))


def test_modes_are_the_eigenvalues_up_to_three_times_the_speed(store: Path) -> None:
    case = tiny_case(config=TURBINE).case
    group, machine, parameters = stored(store), build_machine(case), parameter_vector(case)
    state = machine_equilibrium(machine, parameters).state
    every = np.linalg.eigvals(machine.jacobian(0.0, state, parameters * [1.0, 0.0, 1.0, 1.0]).toarray())
    top = 3.0 * parameters[0]
    kept = every[(every.imag > 0.0) & (every.imag <= top) & (-every.real < 0.9 * np.abs(every))]
    np.testing.assert_allclose(group["eigenvalue"], kept[np.argsort(kept.imag)], rtol=1e-7)
    np.testing.assert_allclose(
        group["frequency_hertz"], group["eigenvalue"].imag / (2 * np.pi * machine.scales.time), rtol=1e-12
    )
    np.testing.assert_allclose(group["frequency_rpm"], 60.0 * group["frequency_hertz"], rtol=1e-12)
    # successive maxima of exp(lambda t) have the ratio exp(decrement)
    period = 2.0 * np.pi / group["eigenvalue"].imag
    ratio = np.exp(-group["eigenvalue"].real * period)
    np.testing.assert_allclose(group["logarithmic_decrement"], np.log(ratio), rtol=1e-10)
    assert group["mode_shape"].shape == (len(kept), 13, 2)


def test_the_terminal_gets_bearings_and_modes(store: Path) -> None:
    group = stored(store)
    result = Watched("linearize", tiny_case(*FEW, config=TURBINE), store).result
    assert result.tables == tables(group)
    bearings, modes = result.tables.values()
    assert [row["bearing"] for row in bearings] == [1, 2]
    assert bearings[0]["Kxx N/m"] == group["stiffness"][0, 0, 0]
    unstable = [row["mode"] for row in modes if "unstable" in str(row["direction"])]
    assert unstable == (1 + np.flatnonzero(group["logarithmic_decrement"] < 0.0)).tolist() != []
    assert type(result).from_dict(result.as_dict()) == result


def test_it_is_computed_again_for_another_ring_only(store: Path, tmp_path: Path) -> None:
    copied = tmp_path / "a.zarr"
    shutil.copytree(store, copied)
    place = copied / "cases" / "mgt" / "operating_point" / "zarr.json"
    before = place.stat().st_mtime_ns
    Watched("linearize", tiny_case(*FEW, "linearize.points=3", config=TURBINE), copied)
    assert place.stat().st_mtime_ns == before
    passive = Watched("linearize", tiny_case(*FEW, "linearize.ring='undeformed'", config=TURBINE), copied)
    assert passive.result.ok
    assert place.stat().st_mtime_ns > before
    assert not np.allclose(stored(copied)["journal"], stored(store)["journal"], rtol=1e-4)


def test_without_an_equilibrium_the_group_says_why(tmp_path: Path) -> None:
    result = Watched("linearize", tiny_case("rotor.gravity=1000", "linearize.points=2"), tmp_path / "a.zarr")
    group = stored(tmp_path / "a.zarr", "smoke")
    assert not group.attributes["equilibrium"]
    assert "of the rotor's weight" in group.attributes["reason"]
    assert result.result.tables == {}
    assert verify(tmp_path / "a.zarr") == []
