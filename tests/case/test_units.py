"""Configurations in rpm, Hz, s, um and N/m3 are those in dimensionless numbers."""

from __future__ import annotations

import copy
import json
import math
import re
from typing import Any

import numpy as np
import pytest

from pipelines.case.fields import SI_UNITS, extra_of, keys_of
from pipelines.case.identity import physics_hash
from pipelines.case.models import Bearing, Case, Gas
from pipelines.case.reading import CaseError, read_cases
from pipelines.case.reference import json_schema, reference_markdown, settable_keys
from pipelines.case.rewriting import with_values
from pipelines.case.scales import Scales
from pipelines.case.sweeps import values_at
from pipelines.case.units import dimensionless

SI = 'units = "si"\n'
VISCOSITY, PRESSURE, RADIUS, CLEARANCE = 1.85e-5, 101325.0, 0.014, 20.4e-6  # of the text of these tests
FILM_TIME = 6 * VISCOSITY * RADIUS**2 / (PRESSURE * CLEARANCE**2)
RPM, HZ, MICROMETRES = 30 / (math.pi * FILM_TIME), 1 / (2 * math.pi * FILM_TIME), CLEARANCE * 1e6
AREAL = PRESSURE / CLEARANCE
PER_UNIT = dict(zip(SI_UNITS, (RPM, HZ, FILM_TIME, MICROMETRES, AREAL), strict=True))
ROUNDING = 4 * np.finfo(float).eps

RANGES = {  # table: (key, dimensionless value, what it measures)
    "linearize": [("speed_range", [0.31, 1.47], "speed")],
    "criticals": [("speed_range", [0.13, 1.9], "speed")],
    "unbalance_response": [("speed_range", [0.21, 1.7], "speed")],
    "continue_cycles": [
        ("range", [0.3, 1.5], "speed"),
        ("start", 0.9, "speed"),
        ("step", 0.013, "speed"),
        ("minimum_step", 1.7e-6, "speed"),
        ("maximum_step", 0.043, "speed"),
    ],
    "continue_tori": [
        ("range", [0.35, 1.45], "speed"),
        ("start", 0.95, "speed"),
        ("step", 0.011, "speed"),
        ("minimum_step", 3e-5, "speed"),
        ("maximum_step", 0.033, "speed"),
    ],
    "track_curves": [
        ("ranges", [[0.25, 1.95], [0.21, 1.39]], ["frequency", "speed"]),
        ("step", 0.017, "frequency"),
        ("minimum_step", 1.3e-6, "frequency"),
        ("maximum_step", 0.041, "frequency"),
    ],
    "bifurcation_set": [("maximum_step", 0.037, "frequency")],
    "survey": [("ranges", [[0.31, 1.7], [0.41, 1.21]], ["frequency", "speed"])],
    "transient": [
        ("duration", 431.0, "time"),
        ("times", [0.0, 133.0, 401.0], "time"),
        ("speeds", [0.7, 1.1, 1.3], "speed"),
        ("switch_time", 211.0, "time"),
        ("switch_ramp", 3.7, "time"),
    ],
}
UNBALANCE = "[unbalance]\nplanes = [{ node = 2, moment = 1.0 }]\n"
OTHERS = {"transient": {"excitation": "switch_off"}}


def in_si(value: Any, measures: Any) -> Any:
    if isinstance(measures, list):
        return [in_si(item, measure) for item, measure in zip(value, measures, strict=True)]
    return (
        [in_si(item, measures) for item in value] if isinstance(value, list) else value * PER_UNIT[measures]
    )


