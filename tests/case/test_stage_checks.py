"""What a stage asks of the tables that it reads; no table stops a stage that does not read it."""

from __future__ import annotations

import pytest

from pipelines.case.reading import CaseError, Problem, read_cases, stage_problems
from pipelines.case.stage_checks import STAGE_TABLES
from pipelines.stages.scheduling.registry import STAGES
from tests.helpers.configurations import FILES

RIGID = "bearings.foil={rigid=true}"
RING = "[excitation.ring]\ninner_radius = 0.02\nthickness = 2e-3\nwidth = 0.02\nyoung_modulus = 2e11\n"
RING += "poisson_ratio = 0.3\n"
UNBALANCE = "unbalance.planes=[{node = 0, moment = 0.1}]"
CURVES = {"track_pd", "track_ns", "track_folds"}
SEARCHED = {"bifurcation_set", "survey"}


def refused(text: str, *overrides: str, stages: tuple[str, ...] = tuple(STAGES)) -> dict[str, list[Problem]]:
    """What is wrong for each stage, where something is."""
    (named,) = read_cases(text, "demo.toml", (UNBALANCE, *overrides), stages=())
    found = {stage: stage_problems(named, (stage,)) for stage in stages}
    return {stage: problems for stage, problems in found.items() if problems and stage != "calibrate"}


def test_every_stage_has_its_tables() -> None:
    assert set(STAGE_TABLES) == set(STAGES)


def test_a_machine_that_all_stages_can_compute(text: str) -> None:
    assert refused(text) == {}


@pytest.mark.parametrize(
    ("overrides", "stages", "key"),
    [
        (["operation.speed=3.0"], {"continue_cycles"}, "continue_cycles.range"),
        (["continue_cycles.range=[0.2, 0.5]"], {"continue_cycles"}, "continue_cycles.range"),
        (["continue_tori.range=[0.2, 0.5]"], set(), ""),
        ([RIGID, "continue_cycles.parameter=foil_stiffness", "continue_cycles.start=1"], {"continue_cycles"},
         "continue_cycles.parameter"),
        ([RIGID, "track_curves.parameters=[foil_stiffness, speed]"], CURVES | SEARCHED,
         "track_curves.parameters.0"),
        (["track_curves.parameters=[speed, displacement]", "track_curves.ranges=[[0.2, 1.4], [0, 0.6]]",
          "excitation.amplitudes=[1, 2]"], CURVES | SEARCHED, "track_curves.ranges.1"),
        (["excitation.displacement=0.0", "transient.excitation=switch_off", "transient.switch_time=1.0"],
         {"transient", "survey", *CURVES}, ""),
    ],
)  # fmt: skip
def test_a_table_stops_its_own_stages_alone(
    text: str, overrides: list[str], stages: set[str], key: str
) -> None:
    words = [word.replace("[foil_stiffness, speed]", "['foil_stiffness', 'speed']") for word in overrides]
    words = [word.replace("[speed, displacement]", "['speed', 'displacement']") for word in words]
    found = refused(text, *words)
    assert set(found) == stages
    if key:
        assert {problem.key for problems in found.values() for problem in problems} == {key}


def test_a_period_is_not_invented(text: str) -> None:
    passive = text.replace("displacement = 0.2\nfrequency = 0.7", "displacement = 0")
    found = refused(passive)
    assert set(found) == {"continue_cycles", "continue_tori", "survey", *CURVES}
    (problem,) = found["continue_cycles"]
    assert (problem.key, problem.line) == ("continue_cycles.formulation", 1)
    assert "give excitation.frequency" in problem.message
    assert "this is the default" in problem.message
    found = refused(passive, "continue_cycles.formulation=autonomous")
    assert "continue_cycles" not in found, "the period of a whirl is its own"


def test_rings_that_move_are_no_parameter_of_self_excited_cycles(text: str) -> None:
    words = (
        "excitation.displacement=0.0",
        "continue_cycles.formulation=autonomous",
        "track_curves.parameters=['speed', 'displacement']",
        "track_curves.ranges=[[0.2, 1.4], [0, 0.4]]",
    )
    found = refused(text, *words)
    assert set(found) == {*CURVES, "continue_tori"}
    (problem,) = found["track_ns"]
    assert problem.key == "track_curves.parameters.1"
    assert "self-excited" in problem.message
    forced = refused(text, *words, "continue_cycles.parameter=displacement", "continue_cycles.range=[0, 0.4]")
    assert not CURVES & set(forced)


def test_a_whirl_begins_at_its_hopf_point_not_at_the_operating_speed(text: str) -> None:
    words = ("excitation.displacement=0.0", "continue_cycles.formulation=autonomous", "operation.speed=3.0")
    assert "continue_cycles" not in refused(text, *words)


def test_a_calibration_without_its_table(text: str) -> None:
    (named,) = read_cases(text, "demo.toml", stages=())
    (problem,) = stage_problems(named, ("calibrate",))
    assert "no table [calibrate]" in problem.message


def test_written_tables_are_checked_when_no_stage_is_named(text: str) -> None:
    with pytest.raises(CaseError, match="does not contain the case's own speed = 3"):
        read_cases(text + "[continue_cycles]\nmax_points = 9\n", "demo.toml", ("operation.speed=3.0",))
    assert read_cases(text, "demo.toml", ("operation.speed=3.0",))


def test_a_swept_value_is_refused_where_it_is_written(text: str) -> None:
    with pytest.raises(CaseError) as caught:
        read_cases(text + "[sweep]\ncontinue_cycles.range = [[0.5, 1.5], [0.2, 0.4]]\n", "demo.toml")
    (problem,) = caught.value.problems
    assert (problem.line, problem.key) == (35, "continue_cycles.range")


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        (["excitation.load=80000"], "excitation.load"),
        (["excitation.load=20", "excitation.amplitudes=[1, 1000]"], "excitation.amplitudes"),
        # the same length is more of a smaller clearance
        (["excitation.load=20", "bearings.1.clearance=1e-7"], "excitation.load"),
    ],
)
def test_a_load_that_closes_the_film(text: str, overrides: list[str], key: str) -> None:
    with pytest.raises(CaseError) as caught:
        read_cases(text + RING, "demo.toml", overrides)
    (problem,) = caught.value.problems
    assert problem.key == key
    assert "the ring closes the film otherwise; at most" in problem.message
    assert problem.file.startswith("--set excitation")


def test_a_load_up_to_the_film_is_allowed(text: str) -> None:
    """delta c = (F0 Rc^3/E I)(pi k1/4 - 2 k2^2/pi) grows with the load: the bound is the load at delta 1."""
    with pytest.raises(CaseError) as caught:
        read_cases(text + RING, "demo.toml", ("excitation.load=80000",))
    most = float(caught.value.problems[0].message.split("at most ")[1].split()[0])
    assert read_cases(text + RING, "demo.toml", (f"excitation.load={0.99 * most}",))
    with pytest.raises(CaseError, match="closes the film"):
        read_cases(text + RING, "demo.toml", (f"excitation.load={1.01 * most}",))


def test_the_configurations_that_come_with_agfb_run_their_chain() -> None:
    for path in FILES:
        for named in read_cases(path.read_text(), str(path)):
            assert stage_problems(named, ("linearize", "criticals", "continue_cycles", "transient")) == []
