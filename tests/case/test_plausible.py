"""Numbers in another unit than their key are refused with what they mean and what was probably meant."""

from __future__ import annotations

import re

import pytest

from pipelines.case.plausible import FASTEST_SURFACE
from pipelines.case.reading import CaseError, read_cases
from pipelines.case.scales import Scales

TARGET = "calibrate.targets=[{{{}}}]"
FREE = "calibrate.parameters=[{keys=['rotor.discs.mass'], range=[0.05, 0.12]}]"
RATED = "unbalance.grade=2.5"
RPM = [5000.0, 40000.0]


def scales_of(text: str) -> Scales:
    return read_cases(text, "demo.toml")[0].case.scales


def message(text: str, key: str, *overrides: str) -> str:
    """What is wrong with the one key."""
    with pytest.raises(CaseError) as caught:
        read_cases(text, "demo.toml", overrides)
    found = {problem.key: problem.message for problem in caught.value.problems}
    assert set(found) == {key}, found
    return found[key]


@pytest.mark.parametrize(
    ("key", "overrides"),
    [
        ("linearize.speed_range", ["linearize.speed_range=[5000, 40000]"]),
        ("criticals.speed_range", ["criticals.speed_range=[5000, 40000]"]),
        ("continue_cycles.range", ["continue_cycles.range=[5000, 40000]", "continue_cycles.start=inside"]),
        ("continue_tori.range", ["continue_tori.range=[5000, 40000]"]),
        ("track_curves.ranges.1", ["track_curves.ranges=[[0.2, 2], [5000, 40000]]"]),
        ("transient.speeds", ["transient.times=[0, 9]", "transient.speeds=[5000, 40000]"]),
        ("calibrate.speed_range", [FREE, TARGET.format("value=1.0"), "calibrate.speed_range=[5000, 40000]"]),
        ("calibrate.targets.0.speed_range", [FREE, TARGET.format("value=1.0, speed_range=[5000, 40000]")]),
    ],
)
def test_rpm_as_dimensionless_speeds(text: str, key: str, overrides: list[str]) -> None:
    words = [word for word in overrides if not word.endswith("inside")]
    if len(words) < len(overrides):  # a start of its own is refused too
        with pytest.raises(CaseError) as caught:
            read_cases(text, "demo.toml", (*words, "continue_cycles.start=7000"))
        assert {problem.key for problem in caught.value.problems} == {key, "continue_cycles.start"}
        told = next(problem.message for problem in caught.value.problems if problem.key == key)
    else:
        told = message(text, key, *words)
    found = re.search(r"\[5000, 40000\] rpm are \[(.+), (.+)\]", told)
    assert found is not None, told
    meant = [scales_of(text).speed_from_rpm(rpm) for rpm in RPM]
    assert [float(found[1]), float(found[2])] == pytest.approx(meant, rel=1e-3)


@pytest.mark.parametrize(
    ("key", "overrides"),
    [
        ("operation.speed", ["operation.speed=12000"]),
        ("continue_cycles.start", ["continue_cycles.range=[0.2, 50000]", "continue_cycles.start=12000"]),
        ("unbalance.rated_speed", [RATED, "unbalance.rated_speed=12000"]),
        ("calibrate.targets.0.value", [FREE, TARGET.format("value=12000")]),
    ],
)
def test_one_speed_in_rpm(text: str, key: str, overrides: list[str]) -> None:
    with pytest.raises(CaseError) as caught:
        read_cases(text, "demo.toml", (*overrides,))
    told = {problem.key: problem.message for problem in caught.value.problems}[key]
    assert f"12000 rpm is {scales_of(text).speed_from_rpm(12000.0):.4g}" in told


@pytest.mark.parametrize(
    ("key", "overrides"),
    [
        ("excitation.frequency", ["excitation.frequency=220"]),
        ("continue_cycles.range", ["continue_cycles.parameter=excitation_frequency",
                                   "continue_cycles.range=[0.1, 220]"]),
        ("continue_tori.range", ["continue_tori.parameter=excitation_frequency",
                                 "continue_tori.range=[0.1, 220]"]),
        ("track_curves.ranges.0", ["track_curves.ranges=[[0.1, 220], [0.2, 1.4]]"]),
    ],
)  # fmt: skip
def test_hertz_as_dimensionless_frequencies(text: str, key: str, overrides: list[str]) -> None:
    told = message(text, key, *overrides)
    assert f"{scales_of(text).from_hertz(220.0):.4g}" in told
    assert "Hz" in told


def test_an_areal_stiffness_as_a_dimensionless_one(text: str) -> None:
    words = ("continue_cycles.parameter=foil_stiffness", "continue_cycles.range=[5, 5e10]")
    assert f"{5e10 * 20.4e-6 / 101325.0:.4g}]" in message(text, "continue_cycles.range", *words)


def test_a_dimensionless_speed_as_rpm(text: str) -> None:
    told = message(text, "operation.speed_rpm", "operation.speed_rpm=1.1")
    assert f"the dimensionless 1.1 is {scales_of(text).speed_rpm(1.1):.4g} rpm" in told
    words = ("transient.units=si", "transient.times=[0, 1]", "transient.speeds=[0.9, 1.2]")
    assert "at 0.9 rpm no gas film carries" in message(text, "transient.speeds", *words)


def test_a_speed_in_rpm_that_no_shaft_survives(text: str) -> None:
    assert "2000 m/s" in message(text, "operation.speed_rpm", "operation.speed_rpm=1e8")


def test_the_bound_is_a_surface_speed_of_the_larger_journal(text: str) -> None:
    """Omega = v/R t0, whatever the scales: everything slower is allowed."""
    larger = ("bearings.1.radius=0.028",)
    fastest = FASTEST_SURFACE / 0.028 * scales_of(text).time
    below, above = (f"criticals.speed_range=[0.1, {factor * fastest}]" for factor in (0.999, 1.001))
    assert read_cases(text, "demo.toml", (*larger, below))
    with pytest.raises(CaseError, match="2000 m/s"):
        read_cases(text, "demo.toml", (*larger, above))


@pytest.mark.parametrize("table", ["continue_cycles", "continue_tori", "track_curves", "bifurcation_set"])
def test_steps_are_dimensionless_too(text: str, table: str) -> None:
    words = [f"{table}.maximum_step=500"]
    assert "must be" in message(text, f"{table}.maximum_step", *words)
