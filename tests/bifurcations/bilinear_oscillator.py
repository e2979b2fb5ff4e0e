"""x'' + c x' + x + k x^+ = f + cos(omega tau): its exact stroboscopic map, and regularised ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pipelines.orbits.system import DynamicalSystem, ode_system
from tests.bifurcations.explicit_maps import ExplicitMap, explicit_map

STIFFENING, OMEGA = 3.0, 2.4
STEPS = 256  # of the regularised maps: resolve the width 0.05
# Near a period doubling; x at phase zero is negative and crosses zero twice in a period.
STATE, START = np.array([-0.32873009, 0.03781935]), (0.166, 0.1)


def exact_map() -> ExplicitMap:
    """Parameters (c, f): linear pieces in closed form between the two moments where x = 0, which Newton's
    method finds to rounding, also of their complex-step derivatives.
    """

    def function(state, p):  # type: ignore[no-untyped-def]
        time = 0.0
        for stiffness, guess in ((1.0, 0.25), (1.0 + STIFFENING, 0.62)):
            crossing = guess * 2.0 * math.pi / OMEGA
            for _ in range(60):
                x, v = _linear_piece(state, time, crossing - time, stiffness, p)
                crossing = crossing - x / v
            state, time = _linear_piece(state, time, crossing - time, stiffness, p), crossing
        return _linear_piece(state, time, 2.0 * math.pi / OMEGA - time, 1.0, p)

    return replace(explicit_map(2, ("c", "f"), function), steps_per_period=STEPS)


def _linear_piece(state, time, duration, stiffness, p) -> Any:  # type: ignore[no-untyped-def]
    """x'' + c x' + stiffness x = f + cos(omega tau) from ``time`` on."""
    half = 0.5 * p[0]
    own = np.sqrt(stiffness - half * half)
    gap, lag = stiffness - OMEGA**2, p[0] * OMEGA
    size = gap * gap + lag * lag

    def forced(t):  # type: ignore[no-untyped-def]
        cosine, sine = np.cos(OMEGA * t), np.sin(OMEGA * t)
        return (
            p[1] / stiffness + (gap * cosine + lag * sine) / size,
            OMEGA * (lag * cosine - gap * sine) / size,
        )

    (x0, v0), (x1, v1) = forced(time), forced(time + duration)
    a = state[0] - x0
    b = (state[1] - v0 + half * a) / own
    decay, cosine, sine = np.exp(-half * duration), np.cos(own * duration), np.sin(own * duration)
    x = decay * (a * cosine + b * sine)
    return np.array([x1 + x, v1 - half * x + decay * own * (b * cosine - a * sine)])


def oscillator(width: float) -> DynamicalSystem:
    """The same with parameters (c, f, clock) in time units of the period, for clock = 2 pi, and x^+ convolved
    with the biweight kernel of half ``width``, which moves integrals over time by O(width^2).
    """
    period = 2.0 * math.pi / OMEGA

    def part(x: float) -> tuple[float, float]:
        if abs(x) >= width:
            return max(x, 0.0), 1.0 if x > 0.0 else 0.0
        t = x / width
        value = 5.0 / 32.0 + t / 2.0 + t * t * (15.0 - 5.0 * t * t + t**4) / 32.0
        return width * value, 0.5 + t * (15.0 - 10.0 * t * t + 3.0 * t**4) / 16.0

    def rates(phase, s, p):  # type: ignore[no-untyped-def]
        force = p[1] + math.cos(phase) - p[0] * s[1] - s[0] - STIFFENING * part(s[0])[0]
        return [period * s[1], period * force]

    def jacobian(phase, s, p):  # type: ignore[no-untyped-def]
        stiffness = 1.0 + STIFFENING * part(s[0])[1]
        return [[0.0, period], [-period * stiffness, -period * p[0]]]

    return ode_system(rates, jacobian, 2, ("c", "f", "clock"), forcing="clock")