def toml(tables: dict[str, Any], units: str = "") -> str:
    """Tables as TOML, ``units`` in each of them."""
    lines = []
    for table, keys in tables.items():
        keys = {**({"units": units} if units else {}), **keys}
        lines += [f"[{table}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    return "\n".join(lines) + "\n"


def tables(change: Any, names: Any = RANGES) -> dict[str, Any]:
    return {
        name: {key: change(value, measures) for key, value, measures in RANGES[name]} | OTHERS.get(name, {})
        for name in names
    }


def numbers(node: Any, path: str = "") -> dict[str, Any]:
    if isinstance(node, dict):
        return {key: value for name in node for key, value in numbers(node[name], f"{path}.{name}").items()}
    if isinstance(node, list | tuple):
        return {
            key: value for at, item in enumerate(node) for key, value in numbers(item, f"{path}.{at}").items()
        }
    return {path: node}


def same(mine: Case, other: Case) -> None:
    """Two cases have the same numbers but for rounding, the parameters in any of their two units."""
    mine_plain, other_plain = (numbers(case.model_dump(mode="json")) for case in (mine, other))
    twins = ("speed", "speed_rpm", "frequency", "frequency_hz", "rated_speed", "rated_speed_rpm", "stiffness")
    twins += ("areal_stiffness", "value", "value_rpm")
    assert set(mine_plain) == set(other_plain)
    for path, value in mine_plain.items():
        if isinstance(value, float) and path.rpartition(".")[2] not in twins:
            assert value == pytest.approx(other_plain[path], rel=ROUNDING, abs=0), path
        elif path.rpartition(".")[2] not in twins:
            assert value == other_plain[path], path
    assert mine.parameters == pytest.approx(other.parameters, rel=ROUNDING, abs=0)
    for own, theirs in zip(mine.scales.bearings, other.scales.bearings, strict=True):
        assert own.foil_stiffness == pytest.approx(theirs.foil_stiffness, rel=ROUNDING)


def plainly(value: Any, _: Any) -> Any:
    return value


def read(text: str, *overrides: str) -> Case:
    (named,) = read_cases(text, "demo.toml", overrides)
    return named.case


@pytest.mark.parametrize("name", RANGES)
def test_a_table_in_its_own_units(text: str, name: str) -> None:
    text += UNBALANCE
    mine = read(text + toml(tables(in_si, [name]), "si"))
    same(mine, read(text + toml(tables(plainly, [name]))))


def test_a_whole_file_in_si(text: str) -> None:
    machine = text.replace("displacement = 0.2", f"displacement = {0.2 * MICROMETRES!r}")
    machine = machine.replace("frequency = 0.7", f"frequency = {0.7 * HZ!r}")
    machine = machine.replace("speed = 1.0", f"speed = {RPM!r}")
    machine = machine.replace("stiffness = 10.0", f"stiffness = {10.0 * AREAL!r}")
    unbalance = "[unbalance]\ngrade = 2.5\nrated_speed = {!r}\n"
    mine = read(SI + machine + toml(tables(in_si)) + unbalance.format(1.3 * RPM))
    other = read(text + toml(tables(plainly)) + unbalance.format(1.3))
    same(mine, other)
    assert mine.unbalance is not None
    assert other.unbalance is not None
    rated = mine.unbalance.rated_speed_rpm
    assert rated == pytest.approx(RPM * (other.unbalance.rated_speed or 0.0), rel=ROUNDING)


def test_any_machine_and_any_numbers(text: str) -> None:
    """Scales over many decades: what comes back is what was meant, to a few last bits."""
    rng = np.random.default_rng(7)
    document = read_cases(text, "demo.toml")[0].resolved
    for _ in range(300):
        radius, ratio = 10.0 ** rng.uniform(-2, 0), 10.0 ** rng.uniform(-4.9, -1.5)
        bearings = [{**each, "radius": radius, "clearance": radius * ratio} for each in document["bearings"]]
        gas = {"viscosity": 10.0 ** rng.uniform(-6, -3), "ambient_pressure": 10.0 ** rng.uniform(3, 7)}
        scale = Scales.of(Gas(**gas), [Bearing(**each) for each in bearings]).si_per_unit
        meant = {key: in_any(rng.uniform(0.02, 1.0) * np.array(value), 1.0) for key, value in SHAPES.items()}
        given = {
            key: in_any(np.array(value), [scale[name] for name in MEANT[key]]) for key, value in meant.items()
        }
        tables = {"gas": gas, "bearings": bearings, "units": "si", **unflat(given)}
        found = dimensionless(Case, document | tables).document
        for key, value in meant.items():
            (back,) = values_at(found, key)
            assert np.array(back) == pytest.approx(np.array(value), rel=ROUNDING), key


SHAPES = {
    "track_curves.ranges": [[0.3, 0.9], [0.2, 0.7]],
    "continue_cycles.start": 0.5,
    "transient.times": [0.1, 0.7, 0.8],
    "linearize.speed_range": [0.1, 0.9],
    "excitation.displacement": 0.4,
}
MEANT = {
    "track_curves.ranges": ("frequency", "speed"),
    "continue_cycles.start": ("speed",),
    "transient.times": ("time",),
    "linearize.speed_range": ("speed",),
    "excitation.displacement": ("displacement",),
}


def in_any(value: Any, scale: Any) -> Any:
    """Numbers times a scale, row by row."""
    scale = np.atleast_1d(scale)
    return (value * (scale[:, None] if len(scale) > 1 else scale[0])).tolist()


def unflat(values: dict[str, Any]) -> dict[str, Any]:
    return {key.partition(".")[0]: {key.partition(".")[2]: value} for key, value in values.items()}


def test_speed_in_si_is_the_key_in_rpm(text: str) -> None:
    """They are one configuration with one identity, so that a store knows both."""
    mine = read(text, "operation.units=si", "operation.speed=43210.0", "bearings.foil.units=si",
                "bearings.foil.stiffness=5e10")  # fmt: skip
    other = read(text, "operation.speed_rpm=43210.0", "bearings.foil.areal_stiffness=5e10")
    assert mine == other
    assert physics_hash(mine) == physics_hash(other)
    assert "units" not in json.dumps(mine.model_dump(exclude={"transient"}, mode="json"))


def test_keys_that_name_their_unit_keep_it(text: str) -> None:
    words = "operation.speed_rpm=43210.0", "excitation.frequency_hz=321.0", "excitation.displacement=0"
    assert read(text, *words) == read(text, *words, "operation.units=si", "excitation.units=si")


def test_a_table_overrides_the_file(text: str) -> None:
    machine = ("operation.speed_rpm=40000", "excitation.frequency_hz=300", "excitation.displacement=4.0",
               "bearings.foil.areal_stiffness=5e10")  # fmt: skip
    words = "linearize.units=dimensionless", "linearize.speed_range=[0.3, 1.1]"
    case = read(text, "units=si", *machine, *words,
                f"criticals.speed_range=[{0.3 * RPM!r}, {1.1 * RPM!r}]")  # fmt: skip
    assert case.linearize.speed_range == (0.3, 1.1)
    assert case.criticals.speed_range == pytest.approx((0.3, 1.1), rel=ROUNDING)
    assert case.excitation.displacement == pytest.approx(4.0 / MICROMETRES, rel=ROUNDING)


def test_defaults_are_not_converted(text: str) -> None:
    assert read(text, "linearize.units=si", "continue_cycles.units=si") == read(text)


@pytest.mark.parametrize(
    ("parameter", "measure", "ends"),
    [
        ("speed", "speed", [0.3, 1.5]),
        ("excitation_frequency", "frequency", [0.2, 1.4]),
        ("displacement", "displacement", [0.0, 0.5]),
        ("foil_stiffness", "foil_stiffness", [3.0, 20.0]),
    ],
)
def test_the_unit_of_a_range_is_that_of_its_parameter(text, parameter, measure, ends) -> None:
    words = (f"continue_cycles.parameter={parameter}", "continue_cycles.units=si")
    case = read(text, *words, f"continue_cycles.range={in_si(ends, measure)}",
                f"continue_cycles.step={0.02 * PER_UNIT[measure]!r}")  # fmt: skip
    assert case.continue_cycles.range == pytest.approx(tuple(ends), rel=ROUNDING, abs=0)
    assert case.continue_cycles.step == pytest.approx(0.02, rel=ROUNDING)


def test_sweeps_keep_their_unit_where_the_scales_change(text: str) -> None:
    """At half the clearance the unit of speed is a quarter: one range in rpm, two dimensionless ones."""
    sweep = f"[sweep]\nbearings.clearance = [{CLEARANCE}, {CLEARANCE / 2}]\n"
    sweep += "operation.speed = [30000.0, 60000.0]\n"
    words = ("continue_cycles.units=si", "continue_cycles.range=[20000, 70000]", "operation.units=si")
    named = read_cases(text + sweep, "demo.toml", words)
    assert [case.case.operation.speed_rpm for case in named] == [30000.0, 60000.0] * 2
    assert named[1].case_id == "clearance=2.04e-05_speed=60000"
    low = [case.case.continue_cycles.range[0] for case in named]
    assert low == pytest.approx([20000 / RPM, 20000 / RPM, 80000 / RPM, 80000 / RPM], rel=ROUNDING)


def test_samples_are_in_the_unit_of_their_key(text: str) -> None:
    sample = '[sample]\ncount = 4\n[sample.ranges]\n"operation.speed" = [30000.0, 60000.0]\n'
    sample += '[sample.tolerances]\n"excitation.displacement" = 0.5\n'
    words = ("operation.units=si", "operation.speed=40000", "excitation.units=si",
             "excitation.displacement=4.0", "excitation.frequency_hz=300")  # fmt: skip
    for named in read_cases(text + sample, "demo.toml", words):
        assert 30000 <= (named.case.operation.speed_rpm or 0) <= 60000
        assert 3.5 <= (named.case.excitation.displacement or 0) * MICROMETRES <= 4.5


def test_calibration_in_si(text: str) -> None:
    """Targets keep their rpm while the clearance, and with it the unit of speed, is calibrated."""
    calibrate = """
[calibrate]
units = "si"
speed_range = [20000.0, 60000.0]
[[calibrate.parameters]]
keys = ["bearings.foil.stiffness"]
range = [2e10, 8e10]
[[calibrate.targets]]
value = 41000.0
uncertainty = 150.0
set = { "excitation.frequency" = 250.0, excitation.displacement = 3.0 }
[[calibrate.targets]]
quantity = "onset_slope"
value = 0.1
difference = 9.0
uncertainty = 0.02
[[calibrate.targets]]
quantity = "corner_frequency"
value = 250.0
uncertainty = 5.0
frequency_range = [200.0, 300.0]
[[calibrate.targets]]
quantity = "doubling_growth"
value = 0.0
uncertainty = 0.01
speeds = [20000.0, 30000.0]
"""
    found = read(text + calibrate, "bearings.foil.areal_stiffness=5e10").calibrate
    assert found is not None
    assert found.speed_range == pytest.approx((20000 / RPM, 60000 / RPM), rel=ROUNDING)
    assert found.parameters[0].keys == ("bearings.foil.areal_stiffness",)
    assert found.parameters[0].range == (2e10, 8e10)
    speed, slope, corner, growth = found.targets
    assert (speed.value, speed.value_rpm, speed.uncertainty) == (None, 41000.0, 150.0)
    assert speed.set["excitation.frequency_hz"] == 250.0
    assert speed.set["excitation.displacement"] == pytest.approx(3.0 / MICROMETRES, rel=ROUNDING)
    assert (slope.value, slope.uncertainty) == (0.1, 0.02)
    assert slope.difference == pytest.approx(9.0 / HZ, rel=ROUNDING)
    assert (corner.value, corner.uncertainty) == pytest.approx((250.0 / HZ, 5.0 / HZ), rel=ROUNDING)
    assert corner.value_rpm is None
    assert corner.frequency_range == pytest.approx((200.0 / HZ, 300.0 / HZ), rel=ROUNDING)
    assert (growth.value, growth.uncertainty) == (0.0, 0.01)
    assert growth.speeds == pytest.approx((20000.0 / RPM, 30000.0 / RPM), rel=ROUNDING)


def test_fitted_values_are_written_in_the_units_of_the_file(text: str) -> None:
    machine = SI + text.replace("displacement = 0.2", "displacement = 4.0").replace(
        "frequency = 0.7", "frequency = 300"
    )
    machine = machine.replace("speed = 1.0", "speed = 40000").replace("stiffness = 10.0", "stiffness = 5e10")
    fitted = {
        "bearings.foil.areal_stiffness": 4.5e10,
        "excitation.displacement": 0.25,
        "bearings.clearance": 30e-6,
    }
    written = with_values(machine, fitted)
    assert "stiffness = 45000000000.0" in written
    assert f"displacement = {0.25 * 30.0!r}" in written
    case = read(written)
    assert case.excitation.displacement == pytest.approx(0.25, rel=ROUNDING)
    assert case.bearings[1].foil.areal_stiffness == 4.5e10


@pytest.mark.parametrize(
    ("words", "line", "key", "value", "message"),
    [
        ("[linearize]\nunits = 'si'\nspeed_range = [50000, 20000]\n", 36, "linearize.speed_range",
         "[50000, 20000]", rf"low < high, given .* \(1 is {RPM:.6g} rpm\)"),
        ("[continue_cycles]\nunits = 'si'\nrange = [20000, 30000]\n", 36, "continue_cycles.range",
         "[20000, 30000]", "does not contain the case's own speed = 1"),
        ("[continue_cycles]\nunits = 'si'\nrange = [0.2, 1.4]\n", 36, "continue_cycles.range",
         "[0.2, 1.4]", r"in rpm: at 0.2 rpm no gas film carries; the dimensionless \[0.2, 1.4\] are"),
        ("[track_curves]\nunits = 'si'\nranges = [[0.2, 1.9], [10000, 60000]]\n", 36, "track_curves.ranges.0",
         "[0.2, 1.9]", "in Hz: rings at 1.9 Hz are at rest"),
        ("[continue_cycles]\nunits = 'si'\nstep = 1e6\n", 36, "continue_cycles.step",
         "1000000.0", f"> 0 and <= 10: .*1 is {RPM:.6g} rpm"),
        ("[linearize]\nunits = 'rpm'\n", 35, "linearize.units", '"rpm"', "one of dimensionless, si"),
        ("[linearize]\nspeed_range = [5000, 20000]\n", 35, "linearize.speed_range", "[5000.0, 20000.0]",
         'for rpm, Hz, s, um and N/m3 write units = "si"'),
        ("[transient]\nunits = 'si'\ntimes = [0, 2, 1]\nspeeds = [1e4, 2e4, 3e4]\n", 36, "transient.times.2",
         "1",          "above the time before it"),
    ],
)  # fmt: skip
def test_errors_show_what_the_file_says(text, words, line, key, value, message) -> None:
    with pytest.raises(CaseError) as caught:
        read_cases(text + words, "demo.toml")
    found = {problem.key: problem for problem in caught.value.problems}
    assert set(found) <= {key, "continue_cycles.maximum_step"}
    assert (found[key].line, found[key].value) == (line, value)
    assert re.search(message, found[key].message), found[key].message


@pytest.mark.parametrize(
    ("word", "key", "message"),
    [
        ("excitation.displacement=4e-6", "excitation.displacement", "in um: 4e-06 um is nothing"),
        ("bearings.foil.stiffness=10", "bearings.0.foil.stiffness", "in N/m3: a foil of 10 N/m3"),
        ("operation.speed=1.0", "operation.speed", "in rpm: at 1 rpm no gas film carries"),
        ("excitation.frequency=0.7", "excitation.frequency", "in Hz: rings at 0.7 Hz are at rest"),
    ],
)
def test_dimensionless_numbers_in_si_units(text: str, word: str, key: str, message: str) -> None:
    sound = ("excitation.displacement=4", "bearings.foil.stiffness=5e10", "operation.speed=4e4",
             "excitation.frequency=300")  # fmt: skip
    with pytest.raises(CaseError) as caught:
        read_cases(text, "demo.toml", ("units=si", *sound, word))
    problem = caught.value.problems[0]
    assert problem.key == key
    assert message in problem.message


def test_without_scales_nothing_else_is_reported(problems) -> None:
    """No number in SI units is judged that nothing could convert."""
    found = problems((3, "viscosity = 'thin'"), (30, "speed = 40000"), overrides=("operation.units=si",))
    assert [problem.key for problem in found] == ["gas.viscosity", "operation.units"]
    assert "needs gas.viscosity, gas.ambient_pressure, and radius and clearance" in found[1].message
    (problem, other) = problems((20, ""), end="[linearize]\nunits = 'si'\nspeed_range = [9000, 3000]\n")
    assert problem.key == "bearings.0.clearance"
    assert (other.key, other.line) == ("linearize.units", 35)


def test_a_validated_case_is_converted_once(text: str) -> None:
    named = read_cases(text + UNBALANCE + toml(tables(in_si), "si"), "demo.toml")[0]
    assert Case.model_validate(copy.deepcopy(named.resolved)) == named.case


PURE = {  # numbers without any unit: ratios, tolerances, sizes of states
    "poisson_ratio", "loss_factor", "smoothing", "ratio", "amplitudes", "multiplier_tolerance", "scatter",
    "newton_tolerance", "multiplier_cut", "event_tolerance", "whirl_ratios", "max_damping_ratio",
    "minimum_film", "amplitude", "normal_form_widths", "clipping_widths", "smallest_film", "tolerance",
    "factors", "tolerance_factor", "samples_per_period", "difference_step", "weight",
}  # fmt: skip


def test_every_dimensionless_key_names_its_quantity_or_has_none() -> None:
    pure = {path.rpartition(".")[2] for path, field in keys_of(Case) if extra_of(field, "unit") == "1"}
    assert pure <= PURE, pure - PURE


def test_reference_and_schema_state_both_units() -> None:
    markdown, schema = reference_markdown(), json_schema()
    assert "| `speed_range` | numbers (array of 2) | speeds from, to | 1 or rpm | `[0.2, 1.6]` |" in markdown
    assert "| `frequency` | number | excitation frequency Omega_ex" in markdown
    assert schema["properties"]["units"]["anyOf"][0]["enum"] == ["dimensionless", "si"]
    cycles = schema["$defs"]["ContinueCycles"]["properties"]
    assert cycles["maximum_step"]["description"].endswith("[1 or rpm, Hz, um, N/m3]")
    assert "maximum" not in cycles["maximum_step"]  # 300 rpm is no error in an editor
    assert cycles["maximum_step"]["exclusiveMinimum"] == 0
    assert schema["$defs"]["Excitation"]["properties"]["displacement"]["anyOf"][0] == {
        "type": "number", "minimum": 0
    }  # fmt: skip
    assert settable_keys()["continue_cycles.units"] == ("dimensionless", "si")
