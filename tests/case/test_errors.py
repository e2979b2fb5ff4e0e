"""Every kind of wrong input: named at its line, with what is allowed, and all at once."""

from __future__ import annotations

import pickle

import pytest

from pipelines.case.reading import CaseError, read_cases

# (line, replacement, line of the problem, key, part of the message, suggestion)
ONE_PROBLEM = [
    (3, "viscosity = 0", 3, "gas.viscosity", "must be > 0 and <= 1: without viscosity no pressure", ""),
    (3, "viscosity = nan", 3, "gas.viscosity", "must be a finite number", ""),
    (3, "viscosity = -inf", 3, "gas.viscosity", "must be a finite number", ""),
    (3, 'viscosity = "1.85e-5"', 3, "gas.viscosity", "must be a number", ""),
    (3, "viscosity = true", 3, "gas.viscosity", "must be a number", ""),
    (3, "", 2, "gas.viscosity", "is missing: dynamic viscosity of the gas (isothermal) [Pa s]", ""),
    (1, "", 1, "name", "is missing", ""),
    (1, 'name = "a/b"', 1, "name", "may hold letters, digits", ""),
    (1, 'name = "../x"', 1, "name", "names a group of the store", ""),
    (
        6,
        "masters = [0, 2, 5]",
        6,
        "rotor.masters.2",
        "node 5 is not on the shaft, whose nodes are 0 to 4",
        "",
    ),
    (6, "masters = [0, 4, 2]", 6, "rotor.masters", "must rise strictly", ""),
    (6, "masters = [0, 4, 4]", 6, "rotor.masters", "must rise strictly, each node once", ""),
    (6, "masters = [0, 2.5, 4]", 6, "rotor.masters.1", "must be a whole number", ""),
    (6, "masters = [-1, 0, 4]", 6, "rotor.masters.0", "must be >= 0", ""),
    (6, "masters = 3", 6, "rotor.masters", "must be an array", ""),
    (6, "masters = [0, 2]", 25, "bearings.1.node", "must be one of rotor.masters (0, 2)", ""),
    (8, "count = 501", 8, "rotor.elements.0.count", "<= 500: a rotor has 1 to 500 elements", ""),
    (8, "count = 0", 8, "rotor.elements.0.count", "must be >= 1", ""),
    (9, "length = -0.05", 9, "rotor.elements.0.length", "an element without length has no stiffness", ""),
    (10, "outer_diameter = 17.6", 7, "rotor.elements", "kg are allowed: are lengths in m", ""),
    (
        10,
        "outer_diameter = 0.02\ninner_diameter = 0.02",
        11,
        "rotor.elements.0.inner_diameter",
        "must be smaller than outer_diameter = 0.02 m",
        "",
    ),
    (
        10,
        'outer_diameter = 0.02\nmaterial = "brass"',
        11,
        "rotor.elements.0.material",
        "no such material; defined: steel",
        "",
    ),
    (
        10,
        "outer_diameter = 0.02\nouter_diameter_right = 0.01\ninner_diameter = 0.015",
        7,
        "rotor.elements.0.inner_diameter_right",
        "must be smaller than outer_diameter_right = 0.01 m",
        "",
    ),
    (
        10,
        "outer_diameter = 0.02\ninner_diameter_right = 0.02",
        11,
        "rotor.elements.0.inner_diameter_right",
        "must be smaller than outer_diameter = 0.02 m",
        "",
    ),
    (10, "outer_diameter = 0.02\naxial_force = inf", 11, "rotor.elements.0.axial_force", "finite", ""),
    (
        10,
        "outer_diameter = 0.0176\naxial_force = -4e6",
        11,
        "rotor.elements.0.axial_force",
        "buckles the element itself: 3.83e+06 N of compression at most",
        "",
    ),
    (12, "node = 9", 12, "rotor.discs.0.node", "node 9 is not on the shaft", ""),
    (13, "", 11, "rotor.discs.0.mass", "is missing: mass [kg]; or give outer_diameter and width", ""),
    (13, "mas = 0.08", 13, "rotor.discs.0.mas", "unknown key", "rotor.discs.0.mass"),
    (13, "mass = 0.08\nwidth = 0.01", 14, "rotor.discs.0.width", "belongs to outer_diameter", ""),
    (15, "polar_inertia = 5.8e-5", 15, "rotor.discs.0.polar_inertia", "no rigid body has more", ""),
    (17, "node = 1", 17, "bearings.0.node", "must be one of rotor.masters (0, 2, 4)", ""),
    (25, "node = 40", 25, "bearings.1.node", "node 40 is not on the shaft, whose nodes are 0 to 4", ""),
    (25, "node = 0", 25, "bearings.1.node", "both bearings stand on this node", ""),
    (25, "", 24, "bearings.1.node", "is missing", ""),
    (20, "clearance = -20.4e-6", 20, "bearings.0.clearance", "must be >= 1e-07: thinner is no gas film", ""),
    (
        20,
        "clearance = 0.0204",
        20,
        "bearings.0.clearance",
        "Reynolds' equation holds for thin films only",
        "",
    ),
    (20, "clearence = 20.4e-6", 20, "bearings.0.clearence", "unknown key", "bearings.0.clearance"),
    (20, "", 16, "bearings.0.clearance", "is missing: radial clearance c [m]", ""),
    (
        22,
        "stiffness = 10.0\nareal_stiffness = 5e10",
        21,
        "bearings.0.foil.rigid",
        "give exactly one of stiffness, areal_stiffness, bump, rigid",
        "",
    ),
    (22, "", 21, "bearings.0.foil.rigid", "given: none", ""),
    (22, "stiffness = 0", 22, "bearings.0.foil.stiffness", "use rigid = true for a plain bearing", ""),
    (23, "", 21, "bearings.0.foil.loss_factor", "is missing: the foil's rate is", ""),
    (23, "loss_factor = 0", 23, "bearings.0.foil.loss_factor", "cannot be zero", ""),
    (
        23,
        'loss_factor = 0.4\ndamping = "proportonal"',
        24,
        "bearings.0.foil.damping",
        "must be one of proportional, loss_factor",
        "proportional",
    ),
    (27, "displacement = 1.0", 27, "excitation.displacement", ">= 0 and < 1: a displacement of a whole", ""),
    (27, "", 26, "excitation.load", "give exactly one of displacement, load", ""),
    (27, "load = 10.0", 26, "excitation.ring", "the load F0 needs the ring's geometry", ""),
    (27, "displacement = 0.5\namplitudes = [1, 2]", 28, "excitation.amplitudes", "must stay below 1", ""),
    (27, "displacement = 0.5\nphases = [0, 180]", 28, "excitation.phases", "an angle in rad", ""),
    (28, "frequency = 0.7\nfrequency_hz = 200", 29, "excitation.frequency_hz", "give exactly one of", ""),
    (28, "", 26, "excitation.frequency_hz", "give exactly one of frequency, frequency_hz", ""),
    (30, "speed = 0", 30, "operation.speed", "the film carries by rotation", ""),
    (30, "", 29, "operation.speed_rpm", "give exactly one of speed, speed_rpm", ""),
    (30, "viscosity = 1e-5\nspeed = 1", 30, "operation.viscosity", "unknown key", "gas.viscosity"),
    (32, "circumferential = 1_000_000_000", 32, "numerics.circumferential", ">= 8 and <= 1024", ""),
    (33, "axial = 1_000_000_000", 33, "numerics.axial", ">= 1 and <= 32", ""),
    (32, "circumferential = 40.0", 32, "numerics.circumferential", "must be a whole number", ""),
    (31, "[numrics]", 31, "numrics", "unknown key; allowed here: units, name, note, gas, rotor", "numerics"),
]


