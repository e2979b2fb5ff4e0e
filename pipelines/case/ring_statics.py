"""Deformation of the active outer ring under two opposite loads.

Appendix of the paper, with the moment of area corrected. A thick ring of centroidal radius R_c, wall t
(radial) and width b under two opposite loads W changes its diameters by

    vertical    -(W R_c^3 / E I) (pi k1 / 4 - 2 k2^2 / pi)
    horizontal   (W R_c^3 / E I) (2 k2^2 / pi - k2 + k1 / 2)

with I = b t^3/12 and A = b t of the wall's cross section, alpha = I / (A R_c^2), beta = 2 (1 + nu) F alpha
with the form factor F = 6/5 of a rectangle, k2 = 1 - alpha, k1 = 1 - alpha + beta. Either end of a diameter
moves by half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipelines.case.bearings import Ring

RECTANGLE_FORM_FACTOR = 6.0 / 5.0


@dataclass(frozen=True)
class RingCoefficients:
    """k1 and k2 of a ring (both 1 when it is thin) and the resulting deformations."""

    k1: float
    k2: float

    @property
    def vertical(self) -> float:
        """Shortening of the loaded diameter over W R_c^3 / E I."""
        return math.pi * self.k1 / 4.0 - 2.0 * self.k2**2 / math.pi

    @property
    def horizontal(self) -> float:
        """Lengthening of the perpendicular diameter over W R_c^3 / E I."""
        return 2.0 * self.k2**2 / math.pi - self.k2 + self.k1 / 2.0

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
