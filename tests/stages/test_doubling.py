"""The growth of period doubling, and the corner of both curves, against closed forms and continuation."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.stages.calibration.doubling import (
    Corner,
    corner_near,
    doubling_growth,
    first_corner,
    leading_pair,
)
from pipelines.stages.calibration.onset_nearby import Cycles, Undecided
from pipelines.stages.calibration.onset_speed import FOUND, onset_speed
from pipelines.stages.results import StopRequested
from tests.helpers.tiny import Watched, tiny_case

FREQUENCY = 0.7
PERIOD = 2.0 * math.pi / FREQUENCY


def cycle_of(*multipliers: complex, period: float = PERIOD) -> Any:
    """A cycle of which only its multipliers and its period are known."""
    spectrum = SimpleNamespace(multipliers=np.array(multipliers, dtype=complex))
    return SimpleNamespace(spectrum=spectrum, unknowns=SimpleNamespace(period=period))


def pair_of(growth: float, splitting: float, period: float = PERIOD) -> tuple[complex, complex]:
    """The multipliers with sigma = a +- sqrt(q)."""
    root = np.sqrt(complex(splitting))
    return complex(-np.exp((growth + root) * period)), complex(-np.exp((growth - root) * period))


@pytest.mark.parametrize(
    ("growth", "splitting", "expected"),
    [
        (-0.02, 0.03**2, 0.01),  # a multiplier below -1
        (-0.02, 0.02**2, 0.0),  # a period doubling
        (-0.02, 0.0, -0.02),  # where the pair becomes real
        (-0.02, -(0.05**2), -0.07),  # conjugate, away from half the excitation frequency
    ],
)
def test_the_growth_of_period_doubling_is_that_of_the_exponents(
    growth: float, splitting: float, expected: float
) -> None:
    cycle = cycle_of(1.4 + 0.1j, 1.4 - 0.1j, *pair_of(growth, splitting), 0.2)
    assert doubling_growth(cycle) == pytest.approx(expected, abs=1e-9)


def test_it_is_continuous_where_the_pair_becomes_real_and_least_without_one() -> None:
    around = [doubling_growth(cycle_of(*pair_of(-0.02, q))) for q in (-1e-10, 0.0, 1e-10)]
    assert np.ptp(around) < 3e-5
    assert doubling_growth(cycle_of(0.9, 0.2 + 0.3j, 0.2 - 0.3j)) == pytest.approx(-FREQUENCY / 2.0)


def test_the_leading_pair_is_conjugate_or_none() -> None:
    slower = pair_of(-0.1, -(0.01**2))
    assert leading_pair(cycle_of(*pair_of(-0.02, -(0.05**2)), *slower)) == pytest.approx(-0.02 + 0.05j)
    assert leading_pair(cycle_of(*pair_of(-0.02, 0.03**2), *slower)) is None
    assert leading_pair(cycle_of(0.5, 0.9)) is None


class Prescribed(Cycles):
    """Two pairs with exponents a +- sqrt(q) over speed and frequency; the second is that of another mode."""

    def __init__(self, corner: tuple[float, float], lost: Callable[[float, float], bool]) -> None:
        self._corner, self._lost, self.visited = corner, lost, 0

    def at(self, speed: float, frequency: float | None = None) -> Any:
        assert frequency is not None
        self.visited += 1
        if self._lost(speed, frequency):
            raise Undecided
        f, s = frequency - self._corner[0], speed - self._corner[1]
        period = 2.0 * math.pi / frequency
        growth, splitting = (
            0.1 * s - 0.05 * f + 0.08 * s * s,
            0.06 * f - 0.02 * s - 0.2 * f * f + 0.05 * s * f,
        )
        leading = pair_of(growth, splitting, period)
        return cycle_of(*leading, *pair_of(growth - 0.01, splitting - 1e-4, period), period=period)


@pytest.mark.parametrize("shift", [(0.01, -0.03), (-0.02, 0.04), (0.0, 0.0)])
def test_a_corner_is_found_near_an_expected_one(shift: tuple[float, float]) -> None:
    cycles = Prescribed((0.7, 1.2), lambda speed, frequency: False)
    found = corner_near(cycles, Corner(0.7 + shift[0], 1.2 + shift[1]))
    assert found is not None
    assert (found.frequency, found.speed) == pytest.approx((0.7, 1.2), abs=2e-5)
    assert cycles.visited < 30


def test_the_first_corner_is_found_without_knowing_any() -> None:
    """Also where the cycles of some places are missing; not where it lies outside of the ranges."""
    cycles = Prescribed((0.7, 1.2), lambda speed, frequency: speed < 0.9)
    found = first_corner(cycles, (0.55, 0.9), (0.8, 1.4))
    assert found is not None
    assert (found.frequency, found.speed) == pytest.approx((0.7, 1.2), abs=2e-5)
    assert first_corner(cycles, (0.55, 0.66), (0.8, 1.4)) is None
    assert first_corner(cycles, (0.55, 0.9), (0.8, 1.0)) is None
    nothing = Prescribed((0.7, 1.2), lambda speed, frequency: True)
    assert first_corner(nothing, (0.55, 0.9), (0.8, 1.4)) is None
    assert corner_near(nothing, Corner(0.7, 1.2)) is None


PLANE = (  # the Neimark-Sacker curve from the branch at excitation frequency 0.77 to R2 near 0.80
    "excitation.frequency=0.77",
    "continue_cycles.range=[1.2, 1.24]",
    "continue_cycles.start=1.2",
    "track_curves.ranges=[[0.72, 0.82], [1.2, 1.24]]",
    "track_curves.maximum_step=0.04",
    "track_curves.normal_forms=false",
    "numerics.multiplier_tolerance=1e-5",
)


def lone_cycles(*overrides: str, stop: bool = False) -> Cycles:
    case = tiny_case(*overrides).case
    return Cycles(build_machine(case), case, parameter_vector(case), (), lambda: stop)


@pytest.mark.slow
def test_the_corner_is_the_resonance_in_which_the_continued_curve_ends(tmp_path: Any) -> None:
    path = tmp_path / "a.zarr"
    for stage in ("continue_cycles", "track_ns"):
        assert Watched(stage, tiny_case(*PLANE), path).result.ok
    curve = read_group(open_for_reading(path), "cases/smoke/ns/c000")
    assert curve.labels("event_kind").tolist() == ["R2"]
    continued = [float(curve[f"event_{name}"][0]) for name in ("excitation_frequency", "speed")]
    near = corner_near(lone_cycles(*PLANE), Corner(1.01 * continued[0], 0.99 * continued[1]))
    assert near is not None
    assert (near.frequency, near.speed) == pytest.approx(continued, abs=1e-4)
    first = first_corner(lone_cycles(*PLANE), (0.65, 0.95), (1.0, 1.4))
    assert first is not None
    assert (first.frequency, first.speed) == pytest.approx(continued, abs=1e-4)


@pytest.mark.slow
def test_the_growth_passes_zero_at_the_period_doubling_of_a_branch() -> None:
    tongue = ("excitation.frequency=0.85", "continue_cycles.step=0.05", "continue_cycles.maximum_step=0.1")
    case = tiny_case(*tongue).case
    found = onset_speed(case, (0.5, 1.2), "period_doubling")
    assert (found.status, found.bifurcation) == (FOUND, "period_doubling")
    cycles = lone_cycles(*tongue)
    below, at, above = (doubling_growth(cycles.at(share * found.speed)) for share in (0.95, 1.0, 1.05))
    assert below < 0.0 < above
    assert at == pytest.approx(0.0, abs=0.02 * (above - below))


def test_it_can_be_stopped() -> None:
    with pytest.raises(StopRequested):
        first_corner(lone_cycles(stop=True), (0.65, 0.95), (1.0, 1.4))
