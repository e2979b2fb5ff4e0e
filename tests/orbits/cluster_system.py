"""A machine in miniature: weakly damped oscillators, a cluster of relaxing states and a nonlinear spring."""

from __future__ import annotations

import math

import numpy as np

from pipelines.orbits.system import DynamicalSystem, ode_system

CLUSTER_MULTIPLIER = 0.043  # exp(-T k_f / c_f) with eta = 1 and Omega_ex = 2
FREQUENCY = 2.0


def cluster_system(oscillators: int = 6, cluster: int = 78) -> DynamicalSystem:
    """Oscillators y'' + 2 z y' + w^2 y, each driving the relaxing states q' = -r q + coupling y, which feed
    back.

    Parameters (omega, load, feedback).  Without feedback the multipliers are exp((-z +- i w_d) T) and the
    cluster exp(-r T), r spread by one percent around the value which gives CLUSTER_MULTIPLIER.
    """
    size = 2 * oscillators + cluster
    rate = -math.log(CLUSTER_MULTIPLIER) * FREQUENCY / (2.0 * math.pi)
    base = np.zeros((size, size))
    feedback = np.zeros((size, size))
    for j in range(oscillators):
        stiffness = (0.9 + 0.37 * j) ** 2
        base[2 * j, 2 * j + 1] = 1.0
        base[2 * j + 1, 2 * j : 2 * j + 2] = -stiffness, -0.06 - 0.02 * j
    for k in range(cluster):
        row, angle = 2 * oscillators + k, 2.0 * math.pi * k / cluster
        base[row, row] = -rate * (1.0 + 0.01 * math.cos(7.0 * angle))
        for j in range(oscillators):
            base[row, 2 * j] = math.cos((j + 1) * angle)
            feedback[2 * j + 1, row] = 0.4 * math.cos((j + 1) * angle + 0.5) / cluster
    load = np.zeros(size)
    load[1] = 1.0

    def rates(phase, s, p):  # type: ignore[no-untyped-def]
        out = base @ s + p[2] * (feedback @ s) + p[1] * math.cos(phase) * load
        out[1] -= s[0] ** 3
        return out

    def action(phase, s, block, p):  # type: ignore[no-untyped-def]
        out = base @ block + p[2] * (feedback @ block)
        out[1] -= 3.0 * s[0] ** 2 * block[0]
        return out

    return ode_system(rates, None, size, ("omega", "load", "feedback"), "omega", action=action)
