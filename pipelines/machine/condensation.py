"""Static (Guyan) condensation of the rotor onto its master nodes, and its state-space form.

With the freedoms split into masters m (x, y of the master nodes, and alpha, beta of those that keep their
slopes) and slaves s (everything else), the slaves follow the masters as in statics,

    x = T x_m,   T = [I; -K_ss^-1 K_sm]   (rows in the order of the full freedoms)

and the condensed matrices of Eq. 11 are T' A T for A = M, C, G, K; the gravity load is T' F. Motions in which
the slaves do not follow the masters statically are lost. An overhung wheel tilts independently of its
translation: its slopes should be masters too.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices

FloatArray = NDArray[np.float64]

# The slaves' displacements lose log10(condition) of their 16 digits; at least four must remain.
LARGEST_SLAVE_CONDITION = 1e12
BUCKLED = (
    "the axial forces buckle the shaft between its masters {masters}: more masters, or a smaller compression"
)


@dataclass(frozen=True)
class CondensedRotor:
    """The rotor on its master nodes, with n freedoms x_1, y_1, [alpha_1, beta_1], ..., matrices (n, n).

    ``freedoms`` (n,): their indices in the full freedoms. ``gyroscopic`` is to be multiplied by the rotating
    speed. ``transformation`` (4 nodes, n) gives the full displacement from that of the masters.
    """

    freedoms: NDArray[np.intp]
    mass: FloatArray
    damping: FloatArray
    gyroscopic: FloatArray
    stiffness: FloatArray
    gravity_load: FloatArray
    transformation: FloatArray

    @property
    def masters(self) -> tuple[int, ...]:
        """The master nodes."""
        return tuple(dict.fromkeys((self.freedoms // NODE_FREEDOMS).tolist()))

    @property
    def slopes(self) -> tuple[int, ...]:
        """Master nodes that keep their slopes."""
        return tuple(dict.fromkeys((self.freedoms[is_slope(self.freedoms)] // NODE_FREEDOMS).tolist()))

    def position(self, node: int) -> int:
        """Index of the freedom x of a master node, y follows; raises ValueError for another node."""
        found = np.flatnonzero(self.freedoms == NODE_FREEDOMS * node)
        if not found.size:
            raise ValueError(f"node {node} is not a master node; the masters are {list(self.masters)}")
        return int(found[0])

    def scaled(self, time: float, displacement: float, force: float, length: float = 1.0) -> CondensedRotor:
        """The same rotor in units of ``time`` [s], ``displacement`` [m], ``force`` [N] and ``length`` [m].

        ``length`` is the unit along the shaft: slopes are in units of ``displacement / length``, moments in
        units of ``force length``, the speed in units of 1 / ``time``. The transformation gives translations
        in units of ``displacement``, and rotations in units of ``displacement`` over one metre.
        """
        slope = np.where(is_slope(self.freedoms), 1.0 / length, 1.0)
        both, per_displacement = np.outer(slope, slope), displacement / force
        return CondensedRotor(
            freedoms=self.freedoms,
            mass=self.mass * both * (per_displacement / time**2),
            damping=self.damping * both * (per_displacement / time),
            # Omega G: the speed carries one of the two units of 1 / time
            gyroscopic=self.gyroscopic * both * (per_displacement / time**2),
            stiffness=self.stiffness * both * per_displacement,
            gravity_load=self.gravity_load * slope / force,
            transformation=self.transformation * slope,
        )


@dataclass(frozen=True)
class StateSpace:
    """First-order form of the rotor: y' = (constant + Omega per_speed) y + force_input F + gravity (Eq. 12).

    y = [x_1, y_1, [alpha_1, beta_1], ..., velocities]. ``constant`` and ``per_speed`` have shape (2 n, 2 n),
    ``gravity`` (2 n,). ``force_input`` has shape (2 n, n): column j is the response to a unit force (or
    moment) on master freedom j.
    """

    constant: FloatArray
    per_speed: FloatArray
    force_input: FloatArray
    gravity: FloatArray


def master_freedoms(masters: Sequence[int], slopes: Collection[int] = ()) -> NDArray[np.intp]:
    """Indices of the master freedoms among the full ones.

    These are x and y of every node in ``masters``, followed by its alpha and beta if it is in ``slopes``.
    """
    of_node = [range(NODE_FREEDOMS if node in slopes else 2) for node in masters]
    return np.array(
        [NODE_FREEDOMS * node + k for node, own in zip(masters, of_node, strict=True) for k in own],
        dtype=np.intp,
    )


def is_slope(freedoms: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of these full freedoms are rotations."""
    return np.asarray(freedoms % NODE_FREEDOMS >= 2)


