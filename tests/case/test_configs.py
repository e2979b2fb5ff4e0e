"""Every configuration that is shipped can be used."""

from __future__ import annotations

import fnmatch
import re
import tomllib

import pytest

from pipelines.case.reading import read_cases
from tests.helpers.configurations import CONFIGS, FILES

# Foil stiffness and the excitation frequency at which the paper finds its anti-resonance.
ANTIRESONANCES = {3: 0.63, 10: 0.70, 20: 0.72, 50: 0.74}


def test_the_promised_configurations_are_there():
    names = {str(file.relative_to(CONFIGS)) for file in FILES}
    assert names >= {
        "smoke.toml",
        "tongue.toml",
        "passive.toml",
        "your_rotor.toml",
        "paper/kb10.toml",
        "paper/fig3.toml",
    }


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_is_valid(file):
    for named in read_cases(file.read_text(), file.name):
        assert named.resolved["name"] == file.stem


@pytest.mark.parametrize("file", [*sorted((CONFIGS / "paper").glob("*.toml"))], ids=lambda file: file.stem)
def test_a_paper_configuration_says_that_it_is_a_reconstruction(file):
    header = file.read_text().split("\nname =")[0]
    assert "RECONSTRUCTION, NOT THE AUTHORS' DATA" in header


def machine(name):
    """Gas, rotor, bearings and the shape of the rings of a file; foils may differ in their stiffness."""
    file = tomllib.loads((CONFIGS / "paper" / f"{name}.toml").read_text())
    file["bearings"][0]["foil"].pop("stiffness")
    tables = {table: file[table] for table in ("gas", "rotor", "bearings", "note")}
    return tables | {"ratio": file["excitation"]["ratio"]}


def test_the_figures_of_the_paper_have_one_machine():
    for name in ("fig4", "fig5", "fig6", "gain", "energy"):
        assert machine(name) == machine("fig3"), name
    assert machine("fig3")["note"] == "a reconstruction, not the machine of the paper"


def test_the_machine_of_the_figures_differs_from_the_start_of_the_search_in_what_it_frees():
    searched, found = machine("calibration"), machine("fig3")
    assert searched != found
    for tables in (searched, found):
        assert tables["bearings"][0]["foil"]["pressure"] == "absolute", "as printed in Eq. 5 and 8"
        for key in ("radius", "length", "clearance"):
            del tables["bearings"][0][key]
        for disc in tables["rotor"]["discs"]:
            del disc["mass"]
    assert searched == found


def test_the_search_wants_what_the_paper_prints():
    """Thresholds at 0.2, anti-resonances, thresholds there, and where periods double or not."""
    (named,) = read_cases((CONFIGS / "paper" / "calibration.toml").read_text(), "calibration.toml")
    assert named.case.calibrate is not None
    wanted = {}
    for target in named.case.calibrate.targets:
        stiffness = target.set["bearings.foil.stiffness"]
        wanted.setdefault(target.quantity, {})[stiffness, target.set.get("excitation.frequency")] = (
            target.value
        )
    low = {3: 1.1, 10: 0.95, 20: 0.95, 50: 0.95}
    assert wanted["onset_speed"] == {(k, 0.2): speed for k, speed in low.items()}
    assert wanted["corner_frequency"] == {(k, None): at for k, at in ANTIRESONANCES.items()}
    assert wanted["corner_speed"] == {(k, None): 1.2 for k in ANTIRESONANCES}
    assert set(wanted["doubling_growth"]) == {*ANTIRESONANCES.items(), (3, 0.75)}


def test_the_readings_are_changed_one_at_a_time():
    """The first case of each foil and frequency is that of the figures."""
    named = read_cases((CONFIGS / "paper" / "readings.toml").read_text(), "readings.toml")
    assert machine("readings") == machine("fig3")
    conditions, readings = {}, []
    for each in named:
        case, foil = each.case, each.case.bearings[0].foil
        key = foil.stiffness, case.excitation.frequency
        reading = (
            foil.pressure, foil.damping, case.bearings[0].edge_angle, case.excitation.ratio,
            case.excitation.displacement, (case.numerics.scheme, case.numerics.circumferential),
        )  # fmt: skip
        conditions.setdefault(key, []).append(reading)
    assert set(conditions) == {(k, f) for k, at in ANTIRESONANCES.items() for f in (0.2, at)}
    for readings in conditions.values():
        base = readings[0]
        assert base == ("absolute", "proportional", 0.0, 0.918, 0.2, ("fourth_order", 24))
        changed = [sum(a != b for a, b in zip(reading, base, strict=True)) for reading in readings]
        assert changed == [0] + [1] * (len(readings) - 1)
        assert len(set(readings)) == len(readings)


