"""Rotors saved by ROSS become configurations: what is carried over, what is told, what is refused."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from pipelines.case.imports.draft import case_name, draft_text, masters_of
from pipelines.case.imports.parts import Imported
from pipelines.case.imports.ross import read_ross
from pipelines.case.reading import CaseError, read_cases
from tests.helpers.configurations import MODELS

ROOT = Path(__file__).parents[2]
MODEL = (MODELS / "ross_rotor.toml").read_text()
PARTS = (ROOT / "tests" / "reference" / "ross_parts.toml").read_text()
FOIL = ["radius", "length", "clearance", "foil.rigid", "foil.loss_factor"]


def problems(text: str, old: str = "", new: str = "", count: int = 1) -> list[tuple[int | None, str, str]]:
    """Line, key and message of what is wrong with a file of ROSS, after a replacement."""
    assert old in text
    with pytest.raises(CaseError) as caught:
        read_ross(text.replace(old, new, count), "rotor.toml")
    return [(problem.line, problem.key, problem.message) for problem in caught.value.problems]


def line_of(text: str, header: str) -> int:
    return text.splitlines().index(header) + 1


@pytest.fixture(scope="module")
def rotor() -> Imported:
    return read_ross(MODEL, "rotor.toml")


@pytest.fixture(scope="module")
def parts() -> Imported:
    return read_ross(PARTS, "parts.toml")


def fill_in(rotor: Imported) -> list[str]:
    with pytest.raises(CaseError) as caught:
        read_cases(draft_text(rotor, "mine"), "mine.toml")
    return [problem.key for problem in caught.value.problems]


def test_what_is_missing_is_what_must_be_filled_in(rotor, parts):
    bearing = [f"bearings.0.{key}" for key in FOIL]
    assert sorted(fill_in(rotor)) == sorted(bearing)  # the rated speed is known
    assert sorted(fill_in(parts)) == sorted([*bearing, "operation.speed_rpm"])


def test_every_key_to_be_filled_in_stands_there_as_a_comment(parts):
    text = draft_text(parts, "mine")
    for key, value in (
        ("radius", "0.012"),
        ("length", "0.02"),
        ("clearance", "2e-5"),
        ("areal_stiffness", "5e9"),
        ("loss_factor", "0.4"),
        ("speed_rpm", "20000.0"),
    ):
        assert text.count(f"# {key} = ") == 1
        text = text.replace(f"# {key} = ", f"{key} = {value} # ")
    (named,) = read_cases(text, "mine.toml")
    assert [bearing.node for bearing in named.case.bearings] == [2, 7]
    assert named.case.rotor.supports == ()


def test_the_rotor_is_that_of_ross(rotor):
    assert [part.table.count for part in rotor.elements] == [1, 1, 1, 1, 2, 1, 1, 1]
    cone = rotor.elements[3].table
    assert (cone.outer_diameter, cone.inner_diameter, cone.right_diameters) == (0.024, 0.006, (0.034, 0.014))
    assert cone.axial_force == 800.0
    assert [(part.table.node, part.remark) for part in rotor.discs] == [
        (0, "compressor"), (4, "collar"), (9, "turbine"), (7, "sensor")
    ]  # fmt: skip
    assert rotor.speed_rpm == pytest.approx(57295.779513)
    assert rotor.foil_nodes == (2, 7)
    assert set(rotor.foil_nodes) | {0, 4, 9} < set(masters_of(rotor))
    gaps = [rotor.node_positions[node] for node in masters_of(rotor)]
    assert max(right - left for left, right in pairwise(gaps)) <= 0.26 / 5 + 1e-12


def test_what_is_not_carried_over_is_told(parts):
    told = "\n".join(parts.lost)
    for part, word in (
        ("ShaftElement_sleeve", "one layer"),
        ("ShaftElement_Shaft Element 2", "torque"),
        ("CouplingElement_coupling", "other half"),
        ("PointMass_half", "0.1 and 0.2 kg"),
        ("PointMass_block", "node 11, which is not on the shaft"),
        ("SealElement_labyrinth", "a seal, at node 4"),
        ("BearingElement_linked", "cxy, mxx, myy, kzz"),
        ("BearingElement_pedestal", "not on the shaft"),
        ("alpha and beta of the shaft elements", "they differ"),
    ):
        assert f"{part}: " in told
        assert word in next(line for line in parts.lost if line.startswith(part))
    changed = "\n".join(parts.changed)
    for word in (
        "without shear",
        "without rotary",
        "without gyroscopic",
        "than Cowper's",
        "instead of node 11",
    ):
        assert word in changed
    assert "BearingElement_oil: depends on speed; the support has its coefficients at 1000 rad/s" in changed
    support = parts.supports[0].table
    assert (support.stiffness_xx, support.stiffness_yy, support.damping_yy) == (2e6, 3e6, 70.0)
    assert parts.discs[0].table.mass == 0.2  # half the coupling, at the right end
    assert parts.discs[0].table.node == 9
    head = draft_text(parts, "mine").partition("\nname = ")[0]
    assert all(line in head for line in (*parts.lost, *parts.changed))


def test_coefficients_are_those_at_the_rated_speed():
    text = PARTS.replace("[parameters]", "[parameters]\nrated_w = 2800.0")
    found = read_ross(text, "parts.toml")
    assert found.supports[0].table.stiffness_yy == 5e6
    assert "at 3000 rad/s, the nearest to the rated speed of 2800" in "\n".join(found.changed)


def test_equal_damping_of_the_elements_is_that_of_the_rotor():
    text = MODEL.replace("alpha = 0.0\nbeta = 0.0", "alpha = 2.0\nbeta = 1e-6")
    found = read_ross(text, "rotor.toml")
    assert (found.rayleigh_mass, found.rayleigh_stiffness) == (2.0, 1e-6)
    assert [line.partition(":")[0] for line in found.changed] == ["PointMass_sensor", "alpha", "beta"]


def test_two_materials_of_one_name_stay_two():
    changed = MODEL.replace('"ShaftElement_Shaft Element 8".material]\nname = "Steel"\nrho = 7810.0', "%")
    assert "%" in changed
    text = changed.replace("%", '"ShaftElement_Shaft Element 8".material]\nname = "Steel"\nrho = 7900.0')
    found = read_ross(text, "rotor.toml")
    assert found.elements[-1].table.material == "Steel_2"
    assert {name: material.density for name, material in found.materials.items()} == {
        "Ti6Al4V": 4430.0, "Steel": 7810.0, "Steel_2": 7900.0
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "header", "key", "message"),
    [
        ("odl = 0.012", "odl = -0.012", "ShaftElement_Shaft Element 0", "outer_diameter", "must be >= 1e-06"),
        ("odl = 0.012", 'odl = "x"', "ShaftElement_Shaft Element 0", "odl", "must be a finite number"),
        ("odr = 0.034", "odr = 0.013", "ShaftElement_Shaft Element 3", "diameter_right", "smaller than"),
        ("m = 0.12", "m = nan", "DiskElement_compressor", "m", "must be a finite number"),
        ("Ip = 6.5e-5", "Ip = 9e-5", "DiskElement_compressor", "polar_inertia", "no rigid body has more"),
        ("n = 4", "n = 14", "ShaftElement_Shaft Element 5", "", "no element between nodes 4 and 5"),
        ("kxx = [ 3000000.0,]", "kxx = [ 1, 2 ]", "BearingElement_left", "kxx", "number for each frequency"),
    ],
)  # fmt: skip
def test_bad_numbers_are_refused_with_the_line_of_their_part(old, new, header, key, message):
    found = problems(MODEL, old, new)
    plain, quoted = f"[{header}]", f'["{header}"]'
    place = line_of(MODEL, plain if plain in MODEL.splitlines() else quoted)
    assert all(line == place for line, _, _ in found if key)
    assert any(key in name and message in told for _, name, told in found), found


def test_what_is_no_rotor_of_ross_is_refused():
    assert "no rotor saved by ROSS, it has no ross_version" in problems("name = 1\n")[0][2]
    assert "it has no elements of a shaft" in problems('ross_version = "2.3.0"\n')[0][2]
    assert problems("a = \n")[0][0] == 1
    assert "joins two shafts" in problems(PARTS, 'n = 9\ntag = "coupling"', 'n = 4\ntag = "coupling"')[0][2]


def test_tags_cannot_break_the_configuration():
    tag = '"evil\\nname = 3 \\u0007"'
    found = read_ross(MODEL.replace("[DiskElement_compressor]", f'["DiskElement_{tag[1:]}]'), "rotor.toml")
    assert sorted(fill_in(found)) == sorted(f"bearings.0.{key}" for key in FOIL)


def test_names_of_cases():
    assert case_name("my rotor (2)") == "my_rotor_2"
    assert case_name("..") == "rotor"
