"""The hash tells machines and numerics apart, and nothing else; differences are named."""

from __future__ import annotations

import copy

import pytest

from pipelines.case.identity import PHYSICS, differences, physics_hash
from pipelines.case.reading import read_cases


def hash_of(text: str, *overrides: str) -> str:
    return physics_hash(read_cases(text, "demo.toml", overrides)[0].case)


def test_the_hash_is_stable(text):
    """Frozen: a change means that stores of earlier versions are no longer recognised."""
    assert hash_of(text) == "696742d3fe6e77230b1f8a36d57db952c7f1acec311f0978bc17bfa7e7ac706f"


def test_keys_of_later_versions_enter_only_where_they_are_used(text, table):
    assert "outer_diameter_right" not in table["rotor"]["elements"][0]
    assert "width" not in table["rotor"]["discs"][0]
    assert hash_of(text, "rotor.elements.axial_force=0.0") == hash_of(text)
    for override in ("outer_diameter_right=0.02", "inner_diameter_right=0.01", "axial_force=100.0"):
        assert hash_of(text, f"rotor.elements.{override}") != hash_of(text)
        named = read_cases(text, "demo.toml", (f"rotor.elements.{override}",))[0]
        assert type(named).from_dict(named.as_dict()) == named


@pytest.mark.parametrize(
    "override", ["name=other", "linearize.points=7", "criticals.orders=2", "continue_cycles.max_points=9"]
)
def test_names_and_stages_do_not_enter(text, override):
    assert hash_of(text, override) == hash_of(text)


def test_order_notation_and_written_defaults_do_not_enter(text):
    gas = "viscosity = 1.85e-5\nambient_pressure = 101325.0\n"
    other = text.replace(gas, "ambient_pressure = 101_325\nviscosity = 0.0000185 # air\n")
    other = other.replace("[rotor]", "[rotor]\ngravity = 9.81")
    assert other != text
    assert hash_of(other) == hash_of(text)


@pytest.mark.parametrize(
    "override",
    [
        "gas.viscosity=1.86e-5",
        "rotor.gravity=0",
        "bearings.1.clearance=21e-6",
        "bearings.foil.pressure=absolute",
        "excitation.frequency=0.71",
        "operation.speed=1.1",
        "numerics.axial=3",
        "numerics.newton_tolerance=1e-9",
    ],
)
def test_physics_and_numerics_enter(text, override):
    assert hash_of(text, override) != hash_of(text)


def test_differences_name_keys_with_both_values(text, table):
    other = read_cases(
        text, "demo.toml", ("numerics.axial=3", "bearings.1.clearance=21e-6", "rotor.discs=[]", "name=other")
    )[0].resolved
    assert differences(table, other) == [
        "rotor.discs.0.node: 0 / null",
        "rotor.discs.0.mass: 0.08 / null",
        "rotor.discs.0.diametral_inertia: 2.85e-05 / null",
        "rotor.discs.0.polar_inertia: 5.7e-05 / null",
        "bearings.1.clearance: 2.04e-05 / 2.1e-05",
        "numerics.axial: 2 / 3",
        "rotor.discs: null / []",
    ]


def test_a_stage_counts_where_it_is_named(text, table):
    other = read_cases(text, "demo.toml", ("continue_cycles.step=0.01",))[0].resolved
    assert differences(table, other) == []
    tables = (*PHYSICS, "continue_cycles")
    assert differences(table, other, tables) == ["continue_cycles.step: 0.02 / 0.01"]


def test_equal_configurations_have_no_difference(table):
    assert differences(table, copy.deepcopy(table)) == []


def test_a_store_that_lacks_tables_is_compared_too(table):
    assert "gas.viscosity: 1.85e-05 / null" in differences(table, {})
