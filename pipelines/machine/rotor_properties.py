"""Mass, centre of gravity and moments of inertia of the whole rotor, and what each bearing carries of it.

From the assembled matrices and rigid motions: r_0 (x = 1), r_1 (x = z, beta = 1), r_2 (y = -z, alpha = 1)

    m = r_0' M r_0,   m z_s = r_0' M r_1,   I_d = r_1' M r_1 - m z_s^2,   I_p = |r_1' G r_2|
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices


@dataclass(frozen=True)
class RotorProperties:
    """The rotor as a rigid body, SI.

    Mass, centre of gravity along the shaft from node 0, moments of inertia about it, and the loads of
    two bearings; no loads (empty) where linear supports carry too.
    """

    mass: float
    centre_of_gravity: float
    diametral_inertia: float
    polar_inertia: float
    bearing_loads: tuple[float, ...]


def rotor_properties(
    rotor: RotorMatrices, bearing_nodes: Sequence[int], supported: bool = False
) -> RotorProperties:
    """The properties of an assembled rotor; ``supported``: it has linear supports too."""
    position = rotor.node_position
    along, tilted, other = np.zeros((3, NODE_FREEDOMS * rotor.nodes))
    along[0::NODE_FREEDOMS] = 1.0
    tilted[0::NODE_FREEDOMS], tilted[3::NODE_FREEDOMS] = position, 1.0
    other[1::NODE_FREEDOMS], other[2::NODE_FREEDOMS] = -position, 1.0
    mass = float(along @ rotor.mass @ along)
    centre = float(along @ rotor.mass @ tilted) / mass
    diametral = float(tilted @ rotor.mass @ tilted) - mass * centre**2
    polar = abs(float(tilted @ rotor.gyroscopic @ other))
    weight = -rotor.gravity_load[1::NODE_FREEDOMS]
    loads: tuple[float, ...] = ()
    if not supported:
        left, right = (position[node] for node in bearing_nodes)
        second = float(weight @ (position - left)) / float(right - left)
        loads = (float(weight.sum()) - second, second)
    return RotorProperties(mass, centre, diametral, polar, loads)
