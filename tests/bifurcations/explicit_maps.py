"""Maps with known bifurcations in the place of a period map: no integration, closed forms everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipelines.orbits.period_map import OrbitStart, PeriodImage, PeriodMap
from pipelines.orbits.system import DynamicalSystem

Function = Callable[[np.ndarray, np.ndarray], Any]


@dataclass(frozen=True)
class ExplicitMap(PeriodMap):
    """s -> function(s, parameters); its Jacobian is the complex-step derivative, exact to rounding."""

    function: Function | None = None

    def evaluate(  # type: ignore[override]
        self,
        state,
        parameters,
        period,
        steps,
        columns=None,
        inhomogeneous=(),
        reference=None,
        keep_factors=False,
        near=None,
    ) -> PeriodImage:
        size = self.size
        columns = np.zeros((size, 0)) if columns is None else columns
        wide = [self._along(state, parameters, column, None) for column in columns.T]
        extra = [self._along(state, parameters, np.zeros(size), term.parameter) for term in inhomogeneous]
        return PeriodImage(
            start=OrbitStart(state, parameters, period, steps),
            state=self._map(state, parameters).real,
            columns=np.array(wide).reshape(-1, size).T.copy(),
            inhomogeneous=np.array(extra).reshape(-1, size).T.copy(),
            orbit=np.tile(state, (self.samples, 1)),
            phase=0.0,
            phase_columns=np.zeros(columns.shape[1]),
            phase_inhomogeneous=np.zeros(len(inhomogeneous)),
            finite=bool(np.all(np.isfinite(self._map(state, parameters)))),
        )

    def _map(self, state, parameters):  # type: ignore[no-untyped-def]
        assert self.function is not None
        for _ in range(self.period_multiple):
            state = np.array(self.function(state, parameters), dtype=complex)
        return state

    def _along(self, state, parameters, column, parameter):  # type: ignore[no-untyped-def]
        step = 1e-30
        shifted = np.array(parameters, dtype=complex)
        if parameter is not None:
            shifted[parameter] += 1j * step
        return self._map(state + 1j * step * column, shifted).imag / step


def explicit_map(size: int, names: tuple[str, ...], function: Function) -> ExplicitMap:
    """The map as a stroboscopic one of period one, with a last parameter "clock" as its forcing frequency."""

    def unused(*_: Any) -> None:
        raise AssertionError("an explicit map has no rates")

    system = DynamicalSystem(size, unused, unused, (*names, "clock"), forcing=len(names), compiled=False)
    return ExplicitMap(system, samples=1, steps_per_period=1, function=function)


CLOCK = 2.0 * math.pi


def henon() -> ExplicitMap:
    """(x, y) -> (1 - a x^2 + y, b x).

    Fold a = -(1 - b)^2/4 at x = 2/(1 - b), period doubling a = 3 (1 - b)^2/4 at x = 2/(3 (1 - b)), doubling
    of the doubled cycle a = (1 - b)^2 + (1 + b)^2/4.
    """
    return explicit_map(2, ("a", "b"), lambda s, p: (1.0 - p[0] * s[0] * s[0] + s[1], p[1] * s[0]))


def delayed_logistic() -> ExplicitMap:
    """(x, y) -> (r x (1 - y) + e, x): the Neimark-Sacker curve has det = r x = 1 at the fixed point."""
    return explicit_map(2, ("r", "e"), lambda s, p: (p[0] * s[0] * (1.0 - s[1]) + p[1], s[0]))


def rotation_map(third: float = 0.3) -> ExplicitMap:
    """w -> (1 + m) e^(i theta) w (1 + (d_r + i d_i) |w|^2), d_r = m_2, with a real multiplier ``third`` + t.

    Parameters (m, theta, d_r, t, k): Neimark-Sacker at m = 0 for every theta, with d = d_r + 0.7 i; the third
    direction is u -> (third + t) u + k |w|^2, which does not feed back.
    """

    def function(s, p):  # type: ignore[no-untyped-def]
        x, y, u = s
        radius = x * x + y * y
        real, imaginary = 1.0 + p[2] * radius, 0.7 * radius
        cosine, sine = np.cos(p[1]), np.sin(p[1])
        a, b = x * real - y * imaginary, x * imaginary + y * real
        growth = 1.0 + p[0]
        return (
            growth * (cosine * a - sine * b),
            growth * (sine * a + cosine * b),
            (third + p[3]) * u + p[4] * radius,
        )

    return explicit_map(3, ("m", "theta", "d_r", "t", "k"), function)


def narrow_tongue(depth: float) -> ExplicitMap:
    """(x, y) -> (2 kappa x - r y, x) with kappa = -1 - depth + e^2: Neimark-Sacker at r = 1 with ends at R2,
    e = -+ sqrt(depth), and between them real multipliers, 2 sqrt(2 depth) apart at e = 0.
    """
    return explicit_map(
        2, ("e", "r"), lambda s, p: (2.0 * (-1.0 - depth + p[0] ** 2) * s[0] - p[1] * s[1], s[0])
    )


def flip_map() -> ExplicitMap:
    """x -> -(1 + m) x + q x^2 + c x^3 with u -> 0.4 u + h x^2: b = c + q^2 (Kuznetsov, eq. 4.11).

    Parameters (m, q, c, h).
    """
    return explicit_map(
        2,
        ("m", "q", "c", "h"),
        lambda s, p: (
            -(1.0 + p[0]) * s[0] + p[1] * s[0] ** 2 + p[2] * s[0] ** 3,
            0.4 * s[1] + p[3] * s[0] ** 2,
        ),
    )


def cusp_map() -> ExplicitMap:
    """x -> x + m + n x - x^3 with u -> 0.2 u + x: folds at m = -+ 2 (n/3)^(3/2), a cusp at m = n = 0."""
    return explicit_map(
        2, ("m", "n"), lambda s, p: (s[0] + p[0] + p[1] * s[0] - s[0] ** 3, 0.2 * s[1] + s[0])
    )


def product_map(kind: str) -> ExplicitMap:
    """A critical direction x beside a linear pair or direction u, mixed by a fixed change of coordinates.

    Parameters (m, n, t): x -> -(1 + m) x + n x^2 + x^3 ("flip") or x -> x + m + n x - x^3 ("fold") or the
    rotation by 1 rad with growth 1 + m ("rotation"); u -> (1 + t) R(2.2) u, so that the second critical event
    lies at t = 0 ("flip_pair", "fold_pair", "rotation_pair"), or u -> t u ("flip_real", "fold_real").
    """
    critical, second = kind.split("_")
    size = (2 if critical == "rotation" else 1) + (2 if second == "pair" else 1)
    mixing = np.eye(size) + 0.3 * np.sin(1.0 + np.arange(size * size)).reshape(size, size)
    inverse = np.linalg.inv(mixing)

    def turned(x, angle, growth):  # type: ignore[no-untyped-def]
        cosine, sine = math.cos(angle), math.sin(angle)
        return [growth * (cosine * x[0] - sine * x[1]), growth * (sine * x[0] + cosine * x[1])]

    def function(s, p):  # type: ignore[no-untyped-def]
        z = inverse @ s
        if critical == "rotation":
            radius = z[0] ** 2 + z[1] ** 2
            new = turned(z[:2] * (1.0 - radius), 1.0, 1.0 + p[0])
        elif critical == "flip":
            new = [-(1.0 + p[0]) * z[0] + p[1] * z[0] ** 2 + z[0] ** 3]
        else:
            new = [z[0] + p[0] + p[1] * z[0] - z[0] ** 3]
        rest = z[len(new) :]
        new += turned(rest, 2.2, 1.0 + p[2]) if second == "pair" else [p[2] * rest[0]]
        return mixing @ np.array(new)

    return explicit_map(size, ("m", "n", "t"), function)