@pytest.mark.parametrize(("line", "replacement", "at", "key", "message", "suggestion"), ONE_PROBLEM)
def test_one_wrong_key_is_one_problem_at_its_line(problems, line, replacement, at, key, message, suggestion):
    found = problems((line, replacement))
    assert len(found) == 1, "\n".join(map(str, found))
    problem = found[0]
    assert (problem.file, problem.line, problem.key) == ("demo.toml", at, key)
    assert message in problem.message
    assert problem.suggestion == suggestion


@pytest.mark.parametrize(
    ("disc", "expected"),
    [
        ("outer_diameter = 0.05", [("width", "belongs to outer_diameter: give both of them")]),
        (
            "outer_diameter = 0.05\nwidth = 0.01\nmass = 0.1",
            [("mass", "follows from outer_diameter, width and material: give one or the other")],
        ),
        ("outer_diameter = 0.05\nwidth = 0.01\ninner_diameter = 0.05", [("inner_diameter", "smaller than")]),
        ('outer_diameter = 0.05\nwidth = 0.01\nmaterial = "brass"', [("material", "no such material")]),
        ("outer_diameter = 50.0\nwidth = 90.0", [("width", "at most 100000 kg are allowed")]),
        (
            "mass = 0.08\ninner_diameter = 0.01\ndiametral_inertia = 1e-3\npolar_inertia = 1e-3",
            [(key, "inner_diameter belongs to") for key in ("mass", "diametral_inertia", "polar_inertia")],
        ),
        ("", [(key, "is missing") for key in ("mass", "diametral_inertia", "polar_inertia")]),
    ],
)
def test_a_disc_is_given_in_exactly_one_way(problems, disc, expected):
    found = problems((13, disc), (14, ""), (15, ""))
    assert {problem.key: True for problem in found} == {f"rotor.discs.0.{key}": True for key, _ in expected}
    for problem, (_, message) in zip(found, sorted(expected), strict=True):
        assert message in problem.message


