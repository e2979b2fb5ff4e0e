"""A forced pair that depends on a film which grazes, with its exact stroboscopic map and regularised ones.

    u(theta, t) = x + cos theta,   x' = a - x + cos t - sin t,   z' = (b - k G(x) + i nu) z - z |z|^2,

    a = p + b,   G(x) = measure of {theta: u > 0} / 2 pi

On the cycle x = a + cos t, so that over a period ln |mu| = 2 pi (b - k g(a)), where g is the share of all
(theta, t) with a + cos t + cos theta > 0: the film touches u = 0 at a = -2, at one angle and one phase.  With
the density of states of the square lattice,

    g(a) = int_{-2}^{a} K(1 - E^2/4) dE / pi^2,      g = 0 for a <= -2,      g'(-2+) = 1/(2 pi)

The Neimark-Sacker curve b = k g(p + b) is b = 0 up to the corner p = -2, behind which db/dp = s/(1 - s) with
s = k/(2 pi): for s > 1 it turns by more than a right angle.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.special import ellipkm1

from pipelines.bifurcations.plane import Kinks
from tests.bifurcations.explicit_maps import ExplicitMap, explicit_map

NU = 1.2
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def density(a):  # type: ignore[no-untyped-def]
    """g'(a) for a >= -2, continued analytically a little below."""
    return ellipkm1(0.25 * a * a) / math.pi**2


def share(a):  # type: ignore[no-untyped-def]
    """g(a) for a < 0."""
    half = 0.5 * np.maximum(np.asarray(a) + 2.0, 0.0)
    energies = -2.0 + half[..., None] * (1.0 + NODES)
    return half * (density(energies) @ WEIGHTS)


def regularised_share(a: float, width: float) -> float:
    """g with the step of u > 0 convolved with K(t) = 105/64 (1 - t^2)^2 (1 - 3 t^2) over the half width."""
    end = min(1.0, (a + 2.0) / width)
    if end <= -1.0:
        return 0.0
    half = 0.5 * (end + 1.0)
    t = -1.0 + half * (1.0 + NODES)
    kernel = 105.0 / 64.0 * (1.0 - t * t) ** 2 * (1.0 - 3.0 * t * t)
    return half * float(WEIGHTS @ (kernel * share(a - width * t)))


def film_map(slope: float, width: float = 0.0, flip: bool = False) -> ExplicitMap:
    """State (x, Re z, Im z), parameters (p, b), with k = 2 pi ``slope``.

    ``flip``: z is real and its multiplier -exp(...), so that the same curve is one of period doublings.
    """

    def growth(a):  # type: ignore[no-untyped-def]
        """g of the width, differentiated along a complex step."""
        at, h = float(a.real), 1e-6
        if width > 0.0:
            rate = (regularised_share(at + h, width) - regularised_share(at - h, width)) / (2.0 * h)
            return regularised_share(at, width) + 1j * a.imag * rate
        return float(share(at)) + 1j * a.imag * (float(density(at)) if at > -2.0 else 0.0)

    def function(s, p):  # type: ignore[no-untyped-def]
        a = p[0] + p[1]
        log = 2.0 * math.pi * (p[1] - 2.0 * math.pi * slope * growth(np.complex128(a)))
        x = a + 1.0 + math.exp(-2.0 * math.pi) * (s[0] - a - 1.0)
        if flip:
            return x, -np.exp(log) * s[1] * (1.0 - s[1] * s[1])
        size = np.exp(log) * (1.0 - s[1] * s[1] - s[2] * s[2])
        cosine, sine = math.cos(NU), math.sin(NU)
        return x, size * (cosine * s[1] - sine * s[2]), size * (sine * s[1] + cosine * s[2])

    return explicit_map(2 if flip else 3, ("p", "b"), function)


def film_kinks(slope: float, widths: tuple[float, ...], flip: bool = False) -> Kinks:
    """The regularised maps; the distance from grazing is that of a from -2."""

    @cache
    def regularised(width: float) -> ExplicitMap:
        return film_map(slope, width, flip)

    return Kinks(regularised, widths, lambda orbit, parameters: abs(float(np.sum(parameters[:2])) + 2.0))
