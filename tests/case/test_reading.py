"""Sweeps, overrides and inheritance; and that nothing but CaseError comes out of wrong text."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.case.reading import CaseError, NamedCase, Problem, read_cases


def ids(text: str, *overrides: str) -> list[str]:
    return [named.case_id for named in read_cases(text, "demo.toml", overrides)]


def test_an_unswept_file_is_one_case_of_its_name(text):
    (named,) = read_cases(text, "demo.toml")
    assert named.case_id == "demo"
    assert NamedCase.from_dict(named.as_dict()) == named


def test_the_second_bearing_inherits_what_it_leaves_out(text):
    first, second = read_cases(text, "demo.toml")[0].case.bearings
    assert second == first.model_copy(update={"node": 4})


def test_inheritance_goes_into_the_foil_and_respects_alternatives(text):
    own = text.replace("node = 4", "node = 4\nclearance = 22e-6\nfoil = { areal_stiffness = 5e10 }")
    first, second = read_cases(own, "demo.toml")[0].case.bearings
    assert second.clearance == 22e-6
    assert second.radius == first.radius
    assert (second.foil.areal_stiffness, second.foil.stiffness) == (5e10, None)
    assert second.foil.loss_factor == first.foil.loss_factor
    assert (first.foil.areal_stiffness, first.foil.stiffness) == (None, 10.0)


@pytest.mark.parametrize(
    "sweep",
    [
        '[sweep]\n"bearings.foil.stiffness" = [3, 10.0]\n"excitation.displacement" = [0.05, 0.2]\n',
        "[sweep]\nbearings.foil.stiffness = [3, 10.0]\nexcitation.displacement = [0.05, 0.2]\n",
        "[sweep.bearings.foil]\nstiffness = [3, 10.0]\n[sweep.excitation]\ndisplacement = [0.05, 0.2]\n",
    ],
)
def test_lists_expand_to_every_combination(text, sweep):
    cases = read_cases(text + sweep, "demo.toml")
    assert [named.case_id for named in cases] == [
        "stiffness=3_displacement=0.05",
        "stiffness=3_displacement=0.2",
        "stiffness=10_displacement=0.05",
        "stiffness=10_displacement=0.2",
    ]
    values = [
        (*(bearing.foil.stiffness for bearing in named.case.bearings), named.case.excitation.displacement)
        for named in cases
    ]
    assert values == [(3.0, 3.0, 0.05), (3.0, 3.0, 0.2), (10.0, 10.0, 0.05), (10.0, 10.0, 0.2)]


TOGETHER = '"bearings.foil.stiffness, excitation.frequency" = [[3, 0.63], [3, 0.2], [50, 0.74]]\n'


def test_keys_with_commas_vary_together_beside_others(text):
    sweep = "[sweep]\nexcitation.displacement = [0.1, 0.2]\n" + TOGETHER
    cases = read_cases(text + sweep, "demo.toml")
    values = [(n.case.bearings[1].foil.stiffness, n.case.excitation.frequency) for n in cases]
    assert values == 2 * [(3.0, 0.63), (3.0, 0.2), (50.0, 0.74)]
    assert cases[1].case_id == "displacement=0.1_stiffness=3_frequency=0.2"
    assert len({named.case_id for named in cases}) == 6


def test_keys_of_one_table_vary_together(text):
    sweep = '[sweep.bearings.foil]\n"stiffness,loss_factor" = [[3, 0.1], [10, 0.4]]\n'
    foils = [named.case.bearings[0].foil for named in read_cases(text + sweep, "demo.toml")]
    assert [(foil.stiffness, foil.loss_factor) for foil in foils] == [(3.0, 0.1), (10.0, 0.4)]


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("excitation.frequency=0.5", ["stiffness=3", "stiffness=50"]),
        ("bearings.foil.stiffness=5", ["frequency=0.63", "frequency=0.2", "frequency=0.74"]),
        ("sweep.excitation.frequency=[0.5]", ["frequency=0.5_stiffness=3", "frequency=0.5_stiffness=50"]),
        (
            "bearings.foil.stiffness, excitation.frequency=[[5, 0.5], [6, 0.6]]",
            ["stiffness=5_frequency=0.5", "stiffness=6_frequency=0.6"],
        ),
        ("sweep.excitation.frequency, operation.speed=[[0.5, 1]]", [
            "frequency=0.5_speed=1_stiffness=3", "frequency=0.5_speed=1_stiffness=50"
        ]),
    ],
)  # fmt: skip
def test_an_override_takes_its_key_out_of_those_that_vary_together(text, override, expected):
    assert ids(text + "[sweep]\n" + TOGETHER, override) == expected


def test_an_index_means_one_bearing_and_names_stay_apart(text):
    sweep = '[sweep]\n"bearings.0.node" = [0, 2]\n"rotor.discs.0.node" = [1, 3]\n'
    cases = read_cases(text + sweep, "demo.toml")
    assert cases[0].case_id == "bearings.0.node=0_discs.0.node=1"
    assert [named.case.bearings[0].node for named in cases] == [0, 0, 2, 2]
    assert {named.case.bearings[1].node for named in cases} == {4}


def test_swept_words_and_arrays_make_safe_names(text):
    sweep = '[sweep]\nnumerics.scheme = ["central", "backward"]\nexcitation.amplitudes = [[1, 1], [1, 0]]\n'
    assert ids(text + sweep)[1] == "scheme=central_amplitudes=1,0"
    assert all(re.fullmatch(r"[A-Za-z0-9=,._+-]+", case_id) for case_id in ids(text + sweep))


def test_a_swept_alternative_replaces_the_key_of_the_file(text):
    (_, second) = read_cases(text + "[sweep]\noperation.speed_rpm = [9000, 18000]\n", "demo.toml")
    assert (second.case.operation.speed, second.case.operation.speed_rpm) == (None, 18000.0)


@pytest.mark.parametrize(
    ("sweep", "line", "message"),
    [
        ("sweep = 3", 0, "must be a table of lists"),
        ("[sweep]\nbearings.foil.stiffness = 3", 35, "must be a list with at least one value"),
        ("[sweep]\nbearings.foil.stiffness = []", 35, "must be a list with at least one value"),
        ("[sweep]\nbearings.foil.stiffness = [3, 3.0]", 34, "lists a value of bearings.foil.stiffness twice"),
        ("[sweep]\nbearings.7.radius = [1]", 35, "names entry 7 of bearings, which has the entries 0 to 1"),
        ("[sweep]\nname.first = ['a']", 35, "leads through name, which is a value and no table"),
        ("[sweep]\nrotor.masters.last = [4]", 35, "is an array of values: give an index"),
        ("[sweep]\nbearings.foil.stifness = [3]", 35, "unknown key"),
        ("[sweep]\nexcitation.displacement = [0.1, 1.5]", 35, "closes the film"),
        (
            '[sweep]\n"gas.viscosity, operation.speed" = [\n[1, 2],\n[3],\n]',
            37,
            "must be a list of 2 values, one for each of gas.viscosity, operation.speed",
        ),
        ('[sweep]\n"gas.viscosity, operation.speed" = [1]', 35, "must be a list of 2 values"),
        ('[sweep]\n"gas.viscosity, operation.speed" = [[1, 2], [1, 2.0]]', 34, "lists a value of gas"),
        ('[sweep]\n"gas.viscosity, operation.sped" = [[1, 2]]', 35, "unknown key"),
        ('[sweep]\n"gas.viscosity," = [[1, 2]]', 35, "is not a key"),
        ('[sweep]\n"gas.viscosity, bearings.7.radius" = [[1, 2]]', 35, "names entry 7 of bearings"),
        (
            '[sweep]\ngas.viscosity = [1]\n"gas.viscosity, operation.speed" = [[1, 2]]',
            34,
            "gas.viscosity twice",
        ),
        (
            f"[sweep]\noperation.speed = {list(range(1, 200))}\ngas.viscosity = {list(range(1, 200))}",
            34,
            "makes 39601 cases; at most 10000 are allowed",
        ),
    ],
)
def test_wrong_sweeps(text, sweep, line, message):
    whole = f"{sweep}\n{text}" if line == 0 else text + sweep + "\n"
    with pytest.raises(CaseError) as caught:
        read_cases(whole, "demo.toml")
    (problem,) = caught.value.problems
    assert message in problem.message
    assert problem.line == (line or 1)


def test_overrides_go_through_the_same_models(text):
    overrides = (
        "gas.viscosity=2e-5",
        "bearings.clearance=21e-6",
        "bearings.1.radius = 0.015",
        "name=other",
        "numerics.scheme=backward",
        "rotor.masters=[0, 1, 4]",
        "linearize.points=7",
        "rotor.masters.1=3",
    )
    (named,) = read_cases(text, "demo.toml", overrides)
    case = named.case
    assert named.case_id == "other"
    assert case.gas.viscosity == 2e-5
    assert [bearing.clearance for bearing in case.bearings] == [21e-6, 21e-6]
    assert [bearing.radius for bearing in case.bearings] == [0.014, 0.015]
    assert case.numerics.scheme == "backward"
    assert case.rotor.masters == (0, 3, 4)
    assert case.linearize.points == 7


def test_an_override_of_a_swept_key_ends_or_replaces_the_sweep(text):
    swept = text + "[sweep]\nexcitation.displacement = [0.05, 0.2]\n"
    assert ids(swept, "excitation.displacement=0.1") == ["demo"]
    assert ids(swept, "excitation.displacement=[0.1, 0.3]") == ["displacement=0.1", "displacement=0.3"]
    assert ids(text, "sweep.excitation.displacement=[0.1, 0.3]") == ["displacement=0.1", "displacement=0.3"]


@pytest.mark.parametrize(
    ("override", "file", "key", "message"),
    [
        ("gas.viscosity=nan", "--set gas.viscosity=nan", "gas.viscosity", "finite"),
        ("gas.viscozity=1", "--set gas.viscozity=1", "gas.viscozity", "unknown key"),
        ("gaz.viscosity=1", "--set gaz.viscosity=1", "gaz", "unknown key"),
        ("bearings.1.node=9", "--set bearings.1.node=9", "bearings.1.node", "not on the shaft"),
        ("gas", "--set", "gas", "is no assignment"),
        ("=1", "--set", "=1", "is no assignment"),
        ("gas..viscosity=1", "--set", "gas..viscosity=1", "is not a key"),
        ("gas.viscosity=[1", "--set", "gas.viscosity=[1", "neither a TOML value nor a bare word"),
        ("gas.viscosity=1\nname='x'", "--set", "gas.viscosity=1\nname='x'", "neither a TOML value"),
        ("sweep.gas.viscosity=1", "--set", "sweep.gas.viscosity=1", "must be a list"),
        ("gas.viscosity, name=[[1]]", "--set", "gas.viscosity, name=[[1]]", "must be a list of 2 values"),
        ("bearings=3", "--set bearings=3", "bearings", "must be an array"),
    ],
)
def test_wrong_overrides(text, override, file, key, message):
    with pytest.raises(CaseError) as caught:
        read_cases(text, "demo.toml", (override,))
    (problem,) = caught.value.problems
    assert (problem.file, problem.line, problem.key) == (file, None, key)
    assert message in problem.message


def test_problems_of_file_and_overrides_come_together(text):
    with pytest.raises(CaseError) as caught:
        read_cases(text.replace("speed = 1.0", "speed = -1"), "demo.toml", ("gas.viscosity=0", "x"))
    assert [(problem.file, problem.line) for problem in caught.value.problems] == [
        ("demo.toml", 30),
        ("--set gas.viscosity=0", None),
        ("--set", None),
    ]


def outcome(text: str, overrides: Sequence[str] = ()) -> tuple[Problem, ...]:
    """The problems of any text, none if it can be read; every exception but CaseError is a failure."""
    try:
        cases = read_cases(text, "demo.toml", overrides)
    except CaseError as error:
        found = error.problems
        message = str(error)
    else:
        assert cases
        assert all(NamedCase.from_dict(named.as_dict()) == named for named in cases)
        return ()
    assert found
    assert message
    return found


WORDS = st.sampled_from(
    [
        "[[bearings]]",
        "[sweep]",
        "=",
        "[",
        "]",
        "{",
        "}",
        '"',
        "'''",
        "nan",
        "1e400",
        "-1",
        "9" * 400,
        "\n",
        "#",
        "foil",
        "stiffness",
        "gas.viscosity = 1\n",
        "[gas]\n",
        "bearings = 3\n",
        "true",
        "1979-05-27",
        ".",
        ",",
        "\\",
        "\u0000",
        "é",
        "continue_cycles = { range = [1, 0] }\n",
    ]
)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_mutated_text_gives_cases_or_a_case_error(text, data):
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 12)))
        text = text[:start] + data.draw(WORDS | st.text(max_size=5)) + text[end:]
    lines = text.count("\n") + 1
    for problem in outcome(text):
        assert problem.line is not None
        assert 1 <= problem.line <= lines


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(
    [
        "gas",
        "gas.viscosity",
        "rotor",
        "rotor.masters",
        "rotor.elements",
        "rotor.elements.0",
        "rotor.materials",
        "rotor.discs.node",
        "bearings",
        "bearings.0",
        "bearings.foil",
        "bearings.foil.bump",
        "excitation.amplitudes",
        "excitation.ring",
        "operation",
        "numerics.axial",
        "linearize.speed_range",
        "continue_cycles.range",
        "sweep",
        "sweep.gas.viscosity",
        "sweep.gas.viscosity, operation.speed",
        "name",
        "x",
        "x.y.0",
    ]
)


def as_toml(value: object) -> str:
    """A value in TOML notation; nothing becomes an empty literal, which TOML refuses."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(key)} = {as_toml(item)}" for key, item in value.items()) + "}"
    return quoted(value) if isinstance(value, str) else repr(value)


def quoted(word: str) -> str:
    return (
        '"' + "".join(f"\\U{ord(letter):08x}" for letter in word if not 0xD800 <= ord(letter) < 0xE000) + '"'
    )


@settings(max_examples=300, deadline=None)
@given(assignments=st.lists(st.tuples(KEYS, VALUES), min_size=1, max_size=3))
def test_any_overrides_give_cases_or_a_case_error(text, assignments):
    overrides = [f"{key}={as_toml(value)}" for key, value in assignments]
    outcome(text, overrides)
