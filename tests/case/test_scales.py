"""Scales: closed forms, published sets of parameters, round trips."""

from __future__ import annotations

import csv
import math
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.case.models import Bearing, Bump, Case, Foil, Gas
from pipelines.case.reading import read_cases
from pipelines.case.ring_statics import ring_displacement_from_load
from pipelines.case.scales import PARAMETERS, Scales, film_time

REFERENCE = Path(__file__).parents[1] / "reference" / "parameter_sets.csv"
ROWS = {row["set"][0]: row for row in csv.DictReader(REFERENCE.open())}


def published_foil(row: dict[str, str]) -> Foil:
    """The foil of a row of the table, from text as `s=4.572e-3 l_half=1.717e-3 t=1.3e-4 E=2e11 nu=0.3`.

    Rows without such numbers count as rigid.
    """
    if row["foil"].startswith("areal"):
        return Foil(areal_stiffness=float(row["foil"].split()[2]), loss_factor=0.25)
    if not row["foil"].startswith("s="):
        return Foil(rigid=True)
    values = dict(word.split("=") for word in row["foil"].split())
    bump = Bump(
        pitch=float(values["s"]),
        half_length=float(values["l_half"]),
        thickness=float(values["t"]),
        young_modulus=float(values["E"]),
        poisson_ratio=float(values["nu"]),
    )
    return Foil(bump=bump, loss_factor=0.25)


def published_scales(row: dict[str, str]) -> Scales:
    bearing = Bearing(
        node=0,
        radius=float(row["R_m"]),
        length=float(row["L_m"] or 0.04),
        clearance=float(row["c_m"]),
        foil=published_foil(row),
    )
    gas = Gas(viscosity=float(row["mu_Pa_s"]), ambient_pressure=float(row["p0_Pa"]))
    return Scales.of(gas, (bearing, bearing))


# The derived columns of set C belong to the standard atmosphere, not to the 101350 Pa of its own row: with
# 101325 Pa all three agree to their last digit, with 101350 Pa time and stiffness are both off by 2.3e-4.
PRESSURE_BEHIND = {"C": "101325"}


@pytest.mark.parametrize("letter", sorted(ROWS))
def test_derived_numbers_of_the_published_sets(letter):
    """Five printed digits of time and stiffness (bumps: A, C; per area: B); rpm within one."""
    row = ROWS[letter] | {"p0_Pa": PRESSURE_BEHIND.get(letter, ROWS[letter]["p0_Pa"])}
    scales = published_scales(row)
    assert scales.time == pytest.approx(float(row["derived_T_s(6muR2/p0c2)"]), rel=5e-5)
    assert scales.speed_rpm(1.0) == pytest.approx(float(row["derived_speed_rpm_at_Lambda_1"]), abs=1.0)
    if row["derived_kf_bar"]:
        assert scales.bearings[0].foil_stiffness == pytest.approx(float(row["derived_kf_bar"]), rel=5e-5)


def test_set_c_contradicts_itself():
    """In exact arithmetic 6 x 2.98e-5 x 19.05e-3^2/(101350 x 31.8e-6^2) is not the printed time."""
    exact = Fraction(6 * 298 * 1905**2, 101350 * 318**2) / 10**3
    assert published_scales(ROWS["C"]).time == pytest.approx(float(exact), rel=1e-14)
    printed = float(ROWS["C"]["derived_T_s(6muR2/p0c2)"])
    assert printed / float(exact) - 1 == pytest.approx(2.2e-4, rel=0.05)


def test_closed_forms(text):
    case = read_cases(text, "demo.toml")[0].case
    scales = case.scales
    t0 = 6 * 1.85e-5 * 0.014**2 / (101325 * 20.4e-6**2)
    assert scales.time == pytest.approx(t0, rel=1e-15)
    assert scales.time == film_time(1.85e-5, 101325.0, 0.014, 20.4e-6)
    assert scales.displacement == 20.4e-6
    assert scales.force == pytest.approx(101325 * 0.014 * 0.0161, rel=1e-15)
    # M_bar = m c/(p0 R L t0^2) and F_bar = F/(p0 R L) leave Newton's law m a = F as it is.
    assert scales.mass * scales.displacement / scales.time**2 == pytest.approx(scales.force, rel=1e-14)
    assert scales.stiffness * scales.displacement == pytest.approx(scales.force, rel=1e-14)
    assert scales.damping * scales.displacement / scales.time == pytest.approx(scales.force, rel=1e-14)
    assert scales.bearings[0].kappa == pytest.approx(0.014 / 0.0161, rel=1e-15)


