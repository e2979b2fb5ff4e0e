"""Small systems with known answers, as compiled kernels and as plain Python."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from pipelines.machine.kernels import RATES, TANGENT
from pipelines.orbits.compiled import dense_shifted
from pipelines.orbits.system import DynamicalSystem

# --- Tondl's self-excited oscillator with parametric coupling, tests/reference/tondl_verified_point

_P, _K1, _K2, _K12, _EPS, _C2, _GAMMA, _KAPPA = 0.5, 1.0, 3.0, 0.6, 0.5, 0.2, 0.3, 0.2


@njit(RATES, cache=True)
def tondl_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    coupling = _K12 * (1.0 + _EPS * np.sin(phase))
    out[0] = s[2]
    out[1] = s[3]
    out[2] = (
        _P + p[0] * s[2] - _GAMMA * s[2] ** 3 - _K1 * s[0] - _KAPPA * s[0] ** 3 - coupling * (s[0] - s[1])
    )
    out[3] = -_C2 * s[3] - _K2 * s[1] - coupling * (s[1] - s[0])


@njit(TANGENT, cache=True)
def tondl_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    coupling = _K12 * (1.0 + _EPS * np.sin(phase))
    for j in range(block.shape[1]):
        out[0, j] = block[2, j]
        out[1, j] = block[3, j]
        out[2, j] = (
            (p[0] - 3.0 * _GAMMA * s[2] ** 2) * block[2, j]
            - (_K1 + 3.0 * _KAPPA * s[0] ** 2 + coupling) * block[0, j]
            + coupling * block[1, j]
        )
        out[3, j] = -_C2 * block[3, j] - (_K2 + coupling) * block[1, j] + coupling * block[0, j]


def tondl() -> DynamicalSystem:
    """State (x1, x2, v1, v2), parameters (c1, eta)."""
    return DynamicalSystem(4, tondl_rates, tondl_tangent, ("c1", "eta"), forcing=1)


# --- Linear systems s' = A(phase) s ---------------------------------------------------------------


@njit(RATES, cache=True)
def mathieu_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = s[1]
    out[1] = -(p[0] - 2.0 * p[1] * np.cos(phase)) * s[0]


@njit(TANGENT, cache=True)
def mathieu_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = block[1, j]
        out[1, j] = -(p[0] - 2.0 * p[1] * np.cos(phase)) * block[0, j]


def mathieu() -> DynamicalSystem:
    """x'' + (a - 2 q cos(omega tau)) x = 0 with parameters (a, q, omega); omega = 2 is the classical form."""
    return DynamicalSystem(2, mathieu_rates, mathieu_tangent, ("a", "q", "omega"), forcing=2)


@njit(RATES, cache=True)
def coupled_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    pump = p[1] * np.cos(phase)
    out[0] = s[2]
    out[1] = s[3]
    out[2] = -constants[0] * s[2] - (2.0 + pump) * s[0] + (1.0 + pump) * s[1]
    out[3] = -constants[1] * s[3] - (3.0 + pump) * s[1] + (1.0 + pump) * s[0]


@njit(TANGENT, cache=True)
def coupled_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    pump = p[1] * np.cos(phase)
    for j in range(block.shape[1]):
        out[0, j] = block[2, j]
        out[1, j] = block[3, j]
        out[2, j] = -constants[0] * block[2, j] - (2.0 + pump) * block[0, j] + (1.0 + pump) * block[1, j]
        out[3, j] = -constants[1] * block[3, j] - (3.0 + pump) * block[1, j] + (1.0 + pump) * block[0, j]


def parametric_pair(damping: tuple[float, float]) -> DynamicalSystem:
    """x'' + diag(damping) x' + (K0 + eps cos(omega tau) K1) x = 0, parameters (omega, eps)."""
    return DynamicalSystem(
        4, coupled_rates, coupled_tangent, ("omega", "eps"), forcing=0, constants=np.array(damping)
    )


# --- Hopf normal form beside a linear pair --------------------------------------------------------


@njit(RATES, cache=True)
def hopf_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    radius = s[0] ** 2 + s[1] ** 2
    out[0] = (p[0] - radius) * s[0] - (1.0 + p[1] * radius) * s[1]
    out[1] = (p[0] - radius) * s[1] + (1.0 + p[1] * radius) * s[0]
    out[2] = constants[0] * s[2] - constants[1] * s[3] + constants[2] * s[0]
    out[3] = constants[1] * s[2] + constants[0] * s[3]


