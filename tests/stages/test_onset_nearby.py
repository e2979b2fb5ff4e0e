"""Onsets from cycles found alone are those of branches, and undecided where only a branch can tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.stages.calibration import onset_speed as branches
from pipelines.stages.calibration.onset_nearby import Cycles, onset_nearby
from pipelines.stages.calibration.onset_speed import FOUND, onset_speed
from pipelines.stages.results import StopRequested
from tests.helpers.tiny import tiny_case

RANGE = (0.9, 1.4)
KINDS = ("neimark_sacker", "period_doubling", "fold")


def cycles(*overrides: str, kinds: tuple[str, ...] = KINDS, stop: bool = False) -> Cycles:
    case = tiny_case(*overrides).case
    return Cycles(build_machine(case), case, parameter_vector(case), kinds, lambda: stop)


@pytest.fixture(scope="module")
def of_a_branch() -> float:
    """The Neimark-Sacker point along a branch from the lowest speed."""
    found = onset_speed(tiny_case().case, RANGE)
    assert (found.status, found.bifurcation) == (FOUND, "neimark_sacker")
    return found.speed


@pytest.mark.parametrize("error", [-0.03, 0.01, 0.08])
def test_it_is_that_of_a_branch(of_a_branch: float, error: float) -> None:
    found = onset_nearby(cycles(), RANGE, (1.0 + error) * of_a_branch)
    assert found is not None
    assert found[0] == pytest.approx(of_a_branch, rel=5e-5)
    assert found[1] == "neimark_sacker"


def test_no_branch_is_followed_where_it_decides(of_a_branch: float, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise AssertionError("a branch is followed")

    monkeypatch.setattr(branches, "continue_branch", refuse)
    found = onset_speed(tiny_case().case, RANGE, "neimark_sacker", of_a_branch)
    assert (found.status, found.bifurcation) == (FOUND, "neimark_sacker")
    assert found.speed == pytest.approx(of_a_branch, rel=5e-5)


def test_a_bracket_that_is_none_leaves_it_to_a_branch(of_a_branch: float) -> None:
    """Far above, all cycles are unstable; far below, stable; of another kind, none is critical."""
    assert onset_nearby(cycles(), (0.9, 2.0), 1.2 * of_a_branch) is None
    assert onset_nearby(cycles(), RANGE, 0.8 * of_a_branch) is None
    assert onset_nearby(cycles(kinds=("period_doubling",)), RANGE, of_a_branch) is None
    found = onset_speed(tiny_case().case, RANGE, "any", 0.7 * of_a_branch)
    assert found.speed == pytest.approx(of_a_branch, rel=1e-5)


def test_thin_films_and_missing_cycles_leave_it_to_a_branch(of_a_branch: float) -> None:
    assert onset_nearby(cycles("continue_cycles.minimum_film=0.9"), RANGE, of_a_branch) is None
    assert onset_nearby(cycles("rotor.discs.mass=60.0"), RANGE, of_a_branch) is None, "nothing carries it"


def test_a_kind_that_changes_within_the_bracket_is_no_onset(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pair outside the circle that appears at once, and a real multiplier with cycles on both sides."""

    class Prescribed(Cycles):
        def at(self, speed: float):  # type: ignore[no-untyped-def]
            raise AssertionError

        def critical(self, speed: float) -> complex:
            return 0.5j if speed < 1.0 else 1.2j

    found = cycles()
    jumping = Prescribed(found.machine, found.case, found.parameters, KINDS, lambda: False)
    assert onset_nearby(jumping, RANGE, 1.0) is None
    monkeypatch.setattr(Prescribed, "critical", lambda self, speed: complex(math.exp(speed - 1.01)))
    crossing = onset_nearby(jumping, RANGE, 1.0)
    assert crossing == (pytest.approx(1.01, abs=1e-6), "branch_point")


def test_it_can_be_stopped(of_a_branch: float) -> None:
    with pytest.raises(StopRequested):
        onset_nearby(cycles(stop=True), RANGE, of_a_branch)


def test_a_cycle_is_computed_once() -> None:
    known = cycles()
    assert known.at(1.0) is known.at(1.0)
    assert known.growth(1.0) == pytest.approx(np.log(np.abs(known.critical(1.0))), rel=1e-12)
