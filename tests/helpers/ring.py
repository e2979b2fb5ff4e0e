"""The displacement of the active ring over an array of angles, by the compiled functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.ring import ring_axes_at, ring_displacement_at, ring_rate_at

FloatArray = NDArray[np.float64]


def ring_deformation(
    cosine: FloatArray,
    sine: FloatArray,
    phase: float,
    displacement: float,
    frequency: float,
    ratio: float,
    radius_over_clearance: float,
    amplitude: float = 1.0,
    phase_shift: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Ring displacement q_r and rate d q_r / d tau, both over c_r and of the shape of ``cosine`` (Eq. 23-25).

    ``cosine`` and ``sine`` belong to the film angles; the other arguments are those of ``ring_axes_at`` and R
    / c_r.
    """
    horizontal, vertical, horizontal_rate, vertical_rate = ring_axes_at.py_func(
        phase, displacement, frequency, ratio, amplitude, phase_shift
    )
    q = ring_displacement_at.py_func(cosine, sine, horizontal, vertical, radius_over_clearance)
    rate = ring_rate_at.py_func(
        cosine, sine, horizontal, vertical, horizontal_rate, vertical_rate, radius_over_clearance
    )
    return q, rate