def static_transformation(
    stiffness: FloatArray, masters: Sequence[int], slopes: Collection[int] = ()
) -> FloatArray:
    """T of the module's head, shape (size, n), for a stiffness of shape (size, size).

    Raises ValueError if masters are missing, repeated or unknown, if K_ss is too ill conditioned: then the
    masters do not hold the rotor (one master alone leaves it free to tilt), or the stiffnesses of its parts
    differ too much; and if K_ss is not positive: axial forces then buckle the shaft between its masters, and
    the condensed rotor would not know.
    """
    size = stiffness.shape[0]
    unknown = [node for node in masters if not 0 <= node < size // NODE_FREEDOMS]
    if unknown or len(set(masters)) != len(masters) or not masters:
        raise ValueError(
            f"masters must be different nodes from 0 to {size // NODE_FREEDOMS - 1}; given {list(masters)}"
        )
    master = master_freedoms(masters, slopes)
    slave = np.setdiff1d(np.arange(size), master)
    transformation = np.zeros((size, master.size))
    transformation[master, np.arange(master.size)] = 1.0
    if not slave.size:
        return transformation

    # Scale by the diagonal first: rotations and displacements differ by the square of a length.
    slave_stiffness = stiffness[np.ix_(slave, slave)]
    diagonal = np.diag(slave_stiffness)
    if np.min(diagonal) <= 0.0:
        raise ValueError(BUCKLED.format(masters=list(masters)))
    scale = 1.0 / np.sqrt(diagonal)
    scaled_stiffness = scale[:, None] * slave_stiffness * scale
    condition = float(np.linalg.cond(scaled_stiffness))
    if not condition < LARGEST_SLAVE_CONDITION:
        raise ValueError(
            f"the masters {list(masters)} do not determine the rest of the rotor: condition number of the "
            f"slave stiffness {condition:.1e}, allowed below {LARGEST_SLAVE_CONDITION:.0e}; choose at least "
            "two masters, spread along the shaft"
        )
    if linalg.eigvalsh(0.5 * (scaled_stiffness + scaled_stiffness.T), subset_by_index=[0, 0])[0] <= 0.0:
        raise ValueError(BUCKLED.format(masters=list(masters)))
    coupling = scale[:, None] * stiffness[np.ix_(slave, master)]

    # x_s = -K_ss^-1 K_sm x_m
    transformation[slave] = -scale[:, None] * linalg.solve(scaled_stiffness, coupling)
    return transformation


def condense(rotor: RotorMatrices, masters: Sequence[int], slopes: Collection[int] = ()) -> CondensedRotor:
    """Condense the rotor onto its masters (Eq. 11); those in ``slopes`` keep their rotations too.

    Raises ValueError as ``static_transformation`` does.
    """
    transformation = static_transformation(rotor.stiffness, masters, slopes)

    def reduced(matrix: FloatArray) -> FloatArray:
        product: FloatArray = transformation.T @ matrix @ transformation
        return product

    return CondensedRotor(
        freedoms=master_freedoms(masters, slopes),
        mass=reduced(rotor.mass),
        damping=reduced(rotor.damping),
        gyroscopic=reduced(rotor.gyroscopic),
        stiffness=reduced(rotor.stiffness),
        gravity_load=transformation.T @ rotor.gravity_load,
        transformation=transformation,
    )


def state_space(condensed: CondensedRotor) -> StateSpace:
    """First-order form of the condensed rotor, in the units of its matrices (Eq. 12).

    [x]'   [    0         I    ] [x]         [0      0    ] [x]   [  0  ]
    [v]  = [-M^-1 K   -M^-1 C  ] [v] + Omega [0   -M^-1 G ] [v] + [M^-1 ] (F + F_gravity)
    """
    freedoms = condensed.mass.shape[0]
    factor = linalg.cho_factor(condensed.mass)
    position, velocity = slice(0, freedoms), slice(freedoms, 2 * freedoms)

    constant = np.zeros((2 * freedoms, 2 * freedoms))
    constant[position, velocity] = np.eye(freedoms)
    constant[velocity, position] = -linalg.cho_solve(factor, condensed.stiffness)
    constant[velocity, velocity] = -linalg.cho_solve(factor, condensed.damping)
    per_speed = np.zeros_like(constant)
    per_speed[velocity, velocity] = -linalg.cho_solve(factor, condensed.gyroscopic)
    force_input = np.zeros((2 * freedoms, freedoms))
    force_input[velocity] = linalg.cho_solve(factor, np.eye(freedoms))
    return StateSpace(constant, per_speed, force_input, force_input @ condensed.gravity_load)
