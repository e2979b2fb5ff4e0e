"""Mass, centre of gravity and moments of inertia of the whole rotor, and what each bearing carries of it.

From the assembled matrices and rigid motions: r_0 (x = 1), r_1 (x = z, beta = 1), r_2 (y = -z, alpha = 1)

    m = r_0' M r_0,   m z_s = r_0' M r_1,   I_d = r_1' M r_1 - m z_s^2,   I_p = |r_1' G r_2|

The bearings hold the rotor at rest rigidly, supports elastically. With the displacements q_f that are free,
the stiffness K of shaft and supports, and the weight F,

    K_ff q_f = F_f,   load = K_bf q_f - F_b
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices


@dataclass(frozen=True)
class RotorProperties:
    """The rotor as a rigid body, SI.

    Mass, centre of gravity along the shaft from node 0, moments of inertia about it, and the downward loads
    of the bearings.
    """

    mass: float
    centre_of_gravity: float
    diametral_inertia: float
    polar_inertia: float
    bearing_loads: tuple[float, ...]


def rotor_properties(rotor: RotorMatrices, bearing_nodes: Sequence[int]) -> RotorProperties:
    """The properties of an assembled rotor."""
    position = rotor.node_position
    along, tilted, other = np.zeros((3, NODE_FREEDOMS * rotor.nodes))
    along[0::NODE_FREEDOMS] = 1.0
    tilted[0::NODE_FREEDOMS], tilted[3::NODE_FREEDOMS] = position, 1.0
    other[1::NODE_FREEDOMS], other[2::NODE_FREEDOMS] = -position, 1.0
    mass = float(along @ rotor.mass @ along)
    centre = float(along @ rotor.mass @ tilted) / mass
    diametral = float(tilted @ rotor.mass @ tilted) - mass * centre**2
    polar = abs(float(tilted @ rotor.gyroscopic @ other))
    return RotorProperties(mass, centre, diametral, polar, _bearing_loads(rotor, bearing_nodes))


def _bearing_loads(rotor: RotorMatrices, nodes: Sequence[int]) -> tuple[float, ...]:
    """What rigid bearings carry of the weight."""
    held = NODE_FREEDOMS * np.array(nodes) + 1  # their y
    free = np.setdiff1d(np.arange(NODE_FREEDOMS * rotor.nodes), [held, held - 1])
    stiffness, weight = rotor.stiffness, rotor.gravity_load
    deflection = np.linalg.solve(stiffness[np.ix_(free, free)], weight[free])
    loads = stiffness[np.ix_(held, free)] @ deflection - weight[held]
    return tuple(loads.tolist())
