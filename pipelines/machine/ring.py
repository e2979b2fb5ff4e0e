"""The active outer ring: the radial displacement on which the foil rests.

How far the ring deforms under its actuators is computed in ``pipelines.case.ring_statics``.

Displacements below are in units of the clearance c_r and times in units of t0; ``radius_over_clearance`` is R
/ c_r with the bearing radius R. The compiled scalar functions are called by the film kernels; their
``py_func`` takes arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.kernels import kernel

FloatArray = NDArray[np.float64]


@kernel(error_model="numpy")
def ring_axes_at(  # type: ignore[no-untyped-def]
    phase, displacement, frequency, ratio, amplitude, phase_shift, displacement_rate=0.0
):
    """Displacements of the ring's two axes and their rates d/dtau: (d_h, d_v, d_h rate, d_v rate), over c_r.

    ``phase`` is Omega_ex tau [rad], ``displacement`` is delta, ``frequency`` is Omega_ex (dimensionless);
    ``amplitude`` and ``phase_shift`` [rad] are those of the bearing, ``displacement_rate`` is d delta/d tau
    while the excitation is switched.  At frequency 0 the ring rests in its mean position, whatever its phase.
    """
    half = 0.5 * amplitude * displacement
    # d_v = -(delta/2)(1 + sin(Omega_ex tau)),  d_h = -rho d_v
    swing = np.sin(phase + phase_shift) if frequency != 0.0 else 0.0
    vertical = -half * (1.0 + swing)
    vertical_rate = -half * frequency * np.cos(phase + phase_shift)
    vertical_rate -= 0.5 * amplitude * displacement_rate * (1.0 + swing)
    return -ratio * vertical, vertical, -ratio * vertical_rate, vertical_rate


@kernel(error_model="numpy")
def ring_displacement_at(cosine, sine, horizontal, vertical, radius_over_clearance):  # type: ignore[no-untyped-def]
    """Radial displacement q_r of the ring over c_r at the angle with this cosine and sine (Eq. 25).

    With r = R / c_r the paper's sqrt(((r + d_h) cos)^2 + ((r + d_v) sin)^2) - r cancels three digits at r =
    700. The same number without the difference of near equals:

        q_r = [d_h (2 r + d_h) cos^2 + d_v (2 r + d_v) sin^2] / (sqrt(...) + r)
    """
    r = radius_over_clearance
    root = np.sqrt(((r + horizontal) * cosine) ** 2 + ((r + vertical) * sine) ** 2)
    growth = horizontal * (2.0 * r + horizontal) * cosine**2 + vertical * (2.0 * r + vertical) * sine**2
    return growth / (root + r)


@kernel(error_model="numpy")
def ring_rate_at(cosine, sine, horizontal, vertical, horizontal_rate, vertical_rate, radius_over_clearance):  # type: ignore[no-untyped-def]
    """Rate d q_r / d tau over c_r at the angle with this cosine and sine (Eq. 25, second line)."""
    along = radius_over_clearance + horizontal
    across = radius_over_clearance + vertical
    root = np.sqrt((along * cosine) ** 2 + (across * sine) ** 2)
    return (along * horizontal_rate * cosine**2 + across * vertical_rate * sine**2) / root
