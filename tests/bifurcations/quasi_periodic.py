"""Maps and flows with invariant curves, most of them known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.system import DynamicalSystem
from tests.bifurcations.explicit_maps import ExplicitMap, explicit_map

# --- A rotation seen through a Moebius map ----------------------------------------------------------


def _times(a: Any, b: Any) -> tuple[Any, Any]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _over(a: Any, b: Any) -> tuple[Any, Any]:
    size = b[0] * b[0] + b[1] * b[1]
    return _times(a, (b[0] / size, -b[1] / size))


def moebius_rotation() -> ExplicitMap:
    """s = h(w) = w/(1 - e w) with w -> (1 + m) exp(i theta) w (1 + (d + i b) |w|^2) underneath.

    Parameters (m, theta, d, b, e).  The circle |w| = r with (1 + m) |1 + (d + i b) r^2| = 1 is seen as

        x(phi) = sum_{k > 0} e^(k-1) r^k exp(i k phi),    rho = theta + arg(1 + (d + i b) r^2)

    so that the amplitudes of its wave numbers fall exactly like (e r)^k.
    """

    def function(s, p):  # type: ignore[no-untyped-def]
        m, theta, d, b, e = p[:5]
        # h^-1(s) = s/(1 + e s)
        w = _over((s[0], s[1]), (1.0 + e * s[0], e * s[1]))
        square = w[0] * w[0] + w[1] * w[1]
        w = _times(w, (1.0 + d * square, b * square))
        w = _times(w, ((1.0 + m) * np.cos(theta), (1.0 + m) * np.sin(theta)))
        return _over(w, (1.0 - e * w[0], -e * w[1]))

    return explicit_map(2, ("m", "theta", "d", "b", "e"), function)


def moebius_circle(m: float, theta: float, d: float, b: float) -> tuple[float, float, float]:
    """r, rho and the normal multiplier dr_next/dr of the circle near w = 0, for d < 0."""
    # (1 + 2 d q + (d^2 + b^2) q^2) (1 + m)^2 = 1 for q = r^2
    square = float(min(root.real for root in np.roots([d * d + b * b, 2.0 * d, 1.0 - (1.0 + m) ** -2])))
    factor = 1.0 + (d + 1j * b) * square
    # d log(r |1 + (d + i b) r^2|)/d log r
    slope = 1.0 + 2.0 * square * ((np.conj(factor) * (d + 1j * b)).real) / abs(factor) ** 2
    return np.sqrt(square), theta + float(np.angle(factor)), slope


# --- Tori that lose their stability in every way ------------------------------------------------------


def folded_circle() -> ExplicitMap:
    """w -> (1 + m + d |w|^2 - e |w|^4) exp(i theta) w, seen through s = w/(1 - 0.3 w); parameters (m, d, e).

    Circles m + d r^2 - e r^4 = 0, theta = 1; fold at r^2 = d/(2 e), m = -d^2/(4 e).
    """

    def function(s, p):  # type: ignore[no-untyped-def]
        w = _over((s[0], s[1]), (1.0 + 0.3 * s[0], 0.3 * s[1]))
        square = w[0] * w[0] + w[1] * w[1]
        w = _times(w, (np.cos(1.0), np.sin(1.0)))
        factor = 1.0 + p[0] + p[1] * square - p[2] * square * square
        w = factor * w[0], factor * w[1]
        return _over(w, (1.0 - 0.3 * w[0], -0.3 * w[1]))

    return explicit_map(2, ("m", "d", "e"), function)


CIRCLE_TURN = 1.3


def losing_circle(kind: str) -> ExplicitMap:
    """The circle |w| = 1 with turn 1.3 and a normal bundle z = (u, v) that is carried to p (1 + k x) R z.

    The moduli of R = 1, -1, or a rotation by 0.7 (``kind``: branch_point, period_doubling, hopf) become
    p (1 + sqrt(1 - k^2))/2, because the mean of log(1 + k cos) is that of the factor. For "moebius" the
    bundle with the moduli p and 0.3 turns by half the angle. Parameters (p, k).
    """

    def function(s, p):  # type: ignore[no-untyped-def]
        x, y, u, v = s
        square = x * x + y * y
        w = _times((x, y), (np.cos(CIRCLE_TURN), np.sin(CIRCLE_TURN)))
        factor = 1.3 - 0.3 * square
        size = p[0] * (1.0 + p[1] * x)
        if kind == "hopf":
            z = _times((u, v), (size * np.cos(0.7), size * np.sin(0.7)))
        elif kind == "moebius":  # R(rho/2) R(theta/2) diag(p, 0.3) R(-theta/2)
            mean, half = 0.5 * (p[0] + 0.3), 0.5 * (p[0] - 0.3)
            z = mean * u + half * (x * u + y * v), mean * v + half * (y * u - x * v)
            z = _times(z, (np.cos(0.5 * CIRCLE_TURN), np.sin(0.5 * CIRCLE_TURN)))
        else:
            sign = 1.0 if kind == "branch_point" else -1.0
            z = sign * size * u, 0.4 * v
        return factor * w[0], factor * w[1], z[0], z[1]

    return explicit_map(4, ("p", "k"), function)


# --- Flows ------------------------------------------------------------------------------------------


@njit(RATES, cache=True)
def two_tone_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    second = p[4] + phase * p[1] / p[0]
    out[0] = s[1]
    out[1] = -constants[0] * s[1] - s[0] - constants[1] * s[0] ** 3 + p[2] * np.cos(phase)
    out[1] += p[3] * np.cos(second) * (1.0 + constants[2] * np.cos(phase))


@njit(TANGENT, cache=True)
def two_tone_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = block[1, j]
        out[1, j] = -constants[0] * block[1, j] - (1.0 + 3.0 * constants[1] * s[0] ** 2) * block[0, j]


def two_tones(damping: float = 0.2, cubic: float = 0.0, modulation: float = 0.0) -> DynamicalSystem:
    """x'' + c x' + x + g x^3 = F cos(phase) + G cos(angle + speed tau)(1 + k cos(phase)), phase = omega tau.

    Parameters (frequency, speed, F, G, angle), constants (c, g, k).  For g = 0 the response to each
    frequency is known, and the multipliers are exp((-c/2 +- i sqrt(1 - c^2/4)) T).
    """
    return DynamicalSystem(
        2, two_tone_rates, two_tone_tangent, ("frequency", "speed", "F", "G", "angle"), forcing=0,
        constants=np.array([damping, cubic, modulation]),
    )  # fmt: skip


@njit(RATES, cache=True)
def van_der_pol_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = s[1]
    out[1] = p[1] * (1.0 - s[0] ** 2) * s[1] - s[0] + p[2] * np.cos(phase)


@njit(TANGENT, cache=True)
def van_der_pol_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = block[1, j]
        out[1, j] = p[1] * (1.0 - s[0] ** 2) * block[1, j] - (1.0 + 2.0 * p[1] * s[0] * s[1]) * block[0, j]


def van_der_pol() -> DynamicalSystem:
    """x'' - mu (1 - x^2) x' + x = a cos(omega tau), parameters (omega, mu, a)."""
    return DynamicalSystem(2, van_der_pol_rates, van_der_pol_tangent, ("omega", "mu", "a"), forcing=0)