@given(st.floats(1e-6, 1e3), st.floats(1e-7, 1.0))
def test_speeds_and_frequencies_return(value, time):
    scales = Scales(time=time, displacement=1e-5, force=1.0, mass=1.0, pressure=1e5, bearings=())
    assert scales.speed_from_rpm(scales.speed_rpm(value)) == pytest.approx(value, rel=1e-14)
    assert scales.from_hertz(scales.hertz(value)) == pytest.approx(value, rel=1e-14)
    assert scales.speed_rpm(value) == pytest.approx(60 * scales.hertz(value), rel=1e-14)


def test_si_and_dimensionless_input_give_the_same_parameters(text):
    case = read_cases(text, "demo.toml")[0].case
    scales = case.scales
    assert dict(zip(PARAMETERS, case.parameters, strict=True)) == {
        "speed": 1.0,
        "excitation_frequency": 0.7,
        "displacement": 0.2,
        "foil_stiffness": 10.0,
    }
    overrides = (
        f"operation.speed_rpm={scales.speed_rpm(1.0)!r}",
        f"excitation.frequency_hz={scales.hertz(0.7)!r}",
        f"bearings.foil.areal_stiffness={10 * 101325.0 / 20.4e-6!r}",
    )
    dimensional = read_cases(text, "demo.toml", overrides)[0].case
    assert dimensional.parameters == pytest.approx(case.parameters, rel=1e-14)


def test_the_second_bearing_enters_by_its_ratios(text):
    overrides = ("bearings.1.clearance=40.8e-6", "bearings.1.radius=0.028", "bearings.1.foil.rigid=true")
    first, second = read_cases(text, "demo.toml", overrides)[0].case.scales.bearings
    assert (first.time_ratio, first.clearance_ratio, first.force_ratio) == (1.0, 1.0, 1.0)
    # t ~ R^2/c^2 and F ~ R L
    assert (second.time_ratio, second.clearance_ratio, second.force_ratio) == pytest.approx((1.0, 2.0, 2.0))
    assert second.foil_stiffness == math.inf
    assert second.kappa == pytest.approx(2 * first.kappa)


RING = """[excitation.ring]
inner_radius = 0.02
thickness = 2e-3
width = 0.02
young_modulus = 2e11
poisson_ratio = 0.3
"""


def test_a_ring_load_is_a_displacement_of_the_same_length_in_both_bearings(text):
    words = ("excitation.load=10", "bearings.1.clearance=40.8e-6", "excitation.amplitudes=[1.0, 0.5]")
    loaded = read_cases(text + RING, "demo.toml", words)[0].case
    assert loaded.excitation.displacement is None
    moved = ring_displacement_from_load(loaded.excitation.ring, 10.0)
    assert loaded.parameters[2] == pytest.approx(moved / 20.4e-6, rel=1e-14)
    assert loaded.scales.ring_factors(loaded.excitation) == pytest.approx((1.0, 0.25), rel=1e-14)
    given_directly = read_cases(text, "demo.toml", words[1:])[0].case
    assert given_directly.scales.ring_factors(given_directly.excitation) == (1.0, 0.5)


def test_rotor_geometry(text):
    rotor = read_cases(text, "demo.toml")[0].case.rotor
    assert rotor.node_count == 5
    assert rotor.node_positions() == pytest.approx((0.0, 0.05, 0.1, 0.15, 0.2), rel=1e-14)
    assert [element.count for element in rotor.single_elements()] == [1, 1, 1, 1]
    assert rotor.mass == pytest.approx(7850 * math.pi / 4 * 0.0176**2 * 0.2 + 0.08, rel=1e-14)
    assert rotor.materials["steel"].resolved_poisson_ratio == 0.3


def test_models_are_frozen(text):
    case: Case = read_cases(text, "demo.toml")[0].case
    with pytest.raises(ValueError, match="frozen"):
        case.gas.viscosity = 1.0  # type: ignore[misc]
    assert isinstance(case.rotor.masters, tuple)
    assert isinstance(case.rotor.elements, tuple)