def test_the_message_names_place_key_value_and_what_is_allowed(problems):
    (problem,) = problems((20, "clearance = -20.4e-6"))
    assert str(problem) == (
        "demo.toml:20: bearings.0.clearance = -2.04e-05: must be >= 1e-07: thinner is no gas film"
    )


def test_all_problems_are_reported_at_once_in_the_order_of_the_file(problems):
    found = problems(
        (3, "viscozity = 1.85e-5"),
        (6, "masters = [0, 2, 7]"),
        (20, "clearance = -1e-6"),
        (25, "node = 99"),
        (30, "speed = nan"),
        (33, "axial = 1000000000"),
        end='[continue_cycles]\nparameter = "spead"\nrange = [2, 1]\n',
    )
    assert [(problem.line, problem.key) for problem in found] == [
        (3, "gas.viscozity"),
        (6, "rotor.masters.2"),
        (20, "bearings.0.clearance"),
        (30, "operation.speed"),
        (33, "numerics.axial"),
        (35, "continue_cycles.parameter"),
        (36, "continue_cycles.range"),
    ]


def test_a_bearing_off_the_shaft_is_found_beside_a_wrong_clearance(problems):
    found = problems((20, "clearance = -1e-6"), (25, "node = 99"))
    assert [(problem.line, problem.key) for problem in found] == [
        (20, "bearings.0.clearance"),
        (25, "bearings.1.node"),
    ]


def test_a_huge_grid_is_refused_by_its_unknowns(problems):
    (problem,) = problems((32, "circumferential = 1024"), (33, "axial = 32"))
    assert problem.line == 31
    # 2 (1024 - 1)(32 + 1) + 4 x 3 master nodes
    assert "the grid 1024 x 32 makes 67530 unknowns; at most 20000 are allowed" in problem.message


def test_too_many_elements_in_several_tables(problems):
    more = "".join(
        "[[rotor.elements]]\ncount = 300\nlength = 0.01\nouter_diameter = 0.02\n" for _ in range(2)
    )
    (problem,) = problems(end=more)
    assert problem.line == 7
    assert "make 604 elements; at most 500 are allowed" in problem.message


def test_a_huge_array_of_tables_is_refused(problems):
    found = problems(end="[linearize]\nwhirl_ratios = [" + "1.0, " * 5000 + "]\n")
    assert [(problem.line, problem.key) for problem in found] == [(35, "linearize.whirl_ratios")]
    assert "1000 entries that are allowed" in found[0].message


@pytest.mark.parametrize(
    ("stage", "key", "message"),
    [
        ("range = [0.5, 0.4]", "range", "low < high"),
        ("range = [0.0, 0.4]", "range.0", "must be > 0"),
        ("range = [0.5, 0.9]", "range", "does not contain the case's own speed = 1"),
        ("range = [0.5, 0.9]\nstart = 0.95", "start", "must lie inside range = [0.5, 0.9]"),
        ('parameter = "displacement"\nrange = [0.1, 1.0]', "range", "the ring closes the film"),
        ('parameter = "displacement"\nrange = [-0.1, 0.5]', "range", "must lie within 0 <= displacement"),
        ('parameter = "excitation_frequency"\nrange = [0.1, 0.5]', "range", "excitation_frequency = 0.7"),
        ("step = 0.1", "maximum_step", "minimum_step <= step <= maximum_step"),
        ("max_points = 1000000000", "max_points", "<= 100000"),
        ('direction = "left"', "direction", "must be one of up, down, both"),
    ],
)
def test_what_a_continuation_cannot_do(problems, stage, key, message):
    found = problems(end=f"[continue_cycles]\n{stage}\n")
    assert [problem.key for problem in found] == [f"continue_cycles.{key}"]
    assert message in found[0].message
    assert found[0].line in (34, 35, 36)


def test_passive_bearings_need_no_frequency_unless_the_period_is_that_of_the_excitation(problems, text):
    passive = text.replace("displacement = 0.2\nfrequency = 0.7", "displacement = 0")
    autonomous = '[continue_cycles]\nformulation = "autonomous"\n'
    assert read_cases(passive, "demo.toml")[0].case.excitation.frequency is None
    assert read_cases(passive + autonomous, "demo.toml")
    found = problems((27, "displacement = 0"), (28, ""), end="[continue_cycles]\nmax_points = 9\n")
    assert [problem.key for problem in found] == ["continue_cycles.formulation"]
    found = problems(
        (27, "displacement = 0"),
        end='[continue_cycles]\nparameter = "excitation_frequency"\nrange = [0.2, 1]\n',
    )
    assert "nothing depends on the excitation frequency" in found[0].message