@njit(RATES, cache=True)
def shaken_hopf_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y = s[0] - p[3] * np.cos(phase), s[1] - p[3] * np.sin(phase)
    radius = x * x + y * y
    out[0] = (p[1] - radius) * x - (constants[0] + p[2] * radius) * y - p[3] * p[0] * np.sin(phase)
    out[1] = (p[1] - radius) * y + (constants[0] + p[2] * radius) * x + p[3] * p[0] * np.cos(phase)


@njit(TANGENT, cache=True)
def shaken_hopf_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    x, y = s[0] - p[3] * np.cos(phase), s[1] - p[3] * np.sin(phase)
    radius = x * x + y * y
    for j in range(block.shape[1]):
        a, b = block[0, j], block[1, j]
        change = 2.0 * (x * a + y * b)
        out[0, j] = (p[1] - radius) * a - change * x - (constants[0] + p[2] * radius) * b - p[2] * change * y
        out[1, j] = (p[1] - radius) * b - change * y + (constants[0] + p[2] * radius) * a + p[2] * change * x


def shaken_hopf(own: float) -> DynamicalSystem:
    """z = s_1 + i s_2 - F exp(i phase) obeys z' = (mu + i w) z - (1 - i b) z |z|^2 with w = ``own``.

    Parameters (omega, mu, b, F).  The cycle z = 0 has the multipliers exp((mu +- i w) T); its Neimark-Sacker
    point is mu = 0.  The torus has |z|^2 = mu, rho = (w + b mu) T and the normal multiplier exp(-2 mu T).
    """
    return DynamicalSystem(
        2, shaken_hopf_rates, shaken_hopf_tangent, ("omega", "mu", "b", "F"), forcing=0,
        constants=np.array([own]),
    )  # fmt: skip
