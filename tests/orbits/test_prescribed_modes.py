"""Critical speeds of modes on known paths: none is lost and none invented, from any number of speeds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.orbits.equilibria.critical_speeds import NO_EQUILIBRIUM, NOT_TOLD_APART
from tests.helpers.prescribed_modes import Matrix, Path, PrescribedModes, on_paths, rotor_in_films

RANGE = (0.15, 1.5)
POINTS = pytest.mark.parametrize("points", [2, 3, 8, 21, 60])


def straight(crossing: float, slope: float = 0.3) -> Path:
    """Im lambda - speed changes its sign at ``crossing``."""
    return lambda speed: complex(-0.05, crossing + slope * (speed - crossing))


def high(speed: float) -> complex:
    """A mode far above the synchronous line."""
    return complex(-0.05, 3.0 + 0.2 * speed)


def found(
    modes: PrescribedModes, patch: pytest.MonkeyPatch, points: int, speeds: tuple[float, float] = RANGE
) -> list[float]:
    """Critical speeds about which nothing is in doubt and whose number is that of the counts."""
    diagram, result = modes.critical_speeds(patch, speeds, points)
    assert result.undecided == []
    crossed = sum(one.change for one in result.found)
    assert result.counts[-1] - result.counts[0] == crossed + result.passages
    assert set(np.linspace(*speeds, points)) <= set(diagram.speeds)
    return [one.speed for one in result.found]


@POINTS
@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6, 1e-8, -1e-8, -1e-4])
def test_a_mode_that_hardly_crosses_the_line_does_so_twice(
    monkeypatch: pytest.MonkeyPatch, depth: float, points: int
) -> None:
    """Also where both crossings are closer than any two speeds; one that passes above has none."""

    def tangent(speed: float) -> complex:
        return complex(-0.05, speed + (speed - 0.9) ** 2 - depth)

    half = math.sqrt(max(depth, 0.0))
    expected = [0.5] + ([0.9 - half, 0.9 + half] if depth > 0.0 else [])
    modes = PrescribedModes(on_paths(tangent, high, straight(0.5, 0.1)))
    assert found(modes, monkeypatch, points) == pytest.approx(expected, abs=1e-7)


@POINTS
@pytest.mark.parametrize("slope", [0.3, 1.1])
@pytest.mark.parametrize("end", RANGE)
def test_a_critical_speed_at_an_end_of_the_range_is_in_it(
    monkeypatch: pytest.MonkeyPatch, end: float, slope: float, points: int
) -> None:
    """Where rounding puts the mode does not matter."""
    for rounding in (0.0, 1e-12, -1e-12):
        modes = PrescribedModes(on_paths(straight(end + rounding, slope), high))
        assert found(modes, monkeypatch, points) == pytest.approx([end], abs=1e-9)


@POINTS
def test_a_critical_speed_at_a_speed_that_is_asked_for_is_found_once(
    monkeypatch: pytest.MonkeyPatch, points: int
) -> None:
    middle = 0.5 * sum(RANGE)
    for rounding in (0.0, 1e-13, -1e-13):
        modes = PrescribedModes(on_paths(straight(middle + rounding), high))
        assert found(modes, monkeypatch, points) == pytest.approx([middle], abs=1e-9)


@POINTS
@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_two_modes_of_one_eigenvalue_are_two(
    monkeypatch: pytest.MonkeyPatch, apart: float, points: int
) -> None:
    """They have no vectors of their own, only a plane."""
    modes = PrescribedModes(on_paths(straight(0.8), straight(0.8 + apart), high))
    assert found(modes, monkeypatch, points) == pytest.approx([0.8, 0.8 + apart], abs=1e-9)


def stiffening(rate: float) -> Path:
    """x'' + 0.1 x' + k x = 0 with the frequency sqrt(rate (speed - 0.61)): it oscillates from there on."""

    def block(speed: float) -> Matrix:
        return np.array([[0.0, 1.0], [-(0.05**2 + rate * (speed - 0.61)), -0.1]])

    return block


@POINTS
@pytest.mark.parametrize("rate", [4.0, 100.0])
def test_a_mode_that_is_overdamped_at_first(
    monkeypatch: pytest.MonkeyPatch, rate: float, points: int
) -> None:
    """It begins to oscillate, crosses the line and leaves the frequencies of interest between two speeds."""
    crossings = np.roots([1.0, -rate, 0.61 * rate])
    expected = sorted([0.5, *crossings[crossings < RANGE[1]]])
    modes = PrescribedModes(on_paths(stiffening(rate), high, straight(0.5, 0.1)))
    assert found(modes, monkeypatch, points) == pytest.approx(expected, abs=1e-8)


def test_a_mode_that_appears_too_fast_to_be_followed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = PrescribedModes(on_paths(stiffening(1e4), high, straight(0.5, 0.1)))
    _, result = modes.critical_speeds(monkeypatch, RANGE, 8)
    assert [one.speed for one in result.found] == pytest.approx([0.5])
    (doubt,) = result.undecided
    assert (doubt.reason, doubt.matters, doubt.after - doubt.before) == (NOT_TOLD_APART, True, 1)
    assert doubt.low < 0.61004 < doubt.high < doubt.low + 1e-3


@pytest.mark.parametrize("points", [8, 21, 60])
def test_speeds_without_equilibrium_at_an_end_hide_what_is_there_only(
    monkeypatch: pytest.MonkeyPatch, points: int
) -> None:
    matrix = on_paths(straight(0.25), straight(0.8), straight(1.3), high)
    for missing, expected in ((lambda w: w < 0.4, [0.8, 1.3]), (lambda w: w > 1.1, [0.25, 0.8])):
        diagram, result = PrescribedModes(matrix, missing).critical_speeds(monkeypatch, RANGE, points)
        assert [one.speed for one in result.found] == pytest.approx(expected, abs=1e-9)
        assert result.undecided == []
        assert diagram.missing


def test_a_stretch_without_equilibrium_is_told_even_where_the_counts_agree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mode that crosses the line twice within it is lost, and nothing shows it."""
    modes = PrescribedModes(on_paths(straight(0.5), high), lambda speed: 0.7 < speed < 0.75)
    _, result = modes.critical_speeds(monkeypatch, RANGE, 8)
    (gap,) = result.undecided
    assert (gap.reason, gap.matters, gap.before) == (NO_EQUILIBRIUM, False, gap.after)
    assert gap.low == pytest.approx(0.7, abs=2.0**-7)
    assert gap.high == pytest.approx(0.75, abs=2.0**-7)


@pytest.mark.parametrize("seed", [*range(12), 17, 32, 89])
def test_random_rotors_in_films_that_lag(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    modes = PrescribedModes(rotor_in_films(seed))
    few, some, many = (found(modes, monkeypatch, points, (0.15, 3.0)) for points in (2, 8, 60))
    assert few == pytest.approx(many, abs=1e-8)
    assert some == pytest.approx(many, abs=1e-8)
