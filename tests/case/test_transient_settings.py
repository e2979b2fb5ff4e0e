"""Tables [unbalance] and [transient]: what they mean, and every way to write them wrongly."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from pipelines.case.identity import physics_hash
from pipelines.case.reading import read_cases
from pipelines.case.transient_settings import unbalance_moments


def case_of(text: str, *overrides: str):
    return read_cases(text, "demo.toml", overrides)[0].case


def moments(text: str, *overrides: str):
    case = case_of(text, *overrides)
    return unbalance_moments(case.unbalance, case.rotor, case.bearings, case.scales)


def test_a_grade_is_split_equally_over_the_bearings_in_phase(text):
    """ISO 21940-11: e Omega = G, so U = G m / Omega; G 2.5 at 30000 rpm."""
    found = moments(text, "unbalance.grade=2.5", "unbalance.rated_speed_rpm=30000")
    mass = case_of(text).rotor.mass
    expected = 2.5e-3 * mass / (30000 * 2 * math.pi / 60)
    assert [node for node, _, _ in found] == [0, 4]
    assert [moment for _, moment, _ in found] == pytest.approx([expected / 2] * 2, rel=1e-14)
    assert [phase for _, _, phase in found] == [0.0, 0.0]


def test_a_rated_speed_without_dimension_is_the_same_speed(text):
    scales = case_of(text).scales
    dimensionless = f"unbalance.rated_speed={scales.speed_from_rpm(30000.0)!r}"
    rpm = moments(text, "unbalance.grade=2.5", "unbalance.rated_speed_rpm=30000")
    assert moments(text, "unbalance.grade=2.5", dimensionless)[0][1] == pytest.approx(rpm[0][1], rel=1e-13)


def test_the_moment_of_a_grade_does_not_follow_the_speed(text):
    table = ("unbalance.grade=2.5", "unbalance.rated_speed_rpm=30000")
    assert moments(text, *table, "operation.speed=0.4") == moments(text, *table)


def test_planes_of_a_grade_and_planes_with_moments(text):
    graded = moments(
        text,
        "unbalance.grade=2.5",
        "unbalance.rated_speed_rpm=30000",
        "unbalance.planes=[{node = 1}, {node = 2, phase = 3.0}, {node = 3}]",
    )
    whole = moments(text, "unbalance.grade=2.5", "unbalance.rated_speed_rpm=30000")
    assert sum(moment for _, moment, _ in graded) == pytest.approx(sum(m for _, m, _ in whole), rel=1e-14)
    assert [(node, phase) for node, _, phase in graded] == [(1, 0.0), (2, 3.0), (3, 0.0)]
    found = moments(text, "unbalance.planes=[{node = 3, moment = 2.5, phase = 0.5}]")
    assert found == ((3, pytest.approx(2.5e-6, rel=1e-14), 0.5),)


def test_without_a_table_there_is_no_unbalance(text):
    assert moments(text) == ()


def test_neither_table_changes_the_identity_of_the_case(text):
    plain = physics_hash(case_of(text))
    assert physics_hash(case_of(text, "unbalance.grade=2.5", "unbalance.rated_speed=1.0")) == plain
    assert physics_hash(case_of(text, "transient.duration=7.0")) == plain


def test_the_example_of_the_pages_is_valid(text):
    page = Path(__file__).resolve().parents[2] / "configs" / "configuration.md"
    (example,) = [
        block
        for block in re.findall(
            r"^```toml\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        if "[transient]" in block
    ]
    case = case_of(text + example)
    assert case.scales.si_per_unit["time"] * case.transient.duration == pytest.approx(20.0, rel=1e-15)
    assert case.unbalance is not None


UNBALANCE, RUN = "[unbalance]\n", "[transient]\n"
PLANES = "planes = [{node = 2, moment = 1.0}]\n"


@pytest.mark.parametrize(
    ("end", "key", "message"),
    [
        (UNBALANCE + "grade = 2.5\n", "unbalance.rated_speed_rpm", "give exactly one of rated_speed"),
        (
            UNBALANCE + "grade = 2.5\nrated_speed = 1.0\nrated_speed_rpm = 3e4\n",
            "unbalance.rated_speed_rpm",
            "give exactly one of",
        ),
        (UNBALANCE + "rated_speed_rpm = 3e4\n" + PLANES, "unbalance.rated_speed_rpm", "belongs to a grade"),
        (UNBALANCE + "grade = -1.0\nrated_speed = 1.0\n", "unbalance.grade", "> 0"),
        (UNBALANCE, "unbalance.planes", "at least one plane"),
        (UNBALANCE + "planes = [{node = 2}]\n", "unbalance.planes.0.moment", "is missing"),
        (
            UNBALANCE + "grade = 2.5\nrated_speed = 1.0\nplanes = [{node = 2, moment = 1.0}]\n",
            "unbalance.planes.0.moment",
            "leave out moment, or grade",
        ),
        (
            UNBALANCE + "planes = [{node = 2, moment = 1.0}, {node = 5, moment = 1.0}]\n",
            "unbalance.planes.1.node",
            "not on the shaft, whose nodes are 0 to 4",
        ),
        (
            UNBALANCE + "planes = [{node = 2, moment = 1.0, phase = 90}]\n",
            "unbalance.planes.0.phase",
            "degrees",
        ),
        (RUN + "times = [0, -1]\nspeeds = [1, 1]\n", "transient.times.1", "must not be negative"),
        (RUN + "times = [0, 5, 5]\nspeeds = [1, 1, 2]\n", "transient.times.2", "the speed cannot jump"),
        (RUN + "times = [0, 5, 4]\nspeeds = [1, 1, 2]\n", "transient.times.2", "above the time before it, 5"),
        (RUN + "times = [1, 5]\nspeeds = [1, 1]\n", "transient.times.0", "must be 0"),
        (RUN + "times = [0, 5]\nspeeds = [1]\n", "transient.speeds", "1 values for 2 times"),
        (RUN + "speeds = [1]\n", "transient.speeds", "1 values for 0 times"),
        (RUN + "times = [0, 5]\nspeeds = [1, 0]\n", "transient.speeds.1", "cannot pass through standstill"),
        (RUN + "times = [0, 5]\nspeeds = [1, -1]\n", "transient.speeds.1", "cannot pass through standstill"),
        (RUN + "duration = 0.0\n", "transient.duration", "> 0"),
        (RUN + 'start = "pd/c000"\n', "transient.start", "cycles/b000"),
        (RUN + 'start = "cases/other/cycles/b000"\n', "transient.start", "a group of the same case"),
        (RUN + "start_row = 1\n", "transient.start_row", "no meaning"),
        (RUN + 'start = "transient/t000"\nangle = 1.0\n', "transient.angle", "sets the angle"),
        (RUN + 'excitation = "switch_on"\n', "transient.switch_time", "is missing"),
        (RUN + "switch_time = 1.0\n", "transient.switch_time", "no meaning"),
        (
            RUN + 'excitation = "switch_off"\nduration = 5.0\nswitch_time = 6.0\n',
            "transient.switch_time",
            "before the end of the run",
        ),
        (RUN + 'excitation = "switch"\n', "transient.excitation", "must be one of on, off, switch_on"),
        (RUN + "minimum_film = 1.0\n", "transient.minimum_film", "< 1"),
        (RUN + "step_per_period = 40\n", "transient.step_per_period", "unknown key"),
    ],
)
def test_mistakes_are_reported_with_their_key(problems, end, key, message):
    found = problems(end=end)
    assert [problem.key for problem in found] == [key]
    assert message in found[0].message
    assert found[0].line is not None


def test_all_mistakes_at_once(problems):
    found = problems(
        end=RUN + "times = [0, -1]\nspeeds = [1, 0]\n" + UNBALANCE + "planes = [{node = 9, moment = 1.0}]\n"
    )
    assert {problem.key for problem in found} == {
        "transient.times.1",
        "transient.speeds.1",
        "unbalance.planes.0.node",
    }


def test_switching_needs_an_excitation(problems):
    end = RUN + 'excitation = "switch_on"\nswitch_time = 1.0\n'
    found = problems(overrides=("excitation.displacement=0.0",), end=end)
    assert [problem.key for problem in found] == ["transient.excitation"]
    assert "nothing to switch" in found[0].message
