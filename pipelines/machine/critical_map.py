"""Undamped critical speeds of the rotor over the stiffness of its supports: the critical speed map.

Both bearings are replaced by the same stiffness k in x and y. A circular whirl at the rotating speed,
x = u, y = -i u (backward: +i u), beta = s, alpha = i s (backward: -i s), is q = P (u, s), which gives

    (K_p + k E) w = Omega^2 (M_p - G_p) w,   K_p = P* K P / 2,  M_p = P* M P / 2,  G_p = P* (i G) P / 2
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from pipelines.machine.shaft import NODE_FREEDOMS, RotorMatrices

FloatArray = NDArray[np.float64]
REAL = 1e-6  # an eigenvalue with a smaller imaginary part, over its modulus, is real


def critical_map(
    rotor: RotorMatrices, nodes: Sequence[int], stiffness: FloatArray, modes: int, backward: bool = False
) -> FloatArray:
    """The lowest ``modes`` critical speeds [rad/s] at every stiffness [N/m], (stiffness, modes).

    NaN where there are fewer: a thin disc on a soft shaft has no forward tilt at its own speed.
    """
    plane = _circular_whirl(rotor.nodes, -1.0 if backward else 1.0)

    def projected(matrix: NDArray[Any]) -> FloatArray:
        return np.asarray((plane.conj().T @ matrix @ plane).real / 2.0)

    own, inertia = projected(rotor.stiffness), projected(rotor.mass - 1j * rotor.gyroscopic)
    held = np.zeros(own.shape[0])
    held[2 * np.array(nodes)] = 1.0
    found = np.full((len(stiffness), modes), np.nan)
    for row, each in enumerate(stiffness.tolist()):
        squares = linalg.eigvals(own + each * np.diag(held), inertia)
        squares = squares[np.isfinite(squares) & (np.abs(squares.imag) <= REAL * np.abs(squares))].real
        speeds = np.sqrt(np.sort(squares[squares > 0.0]))[:modes]
        found[row, : len(speeds)] = speeds
    return found


def _circular_whirl(nodes: int, sign: float) -> NDArray[np.complex128]:
    """P, (4 nodes, 2 nodes): displacement and slope of each node in one plane to all its freedoms."""
    one = np.zeros((NODE_FREEDOMS, 2), dtype=np.complex128)
    one[0, 0], one[1, 0] = 1.0, -1j * sign
    one[3, 1], one[2, 1] = 1.0, 1j * sign
    return np.asarray(np.kron(np.eye(nodes), one))
