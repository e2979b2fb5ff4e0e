"""Where a branch starts, and when a first cycle is not even looked for."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.bifurcations.branch import BranchPoint
from pipelines.case.models import Case
from pipelines.machine.assembly import build_machine
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.cycles.start import FirstCycle, Guard, NoStart, first_cycles, first_hopf, resting_start
from tests.helpers.tiny import PASSIVE, tiny_case

STIFFNESS = (
    'continue_cycles.parameter="foil_stiffness"',
    "continue_cycles.range=[5.0, 20.0]",
    "continue_cycles.start=10.0",
    "linearize.speed_range=[0.9, 1.3]",
)


def passive_case(*overrides: str) -> Case:
    """The machine without excitation: its whirl is born at the Hopf point and exists below it."""
    return tiny_case("continue_cycles.start=1.1", *overrides, config=PASSIVE).case


def started(case: Case, watch: Guard | None = None) -> list[FirstCycle | NoStart]:
    """All guesses of a first cycle."""
    machine = build_machine(case)
    watch = watch or Guard(lambda point: None, lambda: False)
    return list(first_cycles(machine, case, cycle_problem(machine, case), watch))


def hopf_speed(case: Case) -> float:
    machine = build_machine(case)
    hopf = first_hopf(machine, cycle_problem(machine, case).parameters, 0.9, 1.3)
    assert hopf is not None
    return hopf.speed


@pytest.mark.parametrize(
    ("overrides", "kind"),
    [
        (["bearings.foil.loss_factor=2e-6", 'numerics.stepper="rk4"'], NoStart),
        # who asks for a number of steps gets them, however many or few
        (
            ["bearings.foil.loss_factor=2e-6", 'numerics.stepper="rk4"', "numerics.steps_per_period=5000000"],
            FirstCycle,
        ),
        (["bearings.foil.loss_factor=2e-6"], FirstCycle),
        ([], FirstCycle),
    ],
)
def test_a_machine_too_stiff_for_explicit_steps_is_refused(overrides: list[str], kind: type) -> None:
    case = tiny_case(*overrides).case
    machine = build_machine(case)
    found = resting_start(machine, cycle_problem(machine, case))
    assert isinstance(found, kind)
    if isinstance(found, NoStart):
        # the fastest rate is that of the foil alone, 1/loss_factor, give or take the film's share
        rate = float(found.reason.split("fastest rate ")[1].rstrip(")"))
        assert rate == pytest.approx(5e5, rel=0.5)
        assert "loss_factor" in found.advice


def test_forced_cycles_have_a_second_way_in() -> None:
    resting, ramped = started(tiny_case().case)
    assert isinstance(resting, FirstCycle)
    assert isinstance(ramped, FirstCycle)
    # the ramp ends on the cycle itself, at the parameter of the branch
    assert ramped.start.parameter == 1.14


def test_what_cannot_rest_is_not_ramped_either() -> None:
    (stiff,) = started(tiny_case("bearings.foil.loss_factor=2e-6", 'numerics.stepper="rk4"').case)
    assert isinstance(stiff, NoStart)
    (heavy,) = started(tiny_case("rotor.gravity=900.0").case)
    assert isinstance(heavy, NoStart)
    assert "equilibrium" in heavy.reason


def test_without_excitation_there_is_no_ramp() -> None:
    assert len(started(tiny_case("excitation.displacement=0.0", stages=("continue_cycles",)).case)) == 1


def test_small_whirl_leaves_its_hopf_point_where_it_exists() -> None:
    case = passive_case("continue_cycles.range=[1.0, 1.2]")
    (found,) = started(case)
    assert isinstance(found, FirstCycle)
    assert found.direction == -1
    assert found.start.parameter < hopf_speed(case)


def test_whirl_that_begins_outside_the_range_is_no_start() -> None:
    low = hopf_speed(passive_case()) - 1e-6
    (found,) = started(passive_case(f"continue_cycles.range=[{low!r}, 1.2]", f"continue_cycles.start={1.15}"))
    assert isinstance(found, NoStart)
    assert "below the Hopf point" in found.reason
    assert "range" in found.advice


def test_whirl_is_carried_to_the_speed_at_which_another_parameter_is_continued() -> None:
    (found,) = started(passive_case(*STIFFNESS, "operation.speed=1.085"))
    assert isinstance(found, FirstCycle)
    assert found.start.parameter == 10.0  # of the foil stiffness


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.14, 0.92])
def test_a_speed_without_whirl_is_no_start(speed: float) -> None:
    # above the Hopf point there is none; far below it the branch has turned back before
    steps = "numerics.steps_per_period=64"  # far below the Hopf point no number of steps is enough
    (found,) = started(passive_case(*STIFFNESS, steps, f"operation.speed={speed}"))
    assert isinstance(found, NoStart)
    assert f"{speed:g}" in found.reason
    assert "operation.speed" in found.advice


def test_the_way_to_a_start_heeds_limit_and_interruption() -> None:
    def thin(point: BranchPoint) -> str | None:
        return "too thin" if point.cycle.unknowns.parameter < 1.1 else None

    way = passive_case(*STIFFNESS, "operation.speed=1.09")
    (limited,) = started(way, Guard(thin, lambda: False))
    assert isinstance(limited, NoStart)
    assert "too thin" in limited.reason
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return True

    (stopped,) = started(way, Guard(lambda point: None, stop))
    assert isinstance(stopped, NoStart)
    assert asked


def test_equal_phases_of_the_rings_only_shift_time() -> None:
    """The mean position of a ring does not depend on the phase at which it swings."""
    states = []
    for phases in ("[0.0, 0.0]", "[1.5707963267948966, 1.5707963267948966]"):
        case = tiny_case(f"excitation.phases={phases}").case
        machine = build_machine(case)
        found = resting_start(machine, cycle_problem(machine, case))
        assert isinstance(found, FirstCycle)
        states.append(found.start.state)
    np.testing.assert_array_equal(*states)


@pytest.mark.slow
def test_without_equilibrium_that_is_why_no_whirl_begins() -> None:
    (found,) = started(passive_case("rotor.gravity=1000", "continue_cycles.range=[1.0, 1.2]"))
    assert isinstance(found, NoStart)
    assert "at speed 1 there is no equilibrium" in found.reason
    assert "of the rotor's weight" in found.advice