@njit(TANGENT, cache=True)
def hopf_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    radius = s[0] ** 2 + s[1] ** 2
    for j in range(block.shape[1]):
        dr = 2.0 * (s[0] * block[0, j] + s[1] * block[1, j])
        out[0, j] = (
            (p[0] - radius) * block[0, j] - dr * s[0] - (1.0 + p[1] * radius) * block[1, j] - p[1] * dr * s[1]
        )
        out[1, j] = (
            (p[0] - radius) * block[1, j] - dr * s[1] + (1.0 + p[1] * radius) * block[0, j] + p[1] * dr * s[0]
        )
        out[2, j] = constants[0] * block[2, j] - constants[1] * block[3, j] + constants[2] * block[0, j]
        out[3, j] = constants[1] * block[2, j] + constants[0] * block[3, j]


def hopf_pair(decay: float = -0.1, frequency: float = 0.4, drive: float = 0.3) -> DynamicalSystem:
    """z' = (mu + i) z - (1 - i b) z abs(z)^2, and a pair with eigenvalues decay +- i frequency driven by Re
    z.

    Parameters (mu, b).  The cycle has abs(z)^2 = mu, T = 2 pi / (1 + b mu) and the multipliers 1, exp(-2 mu
    T), exp((decay +- i frequency) T).
    """
    return DynamicalSystem(
        4, hopf_rates, hopf_tangent, ("mu", "b"), constants=np.array([decay, frequency, drive])
    )


# --- Forced Duffing oscillator --------------------------------------------------------------------


@njit(RATES, cache=True)
def duffing_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = s[1]
    out[1] = -0.1 * s[1] - s[0] - s[0] ** 3 + p[1] * np.cos(phase)


@njit(TANGENT, cache=True)
def duffing_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    for j in range(block.shape[1]):
        out[0, j] = block[1, j]
        out[1, j] = -0.1 * block[1, j] - (1.0 + 3.0 * s[0] ** 2) * block[0, j]


def duffing() -> DynamicalSystem:
    """x'' + 0.1 x' + x + x^3 = load cos(omega tau), parameters (omega, load)."""
    return DynamicalSystem(2, duffing_rates, duffing_tangent, ("omega", "load"), forcing=0)


# --- Damped Mathieu oscillator --------------------------------------------------------------------

LEVER = 20.0  # of the damping: a tongue is so much longer in its parameter than in the frequency


@njit(RATES, cache=True)
def damped_mathieu_rates(phase, s, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    out[0] = s[1]
    out[1] = -2.0 * p[1] / constants[0] * s[1] - (1.0 + p[2] * np.cos(phase) + s[0] ** 2) * s[0]


@njit(TANGENT, cache=True)
def damped_mathieu_tangent(phase, s, block, p, constants, layout, work, out):  # type: ignore[no-untyped-def]
    stiffness = 1.0 + p[2] * np.cos(phase) + 3.0 * s[0] ** 2
    for j in range(block.shape[1]):
        out[0, j] = block[1, j]
        out[1, j] = -2.0 * p[1] / constants[0] * block[1, j] - stiffness * block[0, j]


def damped_mathieu() -> DynamicalSystem:
    """x'' + 2 damping/LEVER x' + (1 + h cos(omega tau)) x + x^3 = 0 with parameters (omega, damping, h).

    At rest the product of the multipliers is exp(-2 damping T/LEVER): Neimark-Sacker points at damping = 0
    but for the tongues around omega = 2/n, see ``mathieu_tongue``.
    """
    return DynamicalSystem(
        2, damped_mathieu_rates, damped_mathieu_tangent, ("omega", "damping", "h"), forcing=0,
        constants=np.array([LEVER]),
    )  # fmt: skip


def mathieu_tongue(order: int, h: float) -> tuple[float, float]:
    """Both ends of the n-th tongue of ``damped_mathieu`` at damping = 0, in omega: exact.

    With t = omega tau/2 the equation is x'' + (a + 2 q cos 2t) x = 0, a = 4/omega^2, q = 2 h/omega^2; the
    tongue lies between the characteristic values b_n(q) and a_n(q) (DLMF 28.2).
    """

    def end(characteristic) -> float:  # type: ignore[no-untyped-def]
        def gap(omega: float) -> float:
            return float(4.0 / omega**2 - characteristic(order, 2.0 * h / omega**2))

        return float(brentq(gap, 1.8 / order, 2.2 / order, xtol=1e-15))

    first, second = sorted((end(mathieu_a), end(mathieu_b)))
    return first, second


def implicit(system: DynamicalSystem) -> DynamicalSystem:
    """A small compiled system with which implicit steppers work too."""
    return replace(system, shifted=dense_shifted(system.tangent, system.size))


def closed_form_hopf_multipliers(mu: float, b: float, decay: float, frequency: float) -> np.ndarray:
    """The four multipliers of ``hopf_pair`` by falling modulus."""
    period = 2.0 * np.pi / (1.0 + b * mu)
    pair = np.exp((decay + 1j * frequency) * period)
    values = np.array([1.0, np.exp(-2.0 * mu * period), pair, np.conj(pair)])
    return values[np.argsort(-np.abs(values), kind="stable")]