def test_a_rigid_bearing_has_no_stiffness_to_continue(problems):
    found = problems(
        (22, "rigid = true"), (23, ""), end='[continue_cycles]\nparameter = "foil_stiffness"\nstart = 1\n'
    )
    assert [problem.message for problem in found] == ["a rigid bearing has no foil stiffness to continue"]


def test_a_stage_at_its_defaults_does_not_stop_another_one(text):
    (named,) = read_cases(text.replace("speed = 1.0", "speed = 3.0"), "demo.toml")
    assert named.case.continue_cycles.range[1] < 3
    assert type(named).from_dict(named.as_dict()) == named


def test_ring_must_surround_the_bearing_and_excludes_a_ratio(problems):
    ring = "[excitation.ring]\ninner_radius = {}\nthickness = 2e-3\nwidth = 0.02\nyoung_modulus = 2e11\n"
    ring += "poisson_ratio = 0.3\n"
    (problem,) = problems(end=ring.format(0.01))
    assert (problem.line, problem.key) == (35, "excitation.ring.inner_radius")
    assert "at least 0.0140204 m" in problem.message
    (problem,) = problems((28, "frequency = 0.7\nratio = 0.9"), end=ring.format(0.02))
    assert (problem.line, problem.key) == (35, "excitation.ring")
    (problem,) = problems(end=ring.format(0.02).replace("2e-3", "21e-3"))
    assert (problem.line, problem.key) == (36, "excitation.ring.thickness")


def test_material_constants(problems):
    steel = "[rotor.materials.steel]\nyoung_modulus = {}\ndensity = 7850\n{}\n"
    (problem,) = problems(end=steel.format("206", "poisson_ratio = 0.3"))
    assert (problem.line, problem.key) == (35, "rotor.materials.steel.young_modulus")
    assert "Pa, not GPa" in problem.message
    (problem,) = problems(end=steel.format("206e9", "poisson_ratio = 0.3\nshear_modulus = 8e10"))
    assert "give exactly one of poisson_ratio, shear_modulus" in problem.message
    (problem,) = problems(end=steel.format("206e9", "shear_modulus = 5e10"))
    assert "E/(2G) - 1 = 1.06" in problem.message


@pytest.mark.parametrize(
    ("wrong", "line", "message"),
    [
        ("a = 1\nb = = 2\n", 2, "not TOML at column 5"),
        ("a = 1\n\n[gas\nb = 2\n", 3, "not TOML"),
        ('a = "unclosed\n', 1, "not TOML"),
        ("a = 1\nb = [1,\n2\n", 4, "not TOML"),
        ("a = 1\na = 2\n", 2, "not TOML"),
        ("a = " + "9" * 5000, 1, "not a configuration"),
        ("a = " + "[" * 100_000, 1, "nested too deeply"),
        ("a = \x00", 1, "not TOML"),
    ],
)
def test_text_that_is_not_toml(wrong, line, message):
    with pytest.raises(CaseError) as caught:
        read_cases(wrong, "wrong.toml")
    (problem,) = caught.value.problems
    assert (problem.file, problem.line) == ("wrong.toml", line)
    assert message in problem.message


def test_an_empty_file_misses_every_table():
    with pytest.raises(CaseError) as caught:
        read_cases("", "empty.toml")
    assert {problem.key for problem in caught.value.problems} == {
        "name",
        "gas",
        "rotor",
        "bearings",
        "excitation",
        "operation",
    }


def test_one_or_three_bearings_are_refused(text):
    third = text + "[[bearings]]\nnode = 2\n"
    with pytest.raises(CaseError) as caught:
        read_cases(third, "demo.toml")
    assert [problem.key for problem in caught.value.problems if problem.key == "bearings"]
    only = text.replace("[[bearings]]\nnode = 4\n", "")
    with pytest.raises(CaseError, match=r"bearings\.1: is missing: exactly two entries are needed"):
        read_cases(only, "demo.toml")


def test_the_error_travels_between_processes(problems):
    error = CaseError(problems((3, "viscosity = 0"), (30, "speed = 0")))
    assert pickle.loads(pickle.dumps(error)).problems == error.problems
    assert str(error).count("\n") == 1


def test_a_wrong_value_is_shown_shortened(problems):
    (problem,) = problems((3, f'viscosity = "{"x" * 199}"'))
    assert len(problem.value) == 60
