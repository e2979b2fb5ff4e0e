"""The rotor at rest: its mass, its centre of gravity, and the static loads of its bearings.

The bearings hold the rotor rigidly; with the displacements q that are left free,

    K_ff q_f = F_f,   load = K_bf q_f - F_b

with the stiffness K of shaft and supports and the weight F. Two bearings without further supports carry what
the law of the lever says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.case.rotor import Rotor
from pipelines.machine.shaft import NODE_FREEDOMS, assemble_rotor


@dataclass(frozen=True)
class RotorAtRest:
    """Mass [kg], axial position of the centre of gravity [m] from node 0, downward bearing loads [N]."""

    mass: float
    centre: float
    loads: tuple[float, ...]


def rotor_at_rest(rotor: Rotor, bearing_nodes: Sequence[int]) -> RotorAtRest:
    """Mass, centre of gravity and static loads of the bearings at some nodes."""
    matrices = assemble_rotor(rotor)
    mass = matrices.mass
    vertical = np.arange(1, len(mass), NODE_FREEDOMS)
    unit, slope = np.zeros(len(mass)), np.zeros(len(mass))  # rigid motions y = 1 and y = z
    unit[vertical], slope[vertical] = 1.0, matrices.node_position
    slope[vertical + 1] = -1.0  # alpha = -y'
    total = float(unit @ mass @ unit)
    held = vertical[list(bearing_nodes)]
    free = np.setdiff1d(np.arange(len(mass)), [held, held - 1])  # the bearings hold x and y
    stiffness, weight = matrices.stiffness, matrices.gravity_load
    deflection = np.linalg.solve(stiffness[np.ix_(free, free)], weight[free])
    loads = stiffness[np.ix_(held, free)] @ deflection - weight[held]
    return RotorAtRest(total, float(slope @ mass @ unit) / total, tuple(loads.tolist()))