@pytest.mark.parametrize(
    ("name", "cases"),
    [
        ("fig3", {(k, d, 0.2) for k in (3, 10, 20, 50) for d in (0.02, 0.1, 0.2)}),
        ("fig4", {(k, 0.2, f) for k, at in ANTIRESONANCES.items() for f in (0.2, at)}),
        ("fig6", {(k, 0.2, ANTIRESONANCES[k]) for k in (3, 50)}),
    ],
)
def test_the_figures_of_the_paper_have_its_cases(name, cases):
    """Foil stiffness, displacement and excitation frequency."""
    found = read_cases((CONFIGS / "paper" / f"{name}.toml").read_text(), f"{name}.toml")
    excitations = [named.case.excitation for named in found]
    stiffnesses = [named.case.bearings[1].foil.stiffness for named in found]
    values = [(k, e.displacement, e.frequency) for k, e in zip(stiffnesses, excitations, strict=True)]
    assert set(values) == cases
    grades = [named.case.unbalance.grade for named in found if named.case.unbalance is not None]
    assert grades == ([1.0, 1.0, 6.3, 6.3] if name == "fig6" else [])


@pytest.mark.parametrize("figure", ["fig3", "fig4", "fig6"])
def test_the_globs_of_the_makefile_choose_the_cases_of_a_chart(figure):
    """Every case is in exactly one chart."""
    text = (CONFIGS / "paper" / f"{figure}.toml").read_text()
    ids = [named.case_id for named in read_cases(text, f"{figure}.toml")]
    makefile = (CONFIGS.parent / "Makefile").read_text()
    globs = re.findall(rf"^CASES_{figure}([a-d]) := (\S+)$", makefile, flags=re.MULTILINE)
    assert [letter for letter, _ in globs] == ["a", "b", "c", "d"]
    chosen = [case for _, glob in globs for case in fnmatch.filter(ids, glob)]
    assert sorted(chosen) == sorted(ids)


def test_kb10_is_the_reconstruction():
    """Against the numbers of the search that found the machine."""
    case = read_cases((CONFIGS / "paper" / "kb10.toml").read_text(), "kb10.toml")[0].case
    assert (case.gas.viscosity, case.gas.ambient_pressure) == (1.85e-5, 101325.0)
    for bearing, node in zip(case.bearings, (2, 12), strict=True):
        assert (bearing.node, bearing.radius, bearing.length, bearing.clearance) == (
            node,
            0.014,
            0.0161,
            20.4e-6,
        )
        assert (bearing.film, bearing.edge_angle, bearing.clipping) == ("edge", 0.0, "gumbel")
        assert (bearing.foil.stiffness, bearing.foil.loss_factor) == (10.0, 0.425)
        assert (bearing.foil.damping, bearing.foil.pressure) == ("proportional", "gauge")
    rotor = case.rotor
    assert rotor.node_positions()[-1] == pytest.approx(0.360, rel=1e-12)
    assert rotor.node_count == 15
    assert rotor.masters == (0, 2, 4, 7, 10, 12, 14)
    # The bearings stand 51.4 mm from the ends.
    assert rotor.node_positions()[2] == pytest.approx(0.0514, abs=5e-5)
    assert {(element.outer_diameter, element.inner_diameter) for element in rotor.elements} == {(0.0176, 0.0)}
    assert [(disc.node, disc.mass, disc.diametral_inertia, disc.polar_inertia) for disc in rotor.discs] == [
        (0, 0.079, 2.85e-5, 5.70e-5),
        (14, 0.079, 2.85e-5, 5.70e-5),
    ]
    steel = rotor.materials["steel"]
    assert (steel.young_modulus, steel.poisson_ratio, steel.density) == (206e9, 0.3, 7850.0)
    assert (rotor.rayleigh_mass, rotor.rayleigh_stiffness) == (0.0, 2.43e-5)
    excitation = case.excitation
    assert (excitation.displacement, excitation.frequency, excitation.ratio) == (0.2, 0.7, 0.918)
    assert (case.numerics.circumferential, case.numerics.axial) == (32, 4)  # the default
    # The paper's rotor is designed for more than 20000 rpm; its branches reach the dimensionless speed 1.2.
    assert case.scales.speed_rpm(1.2) > 20000


def test_the_small_configurations_share_the_machine_of_kb10():
    kb10 = tomllib.loads((CONFIGS / "paper" / "kb10.toml").read_text())
    for name in ("smoke", "tongue", "passive"):
        small = tomllib.loads((CONFIGS / f"{name}.toml").read_text())
        for table in ("gas", "rotor", "bearings"):
            assert small[table] == kb10[table], (name, table)
