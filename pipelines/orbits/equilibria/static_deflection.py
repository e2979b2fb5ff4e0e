"""The rotor at rest in its bearings: reactions, and the deflection of all shaft nodes under its weight.

With the masters m, whose displacement the equilibrium gives, and the other freedoms s,

    K_ss u_s = f_s - K_sm u_m

f is the weight.  The condensation alone would leave out what the weight bends between the masters.
"""

from __future__ import annotations

import numpy as np

from pipelines.case.arrays import Array
from pipelines.machine.assembly import Machine
from pipelines.machine.condensation import is_slope
from pipelines.machine.shaft import NODE_FREEDOMS
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest


def bearing_reactions(machine: Machine, parameters: Array, state: Array) -> Array:
    """Forces of the films on the rotor in an equilibrium [N], shape (bearings, 2)."""
    still = at_rest(parameters)
    return np.array(
        [
            machine.film(index, MEAN_PHASE, state, still).force * machine.scales.bearings[index].force
            for index in range(len(machine.bearings))
        ]
    )


def full_displacement(machine: Machine, state: Array) -> Array:
    """Displacements x, y, alpha, beta of all nodes in an equilibrium [m, rad], shape (4 nodes,)."""
    rotor, masters, scales = machine.rotor, machine.condensed.freedoms, machine.scales
    slope = scales.displacement / scales.bearings[0].length
    unit = np.where(is_slope(masters), slope, scales.displacement)
    whole = np.zeros(rotor.stiffness.shape[0])
    whole[masters] = machine.masters(state) * unit
    others = np.setdiff1d(np.arange(whole.size), masters)
    if others.size:
        load = rotor.gravity_load[others] - rotor.stiffness[np.ix_(others, masters)] @ whole[masters]
        whole[others] = np.linalg.solve(rotor.stiffness[np.ix_(others, others)], load)
    return whole


def static_deflection(machine: Machine, state: Array) -> Array:
    """Displacements x and y of all shaft nodes from the line of the bearings' centres [m], (nodes, 2)."""
    return full_displacement(machine, state).reshape(-1, NODE_FREEDOMS)[:, :2]
