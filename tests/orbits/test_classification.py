"""Known maps and signals are told apart."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.orbits.time_runs.classification import Limits, Motion, chaos_test, classify, return_distance


def logistic(r, count=600, skip=5000):
    x, found = 0.3, []
    for step in range(skip + count):
        x = r * x * (1.0 - x)
        if step >= skip:
            found.append(x)
    return np.array(found)[:, None]


ORBIT = np.array([[-0.5], [0.5]])


@pytest.mark.parametrize(
    ("r", "motion"),
    [
        (2.8, Motion.PERIOD_1),
        (3.2, Motion.PERIOD_2),
        (3.5, Motion.PERIOD_4),
        (3.55, Motion.PERIOD_8),
        (3.68, Motion.CHAOTIC),
        (3.97, Motion.CHAOTIC),
    ],
)
def test_the_logistic_map(r, motion):
    found = classify(logistic(r), ORBIT)
    assert found.motion is motion
    assert found.reason == ""


@pytest.mark.parametrize("rotation", [0.03, 0.2360679775, 0.5 * np.sqrt(2.0)])
@pytest.mark.parametrize("harmonic", [0.0, 0.3])
def test_rotation_on_a_closed_curve_is_quasi_periodic(rotation, harmonic):
    angle = 2.0 * np.pi * rotation * np.arange(300)
    points = np.stack([np.cos(angle) + harmonic * np.cos(2.0 * angle), np.sin(angle)], axis=1)
    found = classify(points, 3.0 * points)
    assert found.motion is Motion.QUASI_PERIODIC
    assert found.chaos < 0.2
    assert np.all(found.returns > 0.1)


def test_a_spiral_is_unsettled_and_tells_its_rate():
    """Points e^{(g + 1.1 i) n}: distances of successive points grow by g per period."""
    for growth in (0.02, -0.02):
        points = np.exp((growth + 1.1j) * np.arange(200))
        found = classify(np.stack([points.real, points.imag], axis=1), ORBIT)
        assert found.motion is Motion.UNSETTLED
        assert found.growth == pytest.approx(growth, rel=1e-9)
        flat = classify(np.stack([points.real, 0.2 * points.imag], axis=1), ORBIT)
        assert flat.growth == pytest.approx(growth, rel=1e-3)  # steps of an ellipse beat


def test_growth_is_seen_long_before_it_is_large():
    """A cycle that is left at a rate of 2 % per period: the points still return within 1e-4."""
    points = 1e-6 * np.exp(0.02 * np.arange(200)) * np.cos(1.1 * np.arange(200))
    found = classify(points[:, None], ORBIT)
    assert found.returns[0] < 1e-3
    assert found.motion is Motion.UNSETTLED
    assert classify(1e-3 * points[:, None], ORBIT).motion is Motion.PERIOD_1  # rounding may grow
    assert classify(points[::-1, None], ORBIT).motion is Motion.PERIOD_1  # settled within the limit


def test_a_motion_that_nearly_repeats_but_drifts_is_not_periodic():
    """Rotation by half a turn and 2e-4 of one: every second point is near, all of them are not."""
    angle = 2.0 * np.pi * (0.5 + 2e-4) * np.arange(800)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert np.linalg.norm(points[2:] - points[:-2], axis=1).max() < 3e-3
    pairs = [points[first::2, None] - points[None, first::2] for first in (0, 1)]
    apart = np.sqrt(np.mean([np.sum(pair**2, axis=2) for pair in pairs]))
    assert return_distance(points, 2) == pytest.approx(apart, rel=1e-9)
    assert apart > 0.4
    assert classify(points, points, Limits(repeats=0.01)).motion is not Motion.PERIOD_2


def test_rest_and_too_few_points():
    still = classify(np.zeros((4, 2)), np.full((10, 2), 0.3) + 1e-9 * np.arange(20.0).reshape(10, 2))
    assert still.motion is Motion.EQUILIBRIUM
    short = classify(logistic(2.8, 31), ORBIT)
    assert short.motion is None
    assert "31 periods of steady drive; 32 are needed" in short.reason
    middle = classify(logistic(3.97, 100), ORBIT)
    assert middle.motion is None
    assert "in 100 periods of steady drive; to tell" in middle.reason
    assert "takes 128 or more" in middle.reason
    assert np.isnan(middle.chaos)
    longer = classify(logistic(3.97, 300), ORBIT)
    assert longer.motion is None
    assert longer.chaos > 0.8
    assert "takes 600 or more" in longer.reason
    assert classify(logistic(3.2, 40), ORBIT).motion is Motion.PERIOD_2


@pytest.mark.parametrize("seed", range(10))
def test_a_torus_of_three_frequencies_is_never_called_chaotic(seed):
    """As under rings, unbalance and whirl: from few points undecided, from many quasi-periodic."""
    random = np.random.default_rng(seed)
    rotations, sizes = random.uniform(0.0, 1.0, 3), random.uniform(0.2, 1.0, 3)
    angles = 2.0 * np.pi * rotations[:, None] * np.arange(600)
    points = (sizes @ np.cos(angles) + 0.3 * np.cos(angles[0] + angles[1]))[:, None]
    assert classify(points[:150], points).motion in (None, Motion.QUASI_PERIODIC, Motion.UNSETTLED)
    assert classify(points, points).motion is Motion.QUASI_PERIODIC


def test_the_chaos_test_is_near_zero_or_one():
    assert chaos_test(logistic(3.97, 2000)) > 0.95
    angle = 2.0 * np.pi * 0.2360679775 * np.arange(2000)
    assert abs(chaos_test(np.cos(angle)[:, None])) < 0.05
