"""When a first cycle is not even looked for."""

from __future__ import annotations

import pytest

from pipelines.machine.assembly import build_machine
from pipelines.stages.cycle_problem import FirstCycle, NoStart, cycle_problem, first_cycle
from tests.helpers.tiny import tiny_case


@pytest.mark.parametrize(
    ("overrides", "kind"),
    [
        (["bearings.foil.loss_factor=1e-6"], NoStart),
        # who asks for a number of steps gets them, however many or few
        (["bearings.foil.loss_factor=1e-6", "numerics.steps_per_period=5000000"], FirstCycle),
        ([], FirstCycle),
    ],
)
def test_a_machine_too_stiff_for_explicit_steps_is_refused(overrides: list[str], kind: type) -> None:
    case = tiny_case(*overrides).case
    machine = build_machine(case)
    found = first_cycle(machine, case, cycle_problem(machine, case))
    assert isinstance(found, kind)
    if isinstance(found, NoStart):
        # the fastest rate is that of the foil alone, 1/loss_factor, give or take the film's share
        rate = float(found.reason.split("fastest rate ")[1].rstrip(")"))
        assert rate == pytest.approx(1e6, rel=0.5)
        assert "loss_factor" in found.advice
