"""The active outer ring: how far it deforms under two opposite loads, and the radial displacement the foil
sees.

Appendix of the paper, with the moment of area corrected. A thick ring of centroidal radius R_c, wall t
(radial) and width b under two opposite loads W changes its diameters by

    vertical    -(W R_c^3 / E I) (pi k1 / 4 - 2 k2^2 / pi)
    horizontal   (W R_c^3 / E I) (2 k2^2 / pi - k2 + k1 / 2)

with I = b t^3/12 and A = b t of the wall's cross section, alpha = I / (A R_c^2), beta = 2 (1 + nu) F alpha
with the form factor F = 6/5 of a rectangle, k2 = 1 - alpha, k1 = 1 - alpha + beta. Either end of a diameter
moves by half.

Displacements below are in units of the clearance c_r and times in units of t0; ``radius_over_clearance`` is R
/ c_r with the bearing radius R. The compiled scalar functions are called by the film kernels; their
``py_func`` takes arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipelines.case.models import Ring

FloatArray = NDArray[np.float64]

RECTANGLE_FORM_FACTOR = 6.0 / 5.0


@dataclass(frozen=True)
class RingCoefficients:
    """k1 and k2 of a ring (both 1 when it is thin) and the deformations they give."""

    k1: float
    k2: float

    @property
    def vertical(self) -> float:
        """Shortening of the loaded diameter over W R_c^3 / E I."""
        return float(np.pi * self.k1 / 4.0 - 2.0 * self.k2**2 / np.pi)

    @property
    def horizontal(self) -> float:
        """Lengthening of the diameter across over W R_c^3 / E I."""
        return float(2.0 * self.k2**2 / np.pi - self.k2 + self.k1 / 2.0)

    @property
    def ratio(self) -> float:
        """rho = |d_h / d_v|."""
        return self.horizontal / self.vertical


THIN_RING = RingCoefficients(k1=1.0, k2=1.0)


def centroidal_radius(ring: Ring) -> float:
    """R_c [m]: inner radius plus half the wall."""
    return ring.inner_radius + 0.5 * ring.thickness


def ring_coefficients(ring: Ring) -> RingCoefficients:
    """k1 and k2 of a ring with rectangular wall, from alpha = t^2 / (12 R_c^2)."""
    alpha = ring.thickness**2 / (12.0 * centroidal_radius(ring) ** 2)
    beta = 2.0 * (1.0 + ring.poisson_ratio) * RECTANGLE_FORM_FACTOR * alpha
    return RingCoefficients(k1=1.0 - alpha + beta, k2=1.0 - alpha)


def ring_displacement_from_load(ring: Ring, load: float) -> float:
    """Largest vertical displacement of the ring's top [m] for the paper's load F0 [N] (Eq. 23).

    The load history is W = F0 (1 + sin Omega_ex tau), so W is largest with 2 F0 and the top then moves by
    half the change of diameter: delta c_r = (F0 R_c^3 / E I)(pi k1 / 4 - 2 k2^2 / pi).
    """
    second_moment = ring.width * ring.thickness**3 / 12.0
    flexibility = centroidal_radius(ring) ** 3 / (ring.young_modulus * second_moment)
    return load * flexibility * ring_coefficients(ring).vertical


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def ring_rate_at(cosine, sine, horizontal, vertical, horizontal_rate, vertical_rate, radius_over_clearance):  # type: ignore[no-untyped-def]
    """Rate d q_r / d tau over c_r at the angle with this cosine and sine (Eq. 25, second line)."""
    along = radius_over_clearance + horizontal
    across = radius_over_clearance + vertical
    root = np.sqrt((along * cosine) ** 2 + (across * sine) ** 2)
    return (along * horizontal_rate * cosine**2 + across * vertical_rate * sine**2) / root


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
