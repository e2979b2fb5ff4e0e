"""The table [continue_tori]: what is refused, and where."""

from __future__ import annotations

import pytest

from pipelines.case.problems import CaseError
from pipelines.case.torus_settings import ContinueTori
from tests.helpers.tiny import PASSIVE, tiny_case

UNBALANCE = "unbalance.planes=[{node=2, moment=0.1}]"


def refused(*overrides: str, **options: object) -> list[tuple[str, str]]:
    with pytest.raises(CaseError) as error:
        tiny_case(*overrides, **options)  # type: ignore[arg-type]
    return [(problem.key, problem.message) for problem in error.value.problems]


def test_defaults_fit_every_case() -> None:
    """Also one without excitation, whose tori cannot be followed: another stage must not stop for them."""
    assert tiny_case(config=PASSIVE).case.continue_tori == ContinueTori()


@pytest.mark.parametrize(
    ("overrides", "key", "complaint"),
    [
        (["continue_tori.origin=hopf"], "origin", "must be one of neimark_sacker, unbalance"),
        (["continue_tori.origin=unbalance"], "origin", "needs the table [unbalance]"),
        (["continue_tori.branch=pd/c000"], "branch", "cycles/b000"),
        (["continue_tori.parameter=period"], "parameter", "must be one of speed"),
        (["continue_tori.range=[0.9, 0.8]"], "range", "low < high"),
        (["continue_tori.range=[0.0, 0.8]"], "range.0", "this parameter is positive"),
        (
            ["continue_tori.parameter=displacement", "continue_tori.range=[0.0, 1.0]"],
            "range",
            "0 <= displacement < 1",
        ),
        (["continue_tori.start=1.7"], "start", "must lie inside range = [0.2, 1.6]"),
        (["continue_tori.step=0.1"], "maximum_step", "minimum_step <= step <= maximum_step"),
        (["continue_tori.max_angles=64"], "max_angles", "must be odd"),
        (["continue_tori.max_angles=13"], "max_angles", ">= 15"),
        (["continue_tori.tolerance=0"], "tolerance", "> 0"),
        (
            ["continue_tori.parameter=foil_stiffness", "bearings.foil={rigid=true}"],
            "parameter",
            "a rigid bearing has no foil stiffness",
        ),
        (
            ["continue_cycles.formulation=autonomous", "continue_tori.step=0.02"],
            "origin",
            'set continue_cycles.formulation = "stroboscopic"',
        ),
    ],
)
def test_what_is_refused(overrides: list[str], key: str, complaint: str) -> None:
    (found,) = refused(*overrides)
    assert found[0] == f"continue_tori.{key}"
    assert complaint in found[1]


def test_unbalance_needs_the_period_of_the_rings() -> None:
    (found,) = refused("continue_tori.origin=unbalance", UNBALANCE, config=PASSIVE)
    assert found == ("continue_tori.origin", found[1])
    assert "give excitation.frequency" in found[1]


def test_unbalance_may_leave_the_cycles_autonomous() -> None:
    case = tiny_case(
        "continue_tori.origin=unbalance", UNBALANCE, "continue_cycles.formulation=autonomous"
    ).case
    assert case.continue_tori.origin == "unbalance"
