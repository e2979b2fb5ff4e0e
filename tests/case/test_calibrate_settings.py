"""The table of the calibration: what is wrong with it is said at its line, before anything is computed."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pipelines.case.identity import physics_hash
from pipelines.case.models import Case
from pipelines.case.reading import Problem, read_cases
from pipelines.case.rewriting import NotWrittenError, with_values

Problems = Callable[..., tuple[Problem, ...]]
LINES = 33  # of the configuration before the table
TABLE = """\
[calibrate]
[[calibrate.parameters]]
keys = ["rotor.discs.mass"]
range = [0.05, 0.12]
scale = "log"
[[calibrate.targets]]
value = 1.0
set = { "excitation.frequency" = 0.2, bearings.foil.stiffness = 3.0 }
"""


def table_with(line: int, replacement: str) -> str:
    lines = TABLE.splitlines()
    lines[line - 1] = replacement
    return "\n".join(lines) + "\n"


def test_a_table_is_read_and_leaves_the_identity_alone(text: str) -> None:
    (plain,), (named,) = read_cases(text, "demo.toml"), read_cases(text + TABLE, "demo.toml")
    settings = named.case.calibrate
    assert settings is not None
    assert settings.targets[0].set == {"excitation.frequency": 0.2, "bearings.foil.stiffness": 3.0}
    assert settings.targets[0].scatter == 1.0
    assert physics_hash(plain.case) == physics_hash(named.case)
    assert Case.model_validate(named.resolved) == named.case


@pytest.mark.parametrize(
    ("line", "replacement", "problem_line", "key", "message"),
    [
        (3, "keys = []", 3, "parameters.0.keys", "needs at least 1 entries"),
        (3, 'keys = ["rotor.discs.mas"]', 3, "parameters.0.keys.0", "did you mean rotor.discs.0.mass"),
        (3, 'keys = ["gas.viscosity.x"]', 3, "parameters.0.keys.0", "which is a value and no table"),
        (3, 'keys = ["bearings.foil.areal_stiffness"]', 3, "parameters.0.keys.0", "has no number"),
        (3, 'keys = ["rotor.discs.mass", "rotor.discs.mass"]', 3, "parameters.0.keys.1", "twice"),
        (4, "range = [0.12, 0.05]", 5, "parameters.0.scale", "low < high"),
        (4, "range = [0.0, 0.12]", 5, "parameters.0.scale", 'scale = "log"'),
        (4, "range = [0.09, 0.12]", 4, "parameters.0.range", "own rotor.discs.mass = 0.08"),
        (4, "range = [0.05, 1e12]", 4, "parameters.0.range", "rotor.discs.mass = 1000000000000.0: must"),
        (7, "weight = 1.0", 6, "targets.0.value_rpm", "exactly one of value, value_rpm"),
        (7, "value = 1.0\nvalue_rpm = 1e4", 8, "targets.0.value_rpm", "exactly one of"),
        (7, "value = 1.0\nweight = 1.0\nuncertainty = 1.0", 9, "targets.0.uncertainty", "not both"),
        (7, 'quantity = "onset_slope"\nvalue_rpm = 1.0', 8, "targets.0.value_rpm", "is no speed"),
        (7, 'value = 1.0\nquantity = "speed"', 8, "targets.0.quantity", "must be one of onset_speed"),
        (7, 'value = 0.0\nquantity = "doubling_growth"', 6, "targets.0.speeds", "is missing"),
        (7, 'value = 0.0\nquantity = "doubling_growth"\nspeeds = [0.0]', 9, "targets.0.speeds", "positive"),
        (7, 'value = 0.7\nquantity = "corner_frequency"', 6, "targets.0.frequency_range", "is missing"),
        (7, 'value = 0.7\nquantity = "corner_speed"\nfrequency_range = [0.9, 0.6]', 9,
         "targets.0.frequency_range", "low < high"),
        (7, 'quantity = "doubling_growth"\nspeeds = [1.0]\nvalue_rpm = 1.0', 9, "targets.0.value_rpm",
         "a growth rate is no speed"),
        (7, 'quantity = "corner_frequency"\nfrequency_range = [0.6, 0.9]\nvalue_rpm = 1.0', 9,
         "targets.0.value_rpm", "an excitation frequency is no speed"),
        (7, 'value = 1.0\nlimit = "above"', 8, "targets.0.limit", "must be one of exact"),
        (7, "value = 1.0\nspeed_range = [1.0, 0.5]", 8, "targets.0.speed_range", "low < high"),
        (8, 'set = { "excitation.freqency" = 1.0 }', 8, "targets.0.set.excitation.freqency",
         "did you mean excitation.frequency"),
        (8, 'set = { "excitation.frequency" = -1.0 }', 8, "targets.0.set.excitation.frequency", "must be"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_at_its_line(
    problems: Problems, line: int, replacement: str, problem_line: int, key: str, message: str
) -> None:
    (problem,) = problems(end=table_with(line, replacement))
    assert (problem.line, problem.key) == (problem_line + LINES, f"calibrate.{key}")
    assert message in problem.message


@pytest.mark.parametrize(
    ("limit", "below", "above"), [("exact", -2.0, 2.0), ("upper", 0.0, 2.0), ("lower", -2.0, 0.0)]
)
def test_of_a_limit_one_side_counts(text: str, limit: str, below: float, above: float) -> None:
    (named,) = read_cases(
        text + table_with(7, f'value = 1.0\nuncertainty = 0.1\nlimit = "{limit}"'), "demo.toml"
    )
    assert named.case.calibrate is not None
    target = named.case.calibrate.targets[0]
    assert [target.deviation(value) for value in (0.8, 1.0, 1.2)] == pytest.approx([below, 0.0, above])


def test_a_table_without_targets_says_so(problems: Problems) -> None:
    (problem,) = problems(end="\n".join(TABLE.splitlines()[:5]))
    assert problem.key == "calibrate.targets"
    assert "is missing" in problem.message


def test_found_values_replace_the_old_ones_and_nothing_else(text: str) -> None:
    commented = text.replace("mass = 0.08", "mass = 0.08   # kg, of one").replace(
        "[bearings.foil]\nstiffness = 10.0\nloss_factor = 0.425",
        "foil = { stiffness = 10.0, loss_factor = 0.425 } # both",
    )
    values = {"rotor.discs.mass": 0.0725, "bearings.foil.loss_factor": 0.3}
    rewritten = with_values(commented, values)
    expected = commented.replace("0.08 ", "0.0725 ").replace("loss_factor = 0.425 }", "loss_factor = 0.3 }")
    assert rewritten == expected
    (named,) = read_cases(rewritten, "demo.toml")
    assert [bearing.foil.loss_factor for bearing in named.case.bearings] == [0.3, 0.3]


@pytest.mark.parametrize(
    ("more", "key", "message"),
    [
        ("", "rotor.rayleigh_stiffness", "does not stand in"),
        ("", "gas.viscosity.x", "which is a value"),
        ('[sweep]\n"gas.viscosity" = [1e-5, 2e-5]\n', "gas.viscosity", "is swept"),
        ("[sweep]\ngas.viscosity = [1e-5, 2e-5]\n", "gas.viscosity", "is swept"),
    ],
)
def test_a_value_that_does_not_stand_in_the_text_is_not_written(
    text: str, more: str, key: str, message: str
) -> None:
    with pytest.raises(NotWrittenError, match=message):
        with_values(text + more, {key: 1.0})
